// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/raw_model.h"

#include <cstring>
#include <type_traits>

#include "core/types/error.h"

namespace fringeslam::sim {

namespace {

// A type, or the same type read-only.
template <class Part, class Type>
concept Either = std::is_same_v<std::remove_const_t<Part>, Type>;

// Plain values in sequence, defined once for both directions.
class Writer {
 public:
  template <class T>
  void value(const T& v) {
    bytes_.append(reinterpret_cast<const char*>(&v), sizeof v);
  }
  template <class T>
  void list(const std::vector<T>& v) {
    value(static_cast<uint64_t>(v.size()));
    bytes_.append(reinterpret_cast<const char*>(v.data()), v.size() * sizeof(T));
  }
  void text(const std::string& t) { list(std::vector<char>(t.begin(), t.end())); }
  template <class T>
  void items(const std::vector<T>& v) {
    value(static_cast<uint64_t>(v.size()));
    for (const T& item : v) exchange(*this, item);
  }
  const std::string& bytes() const { return bytes_; }

 private:
  std::string bytes_;
};

class Reader {
 public:
  explicit Reader(std::string_view bytes) : bytes_(bytes) {}
  template <class T>
  void value(T& v) {
    take(&v, sizeof v);
  }
  template <class T>
  void list(std::vector<T>& v) {
    uint64_t count = 0;
    value(count);
    if (count > (bytes_.size() - at_) / sizeof(T)) throw Error("the mesh reader's output is truncated");
    v.resize(count);
    if (count > 0) take(v.data(), count * sizeof(T));
  }
  void text(std::string& t) {
    std::vector<char> letters;
    list(letters);
    t.assign(letters.begin(), letters.end());
  }
  template <class T>
  void items(std::vector<T>& v) {
    uint64_t left = 0;
    for (value(left); left > 0; --left) exchange(*this, v.emplace_back());
  }
  bool at_end() const { return at_ == bytes_.size(); }

 private:
  void take(void* to, size_t size) {
    if (size > bytes_.size() - at_) throw Error("the mesh reader's output is truncated");
    std::memcpy(to, bytes_.data() + at_, size);
    at_ += size;
  }
  std::string_view bytes_;
  size_t at_ = 0;
};

template <class Pipe, Either<RawMesh> Part>
void exchange(Pipe& pipe, Part& mesh) {
  pipe.text(mesh.name);
  pipe.value(mesh.material);
  pipe.list(mesh.positions);
  pipe.list(mesh.coordinates);
  pipe.list(mesh.indices);
}

template <class Pipe, Either<RawInstance> Part>
void exchange(Pipe& pipe, Part& instance) {
  pipe.text(instance.name);
  pipe.value(instance.mesh);
  pipe.value(instance.transform);
}

template <class Pipe, Either<RawMaterial> Part>
void exchange(Pipe& pipe, Part& material) {
  pipe.text(material.name);
  pipe.text(material.texture);
  pipe.value(material.colour);
}

template <class Pipe, Either<RawTexture> Part>
void exchange(Pipe& pipe, Part& texture) {
  pipe.text(texture.format);
  pipe.value(texture.width);
  pipe.list(texture.bytes);
}

template <class Pipe, Either<RawModel> Part>
void exchange(Pipe& pipe, Part& model) {
  pipe.value(model.unit_m);
  pipe.value(model.y_up);
  pipe.items(model.meshes);
  pipe.items(model.instances);
  pipe.items(model.materials);
  pipe.items(model.textures);
}

}  // namespace

std::string packed(const RawModel& model) {
  Writer out;
  exchange(out, model);
  return out.bytes();
}

RawModel unpacked(std::string_view bytes) {
  Reader in(bytes);
  RawModel model;
  exchange(in, model);
  if (!in.at_end()) throw Error("the mesh reader's output is too long");
  return model;
}

}  // namespace fringeslam::sim

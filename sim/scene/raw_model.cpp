// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/raw_model.h"

#include "core/io/packed_values.h"

namespace fringeslam::sim {

// Not in an unnamed namespace, where argument-dependent lookup would not find them.
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

template <class Pipe, Either<RawFile> Part>
void exchange(Pipe& pipe, Part& file) {
  pipe.text(file.path);
}

template <class Pipe, Either<RawModel> Part>
void exchange(Pipe& pipe, Part& model) {
  pipe.value(model.unit_m);
  pipe.value(model.y_up);
  pipe.items(model.meshes);
  pipe.items(model.instances);
  pipe.items(model.materials);
  pipe.items(model.textures);
  pipe.items(model.files);
}

std::string packed(const RawModel& model) { return packed_values(model); }

RawModel unpacked(std::string_view bytes) { return unpacked_values<RawModel>(bytes); }

}  // namespace fringeslam::sim

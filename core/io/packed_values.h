// SPDX-License-Identifier: Apache-2.0
// Packs values into bytes and unpacks them, for what a child process returns.
//
// A type is described once for both directions by a function template found by argument-dependent lookup,
//   template <class Pipe, Either<Type> Part> void exchange(Pipe& pipe, Part& part);
// which passes each member to value(), list(), text() or items() of the pipe.
#pragma once

#include <cstdint>
#include <cstring>
#include <string>
#include <string_view>
#include <type_traits>
#include <vector>

#include "core/base/append_bytes.h"
#include "core/types/error.h"

namespace fringeslam {

// A type, or the same type read-only.
template <class Part, class Type>
concept Either = std::is_same_v<std::remove_const_t<Part>, Type>;

class ValuePacker {
 public:
  template <class T>
  void value(const T& v) {
    append_bytes(bytes_, v);
  }
  template <class T>
  void list(const std::vector<T>& v) {
    value(static_cast<uint64_t>(v.size()));
    bytes_.append(reinterpret_cast<const char*>(v.data()), v.size() * sizeof(T));
  }
  void text(const std::string& t) {
    value(static_cast<uint64_t>(t.size()));
    bytes_ += t;
  }
  template <class T>
  void items(const std::vector<T>& v) {
    value(static_cast<uint64_t>(v.size()));
    for (const T& item : v) exchange(*this, item);
  }
  std::string& bytes() { return bytes_; }

 private:
  std::string bytes_;
};

// Throws Error if the bytes end early. The values are not checked.
class ValueUnpacker {
 public:
  explicit ValueUnpacker(std::string_view bytes) : bytes_(bytes) {}
  template <class T>
  void value(T& v) {
    static_assert(std::is_trivially_copyable_v<T>);
    take(&v, sizeof v);
  }
  template <class T>
  void list(std::vector<T>& v) {
    v.resize(count_of(sizeof(T)));
    if (!v.empty()) take(v.data(), v.size() * sizeof(T));
  }
  void text(std::string& t) {
    t.resize(count_of(1));
    if (!t.empty()) take(t.data(), t.size());
  }
  template <class T>
  void items(std::vector<T>& v) {
    uint64_t left = 0;
    for (value(left); left > 0; --left) exchange(*this, v.emplace_back());
  }
  bool at_end() const { return at_ == bytes_.size(); }

 private:
  // Reads the number of elements that follow, each of `size` bytes.
  size_t count_of(size_t size) {
    uint64_t count = 0;
    value(count);
    if (count > (bytes_.size() - at_) / size) throw Error("the reader's output is truncated");
    return count;
  }
  void take(void* to, size_t size) {
    if (size > bytes_.size() - at_) throw Error("the reader's output is truncated");
    std::memcpy(to, bytes_.data() + at_, size);
    at_ += size;
  }
  std::string_view bytes_;
  size_t at_ = 0;
};

template <class T>
std::string packed_values(const T& value) {
  ValuePacker out;
  exchange(out, value);
  return std::move(out.bytes());
}

// Throws Error if the bytes are not those of one such value. Only their structure is checked.
template <class T>
T unpacked_values(std::string_view bytes) {
  ValueUnpacker in(bytes);
  T value;
  exchange(in, value);
  if (!in.at_end()) throw Error("the reader's output is too long");
  return value;
}

}  // namespace fringeslam

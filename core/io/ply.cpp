// SPDX-License-Identifier: Apache-2.0
#include "core/io/ply.h"

#include <algorithm>
#include <array>
#include <bit>
#include <charconv>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <map>
#include <memory>
#include <sstream>

#include "core/io/input_file.h"
#include "core/types/error.h"
#include "core/types/options.h"

namespace fringeslam {

namespace fs = std::filesystem;

namespace {

enum class Number { none, int8, uint8, int16, uint16, int32, uint32, float32, float64 };
enum class Format { ascii, little_endian, big_endian };

struct Property {
  std::string name;
  Number type = Number::none;
  Number count = Number::none;  // type of a list's count; none for a scalar
};

struct Element {
  std::string name;
  uint64_t count = 0;
  std::vector<Property> properties;
};

struct Header {
  Format format = Format::ascii;
  std::vector<Element> elements;
  size_t body = 0;    // byte offset of the body
  int body_line = 0;  // line number where the body begins
};

Number number_type(const std::string& name) {
  static const std::map<std::string, Number> types = {
      {"char", Number::int8},      {"int8", Number::int8},       {"uchar", Number::uint8},
      {"uint8", Number::uint8},    {"short", Number::int16},     {"int16", Number::int16},
      {"ushort", Number::uint16},  {"uint16", Number::uint16},   {"int", Number::int32},
      {"int32", Number::int32},    {"uint", Number::uint32},     {"uint32", Number::uint32},
      {"float", Number::float32},  {"float32", Number::float32}, {"double", Number::float64},
      {"float64", Number::float64}};
  const auto found = types.find(name);
  return found == types.end() ? Number::none : found->second;
}

class HeaderReader {
 public:
  HeaderReader(const fs::path& file, const std::string& bytes) : file_(file), bytes_(bytes) {}

  Header read() {
    if (next() != "ply") throw error("is not a PLY file");
    bool has_format = false;
    for (std::string line = next(); line != "end_header"; line = next()) {
      std::istringstream words(line);
      std::string key;
      words >> key;
      if (key == "format") {
        read_format(words);
        has_format = true;
      } else if (key == "element") {
        read_element(words);
      } else if (key == "property") {
        read_property(words);
      } else if (!key.empty() && key != "comment" && key != "obj_info") {
        throw error("unknown keyword '" + key + "' in the header");
      }
    }
    if (!has_format) throw error("the header has no format line");
    header_.body = at_;
    header_.body_line = line_ + 1;
    return std::move(header_);
  }

 private:
  Error error(const std::string& what) const {
    return Error(file_.string() + ":" + std::to_string(line_) + ": " + what);
  }

  std::string next() {
    const size_t end = bytes_.find('\n', at_);
    if (end == std::string::npos) throw error("the header has no end_header");
    std::string line = bytes_.substr(at_, end - at_);
    if (line.ends_with('\r')) line.pop_back();
    at_ = end + 1;
    ++line_;
    return line;
  }

  void read_format(std::istringstream& words) {
    std::string name, version;
    words >> name >> version;
    if (version != "1.0") throw error("unknown version '" + version + "' of the format; only 1.0 is supported");
    if (name == "ascii")
      header_.format = Format::ascii;
    else if (name == "binary_little_endian")
      header_.format = Format::little_endian;
    else if (name == "binary_big_endian")
      header_.format = Format::big_endian;
    else
      throw error("unknown format '" + name + "'");
  }

  void read_element(std::istringstream& words) {
    Element element;
    std::string count;
    words >> element.name >> count;
    const auto [stop, failed] = std::from_chars(count.data(), count.data() + count.size(), element.count);
    if (failed != std::errc() || stop != count.data() + count.size() || element.count > INT32_MAX)
      throw error("'" + count + "' is not a valid element count");
    header_.elements.push_back(element);
  }

  void read_property(std::istringstream& words) {
    if (header_.elements.empty()) throw error("property before any element");
    Property property;
    std::string type;
    words >> type;
    const auto known = [&](const std::string& name) {
      const Number number = number_type(name);
      if (number == Number::none) throw error("unknown type '" + name + "' of a property");
      return number;
    };
    if (type == "list") {
      std::string count;
      words >> count >> type;
      property.count = known(count);
    }
    property.type = known(type);
    if (!(words >> property.name)) throw error("property without a name");
    header_.elements.back().properties.push_back(property);
  }

  const fs::path& file_;
  const std::string& bytes_;
  Header header_;
  size_t at_ = 0;
  int line_ = 0;
};

// Reads the numbers of the body one after another.
class Body {
 public:
  virtual ~Body() = default;
  virtual double next(Number type) = 0;
  // Throws SurplusValues if the line of an element goes on after its last value.
  virtual void end_element() {}
  // True if values follow those of the last element.
  virtual bool goes_on() const = 0;
  // Smallest number of bytes that a value of the type occupies.
  virtual size_t least_bytes(Number type) const = 0;
  virtual size_t left() const = 0;
  virtual Error error(const Element& element, uint64_t index, const std::string& what) const = 0;
};

class TruncatedFile : public std::exception {};
class InvalidNumber : public std::exception {};
class SurplusValues : public std::exception {};

class AsciiBody : public Body {
 public:
  AsciiBody(const fs::path& file, const std::string& bytes, const Header& header)
      : file_(file), bytes_(bytes), at_(header.body), line_(header.body_line) {}
  double next(Number) override {
    while (at_ < bytes_.size() && is_blank(bytes_[at_])) line_ += bytes_[at_++] == '\n';
    if (at_ == bytes_.size()) throw TruncatedFile();
    size_t end = at_;
    while (end < bytes_.size() && !is_blank(bytes_[end])) ++end;
    const char* first = bytes_.data() + at_ + (bytes_[at_] == '+' ? 1 : 0);
    double value = 0;
    const auto [stop, failed] = std::from_chars(first, bytes_.data() + end, value);
    if (failed == std::errc::invalid_argument || stop != bytes_.data() + end) throw InvalidNumber();
    // Leaves `value` alone, whether the number is too large or too small.
    if (failed == std::errc::result_out_of_range) value = std::strtod(std::string(first, stop).c_str(), nullptr);
    at_ = end;
    return value;
  }
  void end_element() override {
    const size_t next = bytes_.find_first_not_of(" \t\r", at_);
    if (next != std::string::npos && bytes_[next] != '\n') throw SurplusValues();
  }
  bool goes_on() const override { return bytes_.find_first_not_of(" \t\r\n", at_) != std::string::npos; }
  size_t least_bytes(Number) const override { return 1; }
  size_t left() const override { return bytes_.size() - at_; }
  Error error(const Element& element, uint64_t, const std::string& what) const override {
    return Error(file_.string() + ":" + std::to_string(line_) + ": " + what + " in element '" + element.name + "'");
  }

 private:
  static bool is_blank(char c) { return c == ' ' || c == '\t' || c == '\r' || c == '\n'; }
  const fs::path& file_;
  const std::string& bytes_;
  size_t at_;
  int line_;
};

class BinaryBody : public Body {
 public:
  BinaryBody(const fs::path& file, const std::string& bytes, const Header& header)
      : file_(file),
        bytes_(bytes),
        at_(header.body),
        swap_((header.format == Format::little_endian) != (std::endian::native == std::endian::little)) {}
  double next(Number type) override {
    switch (type) {
      case Number::int8:
        return take<int8_t>();
      case Number::uint8:
        return take<uint8_t>();
      case Number::int16:
        return take<int16_t>();
      case Number::uint16:
        return take<uint16_t>();
      case Number::int32:
        return take<int32_t>();
      case Number::uint32:
        return take<uint32_t>();
      case Number::float32:
        return static_cast<double>(take<float>());
      default:
        return take<double>();
    }
  }
  bool goes_on() const override { return left() > 0; }
  size_t least_bytes(Number type) const override {
    switch (type) {
      case Number::int8:
      case Number::uint8:
        return 1;
      case Number::int16:
      case Number::uint16:
        return 2;
      case Number::float64:
        return 8;
      default:
        return 4;
    }
  }
  size_t left() const override { return bytes_.size() - at_; }
  Error error(const Element& element, uint64_t index, const std::string& what) const override {
    return Error(file_.string() + ": " + what + " in element '" + element.name + "', number " + std::to_string(index) +
                 " of " + std::to_string(element.count));
  }

 private:
  template <class Value>
  Value take() {
    if (left() < sizeof(Value)) throw TruncatedFile();
    char raw[sizeof(Value)];
    std::memcpy(raw, bytes_.data() + at_, sizeof raw);
    if (swap_) std::reverse(raw, raw + sizeof raw);
    at_ += sizeof raw;
    Value value;
    std::memcpy(&value, raw, sizeof raw);
    return value;
  }
  const fs::path& file_;
  const std::string& bytes_;
  size_t at_;
  bool swap_;
};

constexpr std::array<const char*, 10> kVertexFields = {"x",  "y",   "z",     "nx",   "ny",
                                                       "nz", "red", "green", "blue", "sigma"};

// Text may give any number for a byte.
uint8_t to_byte(double value) { return value > 0 ? static_cast<uint8_t>(std::min(value, 255.0)) : uint8_t{0}; }

// Which of kVertexFields the properties of a vertex are.
struct VertexFields {
  std::vector<int> of_property;  // -1: none of them
  bool normal = false, colour = false, sigma = false;

  explicit VertexFields(const Element& element) {
    std::array<Number, kVertexFields.size()> type{};
    for (const Property& property : element.properties) {
      const auto field = std::find(kVertexFields.begin(), kVertexFields.end(), property.name);
      const bool known = field != kVertexFields.end() && property.count == Number::none;
      of_property.push_back(known ? static_cast<int>(field - kVertexFields.begin()) : -1);
      if (known) type[static_cast<size_t>(of_property.back())] = property.type;
    }
    const auto declared = [](Number number) { return number != Number::none; };
    normal = std::all_of(type.begin() + 3, type.begin() + 6, declared);
    colour = std::all_of(type.begin() + 6, type.begin() + 9, [](Number number) { return number == Number::uint8; });
    sigma = declared(type[9]);
  }
};

class BodyReader {
 public:
  BodyReader(const fs::path& file, const Header& header, Body& body) : file_(file), header_(header), body_(body) {}

  PlyMap read() {
    for (const Element& element : header_.elements) {
      check_length(element);
      if (element.properties.empty()) continue;  // they occupy no bytes, whatever their count
      read_element(element);
    }
    if (body_.goes_on())
      throw Error(file_.string() +
                  ": values follow the last element; the counts in its header are too small: export it again");
    return finished();
  }

 private:
  // Rejects a count that the rest of the file cannot hold before it exhausts the memory.
  void check_length(const Element& element) const {
    uint64_t least = 0;
    for (const Property& p : element.properties) least += body_.least_bytes(p.count == Number::none ? p.type : p.count);
    if (element.count * least > body_.left())
      throw Error(file_.string() + ": the file is truncated: too short for " + std::to_string(element.count) +
                  " elements '" + element.name + "'");
    if (element.name != "vertex") return;
    for (const char* name : {"x", "y", "z"}) {
      if (std::none_of(element.properties.begin(), element.properties.end(),
                       [&](const Property& p) { return p.name == name && p.count == Number::none; }))
        throw Error(file_.string() + ": the vertices have no '" + name + "'");
    }
  }

  void read_element(const Element& element) {
    const bool is_vertex = element.name == "vertex", is_face = element.name == "face";
    const VertexFields fields(element);
    uint64_t index = 0;
    try {
      for (; index < element.count; ++index) {
        if (is_vertex)
          read_vertex(element, fields);
        else
          read_other(element, index, is_face);
        body_.end_element();
      }
    } catch (const TruncatedFile&) {
      throw body_.error(element, index, "the file is truncated");
    } catch (const InvalidNumber&) {
      throw body_.error(element, index, "invalid number");
    } catch (const SurplusValues&) {
      throw body_.error(element, index, "more values than properties");
    }
  }

  void read_vertex(const Element& element, const VertexFields& fields) {
    std::array<double, kVertexFields.size()> v{};
    for (size_t i = 0; i < element.properties.size(); ++i) {
      const Property& property = element.properties[i];
      if (property.count != Number::none)
        read_list(property);
      else if (const double value = body_.next(property.type); fields.of_property[i] >= 0)
        v[static_cast<size_t>(fields.of_property[i])] = value;
    }
    map_.vertices.emplace_back(v[0], v[1], v[2]);
    if (fields.normal) map_.normals.push_back(Eigen::Vector3d(v[3], v[4], v[5]).cast<float>());
    if (fields.colour) map_.colours.push_back({to_byte(v[6]), to_byte(v[7]), to_byte(v[8])});
    if (fields.sigma) map_.sigma_m.push_back(static_cast<float>(v[9]));
  }

  void read_other(const Element& element, uint64_t index, bool is_face) {
    for (const Property& property : element.properties) {
      if (property.count == Number::none) {
        body_.next(property.type);
        continue;
      }
      read_list(property);
      if (is_face && (property.name == "vertex_indices" || property.name == "vertex_index")) add_face(element, index);
    }
  }

  void read_list(const Property& property) {
    list_.clear();
    const double count = body_.next(property.count);
    if (!(count >= 0) || count != std::floor(count)) throw InvalidNumber();
    if (count * static_cast<double>(body_.least_bytes(property.type)) > static_cast<double>(body_.left()))
      throw TruncatedFile();
    for (double i = 0; i < count; ++i) list_.push_back(body_.next(property.type));
  }

  void add_face(const Element& element, uint64_t index) {
    for (const double corner : list_) {
      if (!(corner >= 0) || corner >= static_cast<double>(map_.vertices.size()) || corner != std::floor(corner))
        throw body_.error(
            element, index,
            "there are " + std::to_string(map_.vertices.size()) + " vertices, but a face refers to " + to_text(corner));
    }
    for (size_t i = 2; i < list_.size(); ++i)
      map_.triangles.emplace_back(static_cast<int>(list_[0]), static_cast<int>(list_[i - 1]),
                                  static_cast<int>(list_[i]));
  }

  // Removes non-finite vertices and their faces; organised clouds mark missing measurements by NaN.
  PlyMap finished() {
    // Several vertex elements may differ in their properties.
    const size_t count = map_.vertices.size();
    if (map_.normals.size() != count) map_.normals.clear();
    if (map_.colours.size() != count) map_.colours.clear();
    if (map_.sigma_m.size() != count) map_.sigma_m.clear();
    std::vector<int> kept(map_.vertices.size(), -1);
    PlyMap result;
    for (size_t i = 0; i < map_.vertices.size(); ++i) {
      if (!map_.vertices[i].allFinite()) continue;
      kept[i] = static_cast<int>(result.vertices.size());
      result.vertices.push_back(map_.vertices[i]);
      if (!map_.normals.empty()) result.normals.push_back(map_.normals[i]);
      if (!map_.colours.empty()) result.colours.push_back(map_.colours[i]);
      if (!map_.sigma_m.empty()) result.sigma_m.push_back(map_.sigma_m[i]);
    }
    result.dropped = map_.vertices.size() - result.vertices.size();
    for (const Eigen::Vector3i& triangle : map_.triangles) {
      const Eigen::Vector3i corners = triangle.unaryExpr([&](int i) { return kept[static_cast<size_t>(i)]; });
      if (corners.minCoeff() >= 0) result.triangles.push_back(corners);
    }
    return result;
  }

  const fs::path& file_;
  const Header& header_;
  Body& body_;
  PlyMap map_;
  std::vector<double> list_;
};

}  // namespace

bool is_ply(const fs::path& file) {
  std::error_code ignored;
  if (!fs::is_regular_file(file, ignored)) return false;
  const std::string start = InputFile(file, kMostDataBytes).head(5);
  return start.starts_with("ply\n") || start.starts_with("ply\r\n");
}

PlyMap read_ply(const fs::path& file) {
  const std::string bytes = read_input(file, kMostDataBytes);
  const Header header = HeaderReader(file, bytes).read();
  std::unique_ptr<Body> body;
  if (header.format == Format::ascii)
    body = std::make_unique<AsciiBody>(file, bytes, header);
  else
    body = std::make_unique<BinaryBody>(file, bytes, header);
  return BodyReader(file, header, *body).read();
}

std::string ply_header(const PlyLayout& layout) {
  std::string text = "ply\nformat binary_little_endian 1.0\ncomment " + layout.frame +
                     " frame, metres\nelement vertex " + std::to_string(layout.vertices) +
                     "\nproperty float x\nproperty float y\nproperty float z\n";
  if (layout.normals) text += "property float nx\nproperty float ny\nproperty float nz\n";
  text += "property uchar red\nproperty uchar green\nproperty uchar blue\n";
  if (layout.sigmas) text += "property float sigma\n";
  if (layout.triangles)
    text += "element face " + std::to_string(*layout.triangles) + "\nproperty list uchar int vertex_indices\n";
  return text + "end_header\n";
}

}  // namespace fringeslam

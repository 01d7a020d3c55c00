// SPDX-License-Identifier: Apache-2.0
// Decoding of the files in the samples of a dataset (python/fringeslam/datasets.py).
#include "core/io/files.h"
#include "core/io/image_library.h"
#include "core/io/yaml.h"
#include "core/rig/rig_file.h"
#include "python/src/bindings.h"
#include "python/src/casters.h"

namespace fringeslam::python {

void bind_datasets(py::module_& m) {
  use_no_image_threads();  // data loaders fork
  m.def(
      "decode_image",
      [](const py::bytes& bytes, const std::string& name) {
        const std::string content(bytes);
        DecodedImage decoded;
        {
          const py::gil_scoped_release release;
          decoded = decode_image(content, name);
        }
        return std::pair(decoded.image, decoded.channels);
      },
      py::arg("bytes"), py::arg("name") = "image",
      "Decodes a PNG or EXR file in memory. Returns an array (H, W), or (H, W, channels), of uint8, uint16 or float32, "
      "and the names of the channels. Raises Error with `name` if the file is damaged.");
  m.def(
      "parse_rig",
      [](const std::string& text, const std::string& name) {
        const YamlMap map = YamlMap::parse(text, name);
        const RigModel rig = read_rig(map);
        map.finish();
        return rig;
      },
      py::arg("text"), py::arg("name") = "rig.yaml", "Reads the content of a rig file. Raises Error with name:line.");
  m.def(
      "parse_patterns",
      [](const std::string& text, const std::string& name) { return read_patterns(YamlMap::parse(text, name)); },
      py::arg("text"), py::arg("name") = "patterns.yaml",
      "Reads the content of patterns.yaml. Raises Error with name:line.");
}

}  // namespace fringeslam::python

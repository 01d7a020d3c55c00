// SPDX-License-Identifier: Apache-2.0
#include "bench/datasets/describe.h"

#include <algorithm>
#include <nlohmann/json.hpp>
#include <numeric>

#include "bench/studies/sampling.h"

namespace fringeslam::datasets {

using Json = nlohmann::ordered_json;

namespace {

// Files of a part, as patterns, and their content.
struct PartText {
  Part part;
  const char *files, *media_type, *text;
};
constexpr PartText kPartTexts[] = {
    {Part::images, "image.*", "image/png",
     "fringe images in the order of `patterns.yaml`: gray values of the camera, 8 or 16 bits (`.exr` if not "
     "quantized)"},
    {Part::thermal, "thermal.*", "image/png",
     "thermal image in the thermal camera's own pixels, hundredths of a kelvin, 16 bits (`.exr` in °C if not "
     "quantized); "
     "only of rigs with a thermal camera"},
    {Part::depth, "depth.exr", "image/x-exr", "`depth_m`: true depth, z of the camera frame, m"},
    {Part::normals, "normals.exr", "image/x-exr",
     "`normal.x`, `.y`, `.z`: true unit normal in the camera frame, facing the camera"},
    {Part::coordinate, "coordinate.exr", "image/x-exr",
     "`projector_column`, `projector_row`: true projector coordinate, px, integer at pixel centers"},
    {Part::phase, "phase.exr", "image/x-exr",
     "`phase.columns.P`, `phase.rows.P`: true absolute phase of the finest period P, rad"},
    {Part::order, "order.*", "image/png",
     "`order.columns.P.png`, `order.rows.P.png`: true fringe order of each period P, from 0, 16 bits; 65535: none"},
    {Part::sigma, "sigma.exr", "image/x-exr",
     "`column_sigma_px`, `row_sigma_px`, `depth_sigma_m`: standard deviation of coordinate and depth due to the "
     "camera's "
     "noise, propagated from the gray values with the sensor model of `rig.yaml`"},
    {Part::objects, "objects.*", "image/png",
     "number of the object from 1 in scene order, 16 bits; 0: none (`.exr` with more than 65534 objects)"},
    {Part::mask, "mask.png", "image/png",
     "bits: 1 surface, 2 in the projector's field, 4 shadowed from the projector, 8 edge within the pixel, 16 victim, "
     "32 "
     "seen by the thermal camera"},
    {Part::temperature, "temperature.exr", "image/x-exr",
     "`temperature_c`: true temperature of the surface, °C; only of rigs with a thermal camera"}};

std::string joined(const std::vector<std::string>& words) {
  std::string text;
  for (const std::string& word : words) text += (text.empty() ? "" : ", ") + word;
  return text;
}

std::string law_text(const studies::Parameter& parameter) {
  using Law = studies::Parameter::Law;
  const std::string law = to_string(parameter.law);
  if (parameter.law == Law::choice || parameter.law == Law::grid) return law + " of " + joined(parameter.values);
  const std::string whole = parameter.whole ? ", rounded" : "";
  return law + " [" + to_text(parameter.a) + ", " + to_text(parameter.b) + "]" + whole;
}

std::string size_text(uint64_t bytes) {
  const double mib = static_cast<double>(bytes) / (1 << 20);
  return to_text(std::round(10 * mib) / 10) + " MiB";
}

std::string or_not_stated(const Spec& spec, std::string Publication::*field) {
  return spec.publication ? (*spec.publication).*field : std::string("not stated");
}

std::string composition(const Spec& spec, const Contents& contents) {
  const uint64_t bytes = std::accumulate(contents.tars.begin(), contents.tars.end(), uint64_t{0},
                                         [](uint64_t sum, const FileEntry& tar) { return sum + tar.bytes; });
  std::string text =
      "Each sample is one view of a simulated scene by a structured-light rig: the images taken under a sequence of "
      "projected patterns, the calibration, and exact ground truth for each camera pixel.\n\n"
      "| split | worlds | samples |\n|---|---|---|\n";
  for (size_t split = 0; split < kSplits.size(); ++split) {
    if (contents.samples[split] > 0)
      text += std::string("| ") + kSplits[split] + " | " + std::to_string(contents.worlds[split]) + " | " +
              std::to_string(contents.samples[split]) + " |\n";
  }
  text +=
      "\nA world is an arrangement of objects, drawn from one random seed. All views of a world belong to the same "
      "split, so no surface of the training set occurs in validation or test. " +
      std::to_string(contents.tars.size()) + " tar files with " + size_text(bytes) + " in total.\n\n";
  if (contents.refused > 0)
    text += std::to_string(contents.refused) + " of " + std::to_string(spec.trials()) +
            " trials have no samples, because the simulator refused their drawn values; `refused.csv` lists them with "
            "the reason.\n\n";
  text +=
      "Files of a sample, `NNNNNNNNN.EXTENSION`. NaN marks pixels without data.\n\n| extension | content |\n|---|---|\n"
      "| `json` | poses `world_from_camera` and `world_from_robot` (4 x 4, m), times, seed, drawn values |\n"
      "| `rig.yaml` | calibration of camera and projector, and the camera's noise |\n"
      "| `patterns.yaml` | the pattern of each image |\n";
  for (const PartText& part : kPartTexts) {
    if (spec.writes(part.part)) text += std::string("| `") + part.files + "` | " + part.text + " |\n";
  }
  return text;
}

std::string collection(const Spec& spec, const Contents& contents) {
  std::string text = "Rendered by fringeslam " + contents.program_version + " from `dataset.yaml`, seed " +
                     std::to_string(spec.seed) +
                     ". The same version, specification, scenes and rigs give the same bytes.\n\n- Scenes: " +
                     joined(contents.scenes) + "\n- Rigs: " + joined(contents.rigs) + "\n";
  for (const std::string& patterns : spec.patterns) text += "- Patterns: `" + patterns + "`\n";
  text += "- Views of a world with the same drawn values: " + std::to_string(spec.views) + "\n";
  if (!spec.parameters.empty()) {
    text += "\n| drawn for each trial | law |\n|---|---|\n";
    for (const studies::Parameter& parameter : spec.parameters)
      text += "| `" + parameter.name + "` | " + law_text(parameter) + " |\n";
  }
  if (!spec.fixed.empty()) {
    text += "\n| fixed | value |\n|---|---|\n";
    for (const studies::Fixed& fixed : spec.fixed) text += "| `" + fixed.name + "` | " + fixed.value + " |\n";
  }
  return text;
}

}  // namespace

std::string datasheet(const Spec& spec, const Contents& contents) {
  std::string text = "# " + spec.name + "\n\n";
  if (!spec.description.empty()) text += spec.description + "\n\n";
  text +=
      "Datasheet, generated from `dataset.yaml`.\n\n## Motivation\n\nTraining and evaluation of methods for fringe "
      "projection: phase unwrapping, decoding, depth, uncertainty, registration. Creator: " +
      or_not_stated(spec, &Publication::creator) + ".\n\n## Composition\n\n" + composition(spec, contents) +
      "\n## Collection\n\n" + collection(spec, contents) +
      "\n## Preprocessing\n\nNone: images are gray values of the camera, ground truth is that of the ray through "
      "each pixel's center.\n\n## Uses and limits\n\nThe images are simulated. The simulator models the rig's lenses, "
      "defocus, noise and quantization, ambient light, interreflection, gloss, dust and haze where scenes and "
      "settings enable them. Test on real captures before relying on results. Compare methods on the test split "
      "only once they are fixed.\n\n## Distribution\n\n- License: " +
      or_not_stated(spec, &Publication::license) + "\n- URL: " + or_not_stated(spec, &Publication::url) +
      "\n- Date: " + or_not_stated(spec, &Publication::date) +
      "\n\n`index.csv` lists for each sample its tar file, offset, size and checksum; `sha256sum -c SHA256SUMS` "
      "checks all files; `croissant.json` is the metadata for catalogs. Python:\n\n```python\nimport fringeslam as "
      "fs\n\nfor sample in fs.SampleDataset(\"FOLDER\", split=\"train\"):\n    print(sample[\"images\"].shape, "
      "sample[\"depth\"].shape)\n```\n\n## Maintenance\n\nVersion " +
      (spec.publication ? spec.publication->version : std::string("not stated")) +
      ". To extend or correct the dataset, change `dataset.yaml` and render it again under a new version.\n";
  return text;
}

namespace {

// Recommended by the specification, appendix 1.
Json context() {
  const auto cr = [](const char* term) { return std::string("cr:") + term; };
  Json terms = {{"@language", "en"},
                {"@vocab", "https://schema.org/"},
                {"cr", "http://mlcommons.org/croissant/"},
                {"dct", "http://purl.org/dc/terms/"},
                {"rai", "http://mlcommons.org/croissant/RAI/"},
                {"sc", "https://schema.org/"},
                {"conformsTo", "dct:conformsTo"},
                {"data", {{"@id", "cr:data"}, {"@type", "@json"}}},
                {"dataType", {{"@id", "cr:dataType"}, {"@type", "@vocab"}}},
                {"examples", {{"@id", "cr:examples"}, {"@type", "@json"}}}};
  for (const char* term :
       {"citeAs",       "column", "equivalentProperty", "extract",    "field",         "fileObject", "fileSet",
        "fileProperty", "format", "includes",           "jsonPath",   "isLiveDataset", "key",        "md5",
        "parentField",  "path",   "recordSet",          "references", "regex",         "repeated",   "replace",
        "separator",    "source", "subField",           "transform",  "samplingRate"})
    terms[term] = cr(term);
  return terms;
}

Json file_object(const FileEntry& file, const char* media_type) {
  return {{"@type", "cr:FileObject"},
          {"@id", file.name},
          {"name", file.name},
          {"contentUrl", file.name},
          {"contentSize", std::to_string(file.bytes) + " B"},
          {"encodingFormat", media_type},
          {"sha256", file.sha256}};
}

Json index_field(const std::string& column, const std::string& type, const std::string& text) {
  return {
      {"@type", "cr:Field"}, {"@id", "samples/" + column},
      {"name", column},      {"description", text},
      {"dataType", type},    {"source", {{"fileObject", {{"@id", "index.csv"}}}, {"extract", {{"column", column}}}}}};
}

Json index_fields(const Spec& spec) {
  Json fields = {index_field("sample", "sc:Text", "name of the sample's files"),
                 index_field("split", "sc:Text", "train, validation or test"),
                 index_field("world", "sc:Integer", "number of the world; a world belongs to one split"),
                 index_field("trial", "sc:Integer", "number of the trial, for which values are drawn"),
                 index_field("view", "sc:Integer", "number of the view in its trial"),
                 index_field("scene", "sc:Text", "name of the scene"),
                 index_field("seed", "sc:Integer", "seed of the world"),
                 index_field("rig", "sc:Text", "name of the rig"),
                 index_field("tar", "sc:Text", "tar file of the sample"),
                 index_field("offset", "sc:Integer", "of the sample's first member in the tar file, bytes"),
                 index_field("bytes", "sc:Integer", "of all members of the sample"),
                 index_field("sha256", "sc:Text", "checksum of these bytes")};
  for (Json& field : fields) {
    if (field["name"] != "split") continue;
    field["references"] = {{"@id", "splits/name"}};
  }
  for (const studies::Parameter& parameter : spec.parameters)
    fields.push_back(index_field(
        parameter.name, parameter.numeric() && parameter.law != studies::Parameter::Law::grid ? "sc:Float" : "sc:Text",
        "drawn value: " + law_text(parameter)));
  return fields;
}

Json splits(const Contents& contents) {
  const char* kMeaning[] = {"cr:TrainingSplit", "cr:ValidationSplit", "cr:TestSplit"};
  Json rows = Json::array();
  for (size_t split = 0; split < kSplits.size(); ++split) {
    if (contents.samples[split] > 0) rows.push_back({{"splits/name", kSplits[split]}, {"splits/url", kMeaning[split]}});
  }
  const auto field = [](const char* name, const char* type) {
    return Json{{"@type", "cr:Field"}, {"@id", std::string("splits/") + name}, {"name", name}, {"dataType", type}};
  };
  return {{"@type", "cr:RecordSet"},
          {"@id", "splits"},
          {"name", "splits"},
          {"dataType", "cr:Split"},
          {"key", {{"@id", "splits/name"}}},
          {"field", {field("name", "sc:Text"), field("url", "cr:Split")}},
          {"data", rows}};
}

}  // namespace

Json croissant(const Spec& spec, const Contents& contents) {
  Json json = {
      {"@context", context()},
      {"@type", "sc:Dataset"},
      {"conformsTo", "http://mlcommons.org/croissant/1.0"},
      {"name", spec.name},
      {"description", spec.description.empty() ? "Simulated fringe projection with exact ground truth: " + spec.name
                                               : spec.description}};
  if (spec.publication) {
    const Publication& about = *spec.publication;
    json["license"] = about.license;
    json["url"] = about.url;
    json["creator"] = {{"@type", "sc:Organization"}, {"name", about.creator}};
    json["datePublished"] = about.date;
    json["version"] = about.version;
    if (!about.citation.empty()) json["citeAs"] = about.citation;
  }
  json["keywords"] = {"fringe projection", "structured light", "depth", "phase unwrapping", "synthetic"};
  Json distribution = {file_object(contents.index, "text/csv")};
  Json archives = Json::array();
  for (const FileEntry& tar : contents.tars) {
    distribution.push_back(file_object(tar, "application/x-tar"));
    archives.push_back({{"@id", tar.name}});
  }
  for (const PartText& part : kPartTexts) {
    if (spec.writes(part.part))
      distribution.push_back({{"@type", "cr:FileSet"},
                              {"@id", std::string(to_string(part.part)) + "-files"},
                              {"name", std::string(to_string(part.part)) + "-files"},
                              {"description", part.text},
                              {"containedIn", archives},
                              {"encodingFormat", part.media_type},
                              {"includes", std::string("*.") + part.files}});
  }
  json["distribution"] = distribution;
  json["recordSet"] = {splits(contents),
                       {{"@type", "cr:RecordSet"},
                        {"@id", "samples"},
                        {"name", "samples"},
                        {"description", "One record per sample; its files are members of the tar file named here."},
                        {"key", {{"@id", "samples/sample"}}},
                        {"field", index_fields(spec)}}};
  return json;
}

}  // namespace fringeslam::datasets

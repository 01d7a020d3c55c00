// SPDX-License-Identifier: Apache-2.0
#include "core/io/yaml_guard.h"

#include <yaml-cpp/eventhandler.h>
#include <yaml-cpp/yaml.h>

#include <sstream>
#include <vector>

#include "core/types/error.h"

namespace fringeslam {

namespace {

constexpr size_t kMostNodes = 1000000;
constexpr size_t kMostKeys = 1000;  // per map; keys are searched linearly

// Refuses flow collections, [...] and {...}, that no file within the limits has. The parser reads a collection to its end before it
// reports its beginning, in memory of some 200 times its size. Brackets and commas in texts and comments count, too, but the limits are
// far above their number.
void check_flow_collections(const std::string& text, const std::string& name) {
  constexpr size_t kMostOpen = 10000;
  size_t open = 0, commas = 0, line = 1;
  const auto refuse = [&](const std::string& message) {
    throw Error(name + ":" + std::to_string(line) + ": " + message);
  };
  for (const char c : text) {
    line += c == '\n';
    if (c == '[' || c == '{') ++open;
    if ((c == ']' || c == '}') && open > 0) --open;
    if (open == 0) commas = 0;
    if (c == ',') ++commas;
    if (open > kMostOpen) refuse("more than " + std::to_string(kMostOpen) + " brackets are open; close or quote them");
    if (commas > kMostNodes) refuse("more than " + std::to_string(kMostNodes) + " values between two brackets");
  }
}

class Guard : public YAML::EventHandler {
 public:
  explicit Guard(const std::string& name) : name_(name) {}

  void OnDocumentStart(const YAML::Mark& mark) override {
    if (documents_++ > 0) refuse(mark, "a second document starts here; use one document per file");
  }
  void OnDocumentEnd() override {}
  void OnNull(const YAML::Mark& mark, YAML::anchor_t anchor) override { add(mark, anchor); }
  void OnScalar(const YAML::Mark& mark, const std::string&, YAML::anchor_t anchor, const std::string&) override {
    add(mark, anchor);
  }
  void OnAlias(const YAML::Mark& mark, YAML::anchor_t anchor) override { add(mark, anchor); }
  void OnSequenceStart(const YAML::Mark& mark, const std::string&, YAML::anchor_t anchor,
                       YAML::EmitterStyle::value) override {
    open(mark, anchor, false);
  }
  void OnSequenceEnd() override { open_.pop_back(); }
  void OnMapStart(const YAML::Mark& mark, const std::string&, YAML::anchor_t anchor,
                  YAML::EmitterStyle::value) override {
    open(mark, anchor, true);
  }
  void OnMapEnd() override { open_.pop_back(); }

 private:
  // An open map or list.
  struct Open {
    bool map = false;
    size_t children = 0;  // for a map: keys and values
  };

  [[noreturn]] void refuse(const YAML::Mark& mark, const std::string& message) const {
    throw Error(name_ + ":" + std::to_string(mark.line + 1) + ": " + message);
  }
  void add(const YAML::Mark& mark, YAML::anchor_t anchor) {
    if (anchor != YAML::NullAnchor)
      refuse(mark, "anchors and aliases (&name, *name) are not supported; write the value out");
    if (++nodes_ > kMostNodes) refuse(mark, "the file contains more than " + std::to_string(kMostNodes) + " values");
    if (open_.empty()) return;
    Open& parent = open_.back();
    if (++parent.children > 2 * kMostKeys && parent.map)
      refuse(mark, "the map has more than " + std::to_string(kMostKeys) + " keys");
  }
  void open(const YAML::Mark& mark, YAML::anchor_t anchor, bool map) {
    add(mark, anchor);
    if (open_.size() == kDeepestYaml)
      refuse(mark, "more than " + std::to_string(kDeepestYaml) + " nested maps and lists");
    open_.push_back({map});
  }

  const std::string& name_;
  std::vector<Open> open_;
  size_t nodes_ = 0, documents_ = 0;
};

}  // namespace

void check_yaml(const std::string& text, const std::string& name) {
  if (text.size() > kMostYamlBytes)
    throw Error(name + ": is larger than " + std::to_string(kMostYamlBytes >> 20) + " MiB, the limit for YAML files");
  check_flow_collections(text, name);
  std::istringstream stream(text);
  YAML::Parser parser(stream);
  Guard guard(name);
  while (parser.HandleNextDocument(guard)) {
  }
}

}  // namespace fringeslam

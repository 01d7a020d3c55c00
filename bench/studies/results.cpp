// SPDX-License-Identifier: Apache-2.0
#include "bench/studies/results.h"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <cstring>
#include <nlohmann/json.hpp>

#include "core/io/files.h"
#include "core/types/error.h"

namespace fringeslam::studies {

namespace fs = std::filesystem;

namespace {

std::string name_of(Shard shard) { return std::to_string(shard.index) + "-of-" + std::to_string(shard.count); }

// True if the line of a trial has what tables, summaries and reports take from it.
bool has_result(const nlohmann::json& line, const Study& study) {
  const auto is_text = [](const nlohmann::json& object, const std::string& key) {
    return object.contains(key) && object[key].is_string();
  };
  const auto is_text_or_absent = [&](const char* key) { return !line.contains(key) || line[key].is_string(); };
  if (!is_text(line, "outcome") || !is_text_or_absent("cause") || !is_text_or_absent("message")) return false;
  const auto is_cell = [](const nlohmann::json& value) {
    return value.is_null() || value.is_number() || value.is_string();
  };
  if (line.contains("metrics") &&
      (!line["metrics"].is_object() || !std::all_of(line["metrics"].begin(), line["metrics"].end(), is_cell)))
    return false;
  if (!std::all_of(kOwnColumns.begin(), kOwnColumns.end(),
                   [&](const char* column) { return !line.contains(column) || is_cell(line[column]); }))
    return false;
  if (!line.contains("values") || !line["values"].is_object()) return false;
  return std::all_of(study.parameters.begin(), study.parameters.end(),
                     [&](const Parameter& parameter) { return is_text(line["values"], parameter.name); });
}

// True if a trial may end otherwise on a machine with other load: it took too long, or died, such as for lack of memory.
bool depends_on_load(const nlohmann::json& line) {
  return line["outcome"] == "timed_out" || line["outcome"] == "crashed";
}

// Adds the lines of a file. Of two results of a trial, one that does not depend on the machine's load counts. An incomplete last
// line, cut off when its writer died, is ignored.
void read_lines(const fs::path& file, const Study& study, std::map<int, std::string>& lines) {
  const std::string text = read_bytes(file);
  int number = 0;
  for (size_t begin = 0, end; (end = text.find('\n', begin)) != std::string::npos; begin = end + 1) {
    const std::string where = file.string() + ":" + std::to_string(++number) + ": ";
    const std::string line = text.substr(begin, end - begin);
    const auto json = nlohmann::json::parse(line, nullptr, false);
    if (!json.is_object() || !json.contains("trial") || !json["trial"].is_number_integer() || !json.contains("study"))
      throw Error(where + "is not a trial's result; move the file away");
    if (json["study"] != hash_text(study))
      throw Error(where + "belongs to another study, or to this one before " + study.file.string() +
                  " or its scene changed; use another --out");
    const auto claimed = json["trial"].get<int64_t>();
    if (claimed < 0 || claimed >= study.trials) throw Error(where + "there is no trial " + std::to_string(claimed));
    if (!has_result(json, study)) throw Error(where + "is a damaged result; remove the line and run the study again");
    const int trial = static_cast<int>(claimed);
    const auto [known, is_new] = lines.emplace(trial, line);
    if (is_new || known->second == line) continue;
    const bool known_is_chance = depends_on_load(nlohmann::json::parse(known->second)),
               is_chance = depends_on_load(json);
    if (known_is_chance && (!is_chance || line < known->second)) known->second = line;
    if (!known_is_chance && !is_chance)
      throw Error(where + "trial " + std::to_string(trial) +
                  " has a different result elsewhere in the folder; the machines compute differently, or run "
                  "different versions");
  }
}

std::vector<fs::path> files_in(const fs::path& folder, const std::string& begin) {
  std::vector<fs::path> files;
  std::error_code none;
  for (const auto& entry : fs::directory_iterator(folder / "shards", none)) {
    const std::string name = entry.path().filename().string();
    if (name.starts_with(begin) && (name.ends_with(".jsonl") || name.ends_with(".partial"))) files.push_back(entry);
  }
  std::sort(files.begin(), files.end());
  return files;
}

}  // namespace

Shard shard_of(const std::string& text) {
  Shard shard;
  const char* end = text.data() + text.size();
  const auto first = std::from_chars(text.data(), end, shard.index);
  if (first.ec == std::errc() && first.ptr != end && *first.ptr == '/') {
    const auto second = std::from_chars(first.ptr + 1, end, shard.count);
    if (second.ec == std::errc() && second.ptr == end && shard.index >= 0 && shard.index < shard.count) return shard;
  }
  throw Error("--shard " + text + ": must have the form 2/8, from 0/8 to 7/8");
}

// Throws Error if the folder has files that a study would replace, and that no study wrote.
void require_own_results(const fs::path& folder) {
  std::error_code unknown;
  if (!files_in(folder, "").empty()) return;
  for (const char* name : {"results.jsonl", "results.csv", "results.sqlite", "summary.json", "report.html"}) {
    if (fs::exists(folder / name, unknown))
      throw Error((folder / name).string() +
                  ": was not written by a study, which would replace it; choose another --out");
  }
}

ShardFile::ShardFile(fs::path folder, const Study& study, Shard shard)
    : folder_(std::move(folder)), study_(study), shard_(shard) {
  require_own_results(folder_);
  fs::create_directories(folder_ / "shards");
  for (const fs::path& file : files_in(folder_, name_of(shard) + ".")) read_lines(file, study, lines_);
  if (missing().empty()) return;
  // Reports need not have the files; more trials would be of another scene.
  for (const auto& [trial, line] : lines_) {
    const auto json = nlohmann::json::parse(line);
    if (json.contains("files") && json["files"] != study.files_hash)
      throw Error((folder_ / "shards").string() + ": trial " + std::to_string(trial) +
                  " was run before a file that the scene uses changed; use another --out");
  }
  char host[256] = "";
  gethostname(host, sizeof host - 1);
  partial_ = folder_ / "shards" / (name_of(shard) + "." + host + "." + std::to_string(getpid()) + ".partial");
  // Open for appending: a process on another machine may have had the same name.
  file_ = open(partial_.c_str(), O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0644);
  if (file_ < 0) throw Error(partial_.string() + ": cannot be written");
  const std::string before = read_bytes(partial_);
  if (!before.empty() && before.back() != '\n' && ftruncate(file_, static_cast<off_t>(before.rfind('\n') + 1)) != 0)
    throw Error(partial_.string() + ": cannot be written");
}

ShardFile::~ShardFile() {
  if (file_ < 0) return;
  close(file_);
  std::error_code ignored;
  if (fs::file_size(partial_, ignored) == 0) fs::remove(partial_, ignored);
}

std::vector<int> ShardFile::missing() const {
  std::vector<int> trials;
  for (int trial = shard_.index; trial < study_.trials; trial += shard_.count) {
    if (!lines_.count(trial)) trials.push_back(trial);
  }
  return trials;
}

void ShardFile::add(int trial, const std::string& line) {
  const std::string bytes = line + "\n";
  // A single write: a process killed during it leaves an incomplete line.
  ssize_t written = 0;
  do {
    written = write(file_, bytes.data(), bytes.size());
  } while (written < 0 && errno == EINTR);
  if (written != static_cast<ssize_t>(bytes.size()))
    throw Error(partial_.string() + ": cannot be written: " +
                (written < 0 ? std::strerror(errno) : "the disk is full") + "; the results before are kept");
  lines_.emplace(trial, line);
}

void ShardFile::finish() {
  const fs::path target = folder_ / "shards" / (name_of(shard_) + ".jsonl");
  std::string text;
  for (const auto& [trial, line] : lines_) text += line + "\n";
  // An existing file lacks the trials of lines that were removed from it.
  if (!fs::exists(target) || read_bytes(target) != text) {
    StagedFile staged(target);
    write_text(staged.path(), text);
    staged.commit();
  }
  for (const fs::path& file : files_in(folder_, name_of(shard_) + ".")) {
    if (file.extension() == ".partial") fs::remove(file);
  }
  if (file_ >= 0) close(file_);
  file_ = -1;
}

std::map<int, std::string> merged_lines(const fs::path& folder, const Study& study) {
  const std::vector<fs::path> files = files_in(folder, "");
  if (files.empty()) throw Error(folder.string() + ": contains no shards; run fringeslam study run first");
  std::map<int, std::string> lines;
  for (const fs::path& file : files) read_lines(file, study, lines);
  return lines;
}

}  // namespace fringeslam::studies

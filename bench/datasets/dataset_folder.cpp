// SPDX-License-Identifier: Apache-2.0
#include "bench/datasets/dataset_folder.h"

#include <fcntl.h>
#include <libdeflate.h>
#include <unistd.h>

#include <algorithm>
#include <charconv>
#include <map>
#include <nlohmann/json.hpp>
#include <set>
#include <sstream>
#include <utility>

#include "bench/datasets/sample_files.h"
#include "bench/datasets/sha256.h"
#include "bench/datasets/tar.h"
#include "bench/datasets/trial_part.h"
#include "core/io/files.h"
#include "core/io/input_file.h"

namespace fringeslam::datasets {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

namespace {

constexpr const char* kAbout = "dataset.json";
constexpr const char* kSpecCopy = "dataset.yaml";
constexpr const char* kIndex = "index.csv";
constexpr const char* kRefused = "refused.csv";
constexpr const char* kDatasheet = "README.md";
constexpr const char* kMetadata = "croissant.json";
constexpr const char* kSums = "SHA256SUMS";

// Writes a file piece by piece and computes its checksum. The content is on the disk when close() returns.
class SummedFile {
 public:
  explicit SummedFile(const fs::path& file)
      : file_(file), descriptor_(open(file.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0644)) {
    if (descriptor_ < 0) throw Error(file.string() + ": cannot be written");
  }
  ~SummedFile() {
    if (descriptor_ >= 0) ::close(descriptor_);
  }
  SummedFile(const SummedFile&) = delete;
  SummedFile& operator=(const SummedFile&) = delete;

  void add(std::string_view bytes) {
    sum_.add(bytes);
    bytes_ += bytes.size();
    while (!bytes.empty()) {
      const ssize_t written = write(descriptor_, bytes.data(), bytes.size());
      if (written <= 0) throw Error(file_.string() + ": cannot be written; is the disk full?");
      bytes.remove_prefix(static_cast<size_t>(written));
    }
  }
  FileEntry close() {
    const bool failed = fdatasync(descriptor_) != 0;
    if (::close(std::exchange(descriptor_, -1)) != 0 || failed)
      throw Error(file_.string() + ": cannot be written; is the disk full?");
    return {file_.filename().string(), sum_.hex(), bytes_};
  }
  uint64_t bytes() const { return bytes_; }

 private:
  fs::path file_;
  int descriptor_;
  Sha256 sum_;
  uint64_t bytes_ = 0;
};

// Copies a sample, which starts at `offset`; returns false if its bytes differ from its checksum.
bool copy_sample(const InputFile& piece, uint64_t offset, const PartSample& sample, SummedFile& tar) {
  std::string buffer(size_t{1} << 20, '\0');
  uint32_t sum = 0;
  for (uint64_t copied = 0; copied < sample.bytes;) {
    const size_t count =
        piece.read_at(offset + copied, buffer.data(), std::min<uint64_t>(sample.bytes - copied, buffer.size()));
    if (count == 0) return false;
    const std::string_view read(buffer.data(), count);
    sum = libdeflate_crc32(sum, read.data(), read.size());
    tar.add(read);
    copied += count;
  }
  return sum == sample.crc32;
}

// Returns a number, or empty if the text is anything else.
std::optional<uint64_t> number_of(const std::string& text) {
  uint64_t number = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), number);
  return error == std::errc() && end == text.data() + text.size() ? std::optional(number) : std::nullopt;
}

std::string csv_field(const std::string& text) {
  if (text.find_first_of(",\"\n") == std::string::npos) return text;
  std::string quoted = "\"";
  for (const char c : text) quoted += c == '"' ? "\"\"" : std::string(1, c);
  return quoted + "\"";
}

std::string csv_line(const std::vector<std::string>& fields) {
  std::string line;
  for (size_t i = 0; i < fields.size(); ++i) line += (i ? "," : "") + csv_field(fields[i]);
  return line + "\n";
}

// Returns the fields of a line that csv_line() wrote.
std::vector<std::string> csv_fields(const std::string& line) {
  std::vector<std::string> fields(1);
  bool quoted = false;
  for (size_t i = 0; i < line.size(); ++i) {
    const char c = line[i];
    if (c == '"' && quoted && i + 1 < line.size() && line[i + 1] == '"')
      fields.back() += line[i++];
    else if (c == '"')
      quoted = !quoted;
    else if (c == ',' && !quoted)
      fields.emplace_back();
    else
      fields.back() += c;
  }
  return fields;
}

// Columns of index.csv, followed by the parameters.
const std::vector<std::string> kColumns = {"sample", "split", "world", "trial",  "view",  "scene",
                                           "seed",   "rig",   "tar",   "offset", "bytes", "sha256"};
enum Column : size_t {
  kSplitColumn = 1,
  kWorldColumn = 2,
  kSceneColumn = 5,
  kRigColumn = 7,
  kTarColumn = 8,
  kOffsetColumn = 9,
  kBytesColumn = 10
};

constexpr const char* kRestore = "restore it from a copy, or write the dataset to another --out";

// Calls take(bytes) for the content of a file, block after block; returns the checksum and size of the file.
template <class Take>
FileEntry for_each_block(const fs::path& file, const Take& take) {
  const InputFile input(file, kMostDataBytes);
  FileEntry entry{file.filename().string(), "", 0};
  Sha256 sum;
  std::string block(kMebibyte, '\0');
  for (size_t count; (count = input.read_at(entry.bytes, block.data(), block.size())) > 0; entry.bytes += count) {
    const std::string_view bytes(block.data(), count);
    sum.add(bytes);
    take(bytes);
  }
  entry.sha256 = sum.hex();
  return entry;
}

// Calls take(line) for each line of a file, without its end; returns the checksum and size of the file.
template <class Take>
FileEntry for_each_line(const fs::path& file, const Take& take) {
  std::string line;
  const FileEntry entry = for_each_block(file, [&](std::string_view bytes) {
    for (size_t begin = 0; begin < bytes.size();) {
      const size_t end = std::min(bytes.find('\n', begin), bytes.size());
      line += bytes.substr(begin, end - begin);
      if (line.size() > kMebibyte) throw Error(file.string() + ": is damaged; " + kRestore);
      if (end < bytes.size()) take(std::exchange(line, {}));
      begin = end + 1;
    }
  });
  if (!line.empty()) take(line);
  return entry;
}

std::string checksum(const fs::path& file) {
  return for_each_block(file, [](std::string_view) {}).sha256;
}

Json about_of(const Spec& spec, const std::string& identity, const std::string& version, const std::vector<Tar>& tars) {
  Json about = {{"format", kFormat},
                {"name", spec.name},
                {"identity", sha256_hex(identity)},
                {"program", "fringeslam " + version},
                {"samples", spec.samples},
                {"views", spec.views},
                {"worlds", spec.worlds}};
  Json splits = Json::object();
  for (size_t split = 0; split < kSplits.size(); ++split) {
    Json names = Json::array();
    for (const Tar& tar : tars) {
      if (tar.split == static_cast<int>(split)) names.push_back(tar.name + ".tar");
    }
    if (!names.empty()) splits[kSplits[split]] = names;
  }
  about["splits"] = splits;
  for (const Part part : spec.parts) about["write"].push_back(to_string(part));
  return about;
}

// True if a folder contains nothing, or only what a process leaves that dies before it describes the dataset.
bool was_just_begun(const fs::path& folder) {
  std::error_code failed;
  fs::recursive_directory_iterator entry(folder, failed);
  if (failed) return false;
  for (const fs::recursive_directory_iterator end; entry != end; entry.increment(failed)) {
    if (failed) return false;
    const bool own = entry->path() == folder / kParts ||
                     entry->path().lexically_relative(folder).generic_string().find(".partial-") != std::string::npos;
    if (!own) return false;
  }
  return true;
}

}  // namespace

DatasetFolder::DatasetFolder(fs::path folder, const Spec& spec, const std::string& identity,
                             const std::string& program_version)
    : folder_(std::move(folder)), spec_(spec), version_(program_version), tars_(tars_of(spec)) {
  const Json wanted = about_of(spec, identity, version_, tars_);
  const fs::path about = folder_ / kAbout;
  std::error_code failed;
  if (fs::exists(about, failed)) {
    const Json found = Json::parse(read_bytes(about), nullptr, false);
    const auto text = [&](const char* key) { return found.is_object() ? found.value(key, "") : std::string(); };
    if (text("format") != kFormat)
      throw Error(about.string() + ": is not the description of a dataset; choose another --out");
    if (text("program") != wanted["program"])
      throw Error(folder_.string() + ": was begun by " + text("program") + ", this is " +
                  wanted["program"].get<std::string>() + "; choose another --out");
    if (text("identity") != wanted["identity"])
      throw Error(folder_.string() + ": contains another dataset, or this one before " + spec.file.string() +
                  ", a scene or a rig changed; choose another --out");
  } else if (fs::exists(folder_, failed) && !was_just_begun(folder_)) {
    throw Error(folder_.string() + ": exists and is not a dataset; choose another --out or remove it");
  }
  failed.clear();
  fs::create_directories(folder_ / kParts, failed);
  if (failed) throw Error(folder_.string() + ": cannot be created: " + failed.message());
  place(kAbout, wanted.dump(1) + "\n");
  place(kSpecCopy, read_bytes(spec.file));
}

fs::path DatasetFolder::parts_of(size_t tar) const { return folder_ / kParts / tars_[tar].name; }
fs::path DatasetFolder::index_of(size_t tar) const { return folder_ / kParts / (tars_[tar].name + ".jsonl"); }
fs::path DatasetFolder::tar_file(size_t tar) const { return folder_ / (tars_[tar].name + ".tar"); }

void DatasetFolder::place(const std::string& name, const std::string& text) const {
  const StagedFile staged(folder_ / kParts / name);
  write_text(staged.path(), text);
  fs::rename(staged.path(), folder_ / name);
}

bool DatasetFolder::has(size_t tar) const {
  std::error_code failed;
  return fs::exists(tar_file(tar), failed);
}

std::vector<int> DatasetFolder::missing(size_t tar) const {
  std::vector<int> trials;
  if (has(tar)) return trials;
  for (const int trial : tars_[tar].trials) {
    if (!read_trial(parts_of(tar), trial)) trials.push_back(trial);
  }
  return trials;
}

void DatasetFolder::join(size_t tar) const {
  const fs::path parts = parts_of(tar);
  try {
    fs::create_directories(parts);
    // Staged in a folder of its own, because another process may join the same tar file.
    const StagedFile staged(parts / (tars_[tar].name + ".tar"));
    SummedFile whole(staged.path());
    std::string lines;
    for (const int trial : tars_[tar].trials) {
      std::optional<TrialIndex> index = read_trial(parts, trial);
      const fs::path file = part_file(parts, trial);
      if (!index) throw Error(file.string() + ": is missing or damaged; run the command again");
      std::optional<InputFile> piece;
      if (!index->samples.empty()) piece.emplace(file, kMostDataBytes);
      uint64_t begin = 0;  // of the sample, in the piece
      for (PartSample& sample : index->samples) {
        const uint64_t offset = whole.bytes();
        if (!copy_sample(*piece, begin, sample, whole)) {
          fs::remove(part_index_file(parts, trial));
          fs::remove(file);
          throw Error(file.string() + ": was damaged and has been removed; run the command again");
        }
        begin += sample.bytes;
        sample.offset = offset;
      }
      lines += index_text(*index) + "\n";
    }
    whole.add(std::string(kTarEnd, '\0'));
    const FileEntry entry = whole.close();
    StagedFile index(index_of(tar));
    write_text(index.path(), Json{{"sha256", entry.sha256}, {"bytes", entry.bytes}}.dump() + "\n" + lines);
    index.commit();
    fs::rename(staged.path(), tar_file(tar));
  } catch (const std::exception&) {
    if (!has(tar)) throw;  // otherwise another process has joined the same pieces and removed them
  }
  std::error_code ignored;
  fs::remove_all(parts, ignored);
}

bool DatasetFolder::complete() const {
  std::error_code failed;
  return fs::exists(folder_ / kSums, failed);
}

namespace {

// Parses the first line of a tar file's index: checksum and size of the tar file.
std::optional<FileEntry> tar_sums(const std::string& line) {
  const Json json = Json::parse(line, nullptr, false);
  try {
    return FileEntry{"", json.at("sha256").get<std::string>(), json.at("bytes").get<uint64_t>()};
  } catch (const Json::exception&) {
    return std::nullopt;
  }
}

}  // namespace

std::vector<FileEntry> DatasetFolder::write_index() const {
  std::vector<FileEntry> tars;
  std::string refused;
  const StagedFile staged(folder_ / kParts / kIndex);
  SummedFile index(staged.path());
  std::vector<std::string> header = kColumns;
  for (const studies::Parameter& parameter : spec_.parameters) header.push_back(parameter.name);
  index.add(csv_line(header));
  for (size_t tar = 0; tar < tars_.size(); ++tar) {
    const std::string split = kSplits[static_cast<size_t>(tars_[tar].split)], name = tars_[tar].name + ".tar";
    std::istringstream lines(read_bytes(index_of(tar)));
    const auto damaged = [&](const char* how) {
      return Error(index_of(tar).string() + ": is " + how + "; remove " + tar_file(tar).string() +
                   " and run the command again");
    };
    std::string text;
    if (!std::getline(lines, text)) throw damaged("missing");
    const std::optional<FileEntry> sums = tar_sums(text);
    if (!sums) throw damaged("damaged");
    tars.push_back({name, sums->sha256, sums->bytes});
    while (std::getline(lines, text)) {
      const std::optional<TrialIndex> piece = trial_index_of(text);
      if (!piece || piece->trial < 0 || piece->trial >= spec_.trials()) throw damaged("damaged");
      const std::string number = std::to_string(piece->trial);
      const std::string world = std::to_string(studies::world_of(spec_, piece->trial));
      const studies::Trial trial = studies::trial_of(spec_, piece->trial);
      const std::string seed = std::to_string(trial.world_seed);
      if (!piece->refused.empty()) refused += csv_line({number, split, world, seed, piece->refused});
      int view = 0;
      for (const PartSample& sample : piece->samples) {
        std::vector<std::string> fields = {sample_name(sample.sample),
                                           split,
                                           world,
                                           number,
                                           std::to_string(view++),
                                           piece->scene,
                                           seed,
                                           piece->rig,
                                           name,
                                           std::to_string(sample.offset),
                                           std::to_string(sample.bytes),
                                           sample.sha256};
        fields.insert(fields.end(), trial.values.begin(), trial.values.end());
        index.add(csv_line(fields));
      }
    }
  }
  index.close();
  if (!refused.empty()) place(kRefused, "trial,split,world,seed,message\n" + refused);
  fs::rename(staged.path(), folder_ / kIndex);
  return tars;
}

std::vector<FileEntry> DatasetFolder::recorded_tars(const Contents& found) const {
  std::map<std::string, std::string> sums;
  std::istringstream in(read_input(folder_ / kSums));
  for (std::string sum, name; in >> sum >> name;) sums[name] = sum;
  const bool lists_all = sums.contains(kIndex) && std::all_of(found.tars.begin(), found.tars.end(),
                                                              [&](const auto& tar) { return sums.contains(tar.name); });
  if (!lists_all) throw Error((folder_ / kSums).string() + ": is damaged; " + kRestore);
  if (found.index.sha256 != sums[kIndex])
    throw Error((folder_ / kIndex).string() + ": differs from its checksum in SHA256SUMS; " + kRestore);
  std::vector<FileEntry> tars;
  for (size_t tar = 0; tar < tars_.size(); ++tar) {
    const FileEntry& indexed = found.tars[tar];
    const fs::path file = folder_ / indexed.name;
    std::error_code failed;
    // A tar file that was missing has been written again, and has a record.
    if (fs::exists(index_of(tar), failed)) {
      if (checksum(file) != sums[indexed.name])
        throw Error(file.string() +
                    ": was written again and differs from its checksum in SHA256SUMS, because a file that "
                    "the scenes use, or a library, has changed; " +
                    kRestore);
    } else if (const uint64_t bytes = fs::file_size(file, failed); failed || bytes != indexed.bytes) {
      throw Error(file.string() + ": has " + (failed ? "no readable size" : std::to_string(bytes) + " bytes") +
                  ", but " + std::to_string(indexed.bytes) +
                  " bytes were written; remove it and run the command again");
    }
    tars.push_back({indexed.name, sums[indexed.name], indexed.bytes});
  }
  return tars;
}

Contents DatasetFolder::contents() const {
  Contents contents;
  contents.program_version = version_;
  std::set<std::string> scenes, rigs;
  std::array<std::set<std::string>, kSplits.size()> worlds;
  std::map<std::string, uint64_t> ends;  // by tar file: where its last sample ends
  for (const Tar& tar : tars_) ends[tar.name + ".tar"] = 0;
  std::error_code unknown;
  if (!fs::exists(folder_ / kIndex, unknown)) throw Error((folder_ / kIndex).string() + ": is missing; " + kRestore);
  bool is_header = true;
  contents.index = for_each_line(folder_ / kIndex, [&](const std::string& line) {
    if (std::exchange(is_header, false)) return;
    const std::vector<std::string> fields = csv_fields(line);
    const auto damaged = [&] { return Error((folder_ / kIndex).string() + ": is damaged; " + kRestore); };
    if (fields.size() < kColumns.size()) throw damaged();
    const auto split =
        static_cast<size_t>(std::find(kSplits.begin(), kSplits.end(), fields[kSplitColumn]) - kSplits.begin());
    const std::optional<uint64_t> offset = number_of(fields[kOffsetColumn]), bytes = number_of(fields[kBytesColumn]);
    const auto end = ends.find(fields[kTarColumn]);
    if (split == kSplits.size() || !offset || !bytes || end == ends.end()) throw damaged();
    end->second = std::max(end->second, *offset + *bytes);
    ++contents.samples.at(split);
    worlds.at(split).insert(fields.at(kWorldColumn));
    scenes.insert(fields.at(kSceneColumn));
    rigs.insert(fields.at(kRigColumn));
  });
  for (const Tar& tar : tars_) {
    const std::string name = tar.name + ".tar";
    contents.tars.push_back({name, "", ends[name] + kTarEnd});
  }
  contents.scenes.assign(scenes.begin(), scenes.end());
  contents.rigs.assign(rigs.begin(), rigs.end());
  for (size_t split = 0; split < kSplits.size(); ++split)
    contents.worlds[split] = static_cast<int>(worlds[split].size());
  const int samples = contents.samples[0] + contents.samples[1] + contents.samples[2];
  contents.refused = spec_.trials() - samples / spec_.views;
  return contents;
}

bool DatasetFolder::finish() const {
  for (size_t tar = 0; tar < tars_.size(); ++tar) {
    if (!has(tar)) return false;
  }
  // Written again even if complete: texts of the specification that are only quoted may have changed.
  Contents found;
  const bool was_complete = complete();
  if (was_complete) {
    found = contents();
    found.tars = recorded_tars(found);
  }
  try {
    if (!was_complete) {
      const std::vector<FileEntry> tars = write_index();
      found = contents();
      found.tars = tars;
    }
    place(kDatasheet, datasheet(spec_, found));
    place(kMetadata, croissant(spec_, found).dump(1) + "\n");
    std::string sums;
    for (const FileEntry& tar : found.tars) sums += tar.sha256 + "  " + tar.name + "\n";
    sums += found.index.sha256 + "  " + kIndex + "\n";
    for (const char* name : {kMetadata, kAbout, kSpecCopy, kDatasheet, kRefused}) {
      if (fs::exists(folder_ / name)) sums += sha256_hex(read_bytes(folder_ / name)) + "  " + name + "\n";
    }
    place(kSums, sums);
  } catch (const std::exception&) {
    if (!complete()) throw;  // otherwise another process has finished the dataset and removed the parts
  }
  std::error_code ignored;
  fs::remove_all(folder_ / kParts, ignored);
  return true;
}

}  // namespace fringeslam::datasets

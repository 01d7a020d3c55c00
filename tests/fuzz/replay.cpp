// SPDX-License-Identifier: Apache-2.0
// Main program of a fuzz target in builds without libFuzzer: runs it on all files of a folder and on COUNT mutations of them, the
// same in every run. Fails like the target: by a signal.
//
// TARGET FOLDER COUNT
#include <unistd.h>

#include <algorithm>
#include <charconv>
#include <csignal>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <memory>
#include <random>
#include <set>
#include <string>
#include <vector>

extern "C" {
int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size);
// Targets may have these.
__attribute__((weak)) int LLVMFuzzerInitialize(int* argc, char*** argv);
__attribute__((weak)) size_t LLVMFuzzerCustomMutator(uint8_t* data, size_t size, size_t most, unsigned seed);
}

namespace {

constexpr size_t kMostBytes = 8192;

std::minstd_rand& generator() {
  static std::minstd_rand only(1);
  return only;
}

size_t below(size_t end) { return generator()() % end; }

char current_input[512];  // description, for the message when the target fails

extern "C" void report_input(int signal) {
  (void)!write(2, current_input, std::strlen(current_input));
  std::signal(signal, SIG_DFL);
  std::raise(signal);
}

void run(const std::vector<uint8_t>& seed, size_t size) {
  // A block of its size, so that sanitizers see what is read beyond it.
  const auto input = std::make_unique<uint8_t[]>(size);
  std::copy_n(seed.begin(), size, input.get());
  LLVMFuzzerTestOneInput(input.get(), size);
}

}  // namespace

// Changes, removes, repeats or inserts a few bytes.
extern "C" size_t LLVMFuzzerMutate(uint8_t* data, size_t size, size_t most) {
  for (size_t changes = 1 + below(4); changes > 0; --changes) {
    const size_t at = size > 0 ? below(size) : 0, length = size > 0 ? 1 + below(std::min<size_t>(size - at, 16)) : 0;
    const size_t kind = size > 0 ? below(4) : 3;
    if (kind == 0) data[at] = static_cast<uint8_t>(generator()());
    if (kind == 1 && size > length) {
      std::memmove(data + at, data + at + length, size - at - length);
      size -= length;
    }
    if (kind == 2 && size + length <= most) {
      std::memmove(data + at + length, data + at, size - at);
      size += length;
    }
    if (kind == 3 && size < most) {
      std::memmove(data + at + 1, data + at, size - at);
      data[at] = static_cast<uint8_t>(generator()());
      ++size;
    }
  }
  return size;
}

int main(int argc, char** argv) {
  if (LLVMFuzzerInitialize) LLVMFuzzerInitialize(&argc, &argv);
  size_t count = 0;
  if (argc != 3 || std::from_chars(argv[2], argv[2] + std::strlen(argv[2]), count).ec != std::errc()) {
    std::fprintf(stderr, "give a folder of inputs and a number of mutations\n");
    return 2;
  }
  for (const int signal : {SIGABRT, SIGSEGV, SIGBUS, SIGFPE, SIGILL}) std::signal(signal, report_input);
  std::vector<std::vector<uint8_t>> seeds;
  std::vector<std::string> names;
  const std::filesystem::directory_iterator entries(argv[1]);
  for (const std::filesystem::path& file : std::set<std::filesystem::path>(begin(entries), end(entries))) {
    std::ifstream in(file, std::ios::binary);
    seeds.emplace_back(std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>());
    names.push_back(file.filename().string());
    std::snprintf(current_input, sizeof current_input, "replay: failed on the seed %s\n", names.back().c_str());
    run(seeds.back(), seeds.back().size());
  }
  if (seeds.empty()) {
    std::fprintf(stderr, "%s: contains no inputs\n", argv[1]);
    return 2;
  }
  for (size_t i = 0; i < count; ++i) {
    std::vector<uint8_t> input = seeds[i % seeds.size()];
    size_t size = std::min(input.size(), kMostBytes);
    input.resize(kMostBytes);
    for (size_t rounds = 1 + below(3); rounds > 0; --rounds) {
      const auto seed = static_cast<unsigned>(generator()());
      size = LLVMFuzzerCustomMutator ? LLVMFuzzerCustomMutator(input.data(), size, kMostBytes, seed)
                                     : LLVMFuzzerMutate(input.data(), size, kMostBytes);
    }
    std::snprintf(current_input, sizeof current_input, "replay: failed on mutation %zu, of the seed %s\n", i + 1,
                  names[i % seeds.size()].c_str());
    run(input, size);
  }
  std::printf("%zu inputs and %zu mutations\n", seeds.size(), count);
  return 0;
}

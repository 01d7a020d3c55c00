// SPDX-License-Identifier: Apache-2.0
// The Python package: time relative to C++, and copies.
#include <unistd.h>

#include <cstdio>
#include <cstdlib>
#include <filesystem>

#include "bench/row.h"
#include "bench/script.h"
#include "bench/speed/interleaving.h"
#include "core/mapper/driver.h"
#include "core/rig/dataset.h"
#include "core/types/error.h"

namespace fringeslam::bench {

namespace {

namespace fs = std::filesystem;

struct Mapped {
  double seconds = 0, copied_bytes = 0;
  int tracked = 0;
};

Mapped map_in_cpp(const fs::path& dataset) {
  ReplayRig rig(dataset);
  Pipeline pipeline(rig.model(), rig.sequence(), {}, Pose{});
  Mapped mapped;
  mapped.seconds = seconds_of([&] {
    Driver(rig, pipeline).run([&](const MappedView& view) { mapped.tracked += has_pose(view.result.tracking); });
  });
  return mapped;
}

// Maps the dataset in a Python process of its own, which answers with one line.
Mapped map_in_python(const fs::path& dataset) {
  const std::string command = "echo | PYTHONPATH=" FRINGESLAM_PYTHON_PACKAGE " " FRINGESLAM_PYTHON_PROGRAM " -B " +
                              std::string(FRINGESLAM_BENCH_SCRIPTS) + "/python.py '" + dataset.string() + "'";
  Mapped mapped;
  if (std::sscanf(output_of(command).c_str(), "%lf %lf %d", &mapped.seconds, &mapped.copied_bytes, &mapped.tracked) !=
      3)
    throw Error("python.py printed no result; see its message above");
  return mapped;
}

std::vector<Row> python_rows(const Context& context) {
  const fs::path folder = fs::temp_directory_path() / ("fringeslam-python-" + std::to_string(::getpid()));
  fs::create_directories(folder);
  const fs::path dataset = folder / "dataset";
  const std::string render = std::string(FRINGESLAM_BENCH_PROGRAM) + " render " + FRINGESLAM_SCENES + "/loop --out '" +
                             dataset.string() + "' --quiet";
  if (std::system(render.c_str()) != 0) throw Error("rendering the loop failed; see its message above");
  std::vector<double> ratio;
  double copied = 0;
  for (int turn = -1; turn < (context.quick ? 2 : 7); ++turn) {
    const Mapped cpp = map_in_cpp(dataset), python = map_in_python(dataset);
    if (cpp.tracked != python.tracked) throw Error("Python tracks other views than C++");
    copied = std::max(copied, python.copied_bytes);
    if (turn < 0) continue;  // reads the dataset into the page cache
    std::fprintf(stderr, "  %d views: C++ %.2f s, Python %.2f s\n", cpp.tracked, cpp.seconds, python.seconds);
    ratio.push_back(python.seconds / cpp.seconds);
  }
  fs::remove_all(folder);
  return {median_row("python.overhead", ratio, "x", 1.03),
          bound_row("python.copy", copied, static_cast<int>(ratio.size()), "B", 0, Limit::most)};
}

}  // namespace

std::vector<Item> python_items() {
  return {{{"python.overhead", "python.copy"}, "mapping scenes/loop from Python relative to C++", python_rows, true}};
}

}  // namespace fringeslam::bench

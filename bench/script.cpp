// SPDX-License-Identifier: Apache-2.0
#include "bench/script.h"

#include <cstdio>
#include <cstdlib>
#include <memory>

#include "core/types/error.h"

namespace fringeslam::bench {

std::string output_of(const std::string& command) {
  const std::unique_ptr<FILE, int (*)(FILE*)> pipe(popen(command.c_str(), "r"), &pclose);
  std::string text(1 << 16, '\0');
  text.resize(pipe ? std::fread(text.data(), 1, text.size(), pipe.get()) : 0);
  return text;
}

std::string browser_result(const std::string& script, const std::string& arguments) {
  const std::string text = output_of("cd '" FRINGESLAM_BROWSER_SCRIPTS "' && node " + script + " " + arguments);
  if (!text.starts_with("{")) throw Error(script + ": printed no result; see its message above");
  return text;
}

void run_program(const std::string& arguments, const std::filesystem::path& answer,
                 const std::filesystem::path& messages) {
  std::string command = std::string(FRINGESLAM_BENCH_PROGRAM) + " --json " + arguments + " > '" + answer.string() + "'";
  if (!messages.empty()) command += " 2> '" + messages.string() + "'";
  if (std::system(command.c_str()) == 0) return;
  throw Error("fringeslam " + arguments + ": failed; see " +
              (messages.empty() ? "its message above" : messages.string()));
}

}  // namespace fringeslam::bench

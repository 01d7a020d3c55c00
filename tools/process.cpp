// SPDX-License-Identifier: Apache-2.0
#include "tools/process.h"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <ios>
#include <new>
#include <opencv2/core.hpp>

#include "core/io/staged.h"
#include "core/types/error.h"

namespace fringeslam::tools {

namespace {

std::string untranslated(const std::exception& exception) {
  if (const auto* files = dynamic_cast<const std::filesystem::filesystem_error*>(&exception)) {
    const std::string& second = files->path2().string();
    const std::string first = files->path1().empty() ? "a file or folder" : files->path1().string();
    return first + (second.empty() ? "" : ", " + second) + ": " + files->code().message() +
           "; check the path and its permissions";
  }
  if (dynamic_cast<const std::bad_alloc*>(&exception))
    return "memory does not suffice; use a smaller input, fewer --threads or a computer with more memory";
  if (const auto* images = dynamic_cast<const cv::Exception*>(&exception)) {
    if (images->code == cv::Error::StsNoMem)
      return "memory does not suffice; use a smaller input, fewer --threads or a computer with more memory";
    return "internal error in image processing: " + images->err + " (" + images->func + ")";
  }
  return exception.what();
}

// Ends the program when a mapped file is no longer readable: another program has shortened it, or its disk has failed or is full.
extern "C" void end_without_file(int) {
  constexpr char kMessage[] =
      "fringeslam: a saved map, or a temporary file in TMPDIR, became shorter or its disk failed or is full; "
      "check them, and run the command again\n";
  (void)!write(2, kMessage, sizeof kMessage - 1);
  _exit(2);
}

}  // namespace

void prepare_process() {
  std::signal(SIGXFSZ, SIG_IGN);
  std::signal(SIGBUS, end_without_file);
  // Reading from and writing to these fails, as it would with the closed stream.
  if (fcntl(0, F_GETFD) < 0) (void)!open("/dev/null", O_WRONLY);
  for (const int stream : {1, 2}) {
    if (fcntl(stream, F_GETFD) < 0) (void)!open("/dev/null", O_RDONLY);
  }
}

void finish_standard_output() {
  const bool failed = std::ferror(stdout) != 0;
  errno = 0;
  if (std::fflush(stdout) == 0 && !failed) return;
  const int error = errno != 0 ? errno : EIO;
  std::clearerr(stdout);
  throw Error(std::string("standard output cannot be written: ") + std::strerror(error) +
              "; what was written to files is complete");
}

std::string message_of(const std::exception& exception) {
  // Error makes one line of it.
  return Error(with_final_names(untranslated(exception))).what();
}

}  // namespace fringeslam::tools

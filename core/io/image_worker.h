// SPDX-License-Identifier: Apache-2.0
// Decoding of image files in other processes, because broken files can make the libraries crash, hang, allocate without
// bound, or worse.
//
// prepare_image_decoding() forks a small process. It should do so before this process has threads and has loaded OpenImageIO,
// because a fork leaves behind the threads and keeps the locks that they held. That process forks a worker whenever all others are busy. It loads
// OpenImageIO when a file first needs it; PNG and most EXR files are decoded by workers without it.
// A worker decodes one file after the other. It gets an open descriptor, not a path, and writes pixels into shared memory
// that this process has allocated after checking the header. It can neither open files nor use the network
// (restrict_child()). If a file stops a worker, that file is an error and the next one gets another worker.
#pragma once

#include <cstdint>
#include <string>

#include "core/io/image_decoder.h"

namespace fringeslam {

// An encoded image: an open file, or bytes in memory.
struct ImageSource {
  int descriptor = -1;
  const std::string* bytes = nullptr;  // if there is no descriptor
  uint64_t size = 0;
  std::string name;  // in messages
};

// Call it first in a program, and before image_library(); later calls do nothing. Processes that are forked afterwards share the process that it
// starts.
void prepare_image_decoding();

// Decodes the first image of a file in a worker; otherwise as decode_here(). Also throws Error if the worker crashes, takes
// too long or cannot be started. Any number of threads may call it.
cv::Mat decode_image_file(const ImageSource& source, const ImageRequest& request, const AllocateImage& allocate);

// For measurements of what the workers cost, and for fuzzing: from now on, decodes in the calling thread (or no longer).
void decode_in_this_process(bool here);

}  // namespace fringeslam

// SPDX-License-Identifier: Apache-2.0
// Setup of the program's process: signals, standard streams, messages of exceptions.
#pragma once

#include <exception>
#include <string>

namespace fringeslam::tools {

// Makes writing beyond a file size limit fail with an error instead of a signal, and occupies closed standard streams so
// that no file that is opened later takes their numbers.
void prepare_process();

// Throws Error unless everything printed to standard output was written.
void finish_standard_output();

// Returns one line for the user: what is wrong, where and, where the exception says it, what to do.
std::string message_of(const std::exception& exception);

}  // namespace fringeslam::tools

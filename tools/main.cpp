// SPDX-License-Identifier: Apache-2.0
#include "tools/program.h"

int main(int argc, char** argv) { return fringeslam::tools::run_program(argc, argv); }

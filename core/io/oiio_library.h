// SPDX-License-Identifier: Apache-2.0
// The entry point of the module that is linked with OpenImageIO. image_library() calls it.
#pragma once

#include "core/io/image_library.h"

extern "C" const fringeslam::ImageLibrary* fringeslam_oiio_library();

// SPDX-License-Identifier: Apache-2.0
#include "core/io/image_threads.h"

#include <OpenImageIO/imageio.h>

namespace fringeslam {

void use_no_image_threads() {
  OIIO::attribute("threads", 1);
  OIIO::attribute("exr_threads", -1);  // no pool of OpenEXR's own
}

}  // namespace fringeslam

// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace fringeslam {

// From now on, images are encoded and decoded in the calling thread alone. For processes that fork after reading images,
// because their children lack the threads of the image libraries and would wait for them, and for processes of which one
// runs per processor. Call it before the first image is read or written.
void use_no_image_threads();

}  // namespace fringeslam

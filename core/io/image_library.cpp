// SPDX-License-Identifier: Apache-2.0
#include "core/io/image_library.h"

#include <pthread.h>

#include <mutex>

#include "core/base/module.h"
#include "core/io/oiio_library.h"
#include "core/types/error.h"

namespace fringeslam {

namespace {

const ImageLibrary* loaded = nullptr;
bool without_threads = false;

// Guards these. A process that is forked while another thread loads the library gets it unlocked, and may load it again.
std::mutex& mutex() {
  static std::mutex* const only = [] {
    static std::mutex guard;
    pthread_atfork([] { mutex().lock(); }, [] { mutex().unlock(); }, [] { mutex().unlock(); });
    return &guard;
  }();
  return *only;
}

#ifdef FRINGESLAM_OPENIMAGEIO_MODULE
const ImageLibrary& load() {
  std::string why;
  void* function = load_from_module(FRINGESLAM_OPENIMAGEIO_MODULE, "fringeslam_oiio_library", why);
  if (!function) throw Error("OpenImageIO cannot be loaded: " + why + "; install FringeSLAM again");
  return *reinterpret_cast<decltype(&fringeslam_oiio_library)>(function)();
}
#else
const ImageLibrary& load() { return *fringeslam_oiio_library(); }
#endif

}  // namespace

const ImageLibrary& image_library() {
  const std::lock_guard lock(mutex());
  if (!loaded) {
    loaded = &load();
    if (without_threads) loaded->use_no_threads();
  }
  return *loaded;
}

void use_no_image_threads() {
  const std::lock_guard lock(mutex());
  without_threads = true;
  if (loaded) loaded->use_no_threads();
}

}  // namespace fringeslam

// SPDX-License-Identifier: Apache-2.0
#include "core/io/image_library.h"

#include <dlfcn.h>
#include <pthread.h>

#include <mutex>

#include "core/io/oiio_library.h"
#include "core/types/error.h"

namespace fringeslam {

namespace {

namespace fs = std::filesystem;

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

#ifdef FRINGESLAM_IMAGE_MODULE
// Returns the path of the module, which is installed with the library that contains this function.
const fs::path& module_file() {
  static const fs::path file = [] {
    Dl_info info{};
    if (dladdr(reinterpret_cast<const void*>(&module_file), &info) == 0 || info.dli_fname == nullptr) return fs::path();
    std::error_code failed;
    const fs::path library = fs::canonical(info.dli_fname, failed);
    return (failed ? fs::path(info.dli_fname) : library).parent_path() / "fringeslam" / FRINGESLAM_IMAGE_MODULE;
  }();
  return file;
}

const ImageLibrary& load() {
  void* module = dlopen(module_file().c_str(), RTLD_NOW | RTLD_LOCAL);  // never closed: its threads would run on
  void* function = module ? dlsym(module, "fringeslam_oiio_library") : nullptr;
  if (!function) {
    const char* why = dlerror();
    throw Error(std::string("OpenImageIO cannot be loaded: ") + (why ? why : module_file().c_str()) +
                "; install FringeSLAM again");
  }
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

void locate_image_library() {
#ifdef FRINGESLAM_IMAGE_MODULE
  (void)module_file();
#endif
}

void use_no_image_threads() {
  const std::lock_guard lock(mutex());
  without_threads = true;
  if (loaded) loaded->use_no_threads();
}

}  // namespace fringeslam

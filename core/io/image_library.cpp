// SPDX-License-Identifier: Apache-2.0
#include "core/io/image_library.h"

#include <mutex>

#include "core/io/oiio_library.h"
#include "core/types/error.h"
#if FRINGESLAM_IMAGE_MODULE
#include <dlfcn.h>
#endif

namespace fringeslam {

namespace {

namespace fs = std::filesystem;

std::mutex mutex;
const ImageLibrary* loaded = nullptr;
bool without_threads = false;

#if FRINGESLAM_IMAGE_MODULE
// Returns the folder of the library that contains this function: the module is installed with it.
fs::path own_folder() {
  Dl_info info{};
  if (dladdr(reinterpret_cast<const void*>(&own_folder), &info) == 0 || info.dli_fname == nullptr)
    throw Error("OpenImageIO cannot be loaded: the folder of this program's libraries is unknown");
  std::error_code failed;
  const fs::path file = fs::canonical(info.dli_fname, failed);
  return (failed ? fs::path(info.dli_fname) : file).parent_path();
}

const ImageLibrary& load() {
  const fs::path file = own_folder() / "fringeslam" / "image_library.so";
  void* module = dlopen(file.c_str(), RTLD_NOW | RTLD_LOCAL);  // never closed: its threads would run on
  void* function = module ? dlsym(module, "fringeslam_oiio_library") : nullptr;
  if (!function) {
    const char* why = dlerror();
    throw Error(std::string("OpenImageIO cannot be loaded: ") + (why ? why : file.c_str()) +
                "; install FringeSLAM again");
  }
  return *reinterpret_cast<decltype(&fringeslam_oiio_library)>(function)();
}
#else
const ImageLibrary& load() { return *fringeslam_oiio_library(); }
#endif

}  // namespace

const ImageLibrary& image_library() {
  const std::lock_guard lock(mutex);
  if (!loaded) {
    loaded = &load();
    if (without_threads) loaded->use_no_threads();
  }
  return *loaded;
}

void use_no_image_threads() {
  const std::lock_guard lock(mutex);
  without_threads = true;
  if (loaded) loaded->use_no_threads();
}

}  // namespace fringeslam

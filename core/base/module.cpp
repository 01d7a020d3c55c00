// SPDX-License-Identifier: Apache-2.0
#include "core/base/module.h"

#include <dlfcn.h>

#include <filesystem>
#include <system_error>

namespace fringeslam {

namespace {

namespace fs = std::filesystem;

const fs::path& module_folder() {
  static const fs::path folder = [] {
    Dl_info info{};
    if (dladdr(reinterpret_cast<const void*>(&load_from_module), &info) == 0 || info.dli_fname == nullptr)
      return fs::path();
    std::error_code failed;
    const fs::path library = fs::canonical(info.dli_fname, failed);
    return (failed ? fs::path(info.dli_fname) : library).parent_path() / "fringeslam";
  }();
  return folder;
}

}  // namespace

void* load_from_module(const std::string& file, const std::string& name, std::string& why) {
  const fs::path path = module_folder() / file;
  void* module = dlopen(path.c_str(), RTLD_NOW | RTLD_LOCAL);  // never closed: its threads would run on
  void* function = module ? dlsym(module, name.c_str()) : nullptr;
  if (!function) {
    const char* reason = dlerror();
    why = reason ? reason : path.string();
  }
  return function;
}

void locate_modules() { (void)module_folder(); }

}  // namespace fringeslam

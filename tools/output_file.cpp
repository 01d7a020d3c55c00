// SPDX-License-Identifier: Apache-2.0
#include "tools/output_file.h"

#include <algorithm>
#include <cctype>

#include "core/io/staged.h"
#include "core/types/error.h"

namespace fringeslam::tools {

namespace fs = std::filesystem;

void require_not_an_input(const fs::path& out, const std::vector<fs::path>& inputs,
                          const std::vector<std::string>& preserved) {
  for (const fs::path& input : inputs) {
    std::error_code differs;
    if (fs::equivalent(out, input, differs) && !differs)
      throw Error(out.string() + ": is the input, which would be replaced; choose another --out");
    if (is_replaced_with(input, out, preserved))
      throw Error(out.string() + ": contains the input " + input.string() +
                  ", which would be replaced; choose another --out");
  }
}

void require_extension(const fs::path& out, const std::string& extension) {
  std::string own = out.extension().string();
  std::transform(own.begin(), own.end(), own.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  if (own != extension) throw Error("--out '" + out.string() + "': the name must end in " + extension);
}

}  // namespace fringeslam::tools

// SPDX-License-Identifier: Apache-2.0
// The result of an expensive function for the argument it was last called with.
#pragma once

#include <mutex>
#include <optional>
#include <utility>

namespace fringeslam {

// Keeps one result for the life of the object, usually that of the process. `Value` must be cheap to copy.
template <class Key, class Value>
class LastResult {
 public:
  // Returns the last result if its key is the same, else that of `compute`. Any number of threads may call it.
  template <class Compute>
  Value get(const Key& key, const Compute& compute) {
    {
      const std::lock_guard lock(mutex_);
      if (last_ && last_->first == key) return last_->second;
    }
    // Without the lock, because the function may run tasks in this thread that need a result as well.
    Value value = compute();
    const std::lock_guard lock(mutex_);
    last_.emplace(key, value);
    return value;
  }

 private:
  std::mutex mutex_;
  std::optional<std::pair<Key, Value>> last_;
};

}  // namespace fringeslam

// Batches of independent samples, and the threads that share them out.
//
// Arrays are row-major doubles.  Leading dimensions of an argument are batches: each is 1 where the argument is shared,
// or the size of the whole batch.

#pragma once

#include <algorithm>
#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <memory>
#include <mutex>
#include <vector>

#include "xla/ffi/api/ffi.h"

namespace ffi = xla::ffi;

namespace {

using Real = ffi::Buffer<ffi::F64>;
using RealResult = ffi::ResultBuffer<ffi::F64>;
using Slots = ffi::Span<const int32_t>;

constexpr double WORTH_A_THREAD = 2e5;  // multiplications below which waking another thread costs more than it saves

// Where each sample of a batch begins in an argument; samples are numbered row-major over the batch's dimensions.
class Samples {
 public:
  Samples(ffi::Span<const int64_t> dimensions, size_t own, const std::vector<int64_t>& batch)
      : batch_(batch), strides_(batch.size()) {
    int64_t stride = 1;
    for (size_t i = dimensions.size(); i-- > dimensions.size() - own;) stride *= dimensions[i];
    for (size_t i = batch.size(); i-- > 0;) {
      strides_[i] = dimensions[i] == 1 ? 0 : stride;
      stride *= dimensions[i];
    }
  }
  int64_t operator()(int64_t sample) const {
    int64_t start = 0;
    for (size_t i = batch_.size(); i-- > 0; sample /= batch_[i]) start += sample % batch_[i] * strides_[i];
    return start;
  }

 private:
  const std::vector<int64_t>& batch_;
  std::vector<int64_t> strides_;
};

inline std::vector<int64_t> batch_of(ffi::Span<const int64_t> dimensions, size_t own) {
  return std::vector<int64_t>(dimensions.begin(), dimensions.end() - own);
}

inline int64_t count(const std::vector<int64_t>& batch) {
  int64_t product = 1;
  for (int64_t size : batch) product *= size;
  return product;
}

// Runs work(0) .. work(samples - 1).  The caller works too and waits only for what has been taken up, so that a pool
// whose threads are all busy, this call's own perhaps among them, cannot stop it.
template <class Work>
void spread(ffi::ThreadPool& pool, int64_t samples, double multiplications, const Work& work) {
  const int64_t worth = static_cast<int64_t>(samples * multiplications / WORTH_A_THREAD);
  const int64_t threads = samples > 1 ? std::min({pool.num_threads(), samples, worth}) : 1;
  if (threads < 2) {
    for (int64_t sample = 0; sample < samples; ++sample) work(sample);
    return;
  }
  struct Shared {
    std::atomic<int64_t> next{0};
    std::mutex mutex;
    std::condition_variable changed;
    int64_t done = 0;
  };
  const auto shared = std::make_shared<Shared>();
  const int64_t share = std::max<int64_t>(1, samples / (4 * threads));
  const auto help = [shared, share, samples, &work] {  // `work` is touched only while the caller still waits
    for (int64_t from; (from = shared->next.fetch_add(share)) < samples;) {
      const int64_t to = std::min(from + share, samples);
      for (int64_t sample = from; sample < to; ++sample) work(sample);
      const std::lock_guard<std::mutex> lock(shared->mutex);
      shared->done += to - from;
      shared->changed.notify_all();
    }
  };
  for (int64_t i = 1; i < threads; ++i) pool.Schedule([help] { help(); });
  help();
  std::unique_lock<std::mutex> lock(shared->mutex);
  shared->changed.wait(lock, [&] { return shared->done == samples; });
}

}  // namespace

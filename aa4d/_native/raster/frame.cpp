#include "raster/frame.hpp"

#include <mutex>

namespace aa4d::raster {
namespace {

constexpr std::size_t kKept = 4;  // frames that wait for use; a trainer needs one for each view of a batch

std::mutex mutex;
std::vector<std::unique_ptr<Frame>>& free_frames() {
  static auto* frames = new std::vector<std::unique_ptr<Frame>>;  // outlives every static destructor
  return *frames;
}

}  // namespace

FramePtr acquire_frame() {
  const std::lock_guard lock(mutex);
  auto& frames = free_frames();
  if (frames.empty()) return FramePtr(new Frame);
  FramePtr frame(frames.back().release());
  frames.pop_back();
  return frame;
}

void ReturnToPool::operator()(Frame* frame) const {
  std::unique_ptr<Frame> owned(frame);
  const std::lock_guard lock(mutex);
  if (free_frames().size() < kKept) free_frames().push_back(std::move(owned));
}

}  // namespace aa4d::raster

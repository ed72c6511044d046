#include "binning.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <stdexcept>
#include <utility>

#include "thread_pool.hpp"

namespace aa4d {
namespace {

constexpr std::size_t kMaxSlots = std::size_t{1} << 31;  // slots are counted in 32 bits
constexpr int kPrefetch = 8;

// Stable radix sort of the seen Gaussians by the bits of their depth: positive floats order like integers. Equal depths
// stay in the order of their indices.
void sort_by_depth(Frame& frame) {
  frame.order.resize_discarding(frame.count);
  frame.order_other.resize_discarding(frame.count);
  std::uint64_t* from = frame.order.data();
  std::size_t seen = 0;
  std::uint32_t smallest = ~0u, largest = 0;
  for (std::size_t g = 0; g < frame.count; ++g) {
    const std::uint32_t key = frame.depth_keys[g];
    if (key == 0) continue;
    smallest = std::min(smallest, key);
    largest = std::max(largest, key);
    from[seen++] = std::uint64_t{key} << 32 | g;
  }
  frame.order.resize_discarding(seen);
  if (seen < 2) return;

  // As few passes as digits of 12 bits allow (their histogram stays in the first-level cache), of equal size.
  const int bits = std::bit_width(largest - smallest), passes = (bits + 11) / 12;
  const int digit_bits = passes ? (bits + passes - 1) / passes : 0;
  const std::uint32_t digits = 1u << digit_bits;
  frame.histogram.resize_discarding(digits);
  std::uint32_t* const place = frame.histogram.data();
  std::uint64_t* to = frame.order_other.data();
  for (int pass = 0; pass < passes; ++pass) {
    const auto digit = [&](std::uint64_t item) {
      return (static_cast<std::uint32_t>(item >> 32) - smallest) >> (pass * digit_bits) & (digits - 1);
    };
    std::fill_n(place, digits, 0u);
    for (std::size_t i = 0; i < seen; ++i) ++place[digit(from[i])];
    std::uint32_t sum = 0;
    for (std::uint32_t d = 0; d < digits; ++d) sum += std::exchange(place[d], sum);
    for (std::size_t i = 0; i < seen; ++i) to[place[digit(from[i])]++] = from[i];
    std::swap(from, to);
  }
  if (from != frame.order.data()) std::copy_n(from, seen, frame.order.data());
}

// Columns of quarters, [begin, end).
struct Columns {
  int begin, end;
};

// The quarters that a splat's ellipse u^2 + w^2 <= reach comes near, row by row. Exact, since the part of an ellipse
// within a horizontal band is convex. With w = l22 dy and u = l11 dx + l21 dy, the ellipse spans
//   dx = (-l21 dy -+ sqrt(reach - w^2)) / l11  at a given dy.
class EllipseRows {
 public:
  EllipseRows(const Splat& splat, const QuarterBox& box, const CameraModel& camera)
      : splat_(splat), box_(box), last_line_(camera.height - kFirst), last_column_(camera.width - kFirst),
        half_height_(std::sqrt(splat.reach) / splat.l22 + kSlack), slope_(-splat.l21 / splat.l11) {
    rightmost_ = -splat.l21 / splat.l22 * std::sqrt(splat.reach / (splat.l21 * splat.l21 + splat.l22 * splat.l22));
  }

  Columns columns(int row) const {
    Columns result = {box_.x_begin, box_.x_end};
    if (row < box_.y_begin || row >= box_.y_end) return {0, 0};
    const double top = row * kQuarterSize + kFirst, bottom = std::min(top + kQuarterSize - 1, last_line_);
    // A row that holds the whole height of the ellipse holds its whole width, which is the box's.
    if (splat_.y - half_height_ >= top && splat_.y + half_height_ <= bottom) return result;
    const double low = top - splat_.y - kSlack, high = bottom - splat_.y + kSlack;
    const double left = splat_.x - kSlack + edge(std::clamp(-rightmost_, low, high), -1);
    const double right = splat_.x + kSlack + edge(std::clamp(rightmost_, low, high), 1);
    if (right < kFirst || left > last_column_) return {0, 0};
    while (result.begin < result.end && left > result.begin * kQuarterSize + kQuarterSize - kFirst) ++result.begin;
    while (result.begin < result.end && right < (result.end - 1) * kQuarterSize + kFirst) --result.end;
    return result;
  }

 private:
  static constexpr double kFirst = 0.5;   // pixel centres, from a quarter's edge
  static constexpr double kSlack = 0.01;  // px, for the rounding of the blending's own test

  double edge(double dy, int side) const {
    const double w = splat_.l22 * dy;
    return slope_ * dy + side * std::sqrt(std::max(0.0, splat_.reach - w * w)) / splat_.l11;
  }

  const Splat& splat_;
  const QuarterBox& box_;
  double last_line_, last_column_, half_height_, slope_;
  double rightmost_;  // dy of the ellipse's rightmost point; its leftmost lies opposite
};

void append_tiles(const Frame& frame, std::size_t g, Buffer<TouchedTile>& touched) {
  static_assert(kTileSize == 2 * kQuarterSize);
  const QuarterBox& box = frame.boxes[g];
  const EllipseRows rows(frame.splats[g], box, frame.camera);
  for (int y = box.y_begin / 2; y < (box.y_end + 1) / 2; ++y) {
    const Columns upper = rows.columns(2 * y), lower = rows.columns(2 * y + 1);
    const auto quarters = [](Columns c, int x) -> unsigned {
      return (c.begin <= 2 * x && 2 * x < c.end) | (c.begin <= 2 * x + 1 && 2 * x + 1 < c.end) << 1;
    };
    for (int x = box.x_begin / 2; x < (box.x_end + 1) / 2; ++x) {
      const unsigned reached = quarters(upper, x) | quarters(lower, x) << 2;
      if (reached) touched.push_back({static_cast<std::uint32_t>(y * frame.tiles_x + x), reached});
    }
  }
}

// The tiles that each seen Gaussian touches, in the order of depth.
void find_tiles(Frame& frame, std::int32_t* radii, int threads) {
  const std::size_t seen = frame.order.size(), chunks = (seen + kChunk - 1) / kChunk;
  frame.touched_count.resize_discarding(seen);
  frame.touched.resize(std::max(frame.touched.size(), chunks));
  parallel_for(threads, chunks, [&](std::size_t chunk) {
    Buffer<TouchedTile>& touched = frame.touched[chunk];
    touched.clear();
    for (std::size_t i = chunk * kChunk; i < std::min(seen, (chunk + 1) * kChunk); ++i) {
      if (i + kPrefetch < seen) {
        const std::uint32_t next = static_cast<std::uint32_t>(frame.order[i + kPrefetch]);
        __builtin_prefetch(&frame.splats[next]);
        __builtin_prefetch(&frame.boxes[next]);
      }
      const std::uint32_t g = static_cast<std::uint32_t>(frame.order[i]);
      const std::size_t before = touched.size();
      append_tiles(frame, g, touched);
      frame.touched_count[i] = static_cast<std::uint32_t>(touched.size() - before);
      if (frame.touched_count[i] == 0) radii[g] = 0;
    }
  });
}

// Deals the Gaussians out to their tiles in the order of depth. Each part of that order counts on its own, so that all
// parts can deal at the same time into the places that a serial run would have used.
void deal_to_tiles(Frame& frame, int threads) {
  const std::size_t tiles = frame.tiles(), seen = frame.order.size(), chunks = (seen + kChunk - 1) / kChunk;
  constexpr std::size_t kWorthSplitting = 8;  // chunks
  const std::size_t parts = std::clamp<std::size_t>(chunks / kWorthSplitting, 1, threads);
  const auto first_chunk = [&](std::size_t part) { return chunks * part / parts; };
  frame.histogram.resize_discarding(parts * tiles);
  parallel_for(threads, parts, [&](std::size_t part) {
    std::uint32_t* const count = frame.histogram.data() + part * tiles;
    std::fill_n(count, tiles, 0u);
    for (std::size_t chunk = first_chunk(part); chunk < first_chunk(part + 1); ++chunk) {
      const Buffer<TouchedTile>& touched = frame.touched[chunk];
      for (std::size_t i = 0; i < touched.size(); ++i) ++count[touched[i].tile];
    }
  });

  std::size_t slots = 0;
  for (std::size_t chunk = 0; chunk < chunks; ++chunk) slots += frame.touched[chunk].size();
  if (slots > kMaxSlots) {
    throw std::length_error("the Gaussians touch more than 2^31 tiles in sum: draw fewer or smaller ones");
  }
  frame.entries.resize_discarding(slots);
  frame.tile_begin.resize_discarding(tiles + 1);
  std::uint32_t sum = 0;
  for (std::size_t tile = 0; tile < tiles; ++tile) {
    frame.tile_begin[tile] = sum;
    for (std::size_t part = 0; part < parts; ++part) sum += std::exchange(frame.histogram[part * tiles + tile], sum);
  }
  frame.tile_begin[tiles] = sum;

  parallel_for(threads, parts, [&](std::size_t part) {
    std::uint32_t* const place = frame.histogram.data() + part * tiles;
    std::uint32_t slot = 0;
    for (std::size_t chunk = 0; chunk < first_chunk(part); ++chunk) {
      slot += static_cast<std::uint32_t>(frame.touched[chunk].size());
    }
    for (std::size_t chunk = first_chunk(part); chunk < first_chunk(part + 1); ++chunk) {
      const TouchedTile* touched = frame.touched[chunk].data();
      for (std::size_t i = chunk * kChunk; i < std::min(seen, (chunk + 1) * kChunk); ++i) {
        const std::uint32_t g = static_cast<std::uint32_t>(frame.order[i]), count = frame.touched_count[i];
        frame.slots[g] = {slot, slot + count};
        for (std::uint32_t k = 0; k < count; ++k, ++touched) {
          frame.entries[place[touched->tile]++] = {g, touched->quarters, slot++};
        }
      }
    }
  });
}

}  // namespace

void sort_into_tiles(Frame& frame, std::int32_t* radii, int threads) {
  sort_by_depth(frame);
  find_tiles(frame, radii, threads);
  deal_to_tiles(frame, threads);
}

}  // namespace aa4d

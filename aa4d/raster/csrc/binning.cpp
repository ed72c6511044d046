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
constexpr double kFirst = 0.5;  // pixel centres of a tile, from its edge

// The columns of one row of tiles that a splat's ellipse u^2 + w^2 <= reach comes near: exact, since the part of an
// ellipse within a horizontal band is convex. With w = l22 dy and u = l11 dx + l21 dy, the ellipse spans
//   dx = (-l21 dy -+ sqrt(reach - w^2)) / l11  at a given dy.
struct RowSpan {
  RowSpan(const Splat& splat) : splat(splat), reach(splat.reach) {
    rightmost = -splat.l21 / splat.l22 * std::sqrt(reach / (splat.l21 * splat.l21 + splat.l22 * splat.l22));
  }

  std::pair<double, double> columns(double low, double high) const {
    const double right_y = std::clamp(rightmost, low, high), left_y = std::clamp(-rightmost, low, high);
    return {splat.x + (-splat.l21 * left_y - half_width(left_y)) / splat.l11,
            splat.x + (-splat.l21 * right_y + half_width(right_y)) / splat.l11};
  }

 private:
  double half_width(double dy) const {
    const double w = splat.l22 * dy;
    return std::sqrt(std::max(0.0, reach - w * w));
  }

  const Splat& splat;
  double reach;
  double rightmost;  // dy of the ellipse's rightmost point; its leftmost lies opposite
};

void append_tiles(const Frame& frame, const Splat& splat, const TileBox& box, Buffer<std::uint32_t>& tiles) {
  constexpr double kSlack = 0.01;  // px, for the rounding of the blending's own test
  if (box.y_begin == box.y_end || box.x_begin == box.x_end) return;
  const double half_height = std::sqrt(splat.reach) / splat.l22;
  const double last_line = frame.camera.height - kFirst, last_column = frame.camera.width - kFirst;
  const RowSpan span(splat);
  for (int row = box.y_begin; row < box.y_end; ++row) {
    const double top = row * kTileSize + kFirst, bottom = std::min(top + kTileSize - 1, last_line);
    int begin = box.x_begin, end = box.x_end;
    // A row that holds the whole height of the ellipse holds its whole width, which is the box's.
    if (splat.y - half_height < top || splat.y + half_height > bottom) {
      const auto [left, right] = span.columns(top - splat.y - kSlack, bottom - splat.y + kSlack);
      if (right + kSlack < kFirst || left - kSlack > last_column) continue;
      while (begin < end && left - kSlack > begin * kTileSize + kTileSize - kFirst) ++begin;
      while (begin < end && right + kSlack < (end - 1) * kTileSize + kFirst) --end;
    }
    for (int column = begin; column < end; ++column) {
      tiles.push_back(static_cast<std::uint32_t>(row * frame.tiles_x + column));
    }
  }
}

// Slots for every pair of a Gaussian and a tile, Gaussian by Gaussian.
void make_slots(Frame& frame, std::int32_t* radii, int threads) {
  frame.slot_begin.resize_discarding(frame.count + 1);
  if (frame.chunk_tiles.size() < frame.chunks()) frame.chunk_tiles.resize(frame.chunks());
  parallel_for(threads, frame.chunks(), [&](std::size_t chunk) {
    Buffer<std::uint32_t>& tiles = frame.chunk_tiles[chunk];
    tiles.clear();
    const std::size_t end = std::min(frame.count, (chunk + 1) * kChunk);
    for (std::size_t g = chunk * kChunk; g < end; ++g) {
      frame.slot_begin[g] = static_cast<std::uint32_t>(tiles.size());  // within the chunk, for now
      append_tiles(frame, frame.splats[g], frame.boxes[g], tiles);
      if (tiles.size() == frame.slot_begin[g]) radii[g] = 0;
    }
  });
  std::size_t base = 0;
  for (std::size_t chunk = 0; chunk < frame.chunks(); ++chunk) {
    if (base + frame.chunk_tiles[chunk].size() > kMaxSlots) {
      throw std::length_error("the Gaussians touch more than 2^31 tiles: draw fewer, smaller ones or a smaller image");
    }
    const std::size_t end = std::min(frame.count, (chunk + 1) * kChunk);
    for (std::size_t g = chunk * kChunk; g < end; ++g) frame.slot_begin[g] += static_cast<std::uint32_t>(base);
    base += frame.chunk_tiles[chunk].size();
  }
  frame.slot_begin[frame.count] = static_cast<std::uint32_t>(base);
}

// Stable radix sort of the visible Gaussians by the bits of their depth: positive floats order like integers. Equal
// depths stay in the order of their indices.
void sort_by_depth(Frame& frame) {
  frame.order.resize_discarding(frame.count);
  frame.order_other.resize_discarding(frame.count);
  std::uint64_t* from = frame.order.data();
  std::size_t visible = 0;
  std::uint32_t smallest = ~0u, largest = 0;
  for (std::size_t g = 0; g < frame.count; ++g) {
    if (frame.slot_begin[g] == frame.slot_begin[g + 1]) continue;
    const std::uint32_t key = std::bit_cast<std::uint32_t>(frame.splats[g].depth);
    smallest = std::min(smallest, key);
    largest = std::max(largest, key);
    from[visible++] = std::uint64_t{key} << 32 | g;
  }
  frame.order.resize_discarding(visible);
  if (visible < 2) return;

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
    for (std::size_t i = 0; i < visible; ++i) ++place[digit(from[i])];
    std::uint32_t sum = 0;
    for (std::uint32_t d = 0; d < digits; ++d) sum += std::exchange(place[d], sum);
    for (std::size_t i = 0; i < visible; ++i) to[place[digit(from[i])]++] = from[i];
    std::swap(from, to);
  }
  if (from != frame.order.data()) std::copy_n(from, visible, frame.order.data());
}

// Deals the slots out to their tiles in the order of depth. Each part of that order counts on its own, so that all
// parts can deal at the same time into the places that a serial run would have used.
void deal_to_tiles(Frame& frame, int threads) {
  const std::size_t tiles = frame.tiles(), visible = frame.order.size();
  constexpr std::size_t kWorthSplitting = 8192;
  const std::size_t parts = std::clamp<std::size_t>(visible / kWorthSplitting, 1, threads);
  frame.histogram.resize_discarding(parts * tiles);
  const auto for_each_slot = [&](std::size_t part, const auto& body) {
    for (std::size_t i = visible * part / parts; i < visible * (part + 1) / parts; ++i) {
      const std::uint32_t g = static_cast<std::uint32_t>(frame.order[i]);
      const std::size_t chunk = g / kChunk;
      const std::uint32_t* const touched = frame.chunk_tiles[chunk].data();
      const std::uint32_t base = frame.slot_begin[chunk * kChunk];
      for (std::uint32_t slot = frame.slot_begin[g]; slot < frame.slot_begin[g + 1]; ++slot) {
        body(touched[slot - base], g, slot);
      }
    }
  };
  parallel_for(threads, parts, [&](std::size_t part) {
    std::uint32_t* const count = frame.histogram.data() + part * tiles;
    std::fill_n(count, tiles, 0u);
    for_each_slot(part, [&](std::uint32_t tile, std::uint32_t, std::uint32_t) { ++count[tile]; });
  });
  frame.tile_begin.resize_discarding(tiles + 1);
  std::uint32_t sum = 0;
  for (std::size_t tile = 0; tile < tiles; ++tile) {
    frame.tile_begin[tile] = sum;
    for (std::size_t part = 0; part < parts; ++part) sum += std::exchange(frame.histogram[part * tiles + tile], sum);
  }
  frame.tile_begin[tiles] = sum;
  frame.entries.resize_discarding(sum);
  parallel_for(threads, parts, [&](std::size_t part) {
    std::uint32_t* const place = frame.histogram.data() + part * tiles;
    for_each_slot(part, [&](std::uint32_t tile, std::uint32_t g, std::uint32_t slot) {
      frame.entries[place[tile]++] = {g, slot};
    });
  });
}

}  // namespace

void sort_into_tiles(Frame& frame, std::int32_t* radii, int threads) {
  make_slots(frame, radii, threads);
  sort_by_depth(frame);
  deal_to_tiles(frame, threads);
}

}  // namespace aa4d

#include "binning.hpp"

#include <algorithm>
#include <bit>
#include <stdexcept>
#include <utility>

#include "kernels.hpp"
#include "thread_pool.hpp"

namespace aa4d {
namespace {

constexpr std::size_t kMaxSlots = std::size_t{1} << 31;  // slots are counted in 32 bits
constexpr std::size_t kBinChunk = 2048;  // Gaussians; larger than kChunk because each chunk counts every tile
constexpr int kPrefetch = 8;

std::size_t bin_chunks(const Frame& frame) { return (frame.order.size() + kBinChunk - 1) / kBinChunk; }

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

// The bits of a group's quarters in rows or columns [begin, end) of it, where `unit` is one row or column.
std::uint32_t lines(int begin, int end, std::uint32_t unit, int shift) {
  std::uint32_t result = 0;
  for (int i = std::max(begin, 0); i < std::min(end, 4); ++i) result |= unit << (shift * i);
  return result;
}

void append_tiles(const Frame& frame, std::size_t g, Buffer<TouchedTile>& touched) {
  static_assert(kTileSize == 2 * kQuarterSize);
  const QuarterBox& box = frame.boxes[g];
  const auto test = kernels().touched_quarters;
  for (int row = box.y_begin & ~1; row < box.y_end; row += 4) {
    for (int column = box.x_begin & ~1; column < box.x_end; column += 4) {
      const std::uint32_t in_box = lines(box.x_begin - column, box.x_end - column, 0x1111, 1) &
                                   lines(box.y_begin - row, box.y_end - row, 0x000f, 4);
      const std::uint32_t group = in_box & test(frame.splats[g], frame.camera, column, row);
      for (int tile = 0; tile < 4; ++tile) {
        const std::uint32_t bits = group >> (tile / 2 * 8 + tile % 2 * 2);
        const std::uint32_t quarters = (bits & 3) | (bits >> 4 & 3) << 2;
        if (quarters == 0) continue;
        const int x = column / 2 + tile % 2, y = row / 2 + tile / 2;
        touched.push_back({static_cast<std::uint32_t>(y * frame.tiles_x + x), quarters});
      }
    }
  }
}

// The tiles that each seen Gaussian touches, in the order of depth, and how often each chunk of that order touches each.
void find_tiles(Frame& frame, std::int32_t* radii, int threads) {
  const std::size_t seen = frame.order.size(), tiles = frame.tiles();
  frame.touched_count.resize_discarding(seen);
  frame.touched.resize(std::max(frame.touched.size(), bin_chunks(frame)));
  frame.histogram.resize_discarding(bin_chunks(frame) * tiles);
  parallel_for(threads, bin_chunks(frame), [&](std::size_t chunk) {
    Buffer<TouchedTile>& touched = frame.touched[chunk];
    touched.clear();
    for (std::size_t i = chunk * kBinChunk; i < std::min(seen, (chunk + 1) * kBinChunk); ++i) {
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
    std::uint32_t* const count = frame.histogram.data() + chunk * tiles;
    std::fill_n(count, tiles, 0u);
    for (std::size_t i = 0; i < touched.size(); ++i) ++count[touched[i].tile];
  });
}

// Deals the Gaussians out to their tiles in the order of depth. Every chunk of that order knows its places from the
// counts of those before it, so that all chunks can deal at the same time and the lists come out as from a serial run.
void deal_to_tiles(Frame& frame, int threads) {
  const std::size_t tiles = frame.tiles(), seen = frame.order.size(), chunks = bin_chunks(frame);
  frame.chunk_slots.resize_discarding(chunks);
  std::size_t slots = 0;
  for (std::size_t chunk = 0; chunk < chunks; ++chunk) {
    frame.chunk_slots[chunk] = static_cast<std::uint32_t>(slots);
    slots += frame.touched[chunk].size();
    if (slots > kMaxSlots) {
      throw std::length_error("the Gaussians touch more than 2^31 tiles in sum: draw fewer or smaller ones");
    }
  }
  frame.entries.resize_discarding(slots);
  frame.tile_begin.resize_discarding(tiles + 1);
  std::uint32_t sum = 0;
  for (std::size_t tile = 0; tile < tiles; ++tile) {
    frame.tile_begin[tile] = sum;
    for (std::size_t chunk = 0; chunk < chunks; ++chunk) sum += std::exchange(frame.histogram[chunk * tiles + tile], sum);
  }
  frame.tile_begin[tiles] = sum;

  parallel_for(threads, chunks, [&](std::size_t chunk) {
    std::uint32_t* const place = frame.histogram.data() + chunk * tiles;
    const TouchedTile* touched = frame.touched[chunk].data();
    std::uint32_t slot = frame.chunk_slots[chunk];
    for (std::size_t i = chunk * kBinChunk; i < std::min(seen, (chunk + 1) * kBinChunk); ++i) {
      const std::uint32_t g = static_cast<std::uint32_t>(frame.order[i]), count = frame.touched_count[i];
      frame.slots[g] = {slot, slot + count};
      for (std::uint32_t k = 0; k < count; ++k, ++touched) {
        frame.entries[place[touched->tile]++] = {g, touched->quarters, slot++, {}};
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

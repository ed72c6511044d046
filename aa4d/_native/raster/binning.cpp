#include "raster/binning.hpp"

#include <algorithm>
#include <bit>
#include <stdexcept>
#include <utility>

#include "common/thread_pool.hpp"
#include "raster/kernels.hpp"

namespace aa4d::raster {
namespace {

constexpr std::size_t kMaxSlots = std::size_t{1} << 31;  // slots are counted in 32 bits
constexpr std::size_t kSortChunk = 8192;                 // Gaussians that one task sorts or deals at a time
constexpr int kPrefetch = 16;

std::size_t chunks_of(std::size_t count) { return (count + kSortChunk - 1) / kSortChunk; }

template <class Body>
void for_each_chunk(int threads, std::size_t count, const Body& body) {
  parallel_for(threads, chunks_of(count),
               [&](std::size_t chunk) { body(chunk, chunk * kSortChunk, std::min(count, (chunk + 1) * kSortChunk)); });
}

// Turns how often each chunk has each of `values` into where the chunk's first one goes, value by value and chunk by
// chunk, so that all chunks can deal at the same time and the result comes out as from a serial run. `begin`, if there
// is one, gets where each value begins. Returns the total.
std::uint32_t counts_to_places(Buffer<std::uint32_t>& counts, std::size_t chunks, std::size_t values,
                               std::uint32_t* begin) {
  std::uint32_t sum = 0;
  for (std::size_t value = 0; value < values; ++value) {
    if (begin) begin[value] = sum;
    for (std::size_t chunk = 0; chunk < chunks; ++chunk) sum += std::exchange(counts[chunk * values + value], sum);
  }
  return sum;
}

// Stable radix sort of the seen Gaussians by the bits of their depth: positive floats order like integers. Equal depths
// stay in the order of their indices.
void sort_by_depth(Frame& frame, int threads) {
  frame.order.resize_discarding(frame.count);
  frame.order_other.resize_discarding(frame.count);
  std::uint64_t* from = frame.order.data();
  std::size_t seen = 0;
  std::uint32_t smallest = ~0u, largest = 0;
  for (std::size_t g = 0; g < frame.count; ++g) {
    const std::uint32_t key = frame.depth_keys[g];
    from[seen] = std::uint64_t{key} << 32 | g;
    seen += key != 0;
    smallest = std::min(smallest, key - 1);  // what is not seen becomes the largest
    largest = std::max(largest, key);
  }
  frame.order.resize_discarding(seen);
  if (seen < 2) return;
  ++smallest;

  // As few passes as digits of 11 bits allow (their histogram stays in the first-level cache), of equal size.
  const int bits = std::bit_width(largest - smallest), passes = (bits + 10) / 11;
  const int digit_bits = passes ? (bits + passes - 1) / passes : 0;
  const std::size_t digits = std::size_t{1} << digit_bits;
  frame.histogram.resize_discarding(chunks_of(seen) * digits);
  std::uint64_t* to = frame.order_other.data();
  for (int pass = 0; pass < passes; ++pass) {
    const auto digit = [&](std::uint64_t item) {
      return (static_cast<std::uint32_t>(item >> 32) - smallest) >> (pass * digit_bits) & (digits - 1);
    };
    for_each_chunk(threads, seen, [&](std::size_t chunk, std::size_t begin, std::size_t end) {
      std::uint32_t* const count = frame.histogram.data() + chunk * digits;
      std::fill_n(count, digits, 0u);
      for (std::size_t i = begin; i < end; ++i) ++count[digit(from[i])];
    });
    counts_to_places(frame.histogram, chunks_of(seen), digits, nullptr);
    for_each_chunk(threads, seen, [&](std::size_t chunk, std::size_t begin, std::size_t end) {
      std::uint32_t* const place = frame.histogram.data() + chunk * digits;
      for (std::size_t i = begin; i < end; ++i) to[place[digit(from[i])]++] = from[i];
    });
    std::swap(from, to);
  }
  if (from == frame.order.data()) return;
  frame.order_other.resize_discarding(seen);
  frame.order.swap(frame.order_other);
}

// Deals the Gaussians out to their tiles in the order of depth.
void deal_to_tiles(Frame& frame, int threads) {
  const std::size_t tiles = frame.tiles(), seen = frame.order.size();
  frame.histogram.resize_discarding(chunks_of(seen) * tiles);
  for_each_chunk(threads, seen, [&](std::size_t chunk, std::size_t begin, std::size_t end) {
    std::uint32_t* const count = frame.histogram.data() + chunk * tiles;
    std::fill_n(count, tiles, 0u);
    for (std::size_t i = begin; i < end; ++i) {
      if (i + kPrefetch < end) __builtin_prefetch(&frame.slots[static_cast<std::uint32_t>(frame.order[i + kPrefetch])]);
      const SlotRange slots = frame.slots[static_cast<std::uint32_t>(frame.order[i])];
      for (std::uint32_t slot = slots.begin; slot < slots.end; ++slot) ++count[frame.slot_tiles[slot]];
    }
  });
  frame.tile_begin.resize_discarding(tiles + 1);
  frame.tile_begin[tiles] = counts_to_places(frame.histogram, chunks_of(seen), tiles, frame.tile_begin.data());
  frame.entries.resize_discarding(frame.tile_begin[tiles]);
  for_each_chunk(threads, seen, [&](std::size_t chunk, std::size_t begin, std::size_t end) {
    std::uint32_t* const place = frame.histogram.data() + chunk * tiles;
    for (std::size_t i = begin; i < end; ++i) {
      const std::uint32_t g = static_cast<std::uint32_t>(frame.order[i]);
      const SlotRange slots = frame.slots[g];
      for (std::uint32_t slot = slots.begin; slot < slots.end; ++slot) {
        frame.entries[place[frame.slot_tiles[slot]]++] = {g, slot};
      }
    }
  });
}

// The bits of a group's tiles in rows or columns [begin, end) of it, where `unit` is one row or column.
std::uint32_t lines(int begin, int end, std::uint32_t unit, int shift) {
  std::uint32_t result = 0;
  for (int i = std::max(begin, 0); i < std::min(end, kGroupSize); ++i) result |= unit << (shift * i);
  return result;
}

}  // namespace

void find_tiles(Frame& frame, std::size_t begin, std::size_t end, std::int32_t* radii) {
  Buffer<std::uint32_t>& touched = frame.touched[begin / kChunk];
  touched.clear();
  const auto test = kernels().touched_tiles;
  for (std::size_t g = begin; g < end; ++g) {
    const std::uint32_t first = static_cast<std::uint32_t>(touched.size());
    if (frame.depth_keys[g] != 0) {
      const TileBox& box = frame.boxes[g];
      for (int row = box.y_begin; row < box.y_end; row += kGroupSize) {
        for (int column = box.x_begin; column < box.x_end; column += kGroupSize) {
          const std::uint32_t in_box = lines(0, box.x_end - column, 0x1111, 1) & lines(0, box.y_end - row, 0x000f, 4);
          for (std::uint32_t rest = in_box & test(frame.splats[g], frame.camera, column, row); rest != 0;
               rest &= rest - 1) {
            const int tile = std::countr_zero(rest);
            touched.push_back((row + tile / kGroupSize) * frame.tiles_x + column + tile % kGroupSize);
          }
        }
      }
      if (touched.size() == first) frame.depth_keys[g] = radii[g] = 0;
    }
    frame.slots[g] = {first, static_cast<std::uint32_t>(touched.size())};
  }
}

void sort_into_tiles(Frame& frame, int threads) {
  std::size_t slots = 0;
  frame.chunk_slots.resize_discarding(frame.chunks());
  for (std::size_t chunk = 0; chunk < frame.chunks(); ++chunk) {
    frame.chunk_slots[chunk] = static_cast<std::uint32_t>(slots);
    slots += frame.touched[chunk].size();
    if (slots > kMaxSlots) {
      throw std::length_error("the Gaussians touch more than 2^31 tiles in sum: draw fewer or smaller ones");
    }
  }
  frame.slot_tiles.resize_discarding(slots);
  parallel_for(threads, frame.chunks(), [&](std::size_t chunk) {
    const std::uint32_t first = frame.chunk_slots[chunk];
    std::copy_n(frame.touched[chunk].data(), frame.touched[chunk].size(), frame.slot_tiles.data() + first);
    for (std::size_t g = chunk * kChunk; g < std::min(frame.count, (chunk + 1) * kChunk); ++g) {
      frame.slots[g].begin += first;
      frame.slots[g].end += first;
    }
  });
  sort_by_depth(frame, threads);
  deal_to_tiles(frame, threads);
}

}  // namespace aa4d::raster

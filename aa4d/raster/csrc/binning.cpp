#include "binning.hpp"

#include <utility>

namespace aa4d {
namespace {

constexpr int kDigitBits = 11;
constexpr std::uint32_t kDigits = 1u << kDigitBits;

// Stable radix sort of the Gaussians that touch a tile, by the bits of their depth: positive floats order like integers.
// Equal depths stay in the order of their indices.
void sort_by_depth(Frame& frame) {
  const std::size_t count = frame.count;
  frame.order.resize_discarding(count);
  frame.order_other.resize_discarding(count);
  std::uint32_t* from = frame.order.data();
  std::uint32_t* to = frame.order_other.data();
  const std::uint32_t* keys = frame.depth_keys.data();
  std::uint32_t visible = 0;
  std::uint32_t smallest = ~0u, largest = 0;
  for (std::uint32_t g = 0; g < count; ++g) {
    if (frame.slot_begin[g] == frame.slot_begin[g + 1]) continue;
    from[visible++] = g;
    smallest = keys[g] < smallest ? keys[g] : smallest;
    largest = keys[g] > largest ? keys[g] : largest;
  }
  for (int shift = 0; visible > 0 && ((largest - smallest) >> shift) != 0; shift += kDigitBits) {
    std::uint32_t place[kDigits] = {};
    for (std::uint32_t i = 0; i < visible; ++i) ++place[((keys[from[i]] - smallest) >> shift) & (kDigits - 1)];
    std::uint32_t sum = 0;
    for (std::uint32_t& p : place) sum += std::exchange(p, sum);
    for (std::uint32_t i = 0; i < visible; ++i) to[place[((keys[from[i]] - smallest) >> shift) & (kDigits - 1)]++] = from[i];
    std::swap(from, to);
    if (shift + kDigitBits >= 32) break;
  }
  if (from != frame.order.data()) {
    for (std::uint32_t i = 0; i < visible; ++i) frame.order[i] = from[i];
  }
  frame.order.resize_discarding(visible);
}

}  // namespace

void sort_into_tiles(Frame& frame, int) {
  sort_by_depth(frame);
  const int tiles = frame.tiles();
  frame.tile_begin.resize_discarding(tiles + 1);
  for (int t = 0; t <= tiles; ++t) frame.tile_begin[t] = 0;
  for (const auto& chunk : frame.chunk_tiles) {
    for (std::size_t i = 0; i < chunk.size(); ++i) ++frame.tile_begin[chunk[i] + 1];
  }
  frame.cursor.resize_discarding(tiles);
  for (int t = 0; t < tiles; ++t) {
    frame.tile_begin[t + 1] += frame.tile_begin[t];
    frame.cursor[t] = frame.tile_begin[t];
  }
  frame.entries.resize_discarding(frame.slot_begin[frame.count]);
  for (std::size_t i = 0; i < frame.order.size(); ++i) {
    const std::uint32_t g = frame.order[i];
    const std::size_t chunk = g / kProjectionChunk;
    const std::uint32_t* touched = frame.chunk_tiles[chunk].data() - frame.slot_begin[chunk * kProjectionChunk];
    for (std::uint32_t slot = frame.slot_begin[g]; slot < frame.slot_begin[g + 1]; ++slot) {
      frame.entries[frame.cursor[touched[slot]]++] = {g, slot};
    }
  }
}

}  // namespace aa4d

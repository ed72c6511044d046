// Front-to-back alpha blending of one tile, block by block: all that a block needs of its pixels stays in registers
// while it walks along the splats that reach it.
#pragma once

#include "raster/reached_blocks.hpp"
#include "raster/splat_view.hpp"

namespace aa4d::raster::AA4D_ARCH {

// One bit for each block that has a pixel inside the image.
inline std::uint64_t blocks_inside(int pixels_x, int pixels_y) {
  std::uint64_t result = 0;
  for (int b = 0; b < kTileBlocks; ++b) {
    const bool inside = b % kRowBlocks * kBlockSize < pixels_x && b / kRowBlocks * kBlockSize < pixels_y;
    result |= static_cast<std::uint64_t>(inside) << b;
  }
  return result;
}

// A run of a tile's list, and for any block those of the run that reach it.
class ForwardBatch {
 public:
  // Before the first fill().
  static void prefetch_first(const TileList& list) {
    for (std::uint32_t i = 0; i < kPrefetch && i < list.count; ++i) prefetch(list, i);
  }

  // Takes entries from list.entries[first] on, and notes for the way back which of the blocks `alive` each of them
  // reaches. Returns how many.
  int fill(const TileList& list, std::uint32_t first, std::uint64_t alive) {
    const int taken = list.count - first < kSplats ? static_cast<int>(list.count - first) : kSplats;
    reached_ = 0;
    for (int e = 0; e < taken; ++e) {
      const std::uint32_t place = first + e;
      if (place + kPrefetch < list.count) prefetch(list, place + kPrefetch);
      views_[e].look(list, place);
      const std::uint64_t blocks = reached_blocks(list.splats[views_[e].gaussian], list.x, list.y) & alive;
      list.blocks[place] = blocks_[e] = blocks;
      reached_ |= blocks;
    }
    words_ = (taken + 15) / 16 * 16;
    for (int e = taken; e < words_; ++e) blocks_[e] = 0;
    return taken;
  }

  std::uint64_t reached() const { return reached_; }

  void select(int block) {
    count_ = 0;
    for (int e = 0; e < words_; e += 16) {
      count_ += append_lanes(words_with(blocks_ + e, std::uint64_t{1} << block), e, selected_ + count_);
    }
  }
  const std::uint32_t* begin() const { return selected_; }
  const std::uint32_t* end() const { return selected_ + count_; }
  const SplatView& view(std::uint32_t e) const { return views_[e]; }

 private:
  static constexpr int kSplats = 512;
  static constexpr std::uint32_t kPrefetch = 24;  // entries ahead: a tile's list points all over the splats

  static void prefetch(const TileList& list, std::uint32_t place) {
    __builtin_prefetch(&list.splats[list.entries[place].gaussian]);
  }

  SplatView views_[kSplats];
  alignas(64) std::uint64_t blocks_[kSplats];
  std::uint32_t selected_[kSplats + 16];  // with room for the appending store
  std::uint64_t reached_ = 0;
  int words_ = 0, count_ = 0;
};

inline void accumulate(float* sums, Float weight, Float value) { fma(weight, value, Float::load(sums)).store(sums); }

// Blends the batch's selected splats into the pixels from `p` on; `place` is that of the batch's first entry in the
// tile's list. `running` is the product of 1 - alpha, which tile.transmittance no longer follows once a pixel is
// finished. Returns whether any pixel is still unfinished.
template <bool kExtras>
bool blend(const ForwardTile& tile, const ForwardBatch& batch, std::int32_t place, int p, float* running) {
  const Float cutoff(tile.log2_min_alpha), min_transmittance(tile.min_transmittance);
  const Float max_alpha(static_cast<float>(kMaxAlpha)), one(1.0f);
  const Float x = Float::load(kGrid.pixel_x + p), y = Float::load(kGrid.pixel_y + p);
  std::int32_t* const pixel_end = tile.pixel_end + p;
  Float before = Float::load(running), left = Float::load(tile.transmittance + p);
  Float red = Float::load(tile.color[0] + p), green = Float::load(tile.color[1] + p),
        blue = Float::load(tile.color[2] + p);
  Mask unfinished = before > min_transmittance;
  for (const std::uint32_t* e = batch.begin(); e != batch.end() && any(unfinished); ++e) {
    const SplatView& view = batch.view(*e);
    const Float exponent = view.log2_alpha(view.u(x, y), view.w(y));
    const Mask passes = exponent >= cutoff;
    const Float alpha = zero_unless(passes, min(exp2_nonpositive(exponent), max_alpha));
    const Float after = fnma(alpha, before, before);
    unfinished = after > min_transmittance;  // never again once it is not, as `after` only falls
    const Float weight = zero_unless(unfinished, alpha * before);
    before = after;
    left = select(unfinished, after, left);
    store_where(passes & unfinished, pixel_end, place + static_cast<std::int32_t>(*e) + 1);
    red = fma(weight, Float(view.color[0]), red);
    green = fma(weight, Float(view.color[1]), green);
    blue = fma(weight, Float(view.color[2]), blue);
    if constexpr (kExtras) {
      if (tile.depth) {
        accumulate(tile.depth + p, weight, Float(view.depth));
        accumulate(tile.weight + p, weight, one);
      }
      const float* const features = tile.list.features + std::size_t{view.gaussian} * tile.list.feature_count;
      for (int c = 0; c < tile.list.feature_count; ++c) {
        accumulate(tile.features + c * kTilePixels + p, weight, Float(features[c]));
      }
    }
  }
  before.store(running);
  left.store(tile.transmittance + p);
  red.store(tile.color[0] + p);
  green.store(tile.color[1] + p);
  blue.store(tile.color[2] + p);
  return any(unfinished);
}

// kExtras: whether depth or features are wanted beside colour.
template <bool kExtras>
void forward_tile(const ForwardTile& tile) {
  const TileList& list = tile.list;
  std::uint64_t alive = blocks_inside(tile.pixels_x, tile.pixels_y);  // blocks that have an unfinished pixel
  alignas(64) float running[kTilePixels];
  for (int p = 0; p < kTilePixels; p += Float::kWidth) Float::load(tile.transmittance + p).store(running + p);
  ForwardBatch batch;
  ForwardBatch::prefetch_first(list);
  for (std::uint32_t done = 0; done < list.count && alive != 0;) {
    const int taken = batch.fill(list, done, alive);
    for (std::uint64_t rest = batch.reached(); rest != 0; rest &= rest - 1) {
      const int block = __builtin_ctzll(rest);
      batch.select(block);
      bool unfinished = false;
      for (int p = block * kBlockPixels; p < (block + 1) * kBlockPixels; p += Float::kWidth) {
        unfinished |= blend<kExtras>(tile, batch, static_cast<std::int32_t>(done), p, running + p);
      }
      alive &= ~(static_cast<std::uint64_t>(!unfinished) << block);
    }
    done += taken;
  }
}

}  // namespace aa4d::raster::AA4D_ARCH

// A run of a tile's list, laid out flat: first all views of its splats, then all blocks of pixels they reach. Splitting
// the work this way leaves no loop whose length the processor has to guess, which for small splats costs more than the
// arithmetic does.
#pragma once

#include "quarter_view.hpp"

namespace aa4d::AA4D_ARCH {

// A block of pixels that a splat may reach: the view in the upper bits, the block within the tile in the lower six.
struct BlockItem {
  std::uint32_t bits;

  int view() const { return bits >> 6; }
  int block() const { return bits % kTileBlocks; }
  int quarter_block() const { return bits % kQuarterBlocks; }
};

class Batch {
 public:
  // Before the first fill(), of the same run of entries.
  static void prefetch_first(const TileList& list, std::int64_t first, int step, std::int64_t count) {
    for (int i = 0; i < kPrefetch && i < count; ++i) prefetch(list, first + i * step);
  }

  // Takes entries from list.entries[first] on, `step` (1 or -1) apart, up to `count` of them. `wanted.any(entry,
  // quarter, place)` tells whether a quarter has blocks that the entry at a place adds to, and `wanted.blocks(entry,
  // quarter, place, splat, x, y)` which. Returns how many entries were taken, at least one.
  template <class Wanted>
  int fill(const TileList& list, std::int64_t first, int step, std::int64_t count, const Wanted& wanted) {
    std::uint16_t view_entry[kViews], view_quarter[kViews];
    int taken = 0, views = 0;
    for (; taken < count && taken < kEntries && views + kTileQuarters < kViews; ++taken) {
      const std::int64_t place = first + taken * step;
      if (taken + kPrefetch < count) prefetch(list, place + kPrefetch * step);
      for (int q = 0; q < kTileQuarters; ++q) {
        view_entry[views] = taken;
        view_quarter[views] = q;
        views += wanted.any(list.entries[place], q, place);
      }
      entry_views_[taken + 1] = views;
    }
    int items = 0;
    for (int v = 0; v < views; ++v) {
      const std::int64_t place = first + view_entry[v] * step;
      const int quarter = view_quarter[v];
      const int x = list.x + quarter % 2 * kQuarterSize, y = list.y + quarter / 2 * kQuarterSize;
      TileEntry& entry = list.entries[place];
      const Splat& splat = list.splats[entry.gaussian];
      QuarterView& view = views_[v];
      view.place = static_cast<std::int32_t>(place);
      view.gaussian = entry.gaussian;
      view.look(splat, x, y);
      items += append_lanes(wanted.blocks(entry, quarter, place, splat, x, y), v * kTileBlocks + quarter * kQuarterBlocks,
                            &items_[items].bits);
      view_items_[v + 1] = items;
    }
    item_count_ = items;
    return taken;
  }

  const QuarterView& view(const BlockItem& item) const { return views_[item.view()]; }

  // Of the whole batch, and of one entry of it.
  const BlockItem* begin() const { return items_; }
  const BlockItem* end() const { return items_ + item_count_; }
  const BlockItem* begin(int entry) const { return items_ + view_items_[entry_views_[entry]]; }
  const BlockItem* end(int entry) const { return items_ + view_items_[entry_views_[entry + 1]]; }

 private:
  static constexpr int kViews = 36, kEntries = 64;
  static constexpr int kPrefetch = 48;  // entries ahead: a tile's list points all over the splats

  static void prefetch(const TileList& list, std::int64_t place) {
    __builtin_prefetch(&list.splats[list.entries[place].gaussian]);
  }

  QuarterView views_[kViews];
  BlockItem items_[(kViews + 1) * kQuarterBlocks];  // the last row is room for the appending store
  int entry_views_[kEntries + 1] = {};              // how many views the entries before this one have
  int view_items_[kViews + 1] = {};                 // how many items the views before this one have
  int item_count_ = 0;
};

}  // namespace aa4d::AA4D_ARCH

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
  static constexpr int kViews = 32;
  static constexpr int kEntries = kViews - kTileQuarters + 1;

  // Before the first fill(), of the same run of entries.
  static void prefetch_first(const TileList& list, std::int64_t first, int step, std::int64_t count) {
    for (int i = 0; i < kPrefetch && i < count; ++i) prefetch(list, first + i * step);
  }

  // Takes entries from list.entries[first] on, `step` (1 or -1) apart, up to `count` of them; `wanted(quarter, place)`
  // gives the blocks of a quarter that matter to the entry at a place. Returns how many entries were taken.
  template <class Wanted>
  int fill(const TileList& list, std::int64_t first, int step, std::int64_t count, const Wanted& wanted) {
    std::uint16_t view_entry[kViews + kTileQuarters], view_quarter[kViews + kTileQuarters];
    int taken = 0, views = 0;
    for (; taken < count && views + kTileQuarters <= kViews; ++taken) {
      const TileEntry& entry = list.entries[first + taken * step];
      if (taken + kPrefetch < count) prefetch(list, first + (taken + kPrefetch) * step);
      for (int q = 0; q < kTileQuarters; ++q) {
        view_entry[views] = taken;
        view_quarter[views] = q;
        views += entry.quarters >> q & 1;
      }
    }
    int items = 0;
    for (int v = 0; v < views; ++v) {
      const std::int64_t place = first + view_entry[v] * step;
      const int quarter = view_quarter[v];
      QuarterView& view = views_[v];
      view.place = static_cast<std::int32_t>(place);
      view.gaussian = list.entries[place].gaussian;
      const std::uint32_t reached = view.look(list.splats[view.gaussian], list.x + quarter % 2 * kQuarterSize,
                                              list.y + quarter / 2 * kQuarterSize);
      items += append_lanes(reached & wanted(quarter, place), v * kTileBlocks + quarter * kQuarterBlocks, &items_[items].bits);
      item_end_[view_entry[v]] = items;
    }
    item_count_ = items;
    return taken;
  }

  const QuarterView& view(int i) const { return views_[i]; }
  const BlockItem* items_begin(int entry = 0) const { return items_ + (entry == 0 ? 0 : item_end_[entry - 1]); }
  const BlockItem* items_end(int entry) const { return items_ + item_end_[entry]; }
  const BlockItem* items_end() const { return items_ + item_count_; }

 private:
  static constexpr int kPrefetch = 2 * kEntries;  // entries ahead: a tile's list points all over the splats

  static void prefetch(const TileList& list, std::int64_t place) {
    __builtin_prefetch(&list.splats[list.entries[place].gaussian]);
  }

  QuarterView views_[kViews];
  BlockItem items_[(kViews + 1) * kQuarterBlocks];  // the last row is room for the appending store
  int item_end_[kEntries];
  int item_count_;
};

}  // namespace aa4d::AA4D_ARCH

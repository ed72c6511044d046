#include "raster/render.hpp"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <numeric>
#include <stdexcept>

#include "common/instruction_set.hpp"
#include "common/thread_pool.hpp"
#include "raster/binning.hpp"
#include "raster/kernels.hpp"

namespace aa4d::raster {
namespace {

// One value for each pixel of a tile, in the kernels' order: block by block.
struct alignas(64) Plane {
  float pixel[kTilePixels];
};

// One value for each pixel of a row of a tile, from left to right. Loops over a row run to its end, even where the
// image ends before: a loop of known length is the one that compilers turn into vectors.
struct alignas(64) Row {
  float pixel[kTileSize];
};

// The colours of those pixels.
struct alignas(64) ColorRow {
  float value[3 * kTileSize];
};

// The part of a plane that holds pixels [x, x + kBlockSize) of row y; x is a multiple of kBlockSize.
constexpr int place_in_plane(int x, int y) {
  return (y / kBlockSize * kRowBlocks + x / kBlockSize) * kBlockPixels + y % kBlockSize * kBlockSize;
}

void read_row(const float* plane, int y, Row& row) {
  for (int x = 0; x < kTileSize; x += kBlockSize) std::copy_n(plane + place_in_plane(x, y), kBlockSize, row.pixel + x);
}

void write_row(const Row& row, int y, float* plane) {
  for (int x = 0; x < kTileSize; x += kBlockSize) std::copy_n(row.pixel + x, kBlockSize, plane + place_in_plane(x, y));
}

// The part of a tile that lies inside the image.
struct TileWindow {
  int x, y, width, height;

  TileWindow(const Frame& frame, std::size_t tile)
      : x(static_cast<int>(tile % frame.tiles_x) * kTileSize),
        y(static_cast<int>(tile / frame.tiles_x) * kTileSize),
        width(std::min(kTileSize, frame.camera.width - x)),
        height(std::min(kTileSize, frame.camera.height - y)) {}

  // Of a row's first pixel in a row-major image.
  std::size_t place(const Frame& frame, int row) const {
    return static_cast<std::size_t>(y + row) * frame.camera.width + x;
  }
};

TileList list_of(const Scene& scene, Frame& frame, std::size_t tile) {
  TileList list;
  list.splats = frame.splats.data();
  list.entries = frame.entries.data() + frame.tile_begin[tile];
  list.blocks = frame.blocks.data() + frame.tile_begin[tile];
  list.count = frame.tile_begin[tile + 1] - frame.tile_begin[tile];
  list.x = static_cast<int>(tile % frame.tiles_x) * kTileSize;
  list.y = static_cast<int>(tile / frame.tiles_x) * kTileSize;
  list.features = scene.features;
  list.feature_count = scene.feature_count;
  return list;
}

void draw_tile(const Scene& scene, const Settings& settings, Frame& frame, std::size_t tile, const Image& image) {
  Plane color[3] = {}, depth, features[kMaxFeatures];
  std::fill_n(features, scene.feature_count, Plane{});
  float* const transmittance = frame.transmittance.data() + tile * kTilePixels;
  float* const weight = image.depth ? frame.weight.data() + tile * kTilePixels : nullptr;
  if (image.depth) {
    depth = {};
    std::fill_n(weight, kTilePixels, 0.0f);
  }
  std::fill_n(frame.pixel_end.data() + tile * kTilePixels, kTilePixels, 0);
  const TileWindow window(frame, tile);
  for (int y = 0; y < kTileSize; ++y) {
    Row row = {};  // outside the image nothing is ever added
    if (y < window.height) std::fill_n(row.pixel, window.width, 1.0f);
    write_row(row, y, transmittance);
  }
  ForwardTile work;
  work.list = list_of(scene, frame, tile);
  work.pixels_x = window.width;
  work.pixels_y = window.height;
  work.log2_min_alpha = static_cast<float>(std::log2(settings.min_alpha));
  work.min_transmittance = static_cast<float>(settings.min_transmittance);
  work.transmittance = transmittance;
  work.pixel_end = frame.pixel_end.data() + tile * kTilePixels;
  for (int k = 0; k < 3; ++k) work.color[k] = color[k].pixel;
  work.depth = image.depth ? depth.pixel : nullptr;
  work.weight = weight;
  work.features = features[0].pixel;
  kernels().forward_tile(work);

  for (int y = 0; y < window.height; ++y) {
    const std::size_t first = window.place(frame, y);
    Row left, values[3], sum;
    ColorRow blended;
    read_row(transmittance, y, left);
    for (int k = 0; k < 3; ++k) read_row(color[k].pixel, y, values[k]);
    for (int x = 0; x < kTileSize; ++x) {
      for (int k = 0; k < 3; ++k) blended.value[3 * x + k] = values[k].pixel[x] + left.pixel[x] * scene.background[k];
    }
    for (int x = 0; x < kTileSize; ++x) left.pixel[x] = 1 - left.pixel[x];
    std::copy_n(blended.value, 3 * window.width, image.color + 3 * first);
    std::copy_n(left.pixel, window.width, image.alpha + first);
    if (image.depth) {
      read_row(depth.pixel, y, values[0]);
      read_row(weight, y, sum);
      for (int x = 0; x < window.width; ++x) {
        image.depth[first + x] = sum.pixel[x] > 0 ? values[0].pixel[x] / sum.pixel[x] : 0;
      }
    }
    for (int k = 0; k < scene.feature_count; ++k) {
      read_row(features[k].pixel, y, values[0]);
      for (int x = 0; x < window.width; ++x) image.features[(first + x) * scene.feature_count + k] = values[0].pixel[x];
    }
  }
}

void tile_backward(const Scene& scene, const Settings& settings, Frame& frame, std::size_t tile,
                   const ImageGradient& image, const SceneGradient& wanted) {
  const int feature_count = image.features ? scene.feature_count : 0;
  Plane color[3], depth, depth_value, behind, transmittance, features[kMaxFeatures];
  const float* const left = frame.transmittance.data() + tile * kTilePixels;
  std::copy_n(left, kTilePixels, transmittance.pixel);
  constexpr int kSums = 8;  // side by side
  double background[3][kSums] = {};
  const TileWindow window(frame, tile);
  for (int y = 0; y < kTileSize; ++y) {
    // Outside the image every gradient is zero.
    const std::size_t first = window.place(frame, y);
    const int width = y < window.height ? window.width : 0;
    Row row_left, values[3], row_behind = {};
    ColorRow gradient = {};
    read_row(left, y, row_left);
    if (image.alpha) std::copy_n(image.alpha + first, width, row_behind.pixel);
    if (image.color) std::copy_n(image.color + 3 * first, 3 * width, gradient.value);
    for (int x = 0; x < kTileSize; ++x) {
      for (int k = 0; k < 3; ++k) values[k].pixel[x] = gradient.value[3 * x + k];
    }
    for (int x = 0; x < kTileSize; ++x) {
      float sum = -row_behind.pixel[x];
      for (int k = 0; k < 3; ++k) sum += scene.background[k] * values[k].pixel[x];
      row_behind.pixel[x] = row_left.pixel[x] * sum;
    }
    for (int k = 0; k < 3; ++k) {
      for (int x = 0; x < kTileSize; ++x) {
        background[k][x % kSums] += static_cast<double>(row_left.pixel[x]) * values[k].pixel[x];
      }
    }
    for (int k = 0; k < 3; ++k) write_row(values[k], y, color[k].pixel);
    write_row(row_behind, y, behind.pixel);
    if (image.depth) {
      // d(sum(w z) / sum(w)) = sum((z - depth) dw + w dz) / sum(w)
      Row weight, gradient = {}, value = {};
      read_row(frame.weight.data() + tile * kTilePixels, y, weight);
      for (int x = 0; x < width; ++x) {
        gradient.pixel[x] = weight.pixel[x] > 0 ? image.depth[first + x] / weight.pixel[x] : 0;
        value.pixel[x] = image.depth_value[first + x];
      }
      write_row(gradient, y, depth.pixel);
      write_row(value, y, depth_value.pixel);
    }
    for (int k = 0; k < feature_count; ++k) {
      Row gradient = {};
      for (int x = 0; x < width; ++x) gradient.pixel[x] = image.features[(first + x) * feature_count + k];
      write_row(gradient, y, features[k].pixel);
    }
  }
  for (int k = 0; k < 3; ++k) {
    frame.partial_sums[3 * tile + k] = std::accumulate(background[k], background[k] + kSums, 0.0);
  }

  BackwardTile work;
  work.list = list_of(scene, frame, tile);
  work.list.feature_count = feature_count;
  work.log2_min_alpha = static_cast<float>(std::log2(settings.min_alpha));
  work.pixel_end = frame.pixel_end.data() + tile * kTilePixels;
  for (int k = 0; k < 3; ++k) work.color[k] = color[k].pixel;
  work.depth = image.depth ? depth.pixel : nullptr;
  work.depth_value = depth_value.pixel;
  work.features = features[0].pixel;
  work.transmittance = transmittance.pixel;
  work.behind = behind.pixel;
  work.absolute = wanted.screen_absolute != nullptr;
  work.squared = wanted.sensitivity != nullptr;
  work.gradients = frame.gradients.data();
  work.feature_gradients = frame.feature_gradients.data();
  const std::uint32_t end = kernels().backward_tile(work);

  for (std::uint32_t place = frame.tile_begin[tile] + end; place < frame.tile_begin[tile + 1]; ++place) {
    const std::size_t slot = frame.entries[place].slot;
    frame.gradients[slot] = SplatGradient{};
    std::fill_n(frame.feature_gradients.data() + slot * feature_count, feature_count, 0.0f);
  }
}

ProjectionRange chunk_range(const Scene& scene, const Frame& frame, const Settings& settings, std::size_t chunk) {
  return {&scene, &frame.camera, &settings, chunk * kChunk, std::min(frame.count, (chunk + 1) * kChunk)};
}

// Adds up partial sums in their order, whatever thread made them.
void add_up(const double* parts, std::size_t count, int width, float* out) {
  for (int k = 0; k < width; ++k) {
    double sum = 0;
    for (std::size_t i = 0; i < count; ++i) sum += parts[i * width + k];
    out[k] = static_cast<float>(sum);
  }
}

}  // namespace

const Kernels& kernels() {
  static const Kernels& chosen = []() -> const Kernels& {
    [[maybe_unused]] const InstructionSet set = choose_instruction_set();
#if defined(__x86_64__)
    if (set == InstructionSet::kAvx512) return kAvx512Kernels;
    if (set == InstructionSet::kAvx2) return kAvx2Kernels;
#endif
    return kPortableKernels;
  }();
  return chosen;
}

FramePtr render(const Scene& scene, const CameraModel& camera, const Settings& settings, const Image& image,
                std::int32_t* radii) {
  if (scene.count >= kMaxGaussians) throw std::length_error("there are more than 2^28 Gaussians");
  FramePtr frame = acquire_frame();
  frame->camera = camera;
  frame->count = scene.count;
  frame->tiles_x = (camera.width + kTileSize - 1) / kTileSize;
  frame->tiles_y = (camera.height + kTileSize - 1) / kTileSize;
  frame->splats.resize_discarding(scene.count);
  frame->boxes.resize_discarding(scene.count);
  frame->depth_keys.resize_discarding(scene.count);
  frame->slots.resize_discarding(scene.count);
  frame->touched.resize(std::max(frame->touched.size(), frame->chunks()));
  std::atomic<bool> finite = true;
  parallel_for(settings.threads, frame->chunks(), [&](std::size_t chunk) {
    const ProjectionRange range = chunk_range(scene, *frame, settings, chunk);
    if (!kernels().project(range, *frame, radii)) finite = false;
    find_tiles(*frame, range.begin, range.end, radii);
  });
  if (!finite && !settings.mask_invalid) return nullptr;
  sort_into_tiles(*frame, settings.threads);

  frame->blocks.resize_discarding(frame->entries.size());
  const std::size_t tiles = frame->tiles();
  frame->transmittance.resize_discarding(tiles * kTilePixels);
  frame->pixel_end.resize_discarding(tiles * kTilePixels);
  if (image.depth) frame->weight.resize_discarding(tiles * kTilePixels);
  parallel_for(settings.threads, tiles, [&](std::size_t tile) { draw_tile(scene, settings, *frame, tile, image); });
  return frame;
}

void render_backward(const Scene& scene, const Settings& settings, Frame& frame, const ImageGradient& image,
                     const SceneGradient& gradient) {
  const std::size_t tiles = frame.tiles(), chunks = frame.chunks();
  frame.gradients.resize_discarding(frame.entries.size());
  frame.feature_gradients.resize_discarding(image.features ? frame.entries.size() * scene.feature_count : 0);
  frame.partial_sums.resize_discarding(std::max(tiles * 3, chunks * kPoseSums));
  parallel_for(settings.threads, tiles,
               [&](std::size_t tile) { tile_backward(scene, settings, frame, tile, image, gradient); });
  add_up(frame.partial_sums.data(), tiles, 3, gradient.background);
  parallel_for(settings.threads, chunks, [&](std::size_t chunk) {
    double* const pose = gradient.viewmat ? frame.partial_sums.data() + chunk * kPoseSums : nullptr;
    kernels().project_backward(chunk_range(scene, frame, settings, chunk), frame, gradient, pose);
  });
  if (gradient.viewmat) {
    float pose[kPoseSums];
    add_up(frame.partial_sums.data(), chunks, kPoseSums, pose);
    for (int i = 0; i < 3; ++i) {
      std::copy_n(pose + 3 * i, 3, gradient.viewmat + 4 * i);
      gradient.viewmat[4 * i + 3] = pose[9 + i];
    }
    std::fill_n(gradient.viewmat + 12, 4, 0.0f);
  }
}

std::uint64_t count_pairs(const Settings& settings, Frame& frame) {
  std::uint64_t pairs = 0;
  for (std::size_t tile = 0; tile < static_cast<std::size_t>(frame.tiles()); ++tile) {
    BackwardTile work{};
    work.list = list_of(Scene{}, frame, tile);
    work.log2_min_alpha = static_cast<float>(std::log2(settings.min_alpha));
    work.pixel_end = frame.pixel_end.data() + tile * kTilePixels;
    pairs += kernels().count_pairs(work);
  }
  return pairs;
}

}  // namespace aa4d::raster

#include "render.hpp"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdlib>
#include <stdexcept>
#include <string>

#include "binning.hpp"
#include "kernels.hpp"
#include "thread_pool.hpp"

namespace aa4d {
namespace {

struct alignas(64) Plane {
  float pixel[kTilePixels];
};

// Calls body(place in a plane, place in a row-major image) for every pixel of the tile that lies inside the image.
template <class Body>
void for_each_pixel(const Frame& frame, std::size_t tile, const Body& body) {
  const int x0 = tile % frame.tiles_x * kTileSize, y0 = tile / frame.tiles_x * kTileSize;
  const int width = std::min(kTileSize, frame.camera.width - x0), height = std::min(kTileSize, frame.camera.height - y0);
  for (int y = 0; y < height; ++y) {
    const std::size_t row = static_cast<std::size_t>(y0 + y) * frame.camera.width + x0;
    for (int x = 0; x < width; ++x) {
      const int quarter = y / kQuarterSize * 2 + x / kQuarterSize;
      const int block = y % kQuarterSize / kBlockSize * (kQuarterSize / kBlockSize) + x % kQuarterSize / kBlockSize;
      const int place = (quarter * kQuarterBlocks + block) * kBlockPixels + y % kBlockSize * kBlockSize + x % kBlockSize;
      body(place, row + x);
    }
  }
}

TileList list_of(const Scene& scene, const Frame& frame, std::size_t tile) {
  TileList list;
  list.splats = frame.splats.data();
  list.entries = frame.entries.data() + frame.tile_begin[tile];
  list.count = frame.tile_begin[tile + 1] - frame.tile_begin[tile];
  list.x = static_cast<int>(tile % frame.tiles_x) * kTileSize;
  list.y = static_cast<int>(tile / frame.tiles_x) * kTileSize;
  list.features = scene.features;
  list.feature_count = scene.feature_count;
  return list;
}

void draw_tile(const Scene& scene, const Settings& settings, Frame& frame, std::size_t tile, const Image& image) {
  Plane color[3] = {}, depth = {}, features[kMaxFeatures];
  std::fill_n(features, scene.feature_count, Plane{});
  float* const transmittance = frame.transmittance.data() + tile * kTilePixels;
  float* const weight = image.depth ? frame.weight.data() + tile * kTilePixels : nullptr;
  std::fill_n(transmittance, kTilePixels, 0.0f);  // outside the image nothing is ever added
  std::fill_n(frame.pixel_end.data() + tile * kTilePixels, kTilePixels, 0);
  if (weight) std::fill_n(weight, kTilePixels, 0.0f);
  for_each_pixel(frame, tile, [&](int place, std::size_t) { transmittance[place] = 1; });
  ForwardTile work;
  work.list = list_of(scene, frame, tile);
  work.pixels_x = frame.camera.width - work.list.x;
  work.pixels_y = frame.camera.height - work.list.y;
  work.log2_min_alpha = static_cast<float>(std::log2(settings.min_alpha));
  work.min_transmittance = static_cast<float>(settings.min_transmittance);
  work.transmittance = transmittance;
  work.pixel_end = frame.pixel_end.data() + tile * kTilePixels;
  for (int k = 0; k < 3; ++k) work.color[k] = color[k].pixel;
  work.depth = image.depth ? depth.pixel : nullptr;
  work.weight = weight;
  work.features = features[0].pixel;
  kernels().forward_tile(work);

  for_each_pixel(frame, tile, [&](int place, std::size_t pixel) {
    const float left = std::fabs(transmittance[place]);
    transmittance[place] = left;
    for (int k = 0; k < 3; ++k) image.color[3 * pixel + k] = color[k].pixel[place] + left * scene.background[k];
    image.alpha[pixel] = 1 - left;
    if (image.depth) image.depth[pixel] = weight[place] > 0 ? depth.pixel[place] / weight[place] : 0;
    for (int k = 0; k < scene.feature_count; ++k) {
      image.features[pixel * scene.feature_count + k] = features[k].pixel[place];
    }
  });
}

void tile_backward(const Scene& scene, const Settings& settings, Frame& frame, std::size_t tile,
                   const ImageGradient& image, bool absolute) {
  const int feature_count = image.features ? scene.feature_count : 0;
  Plane color[3] = {}, depth = {}, depth_value = {}, behind = {}, transmittance = {}, features[kMaxFeatures];
  std::fill_n(features, feature_count, Plane{});
  double background[3] = {};
  for_each_pixel(frame, tile, [&](int place, std::size_t pixel) {
    const float left = frame.transmittance[tile * kTilePixels + place];
    if (image.depth) {
      // d(sum(w z) / sum(w)) = sum((z - depth) dw + w dz) / sum(w)
      const float weight = frame.weight[tile * kTilePixels + place];
      depth.pixel[place] = weight > 0 ? image.depth[pixel] / weight : 0;
      depth_value.pixel[place] = image.depth_value[pixel];
    }
    for (int k = 0; k < feature_count; ++k) features[k].pixel[place] = image.features[pixel * feature_count + k];
    float sum = image.alpha ? -image.alpha[pixel] : 0;
    for (int k = 0; k < 3; ++k) {
      const float g = image.color ? image.color[3 * pixel + k] : 0;
      color[k].pixel[place] = g;
      sum += scene.background[k] * g;
      background[k] += static_cast<double>(left) * g;
    }
    transmittance.pixel[place] = left;
    behind.pixel[place] = left * sum;
  });
  std::copy_n(background, 3, frame.partial_sums.data() + 3 * tile);

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
  work.absolute = absolute;
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
    const char* const wanted = std::getenv("AA4D_SIMD");
    const std::string name = wanted ? wanted : "";
#if defined(__x86_64__)
    const bool avx512 = __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512vl") &&
                        __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512bw");
    const bool avx2 = __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma");
    if (avx512 && (name.empty() || name == "avx512")) return kAvx512Kernels;
    if (avx2 && (name.empty() || name == "avx2")) return kAvx2Kernels;
#endif
    if (name.empty() || name == "portable") return kPortableKernels;
    throw std::invalid_argument("AA4D_SIMD=" + name + ": this machine has no such kernels; use avx512, avx2 or portable");
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
  std::atomic<bool> finite = true;
  parallel_for(settings.threads, frame->chunks(), [&](std::size_t chunk) {
    const ProjectionRange range = chunk_range(scene, *frame, settings, chunk);
    if (!kernels().project(range, *frame, radii)) finite = false;
  });
  if (!finite && !settings.mask_invalid) return nullptr;
  sort_into_tiles(*frame, radii, settings.threads);

  const std::size_t tiles = frame->tiles();
  frame->transmittance.resize_discarding(tiles * kTilePixels);
  frame->pixel_end.resize_discarding(tiles * kTilePixels);
  if (image.depth) frame->weight.resize_discarding(tiles * kTilePixels);
  parallel_for(settings.threads, tiles,
               [&](std::size_t tile) { draw_tile(scene, settings, *frame, tile, image); });
  return frame;
}

void render_backward(const Scene& scene, const Settings& settings, Frame& frame, const ImageGradient& image,
                     const SceneGradient& gradient) {
  const std::size_t tiles = frame.tiles(), chunks = frame.chunks();
  frame.gradients.resize_discarding(frame.entries.size());
  frame.feature_gradients.resize_discarding(image.features ? frame.entries.size() * scene.feature_count : 0);
  frame.partial_sums.resize_discarding(std::max(tiles * 3, chunks * kPoseSums));
  parallel_for(settings.threads, tiles, [&](std::size_t tile) {
    tile_backward(scene, settings, frame, tile, image, gradient.screen_absolute != nullptr);
  });
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

std::uint64_t count_pairs(const Settings& settings, const Frame& frame) {
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

}  // namespace aa4d

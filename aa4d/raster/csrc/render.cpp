#include "render.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <limits>
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
void for_each_pixel(const Frame& frame, int tile, const Body& body) {
  const int x0 = tile % frame.tiles_x * kTileSize, y0 = tile / frame.tiles_x * kTileSize;
  const int width = std::min(kTileSize, frame.camera.width - x0), height = std::min(kTileSize, frame.camera.height - y0);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const int block = y / kBlockSize * (kTileSize / kBlockSize) + x / kBlockSize;
      const int place = block * kBlockPixels + y % kBlockSize * kBlockSize + x % kBlockSize;
      body(place, static_cast<std::size_t>(y0 + y) * frame.camera.width + x0 + x);
    }
  }
}

TileList list_of(const Frame& frame, int tile) {
  return {frame.splats.data(), frame.entries.data() + frame.tile_begin[tile],
          frame.tile_begin[tile + 1] - frame.tile_begin[tile], tile % frame.tiles_x * kTileSize,
          tile / frame.tiles_x * kTileSize};
}

void forward_one(Frame& frame, int tile, const double background[3], const Settings& settings, const Image& image) {
  Plane color[3] = {}, depth = {};
  float* transmittance = frame.transmittance.data() + static_cast<std::size_t>(tile) * kTilePixels;
  std::int32_t* stop = frame.stop.data() + static_cast<std::size_t>(tile) * kTilePixels;
  std::fill_n(transmittance, kTilePixels, 0.0f);  // outside the image nothing is ever added
  std::fill_n(stop, kTilePixels, 0);
  for_each_pixel(frame, tile, [&](int place, std::size_t) {
    transmittance[place] = 1;
    stop[place] = std::numeric_limits<std::int32_t>::max();
  });
  ForwardTile work;
  work.list = list_of(frame, tile);
  work.pixels_x = frame.camera.width - work.list.x;
  work.pixels_y = frame.camera.height - work.list.y;
  work.log2_min_alpha = static_cast<float>(std::log2(settings.min_alpha));
  work.min_transmittance = static_cast<float>(settings.min_transmittance);
  work.transmittance = transmittance;
  work.stop = stop;
  for (int k = 0; k < 3; ++k) work.color[k] = color[k].pixel;
  work.depth = image.depth ? depth.pixel : nullptr;
  frame.tile_end[tile] = kernels().forward_tile(work);

  const float behind[3] = {static_cast<float>(background[0]), static_cast<float>(background[1]),
                           static_cast<float>(background[2])};
  for_each_pixel(frame, tile, [&](int place, std::size_t pixel) {
    const float left = std::fabs(transmittance[place]);
    transmittance[place] = left;
    for (int k = 0; k < 3; ++k) image.color[3 * pixel + k] = color[k].pixel[place] + left * behind[k];
    image.alpha[pixel] = 1 - left;
    if (image.depth) image.depth[pixel] = left < 1 ? depth.pixel[place] / (1 - left) : 0;
  });
}

void backward_one(Frame& frame, int tile, const double background[3], const Settings& settings,
                  const ImageGradient& image) {
  Plane color[3] = {}, depth = {}, behind = {}, transmittance = {};
  const float* final_transmittance = frame.transmittance.data() + static_cast<std::size_t>(tile) * kTilePixels;
  const std::int32_t* stop = frame.stop.data() + static_cast<std::size_t>(tile) * kTilePixels;
  const float back[3] = {static_cast<float>(background[0]), static_cast<float>(background[1]),
                         static_cast<float>(background[2])};
  double background_sum[3] = {};
  for_each_pixel(frame, tile, [&](int place, std::size_t pixel) {
    const float left = final_transmittance[place];
    float alpha_gradient = image.alpha ? image.alpha[pixel] : 0;
    if (image.depth && left < 1) {
      // depth = sum(w z) / sum(w), and sum(w) is alpha.
      depth.pixel[place] = image.depth[pixel] / (1 - left);
      alpha_gradient -= depth.pixel[place] * image.depth_of[pixel];
    }
    float sum = -alpha_gradient;
    for (int k = 0; k < 3; ++k) {
      const float g = image.color ? image.color[3 * pixel + k] : 0;
      color[k].pixel[place] = g;
      sum += back[k] * g;
      background_sum[k] += static_cast<double>(left) * g;
    }
    transmittance.pixel[place] = left;
    behind.pixel[place] = left * sum;
  });
  for (int k = 0; k < 3; ++k) frame.background_gradient[3 * tile + k] = background_sum[k];

  BackwardTile work;
  work.list = list_of(frame, tile);
  const std::uint32_t all = work.list.count;
  work.list.count = frame.tile_end[tile];
  work.log2_min_alpha = static_cast<float>(std::log2(settings.min_alpha));
  work.stop = stop;
  for (int k = 0; k < 3; ++k) work.color_gradient[k] = color[k].pixel;
  work.depth_gradient = image.depth ? depth.pixel : nullptr;
  work.transmittance = transmittance.pixel;
  work.behind = behind.pixel;
  work.gradients = frame.gradients.data();
  kernels().backward_tile(work);
  for (std::uint32_t i = work.list.count; i < all; ++i) frame.gradients[work.list.entries[i].slot] = SplatGradient{};
}

}  // namespace

const Kernels& kernels() {
  static const Kernels& chosen = []() -> const Kernels& {
    const char* wanted = std::getenv("AA4D_SIMD");
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

FramePtr render(const Scene& scene, const CameraModel& camera, const double background[3], const Settings& settings,
                const Image& image, std::int32_t* radii) {
  FramePtr frame = acquire_frame();
  frame->camera = camera;
  frame->tiles_x = (camera.width + kTileSize - 1) / kTileSize;
  frame->tiles_y = (camera.height + kTileSize - 1) / kTileSize;
  project(scene, *frame, settings.min_alpha, radii, settings.threads);
  sort_into_tiles(*frame, settings.threads);

  const std::size_t tiles = frame->tiles();
  frame->transmittance.resize_discarding(tiles * kTilePixels);
  frame->stop.resize_discarding(tiles * kTilePixels);
  frame->tile_end.resize_discarding(tiles);
  parallel_for(settings.threads, tiles, [&](std::size_t tile) {
    forward_one(*frame, static_cast<int>(tile), background, settings, image);
  });
  return frame;
}

void render_backward(const Scene& scene, Frame& frame, const double background[3], const Settings& settings,
                     const ImageGradient& image, const SceneGradient& gradient, double background_gradient[3]) {
  const std::size_t tiles = frame.tiles();
  frame.gradients.resize_discarding(frame.entries.size());
  frame.background_gradient.resize_discarding(tiles * 3);
  parallel_for(settings.threads, tiles, [&](std::size_t tile) {
    backward_one(frame, static_cast<int>(tile), background, settings, image);
  });
  for (int k = 0; k < 3; ++k) {
    background_gradient[k] = 0;
    for (std::size_t tile = 0; tile < tiles; ++tile) background_gradient[k] += frame.background_gradient[3 * tile + k];
  }
  project_backward(scene, frame, gradient, settings.threads);
}

}  // namespace aa4d

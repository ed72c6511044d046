// A whole image, forward and backward: projection, lists, and the tiles in parallel.
#pragma once

#include "frame.hpp"
#include "projection.hpp"

namespace aa4d {

struct Settings {
  double min_alpha;
  double min_transmittance;
  int threads;
};

// Row-major images; depth may be null.
struct Image {
  float* color;  // [H, W, 3]
  float* alpha;  // [H, W]
  float* depth;  // [H, W]
};

struct ImageGradient {
  const float* color;
  const float* alpha;
  const float* depth;     // gradient, and
  const float* depth_of;  // the depth that was rendered
};

FramePtr render(const Scene& scene, const CameraModel& camera, const double background[3], const Settings& settings,
                const Image& image, std::int32_t* radii);

void render_backward(const Scene& scene, Frame& frame, const double background[3], const Settings& settings,
                     const ImageGradient& image, const SceneGradient& gradient, double background_gradient[3]);

}  // namespace aa4d

// What the caller passes in and gets back, as plain arrays. Pixel (column i, row j) has its centre at (i + 0.5, j +
// 0.5).
#pragma once

#include <cstddef>
#include <cstdint>

namespace aa4d::raster {

struct CameraModel {
  double rotation[9];  // world to camera, row by row
  double translation[3];
  double fx, fy, cx, cy;
  double near;
  int width, height;
};

struct Scene {
  std::size_t count;
  const float* means;        // [N, 3]
  const float* quaternions;  // [N, 4] w x y z
  const float* scales;       // [N, 3]
  const float* opacities;    // [N]
  const float* colors;       // [N, 3]
  const float* features;     // [N, F] or null
  int feature_count;
  float background[3];
};

// Where the gradients of the inputs go; laid out like the inputs. The last five may be null.
struct SceneGradient {
  float* means;
  float* quaternions;
  float* scales;
  float* opacities;
  float* colors;
  float* background;       // [3]
  float* screen;           // [N] norm of the gradient of the projected centre, in normalised device units
  float* screen_absolute;  // [N] the same with every pixel's share taken absolutely
  float* sensitivity;      // [N] sum over pixels of (opacity dL/d(alpha))^2
  float* features;
  float* viewmat;          // [4, 4]
};

struct Settings {
  double min_alpha;
  double min_transmittance;
  bool antialiased;
  bool mask_invalid;  // a Gaussian that is not finite is left out rather than refused
  int threads;
};

// Row-major images; depth and features may be null.
struct Image {
  float* color;     // [H, W, 3]
  float* alpha;     // [H, W]
  float* depth;     // [H, W]
  float* features;  // [H, W, F]
};

// The gradients of an image, each of which may be null; `depth_value` is the depth that was rendered.
struct ImageGradient {
  const float* color;
  const float* alpha;
  const float* depth;
  const float* depth_value;
  const float* features;
};

}  // namespace aa4d::raster

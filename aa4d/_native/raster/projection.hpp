// From Gaussians in space to ellipses on the screen: EWA splatting (Zwicker et al. 2002, section 6), several at a time.
#pragma once

#include "raster/kernels.hpp"
#include "raster/lanes.hpp"

namespace aa4d::raster::AA4D_ARCH {

// alpha = o exp(-z.z / 2) = 2^(log2 o - u^2 - w^2), where (u, w) = sqrt(kWhitening) z and z is the pixel in the frame
// in which the Gaussian is round.
inline constexpr double kWhitening = 0.72134752044448170;  // 1 / (2 ln 2)
inline constexpr double kUnwhitening = 1.3862943611198906;  // 2 ln 2
inline constexpr double kRootWhitening = 0.84932180028801904;

// Everything between the inputs and the ellipse; the backward pass computes it again rather than store it.
struct Projection {
  Doubles mean[3], camera[3];  // the centre in the world and in the camera's frame
  Doubles inverse_z;
  Doubles slope_x, slope_y;  // x / z and y / z, clamped
  Longs free_x, free_y;  // not clamped
  Doubles quaternion[4], inverse_norm;
  Longs normalised;  // long enough for a direction
  Doubles rotation[3][3], scale[3];
  Doubles A[2][3];  // Jacobian of the perspective times world-to-camera rotation
  Doubles B[2][3];  // A times the Gaussian's rotation
  Doubles V[2][3];  // B times the scales: the covariance is V V^T + dilation
  Doubles cross[3];  // of V's rows
  Doubles cov_xx, cov_xy, cov_yy, det;
  Doubles l11, l21, l22;  // see Splat
  Doubles opacity, compensation;
  Longs finite, visible;  // every input is finite; and it is in front of the camera and not too faint
  Longs compensated;  // compensation depends on the covariance

  void compute(const ProjectionRange& range, std::size_t begin) {
    const Scene& scene = *range.scene;
    const CameraModel& cam = *range.camera;
    const std::size_t last = range.end - 1;
    Doubles total{};  // times zero, this is zero unless an input is infinite or not a number
    for (int k = 0; k < 3; ++k) total += mean[k] = load_column(scene.means, 3, k, begin, last);
    for (int k = 0; k < 4; ++k) total += quaternion[k] = load_column(scene.quaternions, 4, k, begin, last);
    for (int k = 0; k < 3; ++k) total += scale[k] = load_column(scene.scales, 3, k, begin, last);
    total += opacity = load_column(scene.opacities, 1, 0, begin, last);
    finite = total * 0 == 0;

    for (int i = 0; i < 3; ++i) {
      const double* row = cam.rotation + 3 * i;
      camera[i] = row[0] * mean[0] + row[1] * mean[1] + row[2] * mean[2] + cam.translation[i];
    }
    visible = finite & (camera[2] >= cam.near);
    inverse_z = 1 / camera[2];

    // Outside the frustum and its margin the linearisation explodes; it is taken at the margin instead.
    const double margin_x = kFrustumMargin * 0.5 * cam.width / cam.fx,
                 margin_y = kFrustumMargin * 0.5 * cam.height / cam.fy;
    const Doubles x_over_z = camera[0] * inverse_z, y_over_z = camera[1] * inverse_z;
    slope_x = limit(x_over_z, -(cam.cx / cam.fx + margin_x), (cam.width - cam.cx) / cam.fx + margin_x);
    slope_y = limit(y_over_z, -(cam.cy / cam.fy + margin_y), (cam.height - cam.cy) / cam.fy + margin_y);
    free_x = slope_x == x_over_z;
    free_y = slope_y == y_over_z;

    compute_rotation();
    const Doubles jx = cam.fx * inverse_z, jy = cam.fy * inverse_z;
    for (int k = 0; k < 3; ++k) {
      A[0][k] = jx * (cam.rotation[k] - slope_x * cam.rotation[6 + k]);
      A[1][k] = jy * (cam.rotation[3 + k] - slope_y * cam.rotation[6 + k]);
    }
    for (int i = 0; i < 2; ++i) {
      for (int k = 0; k < 3; ++k) {
        B[i][k] = A[i][0] * rotation[0][k] + A[i][1] * rotation[1][k] + A[i][2] * rotation[2][k];
        V[i][k] = B[i][k] * scale[k];
      }
    }
    compute_ellipse();
    compute_compensation(range.settings->antialiased);
    visible &= opacity * compensation >= range.settings->min_alpha;
    visible &= det < 1e300;  // beyond, infinities would follow; nothing of this size can be told from a flat colour
  }

 private:
  void compute_rotation() {
    const Doubles norm = square_root(quaternion[0] * quaternion[0] + quaternion[1] * quaternion[1] +
                                     quaternion[2] * quaternion[2] + quaternion[3] * quaternion[3]);
    normalised = norm > kMinQuaternionNorm;
    inverse_norm = 1 / larger(norm, splat(kMinQuaternionNorm));
    for (Doubles& q : quaternion) q *= inverse_norm;
    const auto& [w, x, y, z] = quaternion;
    rotation[0][0] = 1 - 2 * (y * y + z * z);
    rotation[0][1] = 2 * (x * y - w * z);
    rotation[0][2] = 2 * (x * z + w * y);
    rotation[1][0] = 2 * (x * y + w * z);
    rotation[1][1] = 1 - 2 * (x * x + z * z);
    rotation[1][2] = 2 * (y * z - w * x);
    rotation[2][0] = 2 * (x * z - w * y);
    rotation[2][1] = 2 * (y * z + w * x);
    rotation[2][2] = 1 - 2 * (x * x + y * y);
  }

  void compute_ellipse() {
    const Doubles xx = V[0][0] * V[0][0] + V[0][1] * V[0][1] + V[0][2] * V[0][2];
    const Doubles yy = V[1][0] * V[1][0] + V[1][1] * V[1][1] + V[1][2] * V[1][2];
    cov_xy = V[0][0] * V[1][0] + V[0][1] * V[1][1] + V[0][2] * V[1][2];
    cov_xx = xx + kDilation;
    cov_yy = yy + kDilation;
    // det(V V^T) is the squared length of a cross product (Cauchy-Binet), and the dilation adds positive terms, where
    // xx yy - xy^2 of a needle would cancel.
    cross[0] = V[0][1] * V[1][2] - V[0][2] * V[1][1];
    cross[1] = V[0][2] * V[1][0] - V[0][0] * V[1][2];
    cross[2] = V[0][0] * V[1][1] - V[0][1] * V[1][0];
    det = undilated_det() + kDilation * (xx + yy) + kDilation * kDilation;
    const Doubles root = kRootWhitening / square_root(cov_yy * det);
    l11 = cov_yy * root;
    l21 = -cov_xy * root;
    l22 = kRootWhitening / square_root(cov_yy);
  }

  // Mip-Splatting's compensation (Yu et al. 2024, equation 10): the dilation must not add opacity.
  void compute_compensation(bool antialiased) {
    compensation = splat(1);
    compensated = Longs{};
    if (!antialiased) return;
    const Doubles ratio = undilated_det() / det;
    compensated = ratio > kMinCompensation * kMinCompensation;
    compensation = select(compensated, square_root(ratio), splat(kMinCompensation));
  }

  Doubles undilated_det() const { return cross[0] * cross[0] + cross[1] * cross[1] + cross[2] * cross[2]; }
};

// The tiles that have pixel centres within `half` of a coordinate, [begin, end) clipped to the image's `pixels`.
struct TileSpan {
  Doubles begin, end;

  TileSpan(Doubles center, Doubles half, int pixels) {
    constexpr double kSlack = 0.01;  // px, for the rounding of the blending's own test
    const Doubles low = larger(center - half - kSlack, splat(0.5)),
                  high = smaller(center + half + kSlack, splat(pixels - 0.5));
    const Longs empty = low > high;
    begin = select(empty, splat(0), round_down((low - 0.5) * (1.0 / kTileSize)));
    end = select(empty, splat(0), round_down((high - 0.5) * (1.0 / kTileSize)) + 1);
    // A tile's pixel centres end half a pixel before the next one's begin: one that `low` has passed is not touched.
    begin = select(low > begin * kTileSize + (kTileSize - 0.5), begin + 1, begin);
  }
};

inline bool features_are_finite(const Scene& scene, std::size_t g) {
  float total = 0;
  for (int k = 0; k < 3; ++k) total += scene.colors[3 * g + k] * 0;
  for (int k = 0; k < scene.feature_count; ++k) total += scene.features[g * scene.feature_count + k] * 0;
  return total == 0;
}

// False if a Gaussian of the range is not finite; such a one is left out.
inline bool project(const ProjectionRange& range, Frame& frame, std::int32_t* radii) {
  const Scene& scene = *range.scene;
  const CameraModel& cam = *range.camera;
  const double log2_min_alpha = log2_positive(splat(range.settings->min_alpha))[0];
  bool all_finite = true;
  Projection p;
  for (std::size_t begin = range.begin; begin < range.end; begin += kLanes) {
    p.compute(range, begin);
    const Doubles x = cam.fx * p.camera[0] * p.inverse_z + cam.cx, y = cam.fy * p.camera[1] * p.inverse_z + cam.cy;
    const Doubles log2_opacity = log2_positive(select(p.visible, p.opacity * p.compensation, splat(1)));
    const Doubles reach = log2_opacity - log2_min_alpha;
    const Doubles reach2 = kUnwhitening * reach;  // d^T cov^-1 d at the cut-off
    const TileSpan columns(x, square_root(reach2 * p.cov_xx), cam.width),
        rows(y, square_root(reach2 * p.cov_yy), cam.height);
    const Doubles middle = 0.5 * (p.cov_xx + p.cov_yy), difference = 0.5 * (p.cov_xx - p.cov_yy);
    const Doubles largest = middle + square_root(difference * difference + p.cov_xy * p.cov_xy);
    const Doubles radius = smaller(square_root(reach2 * largest), splat(1e9));

    const Longs seen = p.visible & (columns.begin < columns.end) & (rows.begin < rows.end);

    for (int i = 0; i < kLanes && begin + i < range.end; ++i) {
      const std::size_t g = begin + i;
      const bool finite = p.finite[i] && features_are_finite(scene, g);
      all_finite &= finite;
      frame.depth_keys[g] = 0;
      radii[g] = 0;
      if (!finite || !seen[i]) continue;

      frame.boxes[g] = {static_cast<std::uint16_t>(columns.begin[i]), static_cast<std::uint16_t>(columns.end[i]),
                        static_cast<std::uint16_t>(rows.begin[i]), static_cast<std::uint16_t>(rows.end[i])};
      const std::int32_t whole = static_cast<std::int32_t>(radius[i]);
      radii[g] = whole + (whole < radius[i]);
      Splat& splat = frame.splats[g];
      splat.x = x[i];
      splat.y = y[i];
      splat.l11 = p.l11[i];
      splat.l21 = p.l21[i];
      splat.l22 = p.l22[i];
      splat.log2_opacity = static_cast<float>(log2_opacity[i]);
      splat.reach = static_cast<float>(reach[i]);
      splat.depth = static_cast<float>(p.camera[2][i]);
      for (int k = 0; k < 3; ++k) splat.color[k] = scene.colors[3 * g + k];
      std::memcpy(&frame.depth_keys[g], &splat.depth, sizeof splat.depth);
    }
  }
  return all_finite;
}

}  // namespace aa4d::raster::AA4D_ARCH

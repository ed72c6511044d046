// The gradient of the projection: from a Gaussian's sums over its pixels to its own parameters and the camera's pose.
#pragma once

#include "raster/projection.hpp"

namespace aa4d::raster::AA4D_ARCH {

// The sums of kLanes Gaussians over their slots; zero for those that touch no tile.
struct SplatSums {
  Doubles color[3], v, vu, vw, vuu, vuw, vww, depth, absolute_vu, absolute_vy, squared;
  Longs touched;

  void gather(const Frame& frame, std::size_t begin, std::size_t end) {
    constexpr int kFields = sizeof(SplatGradient) / sizeof(float);
    alignas(64) double sums[kLanes][kFields] = {};
    for (int i = 0; i < kLanes; ++i) {
      const std::size_t g = begin + i;
      touched[i] = 0;
      if (g >= end) continue;
      const SlotRange slots = frame.slots[g];
      touched[i] = -static_cast<std::int64_t>(slots.begin != slots.end);
      for (std::uint32_t slot = slots.begin; slot < slots.end; ++slot) {
        float fields[kFields];
        std::memcpy(fields, &frame.gradients[slot], sizeof fields);
        for (int k = 0; k < kFields; ++k) sums[i][k] += fields[k];
      }
    }
    Doubles* const fields[] = {color, color + 1, color + 2, &v,           &vu,          &vw,     &vuu,
                               &vuw,  &vww,      &depth,    &absolute_vu, &absolute_vy, &squared};
    for (std::size_t k = 0; k < sizeof fields / sizeof *fields; ++k) {
      for (int i = 0; i < kLanes; ++i) (*fields[k])[i] = sums[i][k];
    }
  }
};

// The gradient of kLanes Gaussians.
struct ProjectionGradient {
  Doubles mean[3], quaternion[4], scale[3], opacity, center[2], camera[3], world_to_camera[3][3];

  void compute(const Projection& p, const SplatSums& s, const CameraModel& cam) {
    opacity = s.v / p.opacity;

    // The centre: dL/d(mean) = L z v.
    center[0] = kUnwhitening * p.l11 * s.vu;
    center[1] = kUnwhitening * (p.l21 * s.vu + p.l22 * s.vw);

    // dL/dV = 2 dL/d(cov) V with dL/d(cov) = L M L^T / 2, M the second moments: first L^T V, what stays of V in the
    // frame in which the Gaussian is round.
    Doubles dV[2][3], dB[2][3], dA[2][3], dR[3][3];
    for (int k = 0; k < 3; ++k) {
      const Doubles a = p.l11 * p.V[0][k] + p.l21 * p.V[1][k], b = p.l22 * p.V[1][k];
      const Doubles ma = kUnwhitening * kUnwhitening * (s.vuu * a + s.vuw * b);
      const Doubles mb = kUnwhitening * kUnwhitening * (s.vuw * a + s.vww * b);
      dV[0][k] = p.l11 * ma;
      dV[1][k] = p.l21 * ma + p.l22 * mb;
    }
    add_compensation(p, s, dV);
    for (int k = 0; k < 3; ++k) {
      scale[k] = dV[0][k] * p.B[0][k] + dV[1][k] * p.B[1][k];
      for (int i = 0; i < 2; ++i) dB[i][k] = dV[i][k] * p.scale[k];
    }
    for (int j = 0; j < 3; ++j) {
      for (int k = 0; k < 3; ++k) dR[j][k] = p.A[0][j] * dB[0][k] + p.A[1][j] * dB[1][k];
      for (int i = 0; i < 2; ++i) {
        dA[i][j] = dB[i][0] * p.rotation[j][0] + dB[i][1] * p.rotation[j][1] + dB[i][2] * p.rotation[j][2];
      }
    }
    compute_quaternion(p, dR);

    // A's rows are jx (r0 - slope_x r2) and jy (r1 - slope_y r2), with r the rows of the camera's rotation.
    const double* r = cam.rotation;
    const Doubles jx = cam.fx * p.inverse_z, jy = cam.fy * p.inverse_z;
    Doubles d_jx{}, d_jy{}, d_slope_x{}, d_slope_y{};
    for (int k = 0; k < 3; ++k) {
      d_jx += dA[0][k] * (r[k] - p.slope_x * r[6 + k]);
      d_jy += dA[1][k] * (r[3 + k] - p.slope_y * r[6 + k]);
      d_slope_x -= dA[0][k] * jx * r[6 + k];
      d_slope_y -= dA[1][k] * jy * r[6 + k];
    }
    // Slopes and centre depend on x / z and y / z alone.
    const Doubles zero{};
    camera[0] = jx * center[0] + select(p.free_x, d_slope_x * p.inverse_z, zero);
    camera[1] = jy * center[1] + select(p.free_y, d_slope_y * p.inverse_z, zero);
    camera[2] = s.depth - (d_jx * jx + d_jy * jy + p.camera[0] * camera[0] + p.camera[1] * camera[1]) * p.inverse_z;
    for (int k = 0; k < 3; ++k) {
      mean[k] = r[k] * camera[0] + r[3 + k] * camera[1] + r[6 + k] * camera[2];
      world_to_camera[0][k] = camera[0] * p.mean[k] + jx * dA[0][k];
      world_to_camera[1][k] = camera[1] * p.mean[k] + jy * dA[1][k];
      world_to_camera[2][k] = camera[2] * p.mean[k] - jx * p.slope_x * dA[0][k] - jy * p.slope_y * dA[1][k];
    }
  }

 private:
  // ln alpha holds ln(compensation) = (ln |c|^2 - ln det) / 2, with c the cross product of V's rows.
  static void add_compensation(const Projection& p, const SplatSums& s, Doubles (&dV)[2][3]) {
    bool any = false;
    for (int i = 0; i < kLanes; ++i) any |= p.compensated[i] != 0;
    if (!any) return;
    const Doubles* c = p.cross;
    const Doubles zero{}, undilated = c[0] * c[0] + c[1] * c[1] + c[2] * c[2];
    const Doubles d_ln_det = select(p.compensated, s.v / p.det, zero);
    const Doubles d_cross = select(p.compensated, s.v / undilated, zero) - d_ln_det;
    for (int k = 0; k < 3; ++k) {
      const int m = (k + 1) % 3, n = (k + 2) % 3;
      dV[0][k] += d_cross * (p.V[1][m] * c[n] - p.V[1][n] * c[m]) - d_ln_det * kDilation * p.V[0][k];
      dV[1][k] += d_cross * (c[m] * p.V[0][n] - c[n] * p.V[0][m]) - d_ln_det * kDilation * p.V[1][k];
    }
  }

  void compute_quaternion(const Projection& p, const Doubles (&d)[3][3]) {
    const auto& [w, x, y, z] = p.quaternion;
    const Doubles g[4] = {
        2 * (x * (d[2][1] - d[1][2]) + y * (d[0][2] - d[2][0]) + z * (d[1][0] - d[0][1])),
        2 * (-2 * x * (d[1][1] + d[2][2]) + y * (d[0][1] + d[1][0]) + z * (d[0][2] + d[2][0]) +
             w * (d[2][1] - d[1][2])),
        2 * (x * (d[0][1] + d[1][0]) - 2 * y * (d[0][0] + d[2][2]) + z * (d[1][2] + d[2][1]) + w * (d[0][2] - d[2][0])),
        2 * (x * (d[0][2] + d[2][0]) + y * (d[1][2] + d[2][1]) - 2 * z * (d[0][0] + d[1][1]) +
             w * (d[1][0] - d[0][1]))};
    const Doubles zero{}, along = select(p.normalised, g[0] * w + g[1] * x + g[2] * y + g[3] * z, zero);
    for (int i = 0; i < 4; ++i) quaternion[i] = (g[i] - along * p.quaternion[i]) * p.inverse_norm;
  }
};

inline void project_backward(const ProjectionRange& range, const Frame& frame, const SceneGradient& out, double* pose) {
  const CameraModel& cam = *range.camera;
  const int features = range.scene->feature_count;
  Projection p;
  SplatSums s;
  ProjectionGradient d;
  Doubles pose_sums[kPoseSums] = {};
  for (std::size_t begin = range.begin; begin < range.end; begin += kLanes) {
    p.compute(range, begin);
    s.gather(frame, begin, range.end);
    d.compute(p, s, cam);
    const double half_width = 0.5 * cam.width, half_height = 0.5 * cam.height;
    const Doubles screen_x = half_width * d.center[0], screen_y = half_height * d.center[1];
    const Doubles screen = square_root(screen_x * screen_x + screen_y * screen_y);
    const Doubles absolute_x = half_width * kUnwhitening * p.l11 * s.absolute_vu;
    const Doubles absolute_y = half_height * kUnwhitening * s.absolute_vy;
    const Doubles opacity = p.opacity * p.compensation, squared = opacity * opacity * s.squared;
    const Doubles absolute = square_root(absolute_x * absolute_x + absolute_y * absolute_y);

    for (int i = 0; i < kLanes && begin + i < range.end; ++i) {
      const std::size_t g = begin + i;
      const bool touched = s.touched[i] != 0;  // the other lanes may hold anything, infinities included
      for (int k = 0; k < 3; ++k) {
        out.means[3 * g + k] = touched ? static_cast<float>(d.mean[k][i]) : 0.0f;
        out.scales[3 * g + k] = touched ? static_cast<float>(d.scale[k][i]) : 0.0f;
        out.colors[3 * g + k] = static_cast<float>(s.color[k][i]);
      }
      for (int k = 0; k < 4; ++k) out.quaternions[4 * g + k] = touched ? static_cast<float>(d.quaternion[k][i]) : 0.0f;
      out.opacities[g] = touched ? static_cast<float>(d.opacity[i]) : 0.0f;
      out.screen[g] = touched ? static_cast<float>(screen[i]) : 0.0f;
      if (out.screen_absolute) out.screen_absolute[g] = touched ? static_cast<float>(absolute[i]) : 0.0f;
      if (out.sensitivity) out.sensitivity[g] = touched ? static_cast<float>(squared[i]) : 0.0f;
      for (int k = 0; k < features && out.features; ++k) {
        double sum = 0;
        for (std::uint32_t slot = frame.slots[g].begin; slot < frame.slots[g].end; ++slot) {
          sum += frame.feature_gradients[static_cast<std::size_t>(slot) * features + k];
        }
        out.features[g * features + k] = static_cast<float>(sum);
      }
    }
    if (pose) {
      const Doubles zero{};
      for (int k = 0; k < 9; ++k) pose_sums[k] += select(s.touched, d.world_to_camera[k / 3][k % 3], zero);
      for (int k = 0; k < 3; ++k) pose_sums[9 + k] += select(s.touched, d.camera[k], zero);
    }
  }
  for (int k = 0; k < kPoseSums && pose; ++k) {
    pose[k] = 0;
    for (int i = 0; i < kLanes; ++i) pose[k] += pose_sums[k][i];
  }
}

}  // namespace aa4d::raster::AA4D_ARCH

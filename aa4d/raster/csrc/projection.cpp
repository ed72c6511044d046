#include "projection.hpp"

#include <algorithm>
#include <bit>
#include <cmath>

#include "thread_pool.hpp"

namespace aa4d {
namespace {

// exponent of two: alpha = o exp(-z.z / 2) = 2^(log2 o - u^2 - w^2) with (u, w) = kWhitening z.
const double kWhitening = std::sqrt(0.5 / std::log(2.0));

// Everything between the inputs and the ellipse; the backward pass computes it again rather than store it.
struct Projection {
  double camera[3];                // the centre in camera space
  double slope_x, slope_y;         // x / z and y / z, clamped
  bool free_x, free_y;             // not clamped
  double quaternion[4], inverse_norm;
  double rotation[3][3];
  double A[2][3];                  // Jacobian of the perspective times world-to-camera rotation
  double B[2][3];                  // A times the Gaussian's rotation
  double V[2][3];                  // B times the scales: the covariance is V V^T + dilation
  double cov_xx, cov_xy, cov_yy, det;
  double scale[3];

  bool in_front(const Scene& scene, const CameraModel& cam, std::size_t g) {
    const double m[3] = {scene.means[3 * g], scene.means[3 * g + 1], scene.means[3 * g + 2]};
    for (int i = 0; i < 3; ++i) {
      camera[i] = cam.rotation[3 * i] * m[0] + cam.rotation[3 * i + 1] * m[1] + cam.rotation[3 * i + 2] * m[2] +
                  cam.translation[i];
    }
    return camera[2] >= cam.near;
  }

  void compute(const Scene& scene, const CameraModel& cam, std::size_t g) {
    const double z = camera[2];
    // Outside the frustum and its margin the linearisation explodes; it is taken at the margin instead.
    const double margin_x = kFrustumMargin * 0.5 * cam.width / cam.fx, margin_y = kFrustumMargin * 0.5 * cam.height / cam.fy;
    const double x_over_z = camera[0] / z, y_over_z = camera[1] / z;
    slope_x = std::clamp(x_over_z, -(cam.cx / cam.fx + margin_x), (cam.width - cam.cx) / cam.fx + margin_x);
    slope_y = std::clamp(y_over_z, -(cam.cy / cam.fy + margin_y), (cam.height - cam.cy) / cam.fy + margin_y);
    free_x = slope_x == x_over_z;
    free_y = slope_y == y_over_z;

    double norm = 0;
    for (int i = 0; i < 4; ++i) {
      quaternion[i] = scene.quaternions[4 * g + i];
      norm += quaternion[i] * quaternion[i];
    }
    inverse_norm = 1 / std::max(std::sqrt(norm), kMinQuaternionNorm);
    for (double& q : quaternion) q *= inverse_norm;
    const auto [w, qx, qy, qz] = quaternion;
    rotation[0][0] = 1 - 2 * (qy * qy + qz * qz);
    rotation[0][1] = 2 * (qx * qy - w * qz);
    rotation[0][2] = 2 * (qx * qz + w * qy);
    rotation[1][0] = 2 * (qx * qy + w * qz);
    rotation[1][1] = 1 - 2 * (qx * qx + qz * qz);
    rotation[1][2] = 2 * (qy * qz - w * qx);
    rotation[2][0] = 2 * (qx * qz - w * qy);
    rotation[2][1] = 2 * (qy * qz + w * qx);
    rotation[2][2] = 1 - 2 * (qx * qx + qy * qy);

    const double jx = cam.fx / z, jy = cam.fy / z;
    for (int k = 0; k < 3; ++k) {
      A[0][k] = jx * (cam.rotation[k] - slope_x * cam.rotation[6 + k]);
      A[1][k] = jy * (cam.rotation[3 + k] - slope_y * cam.rotation[6 + k]);
      scale[k] = scene.scales[3 * g + k];
    }
    for (int i = 0; i < 2; ++i) {
      for (int k = 0; k < 3; ++k) {
        B[i][k] = A[i][0] * rotation[0][k] + A[i][1] * rotation[1][k] + A[i][2] * rotation[2][k];
        V[i][k] = B[i][k] * scale[k];
      }
    }
    const double xx = V[0][0] * V[0][0] + V[0][1] * V[0][1] + V[0][2] * V[0][2];
    const double yy = V[1][0] * V[1][0] + V[1][1] * V[1][1] + V[1][2] * V[1][2];
    cov_xy = V[0][0] * V[1][0] + V[0][1] * V[1][1] + V[0][2] * V[1][2];
    cov_xx = xx + kDilation;
    cov_yy = yy + kDilation;
    // det(V V^T) as the squared length of a cross product (Cauchy-Binet), and the dilation's part added to it: a sum of
    // positive terms, where xx yy - xy^2 of a needle would cancel.
    const double c0 = V[0][1] * V[1][2] - V[0][2] * V[1][1];
    const double c1 = V[0][2] * V[1][0] - V[0][0] * V[1][2];
    const double c2 = V[0][0] * V[1][1] - V[0][1] * V[1][0];
    det = c0 * c0 + c1 * c1 + c2 * c2 + kDilation * (xx + yy) + kDilation * kDilation;
  }
};

// The tiles whose pixel centres the ellipse d^T cov^-1 d <= reach2 comes near: for each row of tiles, the exact interval
// of x that the ellipse has within the row's band.
void append_tiles(const Projection& p, double x, double y, double reach2, const Frame& frame, Buffer<std::uint32_t>& out) {
  constexpr double kSlack = 0.01;  // px, for the rounding of the kernels' own test
  constexpr double kFirst = 0.5, kLast = kTileSize - 0.5;  // pixel centres of a tile
  const double half_height = std::sqrt(reach2 * p.cov_yy) + kSlack;
  const double tiles_y = frame.tiles_y, tiles_x = frame.tiles_x;
  const double first_row = std::max(0.0, std::ceil((y - half_height - kLast) / kTileSize));
  const double last_row = std::min(tiles_y - 1, std::floor((y + half_height - kFirst) / kTileSize));
  if (!(first_row <= last_row)) return;
  const double slope = p.cov_xy / p.cov_yy, spread = p.det / p.cov_yy;
  const double rightmost_y = p.cov_xy * std::sqrt(reach2 / p.cov_xx);  // of the ellipse's rightmost point
  for (int row = static_cast<int>(first_row); row <= static_cast<int>(last_row); ++row) {
    const double low = row * kTileSize + kFirst - y, high = row * kTileSize + kLast - y;
    const double right_y = std::clamp(rightmost_y, low, high), left_y = std::clamp(-rightmost_y, low, high);
    const double right = slope * right_y + std::sqrt(std::max(0.0, spread * (reach2 - right_y * right_y / p.cov_yy)));
    const double left = slope * left_y - std::sqrt(std::max(0.0, spread * (reach2 - left_y * left_y / p.cov_yy)));
    const double first = std::max(0.0, std::ceil((x + left - kSlack - kLast) / kTileSize));
    const double last = std::min(tiles_x - 1, std::floor((x + right + kSlack - kFirst) / kTileSize));
    for (double column = first; column <= last; ++column) {
      out.push_back(static_cast<std::uint32_t>(row * frame.tiles_x + static_cast<int>(column)));
    }
  }
}

void project_chunk(const Scene& scene, Frame& frame, double min_alpha, std::int32_t* radii, std::size_t chunk) {
  const CameraModel& cam = frame.camera;
  Buffer<std::uint32_t>& tiles = frame.chunk_tiles[chunk];
  tiles.clear();
  const std::size_t end = std::min(scene.count, (chunk + 1) * kProjectionChunk);
  for (std::size_t g = chunk * kProjectionChunk; g < end; ++g) {
    frame.slot_begin[g] = static_cast<std::uint32_t>(tiles.size());  // within the chunk, for now
    radii[g] = 0;
    const double opacity = scene.opacities[g];
    Projection p;
    if (!(opacity >= min_alpha) || !p.in_front(scene, cam, g)) continue;
    p.compute(scene, cam, g);

    Splat& splat = frame.splats[g];
    const double z = p.camera[2];
    splat.x = cam.fx * p.camera[0] / z + cam.cx;
    splat.y = cam.fy * p.camera[1] / z + cam.cy;
    const double reach2 = 2 * std::log(opacity / min_alpha);
    append_tiles(p, splat.x, splat.y, reach2, frame, tiles);
    if (tiles.size() == frame.slot_begin[g]) continue;

    const double middle = 0.5 * (p.cov_xx + p.cov_yy), difference = 0.5 * (p.cov_xx - p.cov_yy);
    const double largest = middle + std::sqrt(difference * difference + p.cov_xy * p.cov_xy);
    radii[g] = static_cast<std::int32_t>(std::clamp(std::ceil(std::sqrt(reach2 * largest)), 1.0, 1e9));
    const double root = std::sqrt(p.cov_yy * p.det);
    splat.l11 = kWhitening * p.cov_yy / root;
    splat.l21 = -kWhitening * p.cov_xy / root;
    splat.l22 = kWhitening / std::sqrt(p.cov_yy);
    splat.log2_opacity = static_cast<float>(std::log2(opacity));
    splat.reach = static_cast<float>(kWhitening * kWhitening * reach2);
    splat.depth = static_cast<float>(z);
    for (int k = 0; k < 3; ++k) splat.color[k] = scene.colors[3 * g + k];
    frame.depth_keys[g] = std::bit_cast<std::uint32_t>(splat.depth);
  }
}

// dL/d(quaternion) from dL/d(rotation), through the normalisation.
void quaternion_gradient(const Projection& p, const double (&d)[3][3], float* out) {
  const auto [w, x, y, z] = p.quaternion;
  const double g[4] = {
      2 * (x * (d[2][1] - d[1][2]) + y * (d[0][2] - d[2][0]) + z * (d[1][0] - d[0][1])),
      2 * (-2 * x * (d[1][1] + d[2][2]) + y * (d[0][1] + d[1][0]) + z * (d[0][2] + d[2][0]) + w * (d[2][1] - d[1][2])),
      2 * (x * (d[0][1] + d[1][0]) - 2 * y * (d[0][0] + d[2][2]) + z * (d[1][2] + d[2][1]) + w * (d[0][2] - d[2][0])),
      2 * (x * (d[0][2] + d[2][0]) + y * (d[1][2] + d[2][1]) - 2 * z * (d[0][0] + d[1][1]) + w * (d[1][0] - d[0][1]))};
  const bool normalised = p.inverse_norm < 1 / kMinQuaternionNorm;
  const double along = normalised ? g[0] * w + g[1] * x + g[2] * y + g[3] * z : 0;
  for (int i = 0; i < 4; ++i) out[i] = static_cast<float>((g[i] - along * p.quaternion[i]) * p.inverse_norm);
}

void project_backward_one(const Scene& scene, const Frame& frame, const SceneGradient& out, std::size_t g) {
  const CameraModel& cam = frame.camera;
  double color[3] = {}, v = 0, vu = 0, vw = 0, vuu = 0, vuw = 0, vww = 0, depth = 0;
  for (std::uint32_t slot = frame.slot_begin[g]; slot < frame.slot_begin[g + 1]; ++slot) {
    const SplatGradient& s = frame.gradients[slot];
    for (int k = 0; k < 3; ++k) color[k] += s.color[k];
    v += s.v;
    vu += s.vu;
    vw += s.vw;
    vuu += s.vuu;
    vuw += s.vuw;
    vww += s.vww;
    depth += s.depth;
  }
  for (int k = 0; k < 3; ++k) out.colors[3 * g + k] = static_cast<float>(color[k]);
  out.opacities[g] = static_cast<float>(v / scene.opacities[g]);

  Projection p;
  p.in_front(scene, cam, g);
  p.compute(scene, cam, g);
  const Splat& splat = frame.splats[g];
  constexpr double kUnwhiten = 1.3862943611198906;  // 1 / kWhitening^2 = 2 ln 2

  // The centre: dL/d(mean) = L z v.
  const double dx = kUnwhiten * splat.l11 * vu, dy = kUnwhiten * (splat.l21 * vu + splat.l22 * vw);
  out.screen[g] = static_cast<float>(std::hypot(dx * 0.5 * cam.width, dy * 0.5 * cam.height));

  // dL/dV = 2 dL/d(cov) V with dL/d(cov) = L M L^T / 2, M the second moments: first L^T V, which is what stays of V in
  // the whitened frame.
  double dB[2][3], dA[2][3], dR[3][3];
  for (int k = 0; k < 3; ++k) {
    const double a = splat.l11 * p.V[0][k] + splat.l21 * p.V[1][k], b = splat.l22 * p.V[1][k];
    const double ma = kUnwhiten * kUnwhiten * (vuu * a + vuw * b), mb = kUnwhiten * kUnwhiten * (vuw * a + vww * b);
    const double dV[2] = {splat.l11 * ma, splat.l21 * ma + splat.l22 * mb};
    out.scales[3 * g + k] = static_cast<float>(dV[0] * p.B[0][k] + dV[1] * p.B[1][k]);
    for (int i = 0; i < 2; ++i) dB[i][k] = dV[i] * p.scale[k];
  }
  for (int j = 0; j < 3; ++j) {
    for (int k = 0; k < 3; ++k) dR[j][k] = p.A[0][j] * dB[0][k] + p.A[1][j] * dB[1][k];
    for (int i = 0; i < 2; ++i) {
      dA[i][j] = dB[i][0] * p.rotation[j][0] + dB[i][1] * p.rotation[j][1] + dB[i][2] * p.rotation[j][2];
    }
  }
  quaternion_gradient(p, dR, out.quaternions + 4 * g);

  // A's rows are jx (r0 - slope_x r2) and jy (r1 - slope_y r2), with r the rows of the camera's rotation.
  const double* r = cam.rotation;
  const double z = p.camera[2], jx = cam.fx / z, jy = cam.fy / z;
  double d_jx = 0, d_jy = 0, d_slope_x = 0, d_slope_y = 0;
  for (int k = 0; k < 3; ++k) {
    d_jx += dA[0][k] * (r[k] - p.slope_x * r[6 + k]);
    d_jy += dA[1][k] * (r[3 + k] - p.slope_y * r[6 + k]);
    d_slope_x -= dA[0][k] * jx * r[6 + k];
    d_slope_y -= dA[1][k] * jy * r[6 + k];
  }
  double dc[3];
  dc[0] = jx * dx + (p.free_x ? d_slope_x / z : 0);
  dc[1] = jy * dy + (p.free_y ? d_slope_y / z : 0);
  dc[2] = depth - (d_jx * jx + d_jy * jy) / z -
          (p.camera[0] * dc[0] + p.camera[1] * dc[1]) / z;  // the slopes and the centre depend on x / z and y / z alone
  for (int k = 0; k < 3; ++k) {
    out.means[3 * g + k] = static_cast<float>(r[k] * dc[0] + r[3 + k] * dc[1] + r[6 + k] * dc[2]);
  }
}

}  // namespace

void project(const Scene& scene, Frame& frame, double min_alpha, std::int32_t* radii, int threads) {
  frame.count = scene.count;
  frame.splats.resize_discarding(scene.count);
  frame.depth_keys.resize_discarding(scene.count);
  frame.slot_begin.resize_discarding(scene.count + 1);
  const std::size_t chunks = (scene.count + kProjectionChunk - 1) / kProjectionChunk;
  frame.chunk_tiles.resize(chunks);
  parallel_for(threads, chunks, [&](std::size_t chunk) { project_chunk(scene, frame, min_alpha, radii, chunk); });

  std::uint32_t base = 0;
  for (std::size_t chunk = 0; chunk < chunks; ++chunk) {
    const std::size_t end = std::min(scene.count, (chunk + 1) * kProjectionChunk);
    for (std::size_t g = chunk * kProjectionChunk; g < end; ++g) frame.slot_begin[g] += base;
    base += static_cast<std::uint32_t>(frame.chunk_tiles[chunk].size());
  }
  frame.slot_begin[scene.count] = base;
}

void project_backward(const Scene& scene, const Frame& frame, const SceneGradient& out, int threads) {
  const std::size_t chunks = (scene.count + kProjectionChunk - 1) / kProjectionChunk;
  parallel_for(threads, chunks, [&](std::size_t chunk) {
    const std::size_t end = std::min(scene.count, (chunk + 1) * kProjectionChunk);
    for (std::size_t g = chunk * kProjectionChunk; g < end; ++g) {
      if (frame.slot_begin[g] != frame.slot_begin[g + 1]) {
        project_backward_one(scene, frame, out, g);
        continue;
      }
      for (int k = 0; k < 3; ++k) out.means[3 * g + k] = out.scales[3 * g + k] = out.colors[3 * g + k] = 0;
      for (int k = 0; k < 4; ++k) out.quaternions[4 * g + k] = 0;
      out.opacities[g] = out.screen[g] = 0;
    }
  });
}

}  // namespace aa4d

// The constants of the rasteriser, mirrored in aa4d/raster/constants.py: a test holds the two together.
#pragma once

namespace aa4d {

inline constexpr double kDilation = 0.3;        // added to both diagonals of the projected covariance, px^2
inline constexpr double kMaxAlpha = 0.99;       // keeps 1 - alpha away from zero
inline constexpr double kFrustumMargin = 0.3;   // how far outside the image, in half fields of view, J follows x / z
inline constexpr double kMinQuaternionNorm = 1e-12;  // a shorter quaternion turns less and less: zero, not at all
inline constexpr double kMinCompensation = 0.005;  // of the antialiased mode

inline constexpr int kMaxFeatures = 32;

inline constexpr int kTileSize = 16;                      // px
inline constexpr int kTilePixels = kTileSize * kTileSize;
inline constexpr int kBlockSize = 4;                      // px; 16 pixels: one AVX-512 register
inline constexpr int kBlockPixels = kBlockSize * kBlockSize;
inline constexpr int kTileBlocks = kTilePixels / kBlockPixels;  // 16 as well: one register tests all blocks of a tile

}  // namespace aa4d

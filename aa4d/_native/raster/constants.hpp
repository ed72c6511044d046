// The constants of the rasteriser, mirrored in aa4d/raster/constants.py: a test holds the two together.
#pragma once

namespace aa4d::raster {

inline constexpr double kDilation = 0.3;        // added to both diagonals of the projected covariance, px^2
inline constexpr double kMaxAlpha = 0.99;       // keeps 1 - alpha away from zero
inline constexpr double kFrustumMargin = 0.3;   // how far outside the image, in half fields of view, J follows x / z
inline constexpr double kMinQuaternionNorm = 1e-12;  // a shorter quaternion turns less and less: zero, not at all
inline constexpr double kMinCompensation = 0.005;  // of the antialiased mode

inline constexpr int kMaxFeatures = 32;
inline constexpr int kMaxSide = 1 << 20;  // px; tiles are counted in 16 bits along each side

// A tile is what one thread draws at a time; a Gaussian adds to some of its blocks.
inline constexpr int kTileSize = 32;    // px
inline constexpr int kBlockSize = 4;    // px
inline constexpr int kBlockPixels = 16;  // one AVX-512 register holds the pixels of a block
inline constexpr int kRowBlocks = kTileSize / kBlockSize;
inline constexpr int kTileBlocks = kRowBlocks * kRowBlocks;  // one bit each in 64
inline constexpr int kTilePixels = kTileSize * kTileSize;
inline constexpr int kGroupSize = 4;   // tiles
inline constexpr int kGroupTiles = 16;  // one AVX-512 register tests a group of tiles
static_assert(kTileBlocks == 64 && kRowBlocks == 8 && kMaxSide / kTileSize < 1 << 16);

}  // namespace aa4d::raster

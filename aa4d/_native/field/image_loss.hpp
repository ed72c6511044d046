#pragma once

namespace aa4d::field {

struct ImageErrors {
  double similarity, absolute, squared;  // means over pixels and channels
};

// Compares two images [height, width, 3]. `gradient`, unless it is null, becomes that of
// (1 - dssim) * absolute + dssim * (1 - similarity) by the first.
ImageErrors compare_images(int height, int width, const float* image, const float* target, float dssim, float* gradient,
                           int threads);

}  // namespace aa4d::field

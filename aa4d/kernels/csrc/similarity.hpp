#pragma once

namespace aa4d {

// The mean SSIM of two images [height, width, 3] and, unless it is null, its gradient by the first.
double structural_similarity(int height, int width, const float* image, const float* target, float* gradient,
                             int threads);

}  // namespace aa4d

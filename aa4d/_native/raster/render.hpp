// A whole image, forward and backward: projection, lists, and the tiles in parallel.
#pragma once

#include "raster/frame.hpp"
#include "raster/scene.hpp"

namespace aa4d::raster {

// Draws the scene into `image` and the radii [N], which are zero for what cannot be seen. Null if a Gaussian is not
// finite and the settings do not ask to mask it.
FramePtr render(const Scene& scene, const CameraModel& camera, const Settings& settings, const Image& image,
                std::int32_t* radii);

// The gradient of what render() drew, from the same scene and settings.
void render_backward(const Scene& scene, const Settings& settings, Frame& frame, const ImageGradient& image,
                     const SceneGradient& gradient);

// The contributions of a Gaussian to a pixel that render() added.
std::uint64_t count_pairs(const Settings& settings, Frame& frame);

}  // namespace aa4d::raster

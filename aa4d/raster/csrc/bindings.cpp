// The Python module: checks nothing but shapes, dtypes and layout, and lets other Python threads run meanwhile.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/optional.h>

#include "kernels.hpp"
#include "render.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace {

using Vector = nb::ndarray<float, nb::shape<-1>, nb::c_contig, nb::device::cpu>;
using Vectors3 = nb::ndarray<float, nb::shape<-1, 3>, nb::c_contig, nb::device::cpu>;
using Vectors4 = nb::ndarray<float, nb::shape<-1, 4>, nb::c_contig, nb::device::cpu>;
using Integers = nb::ndarray<std::int32_t, nb::shape<-1>, nb::c_contig, nb::device::cpu>;
using Map = nb::ndarray<float, nb::shape<-1, -1>, nb::c_contig, nb::device::cpu>;
using ColorMap = nb::ndarray<float, nb::shape<-1, -1, 3>, nb::c_contig, nb::device::cpu>;
using Matrix3 = nb::ndarray<double, nb::shape<3, 3>, nb::c_contig, nb::device::cpu>;
using Matrix4 = nb::ndarray<double, nb::shape<4, 4>, nb::c_contig, nb::device::cpu>;
using Color = nb::ndarray<double, nb::shape<3>, nb::c_contig, nb::device::cpu>;

aa4d::Scene scene_of(const Vectors3& means, const Vectors4& quaternions, const Vectors3& scales, const Vector& opacities,
                     const Vectors3& colors) {
  const std::size_t count = means.shape(0);
  if (quaternions.shape(0) != count || scales.shape(0) != count || opacities.shape(0) != count || colors.shape(0) != count)
    throw nb::value_error("the tensors of the Gaussians differ in length");
  return {count, means.data(), quaternions.data(), scales.data(), opacities.data(), colors.data()};
}

// What Python holds between forward and backward.
struct SavedFrame {
  aa4d::FramePtr frame;
};

SavedFrame forward(const Vectors3& means, const Vectors4& quaternions, const Vectors3& scales, const Vector& opacities,
                   const Vectors3& colors, const Matrix4& viewmat, const Matrix3& K, double near, const Color& background,
                   double min_alpha, double min_transmittance, int threads, const ColorMap& color, const Map& alpha,
                   const std::optional<Map>& depth, const Integers& radii) {
  const aa4d::Scene scene = scene_of(means, quaternions, scales, opacities, colors);
  aa4d::CameraModel camera;
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) camera.rotation[3 * i + j] = viewmat(i, j);
    camera.translation[i] = viewmat(i, 3);
  }
  camera.fx = K(0, 0);
  camera.fy = K(1, 1);
  camera.cx = K(0, 2);
  camera.cy = K(1, 2);
  camera.near = near;
  camera.height = static_cast<int>(color.shape(0));
  camera.width = static_cast<int>(color.shape(1));
  const aa4d::Image image = {color.data(), alpha.data(), depth ? depth->data() : nullptr};
  const aa4d::Settings settings = {min_alpha, min_transmittance, threads};
  const nb::gil_scoped_release release;
  return {aa4d::render(scene, camera, background.data(), settings, image, radii.data())};
}

void backward(SavedFrame& saved, const Vectors3& means, const Vectors4& quaternions, const Vectors3& scales,
              const Vector& opacities, const Vectors3& colors, const Color& background, double min_alpha,
              double min_transmittance, int threads, const std::optional<ColorMap>& color_gradient,
              const std::optional<Map>& alpha_gradient, const std::optional<Map>& depth_gradient,
              const std::optional<Map>& depth, const Vectors3& d_means, const Vectors4& d_quaternions,
              const Vectors3& d_scales, const Vector& d_opacities, const Vectors3& d_colors, const Color& d_background,
              const Vector& screen_gradient) {
  const aa4d::Scene scene = scene_of(means, quaternions, scales, opacities, colors);
  const aa4d::ImageGradient image = {color_gradient ? color_gradient->data() : nullptr,
                                     alpha_gradient ? alpha_gradient->data() : nullptr,
                                     depth_gradient ? depth_gradient->data() : nullptr, depth ? depth->data() : nullptr};
  const aa4d::SceneGradient gradient = {d_means.data(),     d_quaternions.data(), d_scales.data(),
                                        d_opacities.data(), d_colors.data(),      screen_gradient.data()};
  const aa4d::Settings settings = {min_alpha, min_transmittance, threads};
  const nb::gil_scoped_release release;
  aa4d::render_backward(scene, *saved.frame, background.data(), settings, image, gradient, d_background.data());
}

}  // namespace

NB_MODULE(_native, m) {
  nb::set_leak_warnings(false);  // an autograd graph that is alive at exit holds its frame: no leak

  nb::class_<SavedFrame>(m, "Frame");
  m.def("forward", &forward, "means"_a, "quaternions"_a, "scales"_a, "opacities"_a, "colors"_a, "viewmat"_a, "K"_a, "near"_a,
        "background"_a, "min_alpha"_a, "min_transmittance"_a, "threads"_a, "color"_a, "alpha"_a, "depth"_a.none(), "radii"_a);
  m.def("backward", &backward, "frame"_a, "means"_a, "quaternions"_a, "scales"_a, "opacities"_a, "colors"_a, "background"_a,
        "min_alpha"_a, "min_transmittance"_a, "threads"_a, "color_gradient"_a.none(), "alpha_gradient"_a.none(),
        "depth_gradient"_a.none(), "depth"_a.none(), "d_means"_a, "d_quaternions"_a, "d_scales"_a, "d_opacities"_a,
        "d_colors"_a, "d_background"_a, "screen_gradient"_a);
  m.def("instruction_set", [] { return aa4d::kernels().name; });
  m.def("constants", [] {
    nb::dict result;
    result["DILATION"] = aa4d::kDilation;
    result["MAX_ALPHA"] = aa4d::kMaxAlpha;
    result["MIN_ALPHA"] = aa4d::kMinAlpha;
    result["MIN_TRANSMITTANCE"] = aa4d::kMinTransmittance;
    result["FRUSTUM_MARGIN"] = aa4d::kFrustumMargin;
    result["MIN_QUATERNION_NORM"] = aa4d::kMinQuaternionNorm;
    return result;
  });
}

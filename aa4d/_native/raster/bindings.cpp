// The bindings of the rasteriser: they check dtypes, shapes and layout, and let other Python threads run meanwhile.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/optional.h>

#include <atomic>
#include <optional>

#include "common/thread_pool.hpp"
#include "raster/kernels.hpp"
#include "raster/render.hpp"

namespace nb = nanobind;
namespace raster = aa4d::raster;
using namespace nb::literals;

namespace {

template <class T, nb::ssize_t... kShape>
using Array = nb::ndarray<T, nb::shape<kShape...>, nb::c_contig, nb::device::cpu>;
using Values = Array<float, -1>;
using Vectors3 = Array<float, -1, 3>;
using Vectors4 = Array<float, -1, 4>;
using Rows = Array<float, -1, -1>;
using Map = Array<float, -1, -1>;
using Maps = Array<float, -1, -1, -1>;

template <class T>
auto* pointer(const std::optional<T>& array) {
  return array ? array->data() : nullptr;
}

void require(bool condition, const char* message) {
  if (!condition) throw nb::value_error(message);
}

raster::Scene make_scene(const Vectors3& means, const Vectors4& quaternions, const Vectors3& scales,
                         const Values& opacities, const Vectors3& colors, const std::optional<Rows>& features,
                         const Array<float, 3>& background) {
  const std::size_t count = means.shape(0);
  require(quaternions.shape(0) == count && scales.shape(0) == count && opacities.shape(0) == count &&
              colors.shape(0) == count && (!features || features->shape(0) == count),
          "the tensors of the Gaussians differ in length");
  require(!features || features->shape(1) <= raster::kMaxFeatures, "too many features");
  raster::Scene scene;
  scene.count = count;
  scene.means = means.data();
  scene.quaternions = quaternions.data();
  scene.scales = scales.data();
  scene.opacities = opacities.data();
  scene.colors = colors.data();
  scene.features = pointer(features);
  scene.feature_count = features ? static_cast<int>(features->shape(1)) : 0;
  for (int k = 0; k < 3; ++k) scene.background[k] = background(k);
  return scene;
}

struct PinholeCamera {
  raster::CameraModel model;

  PinholeCamera(const Array<double, 4, 4>& viewmat, const Array<double, 3, 3>& K, int width, int height, double near) {
    for (int i = 0; i < 3; ++i) {
      for (int j = 0; j < 3; ++j) model.rotation[3 * i + j] = viewmat(i, j);
      model.translation[i] = viewmat(i, 3);
    }
    model.fx = K(0, 0);
    model.fy = K(1, 1);
    model.cx = K(0, 2);
    model.cy = K(1, 2);
    model.near = near;
    model.width = width;
    model.height = height;
  }
};

// What Python holds between forward and backward. It keeps no array of the caller's: backward is given them again.
struct SavedFrame {
  raster::FramePtr frame;
  raster::Settings settings;
};

std::optional<SavedFrame> forward(const raster::Scene& scene, const PinholeCamera& camera,
                                  const raster::Settings& settings, const Maps& color, const Map& alpha,
                                  const std::optional<Map>& depth, const std::optional<Maps>& features,
                                  const Array<std::int32_t, -1>& radii) {
  const raster::CameraModel& model = camera.model;
  const auto fits = [&](const auto& map) {
    return map.shape(0) == static_cast<std::size_t>(model.height) &&
           map.shape(1) == static_cast<std::size_t>(model.width);
  };
  require(fits(color) && color.shape(2) == 3 && fits(alpha) && (!depth || fits(*depth)), "a map has the wrong size");
  require(scene.feature_count == 0 ||
              (features && fits(*features) && features->shape(2) == static_cast<std::size_t>(scene.feature_count)),
          "the map of features has the wrong size");
  require(radii.shape(0) == scene.count, "radii has the wrong length");
  const raster::Image image = {color.data(), alpha.data(), pointer(depth), pointer(features)};
  const nb::gil_scoped_release release;
  raster::FramePtr frame = raster::render(scene, model, settings, image, radii.data());
  if (!frame) return std::nullopt;
  return SavedFrame{std::move(frame), settings};
}

void backward(SavedFrame& saved, const raster::Scene& scene, int threads, const std::optional<Maps>& color,
              const std::optional<Map>& alpha, const std::optional<Map>& depth, const std::optional<Map>& depth_value,
              const std::optional<Maps>& features, const Vectors3& d_means, const Vectors4& d_quaternions,
              const Vectors3& d_scales, const Values& d_opacities, const Vectors3& d_colors,
              const Array<float, 3>& d_background, const Values& screen, const std::optional<Values>& screen_absolute,
              const std::optional<Values>& sensitivity, const std::optional<Rows>& d_features,
              const std::optional<Array<float, 4, 4>>& d_viewmat) {
  require(scene.count == saved.frame->count, "these are not the Gaussians that were drawn");
  const raster::ImageGradient image = {pointer(color), pointer(alpha), pointer(depth), pointer(depth_value),
                                       pointer(features)};
  raster::SceneGradient gradient;
  gradient.means = d_means.data();
  gradient.quaternions = d_quaternions.data();
  gradient.scales = d_scales.data();
  gradient.opacities = d_opacities.data();
  gradient.colors = d_colors.data();
  gradient.background = d_background.data();
  gradient.screen = screen.data();
  gradient.screen_absolute = pointer(screen_absolute);
  gradient.sensitivity = pointer(sensitivity);
  gradient.features = features ? pointer(d_features) : nullptr;
  gradient.viewmat = pointer(d_viewmat);
  raster::Settings settings = saved.settings;
  settings.threads = threads;
  const nb::gil_scoped_release release;
  raster::render_backward(scene, settings, *saved.frame, image, gradient);
}

// Runs the bare arithmetic of `pairs` contributions, split evenly.
float arithmetic(bool is_backward, std::uint64_t pairs, int threads) {
  const nb::gil_scoped_release release;
  const auto run = is_backward ? raster::kernels().backward_arithmetic : raster::kernels().forward_arithmetic;
  std::atomic<float> result = 0;
  aa4d::parallel_for(threads, threads, [&](std::size_t) { result = run(pairs / threads); });
  return result;
}

}  // namespace

void bind_raster(nb::module_& m) {
  nb::class_<raster::Scene>(m, "Scene")
      .def(nb::new_(&make_scene), "means"_a, "quaternions"_a, "scales"_a, "opacities"_a, "colors"_a,
           "features"_a.none(), "background"_a);
  nb::class_<PinholeCamera>(m, "PinholeCamera")
      .def(nb::init<const Array<double, 4, 4>&, const Array<double, 3, 3>&, int, int, double>(), "viewmat"_a, "K"_a,
           "width"_a, "height"_a, "near"_a);
  nb::class_<raster::Settings>(m, "Settings")
      .def(nb::init<double, double, bool, bool, int>(), "min_alpha"_a, "min_transmittance"_a, "antialiased"_a,
           "mask_invalid"_a, "threads"_a);
  nb::class_<SavedFrame>(m, "Frame").def("count_pairs", [](SavedFrame& saved) {
    return raster::count_pairs(saved.settings, *saved.frame);
  });
  m.def("forward", &forward, "scene"_a, "camera"_a, "settings"_a, "color"_a, "alpha"_a, "depth"_a.none(),
        "features"_a.none(), "radii"_a);
  m.def("backward", &backward, "frame"_a, "scene"_a, "threads"_a, "color"_a.none(), "alpha"_a.none(), "depth"_a.none(),
        "depth_value"_a.none(), "features"_a.none(), "d_means"_a, "d_quaternions"_a, "d_scales"_a, "d_opacities"_a,
        "d_colors"_a, "d_background"_a, "screen"_a, "screen_absolute"_a.none(), "sensitivity"_a.none(),
        "d_features"_a.none(), "d_viewmat"_a.none());
  m.def("arithmetic", &arithmetic, "backward"_a, "pairs"_a, "threads"_a);
  m.def("instruction_set", [] { return raster::kernels().name; });
  m.def("constants", [] {
    nb::dict result;
    result["DILATION"] = raster::kDilation;
    result["MAX_ALPHA"] = raster::kMaxAlpha;
    result["FRUSTUM_MARGIN"] = raster::kFrustumMargin;
    result["MIN_QUATERNION_NORM"] = raster::kMinQuaternionNorm;
    result["MIN_COMPENSATION"] = raster::kMinCompensation;
    result["MAX_FEATURES"] = raster::kMaxFeatures;
    result["MAX_SIDE"] = raster::kMaxSide;
    return result;
  });
}

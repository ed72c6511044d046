// The bindings of the field's kernels: they check dtypes, shapes and layout, and let other Python threads run
// meanwhile.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <optional>
#include <tuple>
#include <vector>

#include "field/image_loss.hpp"
#include "field/kernels.hpp"
#include "field/local_gaussians.hpp"
#include "field/plane_lookup.hpp"
#include "field/plane_penalty.hpp"
#include "field/two_layer.hpp"

namespace nb = nanobind;
namespace field = aa4d::field;
using namespace nb::literals;

namespace {

template <nb::ssize_t... kShape>
using Array = nb::ndarray<float, nb::shape<kShape...>, nb::c_contig, nb::device::cpu>;
using Vector = Array<-1>;
using Matrix = Array<-1, -1>;
using Texels = Array<-1, -1, -1>;
using LayerTensors = std::tuple<Matrix, Vector, Matrix, Vector>;  // hidden weight and bias, output weight and bias

void require(bool condition, const char* message) {
  if (!condition) throw nb::value_error(message);
}

template <class T>
auto* pointer(const std::optional<T>& array) {
  return array ? array->data() : nullptr;
}

int size(const auto& array, int axis) { return static_cast<int>(array.shape(axis)); }

field::Query make_query(const std::vector<Texels>& planes, const Array<-1, 3>& coordinates, float time,
                        const std::optional<Texels>& scores) {
  require(!planes.empty() && planes.size() % field::kPlanes == 0 &&
              planes.size() <= field::kPlanes * static_cast<std::size_t>(field::kMaxLevels),
          "expected six planes for each of 1 to 8 levels");
  field::Query query = {};
  query.levels = static_cast<int>(planes.size()) / field::kPlanes;
  query.channels = size(planes[0], 2);
  query.anchors = coordinates.shape(0);
  query.coordinates = coordinates.data();
  query.time = time;
  query.scores = pointer(scores);
  for (std::size_t i = 0; i < planes.size(); ++i) {
    require(size(planes[i], 2) == query.channels, "planes differ in their number of channels");
    require(planes[i].size() > 0, "a plane is empty");
    query.planes[i / field::kPlanes][i % field::kPlanes] = {planes[i].data(), size(planes[i], 0), size(planes[i], 1)};
  }
  require(!scores || (scores->shape(0) == query.anchors && scores->shape(1) == field::kPlanes &&
                      size(*scores, 2) == query.channels),
          "scores must be [N, 6, C]");
  return query;
}

void look_up(const std::vector<Texels>& planes, const Array<-1, 3>& coordinates, float time,
             const std::optional<Texels>& scores, int threads, const Matrix& features,
             const std::optional<Texels>& weights) {
  const field::Query query = make_query(planes, coordinates, time, scores);
  require(features.shape(0) == query.anchors && size(features, 1) == query.levels * query.channels,
          "features must be [N, L C]");
  require(weights.has_value() == scores.has_value() && (!weights || weights->size() == scores->size()),
          "weights must be like scores");
  const nb::gil_scoped_release release;
  field::look_up_planes(query, threads, features.data(), pointer(weights));
}

void look_up_backward(const std::vector<Texels>& planes, const Array<-1, 3>& coordinates, float time,
                      const std::optional<Texels>& scores, const std::optional<Texels>& weights,
                      const Matrix& d_features, int threads, const Vector& result,
                      const std::vector<Texels>& d_planes) {
  const field::Query query = make_query(planes, coordinates, time, scores);
  const std::size_t per_anchor = static_cast<std::size_t>(field::kPlanes) * query.channels;
  require(weights.has_value() == scores.has_value() && (!weights || weights->size() == scores->size()),
          "weights must be like scores");
  require(d_features.shape(0) == query.anchors && size(d_features, 1) == query.levels * query.channels,
          "features must be [N, L C]");
  require(result.size() == query.anchors * per_anchor * (scores ? 1 : query.levels), "result has the wrong size");
  require(d_planes.size() == planes.size(), "one gradient is needed for each plane");
  float* gradients[field::kMaxLevels][field::kPlanes];
  for (std::size_t i = 0; i < planes.size(); ++i) {
    require(d_planes[i].size() == planes[i].size(), "a gradient differs in size from its plane");
    gradients[i / field::kPlanes][i % field::kPlanes] = d_planes[i].data();
  }
  const nb::gil_scoped_release release;
  field::look_up_planes_backward(query, threads, pointer(weights), d_features.data(), result.data(), gradients);
}

double penalise(const std::vector<Texels>& planes, const std::vector<float>& smoothness,
                const std::vector<float>& constancy, const std::vector<std::optional<Texels>>& gradients, int threads) {
  require(smoothness.size() == planes.size() && constancy.size() == planes.size() && gradients.size() == planes.size(),
          "one weight and one gradient are needed for each plane");
  std::vector<field::Penalty> penalties;
  for (std::size_t i = 0; i < planes.size(); ++i) {
    const Texels& plane = planes[i];
    require(!gradients[i] || gradients[i]->size() == plane.size(), "a gradient differs in size from its plane");
    const int rows = size(plane, 0), width = size(plane, 1) * size(plane, 2);
    const float differences = static_cast<float>(std::max(rows - 2, 1)) * static_cast<float>(width);
    penalties.push_back({plane.data(), rows, width, smoothness[i] / differences,
                         constancy[i] / (static_cast<float>(rows) * static_cast<float>(width)), pointer(gradients[i])});
  }
  const nb::gil_scoped_release release;
  return field::penalise_planes(penalties.data(), penalties.size(), threads);
}

std::vector<field::Layers> make_layers(const std::vector<LayerTensors>& networks, const Matrix& x, bool timed) {
  require(!networks.empty(), "no network");
  std::vector<field::Layers> layers;
  for (const auto& [w1, b1, w2, b2] : networks) {
    require(w1.shape(1) == x.shape(1) + (timed ? 1 : 0) && b1.shape(0) == w1.shape(0) && w2.shape(1) == w1.shape(0) &&
                b2.shape(0) == w2.shape(0),
            "the layers of a network do not fit");
    layers.push_back({size(w1, 1), size(w1, 0), size(w2, 0), w1.data(), b1.data(), w2.data(), b2.data()});
  }
  return layers;
}

field::Arithmetic arithmetic_of(bool bfloat16) {
  return bfloat16 ? field::Arithmetic::kBfloat16 : field::Arithmetic::kFloat32;
}

void networks_forward(const Matrix& x, const std::vector<LayerTensors>& networks, std::optional<float> time,
                      bool bfloat16, int threads, const std::vector<Matrix>& outputs) {
  const std::vector<field::Layers> layers = make_layers(networks, x, time.has_value());
  require(outputs.size() == layers.size(), "one output is needed for each network");
  std::vector<float*> y;
  for (std::size_t i = 0; i < layers.size(); ++i) {
    require(outputs[i].shape(0) == x.shape(0) && size(outputs[i], 1) == layers[i].outputs,
            "an output has the wrong size");
    y.push_back(outputs[i].data());
  }
  const nb::gil_scoped_release release;
  field::networks_forward(layers, time, x.shape(0), x.data(), y, arithmetic_of(bfloat16), threads);
}

void networks_backward(const Matrix& x, const std::vector<LayerTensors>& networks, std::optional<float> time,
                       const std::vector<Matrix>& d_outputs, bool bfloat16, int threads,
                       const std::optional<Matrix>& d_x, const std::vector<LayerTensors>& gradients) {
  const std::vector<field::Layers> layers = make_layers(networks, x, time.has_value());
  require(d_outputs.size() == layers.size() && gradients.size() == layers.size(),
          "one gradient is needed for each network");
  require(!d_x || (d_x->shape(0) == x.shape(0) && d_x->shape(1) == x.shape(1)), "d_x must be like x");
  make_layers(gradients, x, time.has_value());
  std::vector<const float*> d_y;
  std::vector<field::LayersGradient> out;
  for (std::size_t i = 0; i < layers.size(); ++i) {
    require(d_outputs[i].shape(0) == x.shape(0) && size(d_outputs[i], 1) == layers[i].outputs,
            "an output has the wrong size");
    const auto& [w1, b1, w2, b2] = gradients[i];
    require(size(w1, 0) == layers[i].hidden && size(w2, 0) == layers[i].outputs, "a gradient has the wrong size");
    d_y.push_back(d_outputs[i].data());
    out.push_back({w1.data(), b1.data(), w2.data(), b2.data()});
  }
  const nb::gil_scoped_release release;
  field::networks_backward(layers, time, x.shape(0), x.data(), d_y, pointer(d_x), out, arithmetic_of(bfloat16),
                           threads);
}

nb::tuple compare_images(const Array<-1, -1, 3>& image, const Array<-1, -1, 3>& target, float dssim,
                         const std::optional<Array<-1, -1, 3>>& gradient, int threads) {
  require(image.size() > 0 && image.shape(0) == target.shape(0) && image.shape(1) == target.shape(1) &&
              (!gradient || gradient->size() == image.size()),
          "the images differ in size");
  field::ImageErrors errors;
  {
    const nb::gil_scoped_release release;
    errors = field::compare_images(size(image, 0), size(image, 1), image.data(), target.data(), dssim,
                                   pointer(gradient), threads);
  }
  return nb::make_tuple(errors.similarity, errors.absolute, errors.squared);
}

// position, offset, scale, opacity, color, covariance
using AnchorTensors = std::tuple<Matrix, Texels, Matrix, Matrix, Matrix, Matrix>;
// means, quaternions, scales, opacities, colors
using GaussianTensors = std::tuple<Matrix, Matrix, Matrix, Vector, Matrix>;

field::AnchorOutputs make_anchors(const AnchorTensors& tensors) {
  const auto& [position, offset, scale, opacity, color, covariance] = tensors;
  const std::size_t n = position.shape(0), K = offset.shape(1);
  require(K <= field::kMaxOffsets, "more than 64 offsets");
  require(position.shape(1) == 3 && offset.shape(0) == n && offset.shape(2) == 3 && scale.shape(0) == n &&
              scale.shape(1) == 6 && opacity.shape(0) == n && opacity.shape(1) == K && color.shape(0) == n &&
              color.shape(1) == 3 * K && covariance.shape(0) == n && covariance.shape(1) == 7 * K,
          "the tensors of the anchors do not fit");
  return {static_cast<int>(K), position.data(), offset.data(),    scale.data(),
          opacity.data(),      color.data(),    covariance.data()};
}

field::LocalGaussians make_gaussians(const GaussianTensors& tensors, std::size_t count) {
  const auto& [means, quaternions, scales, opacities, colors] = tensors;
  require(means.size() == 3 * count && quaternions.size() == 4 * count && scales.size() == 3 * count &&
              opacities.size() == count && colors.size() == 3 * count,
          "the tensors of the Gaussians do not fit");
  return {means.data(), quaternions.data(), scales.data(), opacities.data(), colors.data()};
}

void local_gaussians(const AnchorTensors& anchors, int threads, const GaussianTensors& gaussians) {
  const field::AnchorOutputs from = make_anchors(anchors);
  const std::size_t count = std::get<0>(anchors).shape(0);
  const field::LocalGaussians to = make_gaussians(gaussians, count * from.offsets);
  const nb::gil_scoped_release release;
  field::make_local_gaussians(from, count, threads, to);
}

void local_gaussians_backward(const AnchorTensors& anchors, int threads, const Vector& opacities, const Matrix& colors,
                              const GaussianTensors& gradient, const AnchorTensors& d_anchors) {
  const field::AnchorOutputs from = make_anchors(anchors);
  const std::size_t count = std::get<0>(anchors).shape(0), gaussians = count * from.offsets;
  const field::LocalGaussians d = make_gaussians(gradient, gaussians);
  require(opacities.size() == gaussians && colors.size() == 3 * gaussians, "the tensors of the Gaussians do not fit");
  require(make_anchors(d_anchors).offsets == from.offsets && std::get<0>(d_anchors).shape(0) == count,
          "the gradients of the anchors do not fit");
  const auto& [position, offset, scale, opacity, color, covariance] = d_anchors;
  const field::LocalGaussians value = {nullptr, nullptr, nullptr, opacities.data(), colors.data()};
  const field::AnchorGradient out = {position.data(), offset.data(), scale.data(),
                                     opacity.data(),  color.data(),  covariance.data()};
  const nb::gil_scoped_release release;
  field::make_local_gaussians_backward(from, count, threads, value, d, out);
}

}  // namespace

void bind_field(nb::module_& m) {
  m.def("look_up", &look_up, "planes"_a, "coordinates"_a, "time"_a, "scores"_a.none(), "threads"_a, "features"_a,
        "weights"_a.none());
  m.def("look_up_backward", &look_up_backward, "planes"_a, "coordinates"_a, "time"_a, "scores"_a.none(),
        "weights"_a.none(), "d_features"_a, "threads"_a, "result"_a, "d_planes"_a);
  m.def("penalise", &penalise, "planes"_a, "smoothness"_a, "constancy"_a, "gradients"_a, "threads"_a);
  m.def("networks_forward", &networks_forward, "x"_a, "networks"_a, "time"_a.none(), "bfloat16"_a, "threads"_a,
        "outputs"_a);
  m.def("networks_backward", &networks_backward, "x"_a, "networks"_a, "time"_a.none(), "d_outputs"_a, "bfloat16"_a,
        "threads"_a, "d_x"_a.none(), "gradients"_a);
  m.def("compare_images", &compare_images, "image"_a, "target"_a, "dssim"_a, "gradient"_a.none(), "threads"_a);
  m.def("local_gaussians", &local_gaussians, "anchors"_a, "threads"_a, "gaussians"_a);
  m.def("local_gaussians_backward", &local_gaussians_backward, "anchors"_a, "threads"_a, "opacities"_a, "colors"_a,
        "gradient"_a, "d_anchors"_a);
  m.def("bfloat16_in_hardware", [] { return field::rounded_kernels().in_hardware; });
  m.def("instruction_set", [] { return field::kernels().name; });
}

// Networks of two layers that share one input. Sums over rows are taken in parts whose size depends on the number of
// rows alone, and the parts are added up in order: the number of threads changes no bit.
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

namespace aa4d::field {

// Row-major, as torch has them. With a time, the input of the hidden layer has one column more, which holds it.
struct Layers {
  int inputs, hidden, outputs;  // inputs count that column
  const float *hidden_weight, *hidden_bias, *output_weight, *output_bias;
};

// Of the products: bfloat16 rounds their factors, in both directions, and sums in float32.
enum class Arithmetic { kFloat32, kBfloat16 };

struct LayersGradient {
  float *hidden_weight, *hidden_bias, *output_weight, *output_bias;
};

// x [rows, inputs (less the time)] -> y [i] [rows, outputs of network i].
void networks_forward(const std::vector<Layers>& networks, std::optional<float> time, std::size_t rows, const float* x,
                      const std::vector<float*>& y, Arithmetic arithmetic, int threads);

// d_x may be null.
void networks_backward(const std::vector<Layers>& networks, std::optional<float> time, std::size_t rows, const float* x,
                       const std::vector<const float*>& d_y, float* d_x, const std::vector<LayersGradient>& gradients,
                       Arithmetic arithmetic, int threads);

}  // namespace aa4d::field

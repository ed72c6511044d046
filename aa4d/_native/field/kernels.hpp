// What the kernels of one instruction set offer, and the plain data they work on. All arrays are row-major floats.
#pragma once

#include <cstddef>
#include <cstdint>

namespace aa4d::field {

inline constexpr int kMaxLevels = 8;
inline constexpr int kPlanes = 6;  // xy, xz, yz, xt, yt, zt

// One feature plane [rows, columns, C]. A plane that contains time is given as the one row that holds at the time of
// the query, so that it has a single row.
struct Plane {
  const float* texels;
  int rows, columns;
};

// The planes at all levels, queried by `count` anchors.
struct Lookup {
  Plane planes[kMaxLevels][kPlanes];
  int levels, channels;
  bool is_product;      // instead of a weighted sum
  const float* query;   // [N, 3] in [-1, 1]
  const float* scores;  // [N, 6, C], their softmax over planes are the weights; null for the product
};

// One sweep of a plane's second differences along the rows, and of |1 - value|.
struct Penalty {
  const float* plane;  // [rows, width]
  int rows, width;
  float smoothness, constancy;  // weights, divided by the number of terms
  float* gradient;              // like plane; null when it is not wanted
};

// output(relu(hidden(x))). The padded copies have a row stride of `stride(width)`.
struct Network {
  int inputs, hidden, outputs;
  const float *hidden_rows, *hidden_columns;  // [hidden, inputs] and its transpose, padded
  const float *output_rows, *output_columns;  // [outputs, hidden] and its transpose, padded
  const float *hidden_bias, *output_bias;     // padded
};

// The gradients that one run of rows adds to; laid out like the network's padded copies.
struct NetworkGradient {
  float *hidden_rows, *output_rows, *hidden_bias, *output_bias;
};

// The same with weights rounded to bfloat16, in pairs of neighbours in the direction of the sum: [hidden / 2, inputs]
// and so on, padded. A row of pairs has the stride of its width in floats.
struct RoundedNetwork {
  int inputs, hidden, outputs;
  const std::uint32_t *hidden_rows, *hidden_columns, *output_rows, *output_columns;
  const float *hidden_bias, *output_bias;
};

inline constexpr int kPad = 16;       // floats, a register of the widest instruction set
inline constexpr int kRowBlock = 128;  // rows that pass through a network together; a multiple of kTileRows
inline constexpr int kTileRows = 8;   // rows are padded to this

constexpr int padded(int width) { return (width + kPad - 1) / kPad * kPad; }
// An odd number of cache lines, so that the rows of a column fall into all sets of the cache.
constexpr int stride(int width) { return padded(width) + (padded(width) / kPad % 2 == 0 ? kPad : 0); }

// Scratch memory of one block of rows.
struct NetworkScratch {
  float *input, *hidden, *hidden_gradient, *output;  // [kRowBlock, stride(width)] each
};

constexpr int pairs(int width) { return (width + 1) / 2; }
// Of rows whose neighbours are in pairs: lines for half as many numbers.
constexpr int pair_stride(int width) { return stride(padded(width) / 2); }

// The same for rounded numbers: pairs of neighbours in a row, [kRowBlock, pair_stride(width)], and pairs of two rows,
// [kRowBlock / 2, stride(width)].
struct RoundedScratch {
  std::uint32_t *input_rows, *hidden_rows, *output_rows;
  std::uint32_t *input_pairs, *hidden_pairs, *hidden_gradient_pairs, *output_pairs;
};

// Rows of an image as rows of 3 W floats.
struct SimilarityRows {
  int width, height;  // width counts floats
  const float *image, *target;
  float* filtered;     // [5, height, width]: x, y, x^2, y^2, x y, filtered along rows
  float* derivatives;  // [3, height, width]: d/d(mean of x, of x^2, of x y), filtered along rows; null without gradient
  float* gradient;  // [height, width]
  float by_similarity, by_absolute;  // of the gradient: their weights divided by the number of values
};

// Sums over a row.
struct RowErrors {
  double similarity, absolute, squared;
};

// N anchors as the decoders left them; K = offsets.
struct AnchorOutputs {
  int offsets;
  const float *position, *offset, *scale;  // [N, 3], [N, K, 3], [N, 6]
  const float *opacity, *color, *covariance;  // [N, K], [N, K, 3], [N, K, 7]: before tanh and sigmoid
};

struct AnchorGradient {
  float *position, *offset, *scale, *opacity, *color, *covariance;
};

// N * K Gaussians.
struct LocalGaussians {
  float *means, *quaternions, *scales, *opacities, *colors;
};

inline constexpr int kMaxOffsets = 64;

struct Kernels {
  const char* name;
  // Anchors [begin, end): features [N, L C], and weights [N, 6, C] (null for the product).
  void (*look_up)(const Lookup&, std::size_t begin, std::size_t end, float* features, float* weights);
  // The gradient of the scores [N, 6, C] from that of the features; for the product instead the product of the other
  // planes [N, L, 6, C], which scatter takes as factors.
  void (*look_up_backward)(const Lookup&, std::size_t begin, std::size_t end, const float* weights,
                           const float* d_features, float* result);
  // Adds to one plane's gradient, texel by texel in the anchors' order. `factors`: weights [N, 6, C], or for the
  // product [N, L, 6, C].
  void (*scatter)(const Lookup&, std::size_t count, int level, int plane, const float* factors, const float* d_features,
                  float* d_texels);
  double (*penalise)(const Penalty&, int begin, int end);  // rows [begin, end): value, and the gradient of those rows
  void (*network_forward)(const Network&, const NetworkScratch&, int rows, const float* x, float* y);
  void (*network_backward)(const Network&, const NetworkScratch&, int rows, const float* x, const float* d_y,
                           float* d_x, bool add_to_d_x, const NetworkGradient&);
  void (*filter_row)(const SimilarityRows&, int row, float* padding);
  RowErrors (*compare_row)(const SimilarityRows&, int row, float* padding);
  void (*differentiate_row)(const SimilarityRows&, int row);
  void (*make_gaussians)(const AnchorOutputs&, std::size_t begin, std::size_t end, const LocalGaussians&);
  void (*make_gaussians_backward)(const AnchorOutputs&, std::size_t begin, std::size_t end, const LocalGaussians& value,
                                  const LocalGaussians& d, const AnchorGradient&);
};

// Networks with products of bfloat16 numbers.
struct RoundedKernels {
  bool in_hardware;  // or made of float32's instructions
  // Takes the input of networks; `for_backward` as well.
  void (*take_input)(const RoundedScratch&, int inputs, int rows, const float* x, bool for_backward);
  void (*network_forward)(const RoundedNetwork&, const RoundedScratch&, int rows, float* y);
  void (*network_backward)(const RoundedNetwork&, const RoundedScratch&, int rows, const float* d_y, float* d_x,
                           bool add_to_d_x, const NetworkGradient&);
};

inline constexpr int kTaps = 11;
inline constexpr int kHalf = 5;
// compare_row and filter_row need (kSimilarityRows rows of width + 2 * kMargin) floats.
inline constexpr int kMargin = 3 * kHalf + 16;
inline constexpr int kSimilarityRows = 5;

extern const Kernels kPortableKernels;
#if defined(__x86_64__)
extern const Kernels kAvx2Kernels, kAvx512Kernels;
extern const RoundedKernels kRoundedAvx2Kernels, kRoundedAvx512Kernels, kRoundedAvx512Bf16Kernels;
#endif
extern const RoundedKernels kRoundedPortableKernels;

// The best set this machine can run, unless the environment's AA4D_SIMD names another (avx512, avx2, portable).
const Kernels& kernels();
const RoundedKernels& rounded_kernels();

}  // namespace aa4d::field

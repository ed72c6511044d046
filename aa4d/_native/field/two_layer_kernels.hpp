// Two linear layers with a ReLU between them, for a block of rows that stays in the cache.
#pragma once

#include "field/kernels.hpp"
#include "field/vector.hpp"

namespace aa4d::field::AA4D_ARCH {

// What becomes of a finished sum of products.
enum class Finish {
  kStore,        // c = sum
  kAdd,          // c += sum
  kBias,         // c = sum + bias
  kBiasRelu,     // c = max(sum + bias, 0)
  kWherePositive // c = sum where `extra` (laid out like c) is positive, else 0
};

// c [rows, columns] from a [rows, depth] and b [depth, columns]. a may be read across: element (i, k) stands at
// a[i * a_row + k * a_column]. Rows are a multiple of kTileRows and columns of kWidth: all arrays are padded.
struct Product {
  int rows, columns, depth;
  const float* a;
  int a_row, a_column;
  const float* b;
  int b_row;
  float* c;
  int c_row;
  const float* extra;  // the bias [columns], or a matrix like c
};

// Registers hold kTile rows of kVectors vectors; 32 or 16 registers bound their product.
#if defined(__AVX512F__)
inline constexpr int kTile = 8, kMostVectors = 3;
#else
inline constexpr int kTile = 4, kMostVectors = 2;
#endif

template <Finish kFinish, int kVectors>
inline void multiply_tile(const Product& m, int row, int column) {
  Vector sum[kTile][kVectors];
  float* const c = m.c + static_cast<std::ptrdiff_t>(row) * m.c_row + column;
  for (int i = 0; i < kTile; ++i) {
    for (int j = 0; j < kVectors; ++j) {
      if constexpr (kFinish == Finish::kAdd) {
        sum[i][j] = load(c + i * m.c_row + j * kWidth);
      } else if constexpr (kFinish == Finish::kBias || kFinish == Finish::kBiasRelu) {
        sum[i][j] = load(m.extra + column + j * kWidth);
      } else {
        sum[i][j] = Vector{};
      }
    }
  }
  const float* a = m.a + static_cast<std::ptrdiff_t>(row) * m.a_row;
  const float* b = m.b + column;
  for (int k = 0; k < m.depth; ++k) {
    Vector right[kVectors];
    for (int j = 0; j < kVectors; ++j) right[j] = load(b + j * kWidth);
    for (int i = 0; i < kTile; ++i) {
      const Vector left = splat(a[static_cast<std::ptrdiff_t>(i) * m.a_row]);
      for (int j = 0; j < kVectors; ++j) sum[i][j] += left * right[j];
    }
    a += m.a_column;
    b += m.b_row;
  }
  for (int i = 0; i < kTile; ++i) {
    for (int j = 0; j < kVectors; ++j) {
      Vector value = sum[i][j];
      if constexpr (kFinish == Finish::kBiasRelu) value = value < 0.0f ? Vector{} : value;  // NaN stays
      if constexpr (kFinish == Finish::kWherePositive) {
        const float* const extra = m.extra + static_cast<std::ptrdiff_t>(row + i) * m.c_row + column + j * kWidth;
        value = load(extra) > 0.0f ? value : Vector{};
      }
      store(c + i * m.c_row + j * kWidth, value);
    }
  }
}

template <Finish kFinish, int kVectors>
inline void multiply_panel(const Product& m, int column) {
  for (int row = 0; row < m.rows; row += kTile) multiply_tile<kFinish, kVectors>(m, row, column);
}

template <Finish kFinish>
inline void multiply(const Product& m) {
  int column = 0;
  for (; column + kMostVectors * kWidth <= m.columns; column += kMostVectors * kWidth) {
    multiply_panel<kFinish, kMostVectors>(m, column);
  }
  if constexpr (kMostVectors > 2) {
    if (column + 2 * kWidth <= m.columns) {
      multiply_panel<kFinish, 2>(m, column);
      column += 2 * kWidth;
    }
  }
  for (; column < m.columns; column += kWidth) multiply_panel<kFinish, 1>(m, column);
}

constexpr int padded_rows(int rows) { return (rows + kTileRows - 1) / kTileRows * kTileRows; }

// Rows of `width` floats to rows of stride(width), zero beyond width and beyond `rows`.
inline void pad_rows(const float* from, int rows, int width, float* to) {
  const int row_stride = stride(width);
  for (int i = 0; i < padded_rows(rows); ++i) {
    float* const out = to + static_cast<std::ptrdiff_t>(i) * row_stride;
    int x = 0;
    if (i < rows) {
      const float* const in = from + static_cast<std::ptrdiff_t>(i) * width;
      for (; x + kWidth <= width; x += kWidth) store(out + x, load(in + x));
      for (; x < width; ++x) out[x] = in[x];
    }
    for (; x < padded(width); ++x) out[x] = 0;
  }
}

inline void unpad_rows(const float* from, int rows, int width, float* to) {
  for (int i = 0; i < rows; ++i) {
    const float* const in = from + static_cast<std::ptrdiff_t>(i) * stride(width);
    float* const out = to + static_cast<std::ptrdiff_t>(i) * width;
    int x = 0;
    for (; x + kWidth <= width; x += kWidth) store(out + x, load(in + x));
    for (; x < width; ++x) out[x] = in[x];
  }
}

inline void add_rows(const float* from, int rows, int width, float* to) {
  for (int x = 0; x < padded(width); x += kWidth) {
    Vector total = load(to + x);
    for (int i = 0; i < rows; ++i) total += load(from + static_cast<std::ptrdiff_t>(i) * stride(width) + x);
    store(to + x, total);
  }
}

inline void hidden_layer(const Network& n, const NetworkScratch& s, int rows) {
  multiply<Finish::kBiasRelu>({padded_rows(rows), padded(n.hidden), n.inputs, s.input, stride(n.inputs), 1,
                               n.hidden_columns, stride(n.hidden), s.hidden, stride(n.hidden), n.hidden_bias});
}

inline void network_forward(const Network& n, const NetworkScratch& s, int rows, const float* x, float* y) {
  pad_rows(x, rows, n.inputs, s.input);
  hidden_layer(n, s, rows);
  multiply<Finish::kBias>({padded_rows(rows), padded(n.outputs), n.hidden, s.hidden, stride(n.hidden), 1,
                           n.output_columns, stride(n.outputs), s.output, stride(n.outputs), n.output_bias});
  unpad_rows(s.output, rows, n.outputs, y);
}

// The hidden layer is computed again: it costs a tenth, and keeping it would cost memory that grows with the anchors.
inline void network_backward(const Network& n, const NetworkScratch& s, int rows, const float* x, const float* d_y,
                             float* d_x, bool add_to_d_x, const NetworkGradient& gradient) {
  const int all = padded_rows(rows);
  pad_rows(x, rows, n.inputs, s.input);
  pad_rows(d_y, rows, n.outputs, s.output);
  hidden_layer(n, s, rows);
  multiply<Finish::kWherePositive>({all, padded(n.hidden), n.outputs, s.output, stride(n.outputs), 1, n.output_rows,
                                    stride(n.hidden), s.hidden_gradient, stride(n.hidden), s.hidden});
  // Sums over rows: the rows beyond `rows` have gradients of zero, but their hidden layer is relu(bias).
  multiply<Finish::kAdd>({padded_rows(n.outputs), padded(n.hidden), rows, s.output, 1, stride(n.outputs), s.hidden,
                          stride(n.hidden), gradient.output_rows, stride(n.hidden), nullptr});
  multiply<Finish::kAdd>({padded_rows(n.hidden), padded(n.inputs), rows, s.hidden_gradient, 1, stride(n.hidden),
                          s.input, stride(n.inputs), gradient.hidden_rows, stride(n.inputs), nullptr});
  add_rows(s.output, rows, n.outputs, gradient.output_bias);
  add_rows(s.hidden_gradient, rows, n.hidden, gradient.hidden_bias);
  if (d_x == nullptr) return;
  multiply<Finish::kStore>({all, padded(n.inputs), n.hidden, s.hidden_gradient, stride(n.hidden), 1, n.hidden_rows,
                            stride(n.inputs), s.input, stride(n.inputs), nullptr});
  if (!add_to_d_x) return unpad_rows(s.input, rows, n.inputs, d_x);
  for (int i = 0; i < rows; ++i) {
    const float* const in = s.input + static_cast<std::ptrdiff_t>(i) * stride(n.inputs);
    for (int k = 0; k < n.inputs; ++k) d_x[static_cast<std::ptrdiff_t>(i) * n.inputs + k] += in[k];
  }
}

}  // namespace aa4d::field::AA4D_ARCH

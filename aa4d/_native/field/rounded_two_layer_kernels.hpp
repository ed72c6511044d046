// The two-layer networks with products of bfloat16 numbers: weights, inputs, hidden layers and their gradients are
// rounded where they are multiplied; sums, biases and the gradients of weights are float32.
#pragma once

#include "field/bfloat16.hpp"
#include "field/kernels.hpp"

namespace aa4d::field::AA4D_ARCH::rounded {

// Registers hold kTile rows of kVectors vectors.
#if defined(__AVX512F__)
inline constexpr int kTile = 8, kMostVectors = 2;
#else
inline constexpr int kTile = 4, kMostVectors = 1;
#endif

// The factors of [rows, columns] sums over `depth` pairs of numbers. The pair k of row i stands at
// a[i * a_row + k * a_column], that of a column at b[k * b_row + column].
struct Product {
  int rows, columns, depth;
  const std::uint32_t* a;
  int a_row, a_column;
  const std::uint32_t* b;
  int b_row;
};

template <int kVectors>
using Tile = Vector[kTile][kVectors];

// Adds the products of one tile to `sum`.
template <int kVectors>
inline void add_products(const Product& m, int row, int column, Tile<kVectors>& sum) {
  const std::uint32_t* a = m.a + static_cast<std::ptrdiff_t>(row) * m.a_row;
  const std::uint32_t* b = m.b + column;
  for (int k = 0; k < m.depth; ++k) {
    Bits right[kVectors];
    for (int j = 0; j < kVectors; ++j) right[j] = load(b + j * kWidth);
    for (int i = 0; i < kTile; ++i) {
      const std::uint32_t left = a[static_cast<std::ptrdiff_t>(i) * m.a_row];
      for (int j = 0; j < kVectors; ++j) sum[i][j] = multiply_add(sum[i][j], left, right[j]);
    }
    a += m.a_column;
    b += m.b_row;
  }
}

// Each tile of the product begins as `begin(row, column, sum)` leaves it, and `finish(row, column, sum)` takes it.
template <int kVectors, class Begin, class Finish>
inline void multiply_panel(const Product& m, int column, const Begin& begin, const Finish& finish) {
  for (int row = 0; row < m.rows; row += kTile) {
    Tile<kVectors> sum;
    for (int i = 0; i < kTile; ++i) {
      for (int j = 0; j < kVectors; ++j) sum[i][j] = begin(row + i, column + j * kWidth);
    }
    add_products<kVectors>(m, row, column, sum);
    for (int j = 0; j < kVectors; ++j) {
      Vector rows[kTile];
      for (int i = 0; i < kTile; ++i) rows[i] = sum[i][j];
      finish(row, column + j * kWidth, rows);
    }
  }
}

template <class Begin, class Finish>
inline void multiply(const Product& m, const Begin& begin, const Finish& finish) {
  int column = 0;
  for (; column + kMostVectors * kWidth <= m.columns; column += kMostVectors * kWidth) {
    multiply_panel<kMostVectors>(m, column, begin, finish);
  }
  if constexpr (kMostVectors > 2) {
    if (column + 2 * kWidth <= m.columns) {
      multiply_panel<2>(m, column, begin, finish);
      column += 2 * kWidth;
    }
  }
  for (; column < m.columns; column += kWidth) multiply_panel<1>(m, column, begin, finish);
}

inline Vector zero(int, int) { return Vector{}; }

constexpr int padded_rows(int rows) { return (rows + kTileRows - 1) / kTileRows * kTileRows; }

inline Vector load_part(const float* p, int count) { return count >= kWidth ? load(p) : load<false>(p, count); }

// Rows of `width` floats as pairs of neighbours (`rows_out`) and as pairs of rows (`pairs_out`), where asked for, zero
// beyond width and beyond `rows`; adds up the columns in float32 where `sums` is given.
inline void round_rows(const float* from, int rows, int width, std::uint32_t* rows_out, std::uint32_t* pairs_out,
                       float* sums) {
  const auto part = [&](int i, int x) {
    return i < rows && x < width ? load_part(from + static_cast<std::ptrdiff_t>(i) * width + x, width - x) : Vector{};
  };
  for (int x = 0; x < padded(width); x += kWidth) {
    Vector total = sums ? load(sums + x) : Vector{};
    for (int i = 0; i < padded_rows(rows); i += 2) {
      const Vector first = part(i, x), second = part(i + 1, x);
      if (rows_out) {
        std::uint32_t* const out = rows_out + static_cast<std::ptrdiff_t>(i) * pair_stride(width) + x / 2;
        store_row(out, first);
        store_row(out + pair_stride(width), second);
      }
      if (pairs_out) {
        store(pairs_out + static_cast<std::ptrdiff_t>(i / 2) * stride(width) + x, interleave(first, second));
      }
      total += first + second;
    }
    if (sums) store(sums + x, total);
  }
}

inline void take_input(const RoundedScratch& s, int inputs, int rows, const float* x, bool for_backward) {
  round_rows(x, rows, inputs, s.input_rows, for_backward ? s.input_pairs : nullptr, nullptr);
}

// Both take their input from `take_input`.
inline void network_forward(const RoundedNetwork& n, const RoundedScratch& s, int rows, float* y) {
  const int all = padded_rows(rows), across = pair_stride(n.hidden);
  multiply(
      {all, padded(n.hidden), pairs(n.inputs), s.input_rows, pair_stride(n.inputs), 1, n.hidden_columns,
       stride(n.hidden)},
      [&](int, int column) { return load(n.hidden_bias + column); },
      [&](int row, int column, Vector(&sum)[kTile]) {
        for (int i = 0; i < kTile; ++i) {
          const Vector value = sum[i] < 0.0f ? Vector{} : sum[i];  // NaN stays
          store_row(s.hidden_rows + static_cast<std::ptrdiff_t>(row + i) * across + column / 2, value);
        }
      });
  multiply(
      {all, padded(n.outputs), pairs(n.hidden), s.hidden_rows, across, 1, n.output_columns, stride(n.outputs)},
      [&](int, int column) { return load(n.output_bias + column); },
      [&](int row, int column, Vector(&sum)[kTile]) {
        const int count = n.outputs - column;
        for (int i = 0; i < kTile && row + i < rows; ++i) {
          float* const out = y + static_cast<std::ptrdiff_t>(row + i) * n.outputs + column;
          count >= kWidth ? store(out, sum[i]) : store<false>(out, sum[i], count);
        }
      });
}

inline void network_backward(const RoundedNetwork& n, const RoundedScratch& s, int rows, const float* d_y, float* d_x,
                             bool add_to_d_x, const NetworkGradient& gradient) {
  const int all = padded_rows(rows), across = pair_stride(n.hidden);
  round_rows(d_y, rows, n.outputs, s.output_rows, s.output_pairs, gradient.output_bias);
  multiply(
      {all, padded(n.hidden), pairs(n.inputs), s.input_rows, pair_stride(n.inputs), 1, n.hidden_columns,
       stride(n.hidden)},
      [&](int, int column) { return load(n.hidden_bias + column); },
      [&](int row, int column, Vector(&sum)[kTile]) {
        for (int i = 0; i < kTile; i += 2) {
          const Vector first = sum[i] < 0.0f ? Vector{} : sum[i], second = sum[i + 1] < 0.0f ? Vector{} : sum[i + 1];
          store(s.hidden_pairs + static_cast<std::ptrdiff_t>((row + i) / 2) * stride(n.hidden) + column,
                interleave(first, second));
        }
      });
  multiply({all, padded(n.hidden), pairs(n.outputs), s.output_rows, pair_stride(n.outputs), 1, n.output_rows,
            stride(n.hidden)},
           zero, [&](int row, int column, Vector(&sum)[kTile]) {
             Vector total = load(gradient.hidden_bias + column);
             for (int i = 0; i < kTile; i += 2) {
               const std::ptrdiff_t at = static_cast<std::ptrdiff_t>((row + i) / 2) * stride(n.hidden) + column;
               const Bits hidden = load(s.hidden_pairs + at);
               const Vector first = low(hidden) > 0.0f ? sum[i] : Vector{};
               const Vector second = high(hidden) > 0.0f ? sum[i + 1] : Vector{};
               total += first + second;
               store(s.hidden_gradient_pairs + at, interleave(first, second));
               if (d_x) {
                 std::uint32_t* const out = s.hidden_rows + static_cast<std::ptrdiff_t>(row + i) * across + column / 2;
                 store_row(out, first);
                 store_row(out + across, second);
               }
             }
             store(gradient.hidden_bias + column, total);
           });
  // Sums over rows: those beyond `rows` have gradients of zero.
  const auto add_to = [](float* weights, int row_stride) {
    return [=](int row, int column, Vector(&sum)[kTile]) {
      for (int i = 0; i < kTile; ++i) {
        store(weights + static_cast<std::ptrdiff_t>(row + i) * row_stride + column, sum[i]);
      }
    };
  };
  const auto begin_with = [](const float* weights, int row_stride) {
    return [=](int row, int column) { return load(weights + static_cast<std::ptrdiff_t>(row) * row_stride + column); };
  };
  multiply({padded_rows(n.outputs), padded(n.hidden), all / 2, s.output_pairs, 1, stride(n.outputs), s.hidden_pairs,
            stride(n.hidden)},
           begin_with(gradient.output_rows, stride(n.hidden)), add_to(gradient.output_rows, stride(n.hidden)));
  multiply({padded_rows(n.hidden), padded(n.inputs), all / 2, s.hidden_gradient_pairs, 1, stride(n.hidden),
            s.input_pairs, stride(n.inputs)},
           begin_with(gradient.hidden_rows, stride(n.inputs)), add_to(gradient.hidden_rows, stride(n.inputs)));
  if (d_x == nullptr) return;
  multiply({all, padded(n.inputs), pairs(n.hidden), s.hidden_rows, across, 1, n.hidden_rows, stride(n.inputs)}, zero,
           [&](int row, int column, Vector(&sum)[kTile]) {
             const int count = n.inputs - column;
             for (int i = 0; i < kTile && row + i < rows; ++i) {
               float* const out = d_x + static_cast<std::ptrdiff_t>(row + i) * n.inputs + column;
               Vector value = sum[i];
               if (add_to_d_x) value += load_part(out, count);
               count >= kWidth ? store(out, value) : store<false>(out, value, count);
             }
           });
}

#if defined(__AVX512BF16__)
inline constexpr bool kInHardware = true;
#else
inline constexpr bool kInHardware = false;
#endif
inline constexpr RoundedKernels kKernels = {kInHardware, &take_input, &network_forward, &network_backward};

}  // namespace aa4d::field::AA4D_ARCH::rounded

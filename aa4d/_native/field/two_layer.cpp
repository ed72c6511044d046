#include "field/two_layer.hpp"

#include <algorithm>
#include <bit>
#include <cstdint>

#include "common/buffer.hpp"
#include "common/thread_pool.hpp"
#include "field/kernels.hpp"

namespace aa4d::field {
namespace {

constexpr std::size_t kMostParts = 16;

struct Widths {
  int inputs, hidden, outputs;
};

// A network's weights in the kernels' layout. What is time's share of the first layer goes into the bias.
class Packed {
 public:
  using Scratch = NetworkScratch;

  Packed(const Layers& layers, std::optional<float> time) {
    Network& n = network;
    n.inputs = layers.inputs - (time ? 1 : 0);
    n.hidden = layers.hidden;
    n.outputs = layers.outputs;
    const int sizes[] = {n.hidden * stride(n.inputs),
                         n.inputs * stride(n.hidden),
                         n.outputs * stride(n.hidden),
                         n.hidden * stride(n.outputs),
                         padded(n.hidden),
                         padded(n.outputs)};
    std::size_t total = 0;
    for (const int size : sizes) total += padded(size);
    storage_.resize_discarding(total);
    std::fill_n(storage_.data(), total, 0.0f);
    float* place = storage_.data();
    float* arrays[6];
    for (int i = 0; i < 6; ++i) {
      arrays[i] = place;
      place += padded(sizes[i]);
    }
    for (int h = 0; h < n.hidden; ++h) {
      const float* const row = layers.hidden_weight + static_cast<std::size_t>(h) * layers.inputs;
      for (int i = 0; i < n.inputs; ++i) {
        arrays[0][h * stride(n.inputs) + i] = row[i];
        arrays[1][i * stride(n.hidden) + h] = row[i];
      }
      arrays[4][h] = layers.hidden_bias[h] + (time ? row[n.inputs] * *time : 0.0f);
    }
    for (int o = 0; o < n.outputs; ++o) {
      const float* const row = layers.output_weight + static_cast<std::size_t>(o) * n.hidden;
      for (int h = 0; h < n.hidden; ++h) {
        arrays[2][o * stride(n.hidden) + h] = row[h];
        arrays[3][h * stride(n.outputs) + o] = row[h];
      }
      arrays[5][o] = layers.output_bias[o];
    }
    n.hidden_rows = arrays[0];
    n.hidden_columns = arrays[1];
    n.output_rows = arrays[2];
    n.output_columns = arrays[3];
    n.hidden_bias = arrays[4];
    n.output_bias = arrays[5];
  }

  // Of one thread, kept between calls; `w` are the largest widths.
  static Scratch scratch(const Widths& w) {
    static thread_local Buffer<float> memory;
    const std::size_t inputs = kRowBlock * stride(w.inputs), hidden = kRowBlock * stride(w.hidden);
    memory.resize_discarding(inputs + 2 * hidden + kRowBlock * stride(w.outputs));
    float* const place = memory.data();
    return {place, place + inputs, place + inputs + hidden, place + inputs + 2 * hidden};
  }

  static void take_input(const Scratch&, int, int, const float*, bool) {}  // each network does

  void forward(const Scratch& scratch, int rows, const float* x, float* y) const {
    kernels().network_forward(network, scratch, rows, x, y);
  }
  void backward(const Scratch& scratch, int rows, const float* x, const float* d_y, float* d_x, bool add_to_d_x,
                const NetworkGradient& gradient) const {
    kernels().network_backward(network, scratch, rows, x, d_y, d_x, add_to_d_x, gradient);
  }

  Network network;

 private:
  Buffer<float> storage_;
};

// The nearest bfloat16, ties to even; NaN stays NaN.
std::uint32_t bfloat16(float value) {
  const auto bits = std::bit_cast<std::uint32_t>(value);
  return value == value ? (bits + 0x7fff + (bits >> 16 & 1)) >> 16 : bits >> 16 | 0x40;
}

// The same rounded to bfloat16, but for the biases.
class RoundedPacked {
 public:
  using Scratch = RoundedScratch;

  RoundedPacked(const Layers& layers, std::optional<float> time) {
    RoundedNetwork& n = network;
    n.inputs = layers.inputs - (time ? 1 : 0);
    n.hidden = layers.hidden;
    n.outputs = layers.outputs;
    const std::size_t sizes[] = {static_cast<std::size_t>(pairs(n.hidden)) * stride(n.inputs),
                                 static_cast<std::size_t>(pairs(n.inputs)) * stride(n.hidden),
                                 static_cast<std::size_t>(pairs(n.outputs)) * stride(n.hidden),
                                 static_cast<std::size_t>(pairs(n.hidden)) * stride(n.outputs)};
    weights_.resize_discarding(sizes[0] + sizes[1] + sizes[2] + sizes[3]);
    std::uint32_t* const hidden_rows = weights_.data();
    std::uint32_t* const hidden_columns = hidden_rows + sizes[0];
    std::uint32_t* const output_rows = hidden_columns + sizes[1];
    std::uint32_t* const output_columns = output_rows + sizes[2];
    std::fill_n(hidden_rows, sizes[0] + sizes[1] + sizes[2] + sizes[3], 0);
    biases_.resize_discarding(padded(n.hidden) + padded(n.outputs));
    std::fill_n(biases_.data(), padded(n.hidden) + padded(n.outputs), 0.0f);
    float *const hidden_bias = biases_.data(), *const output_bias = hidden_bias + padded(n.hidden);
    for (int h = 0; h < n.hidden; ++h) {
      const float* const row = layers.hidden_weight + static_cast<std::size_t>(h) * layers.inputs;
      for (int i = 0; i < n.inputs; ++i) {
        const std::uint32_t weight = bfloat16(row[i]);
        hidden_rows[h / 2 * stride(n.inputs) + i] |= weight << (16 * (h % 2));
        hidden_columns[i / 2 * stride(n.hidden) + h] |= weight << (16 * (i % 2));
      }
      hidden_bias[h] = layers.hidden_bias[h] + (time ? row[n.inputs] * *time : 0.0f);
    }
    for (int o = 0; o < n.outputs; ++o) {
      const float* const row = layers.output_weight + static_cast<std::size_t>(o) * n.hidden;
      for (int h = 0; h < n.hidden; ++h) {
        const std::uint32_t weight = bfloat16(row[h]);
        output_rows[o / 2 * stride(n.hidden) + h] |= weight << (16 * (o % 2));
        output_columns[h / 2 * stride(n.outputs) + o] |= weight << (16 * (h % 2));
      }
      output_bias[o] = layers.output_bias[o];
    }
    n.hidden_rows = hidden_rows;
    n.hidden_columns = hidden_columns;
    n.output_rows = output_rows;
    n.output_columns = output_columns;
    n.hidden_bias = hidden_bias;
    n.output_bias = output_bias;
  }

  static Scratch scratch(const Widths& w) {
    static thread_local Buffer<std::uint32_t> memory;
    const std::size_t sizes[] = {
        kRowBlock * static_cast<std::size_t>(pair_stride(w.inputs)),
        kRowBlock * static_cast<std::size_t>(pair_stride(w.hidden)),
        kRowBlock * static_cast<std::size_t>(pair_stride(w.outputs)),
        kRowBlock / 2 * static_cast<std::size_t>(stride(w.inputs)),
        kRowBlock / 2 * static_cast<std::size_t>(stride(w.hidden)),
        kRowBlock / 2 * static_cast<std::size_t>(stride(w.hidden)),
        kRowBlock / 2 * static_cast<std::size_t>(stride(w.outputs)),
    };
    std::size_t total = 0;
    for (const std::size_t size : sizes) total += size;
    memory.resize_discarding(total);
    std::uint32_t* place[7];
    std::size_t begin = 0;
    for (int i = 0; i < 7; ++i) {
      place[i] = memory.data() + begin;
      begin += sizes[i];
    }
    return {place[0], place[1], place[2], place[3], place[4], place[5], place[6]};
  }

  static void take_input(const Scratch& scratch, int inputs, int rows, const float* x, bool for_backward) {
    rounded_kernels().take_input(scratch, inputs, rows, x, for_backward);
  }
  void forward(const Scratch& scratch, int rows, const float*, float* y) const {
    rounded_kernels().network_forward(network, scratch, rows, y);
  }
  void backward(const Scratch& scratch, int rows, const float*, const float* d_y, float* d_x, bool add_to_d_x,
                const NetworkGradient& gradient) const {
    rounded_kernels().network_backward(network, scratch, rows, d_y, d_x, add_to_d_x, gradient);
  }

  RoundedNetwork network;

 private:
  Buffer<std::uint32_t> weights_;
  Buffer<float> biases_;
};

template <class Weights>
std::vector<Weights> pack(const std::vector<Layers>& networks, std::optional<float> time) {
  std::vector<Weights> packed;
  packed.reserve(networks.size());
  for (const Layers& layers : networks) packed.emplace_back(layers, time);
  return packed;
}

template <class Weights>
typename Weights::Scratch scratch_for(const std::vector<Weights>& packed) {
  Widths widths = {0, 0, 0};
  for (const Weights& p : packed) {
    widths = {std::max(widths.inputs, p.network.inputs), std::max(widths.hidden, p.network.hidden),
              std::max(widths.outputs, p.network.outputs)};
  }
  return Weights::scratch(widths);
}

constexpr int padded_to(int value, int step) { return (value + step - 1) / step * step; }

// Where the parts of a gradient stand in a part's memory.
struct GradientLayout {
  std::size_t hidden_rows, output_rows, hidden_bias, output_bias, end;

  GradientLayout(const auto& n, std::size_t begin) {
    hidden_rows = begin;
    output_rows = hidden_rows + static_cast<std::size_t>(padded_to(n.hidden, kTileRows)) * stride(n.inputs);
    hidden_bias = output_rows + static_cast<std::size_t>(padded_to(n.outputs, kTileRows)) * stride(n.hidden);
    output_bias = hidden_bias + padded(n.hidden);
    end = output_bias + padded(n.outputs);
  }
};

template <class Body>
void for_blocks(std::size_t begin, std::size_t end, const Body& body) {
  for (std::size_t row = begin; row < end; row += kRowBlock) {
    body(row, static_cast<int>(std::min<std::size_t>(kRowBlock, end - row)));
  }
}

// The rows of [begin, end) that have a gradient at an output. The others add zero to every sum, in training a fifth of
// them: anchors that are hidden, or of which nothing is drawn.
std::vector<std::size_t> rows_with_gradient(const std::vector<Layers>& networks, const std::vector<const float*>& d_y,
                                            std::size_t begin, std::size_t end) {
  std::vector<std::size_t> found;
  for (std::size_t row = begin; row < end; ++row) {
    std::uint32_t bits = 0;  // but for signs: of minus zero there are none
    for (std::size_t i = 0; i < networks.size(); ++i) {
      const float* const d = d_y[i] + row * networks[i].outputs;
      for (int k = 0; k < networks[i].outputs; ++k) bits |= std::bit_cast<std::uint32_t>(d[k]) << 1;
    }
    if (bits != 0) found.push_back(row);
  }
  return found;
}

// Those rows of one block, one after another, and where their d_x goes.
class Gathered {
 public:
  Gathered(const std::size_t* rows, int count, const std::vector<Layers>& networks, int inputs, const float* x,
           const std::vector<const float*>& d_y, float* d_x)
      : rows_(rows), count_(count), inputs_(inputs), x_(x + rows[0] * inputs), d_x_(d_x) {
    const bool together = rows[count - 1] - rows[0] + 1 == static_cast<std::size_t>(count);
    is_copy_ = !together;
    for (std::size_t i = 0; i < networks.size(); ++i) d_y_.push_back(d_y[i] + rows[0] * networks[i].outputs);
    if (together) {
      place_ = d_x ? d_x + rows[0] * inputs : nullptr;
      return;
    }
    static thread_local Buffer<float> memory;
    std::size_t width = 2 * inputs;
    for (const Layers& layers : networks) width += layers.outputs;
    memory.resize_discarding(width * count);
    float* free = memory.data();
    const auto copy = [&](const float* from, int columns) {
      float* const to = free;
      for (int i = 0; i < count; ++i) std::copy_n(from + rows[i] * columns, columns, to + i * columns);
      free += static_cast<std::size_t>(count) * columns;
      return to;
    };
    x_ = copy(x, inputs);
    for (std::size_t i = 0; i < networks.size(); ++i) d_y_[i] = copy(d_y[i], networks[i].outputs);
    place_ = d_x ? free : nullptr;
  }

  const float* x() const { return x_; }
  const float* d_y(std::size_t network) const { return d_y_[network]; }
  float* d_x() const { return place_; }
  void scatter() const {
    if (!is_copy_ || d_x_ == nullptr) return;
    for (int i = 0; i < count_; ++i) std::copy_n(place_ + i * inputs_, inputs_, d_x_ + rows_[i] * inputs_);
  }

 private:
  const std::size_t* rows_;
  int count_, inputs_;
  bool is_copy_;
  const float* x_;
  std::vector<const float*> d_y_;
  float *d_x_, *place_;
};

template <class Weights>
void forward(const std::vector<Layers>& networks, std::optional<float> time, std::size_t rows, const float* x,
             const std::vector<float*>& y, int threads) {
  const std::vector<Weights> packed = pack<Weights>(networks, time);
  const int inputs = packed[0].network.inputs;
  constexpr std::size_t kTask = 2 * kRowBlock;
  parallel_for(threads, (rows + kTask - 1) / kTask, [&](std::size_t task) {
    const auto scratch = scratch_for(packed);
    for_blocks(task * kTask, std::min(rows, (task + 1) * kTask), [&](std::size_t row, int count) {
      Weights::take_input(scratch, inputs, count, x + row * inputs, false);
      for (std::size_t i = 0; i < packed.size(); ++i) {
        packed[i].forward(scratch, count, x + row * inputs, y[i] + row * packed[i].network.outputs);
      }
    });
  });
}

template <class Weights>
void backward(const std::vector<Layers>& networks, std::optional<float> time, std::size_t rows, const float* x,
              const std::vector<const float*>& d_y, float* d_x, const std::vector<LayersGradient>& gradients,
              int threads) {
  const std::vector<Weights> packed = pack<Weights>(networks, time);
  const int inputs = packed[0].network.inputs;
  std::vector<GradientLayout> layouts;
  for (const Weights& p : packed) layouts.emplace_back(p.network, layouts.empty() ? 0 : layouts.back().end);
  const std::size_t size = layouts.back().end;
  const std::size_t part_rows = padded_to(std::max<std::size_t>(1, (rows + kMostParts - 1) / kMostParts), kRowBlock);
  const std::size_t parts = (rows + part_rows - 1) / part_rows;
  Buffer<float> sums;
  sums.resize_discarding(size * std::max<std::size_t>(parts, 1));
  if (parts == 0) std::fill_n(sums.data(), size, 0.0f);
  parallel_for(threads, parts, [&](std::size_t part) {
    const auto scratch = scratch_for(packed);
    float* const place = sums.data() + part * size;
    std::fill_n(place, size, 0.0f);
    const std::size_t begin = part * part_rows, end = std::min(rows, begin + part_rows);
    const std::vector<std::size_t> used = rows_with_gradient(networks, d_y, begin, end);
    if (d_x && used.size() < end - begin) std::fill(d_x + begin * inputs, d_x + end * inputs, 0.0f);
    for_blocks(0, used.size(), [&](std::size_t first, int count) {
      const Gathered block(used.data() + first, count, networks, inputs, x, d_y, d_x);
      Weights::take_input(scratch, inputs, count, block.x(), true);
      for (std::size_t i = 0; i < packed.size(); ++i) {
        const GradientLayout& at = layouts[i];
        packed[i].backward(
            scratch, count, block.x(), block.d_y(i), block.d_x(), i > 0,
            {place + at.hidden_rows, place + at.output_rows, place + at.hidden_bias, place + at.output_bias});
      }
      block.scatter();
    });
  });
  constexpr std::size_t kRange = 4096;
  parallel_for(threads, (size + kRange - 1) / kRange, [&](std::size_t range) {
    const std::size_t end = std::min(size, (range + 1) * kRange);
    for (std::size_t part = 1; part < parts; ++part) {
      const float* const from = sums.data() + part * size;
      for (std::size_t k = range * kRange; k < end; ++k) sums[k] += from[k];
    }
  });
  for (std::size_t i = 0; i < packed.size(); ++i) {
    const auto& n = packed[i].network;
    const GradientLayout& at = layouts[i];
    const LayersGradient& out = gradients[i];
    const int columns = networks[i].inputs;
    for (int h = 0; h < n.hidden; ++h) {
      float* const row = out.hidden_weight + static_cast<std::size_t>(h) * columns;
      std::copy_n(sums.data() + at.hidden_rows + static_cast<std::size_t>(h) * stride(n.inputs), n.inputs, row);
      if (time) row[n.inputs] = *time * sums[at.hidden_bias + h];
    }
    for (int o = 0; o < n.outputs; ++o) {
      std::copy_n(sums.data() + at.output_rows + static_cast<std::size_t>(o) * stride(n.hidden), n.hidden,
                  out.output_weight + static_cast<std::size_t>(o) * n.hidden);
    }
    std::copy_n(sums.data() + at.hidden_bias, n.hidden, out.hidden_bias);
    std::copy_n(sums.data() + at.output_bias, n.outputs, out.output_bias);
  }
}

}  // namespace

void networks_forward(const std::vector<Layers>& networks, std::optional<float> time, std::size_t rows, const float* x,
                      const std::vector<float*>& y, Arithmetic arithmetic, int threads) {
  const auto run = arithmetic == Arithmetic::kBfloat16 ? &forward<RoundedPacked> : &forward<Packed>;
  run(networks, time, rows, x, y, threads);
}

void networks_backward(const std::vector<Layers>& networks, std::optional<float> time, std::size_t rows, const float* x,
                       const std::vector<const float*>& d_y, float* d_x, const std::vector<LayersGradient>& gradients,
                       Arithmetic arithmetic, int threads) {
  const auto run = arithmetic == Arithmetic::kBfloat16 ? &backward<RoundedPacked> : &backward<Packed>;
  run(networks, time, rows, x, d_y, d_x, gradients, threads);
}

}  // namespace aa4d::field

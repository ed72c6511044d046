#include "field/two_layer.hpp"

#include <algorithm>

#include "common/buffer.hpp"
#include "common/thread_pool.hpp"
#include "field/kernels.hpp"

namespace aa4d::field {
namespace {

constexpr std::size_t kMostParts = 16;

// A network's weights in the kernels' layout. What is time's share of the first layer goes into the bias.
class Packed {
 public:
  Packed(const Layers& layers, std::optional<float> time) : layers_(layers) {
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

  Network network;

 private:
  Layers layers_;
  Buffer<float> storage_;
};

std::vector<Packed> pack(const std::vector<Layers>& networks, std::optional<float> time) {
  std::vector<Packed> packed;
  packed.reserve(networks.size());
  for (const Layers& layers : networks) packed.emplace_back(layers, time);
  return packed;
}

constexpr int padded_to(int value, int step) { return (value + step - 1) / step * step; }

// Of one thread, kept between calls.
NetworkScratch scratch_for(const std::vector<Packed>& packed) {
  static thread_local Buffer<float> memory;
  std::size_t inputs = 0, hidden = 0, outputs = 0;
  for (const Packed& p : packed) {
    inputs = std::max<std::size_t>(inputs, stride(p.network.inputs));
    hidden = std::max<std::size_t>(hidden, stride(p.network.hidden));
    outputs = std::max<std::size_t>(outputs, stride(p.network.outputs));
  }
  memory.resize_discarding(kRowBlock * (inputs + 2 * hidden + outputs));
  float* const place = memory.data();
  return {place, place + kRowBlock * inputs, place + kRowBlock * (inputs + hidden),
          place + kRowBlock * (inputs + 2 * hidden)};
}

// Where the parts of a gradient stand in a part's memory.
struct GradientLayout {
  std::size_t hidden_rows, output_rows, hidden_bias, output_bias, end;

  GradientLayout(const Network& n, std::size_t begin) {
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

}  // namespace

void networks_forward(const std::vector<Layers>& networks, std::optional<float> time, std::size_t rows, const float* x,
                      const std::vector<float*>& y, int threads) {
  const std::vector<Packed> packed = pack(networks, time);
  constexpr std::size_t kTask = 2 * kRowBlock;
  parallel_for(threads, (rows + kTask - 1) / kTask, [&](std::size_t task) {
    const NetworkScratch scratch = scratch_for(packed);
    for_blocks(task * kTask, std::min(rows, (task + 1) * kTask), [&](std::size_t row, int count) {
      for (std::size_t i = 0; i < packed.size(); ++i) {
        const Network& n = packed[i].network;
        kernels().network_forward(n, scratch, count, x + row * n.inputs, y[i] + row * n.outputs);
      }
    });
  });
}

void networks_backward(const std::vector<Layers>& networks, std::optional<float> time, std::size_t rows, const float* x,
                       const std::vector<const float*>& d_y, float* d_x, const std::vector<LayersGradient>& gradients,
                       int threads) {
  const std::vector<Packed> packed = pack(networks, time);
  std::vector<GradientLayout> layouts;
  for (const Packed& p : packed) layouts.emplace_back(p.network, layouts.empty() ? 0 : layouts.back().end);
  const std::size_t size = layouts.back().end;
  const std::size_t part_rows = padded_to(std::max<std::size_t>(1, (rows + kMostParts - 1) / kMostParts), kRowBlock);
  const std::size_t parts = (rows + part_rows - 1) / part_rows;
  Buffer<float> sums;
  sums.resize_discarding(size * std::max<std::size_t>(parts, 1));
  if (parts == 0) std::fill_n(sums.data(), size, 0.0f);
  parallel_for(threads, parts, [&](std::size_t part) {
    const NetworkScratch scratch = scratch_for(packed);
    float* const place = sums.data() + part * size;
    std::fill_n(place, size, 0.0f);
    for_blocks(part * part_rows, std::min(rows, (part + 1) * part_rows), [&](std::size_t row, int count) {
      for (std::size_t i = 0; i < packed.size(); ++i) {
        const Network& n = packed[i].network;
        const GradientLayout& at = layouts[i];
        kernels().network_backward(
            n, scratch, count, x + row * n.inputs, d_y[i] + row * n.outputs, d_x ? d_x + row * n.inputs : nullptr,
            i > 0, {place + at.hidden_rows, place + at.output_rows, place + at.hidden_bias, place + at.output_bias});
      }
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
    const Network& n = packed[i].network;
    const GradientLayout& at = layouts[i];
    const LayersGradient& out = gradients[i];
    const int inputs = networks[i].inputs;
    for (int h = 0; h < n.hidden; ++h) {
      float* const row = out.hidden_weight + static_cast<std::size_t>(h) * inputs;
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

}  // namespace aa4d::field

#include "kernels/reference/hypernetwork.h"

#include <cmath>

#include "kernels/reference/sizes.h"

namespace arah::reference {

HyperTrunk HyperTrunk::zeros() const {
  HyperTrunk result = *this;
  for (HyperLayer& layer : result.layers)
    for (std::vector<double>* values : {&layer.w, &layer.b, &layer.scale, &layer.shift})
      values->assign(values->size(), 0.0);
  return result;
}

HyperTape hyper_trunk_forward(const HyperTrunk& trunk, std::span<const double> code) {
  HyperTape tape;
  std::vector<double> x(code.begin(), code.end());
  for (const HyperLayer& layer : trunk.layers) {
    check_size("hypernetwork: input", x.size(), layer.inputs);
    check_size("hypernetwork: W", layer.w.size(), layer.outputs * layer.inputs);
    HyperTape::Layer t;
    t.input = x;
    std::vector<double> a(layer.b);
    double mean = 0, variance = 0;
    for (std::size_t o = 0; o < layer.outputs; ++o) {
      for (std::size_t i = 0; i < layer.inputs; ++i) a[o] += layer.w[o * layer.inputs + i] * x[i];
      mean += a[o] / double(layer.outputs);
    }
    for (double value : a) variance += (value - mean) * (value - mean) / double(layer.outputs);
    t.inverse_deviation = 1 / std::sqrt(variance + kLayerNormEpsilon);
    for (std::size_t o = 0; o < layer.outputs; ++o) {
      t.normalised.push_back((a[o] - mean) * t.inverse_deviation);
      const double y = layer.scale[o] * t.normalised[o] + layer.shift[o];
      t.output.push_back(y > 0 ? y : 0);
    }
    x = t.output;
    tape.layers.push_back(std::move(t));
  }
  return tape;
}

std::vector<double> hyper_trunk_backward(const HyperTrunk& trunk, const HyperTape& tape, std::span<const double> d_h,
                                         HyperTrunk* gradients) {
  std::vector<double> d_y(d_h.begin(), d_h.end());
  for (std::size_t l = trunk.layers.size(); l-- > 0;) {
    const HyperLayer& layer = trunk.layers[l];
    const HyperTape::Layer& t = tape.layers[l];
    check_size("hypernetwork backward: output", d_y.size(), layer.outputs);
    std::vector<double> d_a(layer.outputs, 0.0), d_x(layer.inputs, 0.0);
    double mean = 0, along = 0;  // of dL/d(normalised), and of it times the normalised value
    for (std::size_t o = 0; o < layer.outputs; ++o) {
      if (!(t.output[o] > 0)) d_y[o] = 0;
      d_a[o] = d_y[o] * layer.scale[o];
      mean += d_a[o] / double(layer.outputs);
      along += d_a[o] * t.normalised[o] / double(layer.outputs);
    }
    for (std::size_t o = 0; o < layer.outputs; ++o) {
      d_a[o] = t.inverse_deviation * (d_a[o] - mean - t.normalised[o] * along);
      for (std::size_t i = 0; i < layer.inputs; ++i) d_x[i] += d_a[o] * layer.w[o * layer.inputs + i];
    }
    if (gradients != nullptr) {
      HyperLayer& g = gradients->layers[l];
      for (std::size_t o = 0; o < layer.outputs; ++o) {
        g.scale[o] += d_y[o] * t.normalised[o];
        g.shift[o] += d_y[o];
        g.b[o] += d_a[o];
        for (std::size_t i = 0; i < layer.inputs; ++i) g.w[o * layer.inputs + i] += d_a[o] * t.input[i];
      }
    }
    d_y = std::move(d_x);
  }
  return d_y;
}

std::vector<double> dense_change(std::span<const double> w, std::span<const double> h) {
  check_size("dense change: W", w.size() % h.size(), 0);
  std::vector<double> change(w.size() / h.size(), 0.0);
  for (std::size_t i = 0; i < w.size(); ++i) change[i / h.size()] += w[i] * h[i % h.size()];
  return change;
}

std::vector<double> dense_change_backward(std::span<const double> w, std::span<const double> h,
                                          std::span<const double> d_phi, std::span<double> d_w) {
  check_size("dense change backward: W", w.size(), h.size() * d_phi.size());
  std::vector<double> d_h(h.size(), 0.0);
  for (std::size_t i = 0; i < w.size(); ++i) {
    d_h[i % h.size()] += w[i] * d_phi[i / h.size()];
    if (!d_w.empty()) d_w[i] += d_phi[i / h.size()] * h[i % h.size()];
  }
  return d_h;
}

LowRank LowRank::zeros() const {
  const auto same = [](const std::vector<double>& values) { return std::vector<double>(values.size(), 0.0); };
  return {outputs, inputs, rank, same(u), same(v), same(c)};
}

LayerChange low_rank_change(const LowRank& l, std::span<const double> h) {
  check_size("low rank: h", h.size(), l.rank);
  check_size("low rank: U", l.u.size(), l.outputs * l.rank);
  check_size("low rank: V", l.v.size(), l.inputs * l.rank);
  check_size("low rank: C", l.c.size(), l.outputs * l.rank);
  LayerChange change{std::vector<double>(l.outputs * l.inputs, 0.0), std::vector<double>(l.outputs, 0.0)};
  for (std::size_t o = 0; o < l.outputs; ++o)
    for (std::size_t r = 0; r < l.rank; ++r) {
      change.b[o] += l.c[o * l.rank + r] * h[r];
      for (std::size_t i = 0; i < l.inputs; ++i)
        change.w[o * l.inputs + i] += h[r] * l.u[o * l.rank + r] * l.v[r * l.inputs + i];
    }
  return change;
}

std::vector<double> low_rank_backward(const LowRank& l, std::span<const double> h, const LayerChange& d,
                                      LowRank* gradients) {
  check_size("low rank backward: W", d.w.size(), l.outputs * l.inputs);
  check_size("low rank backward: b", d.b.size(), l.outputs);
  std::vector<double> d_h(l.rank, 0.0);
  for (std::size_t o = 0; o < l.outputs; ++o)
    for (std::size_t r = 0; r < l.rank; ++r) {
      double along_v = 0;
      for (std::size_t i = 0; i < l.inputs; ++i) {
        along_v += d.w[o * l.inputs + i] * l.v[r * l.inputs + i];
        if (gradients) gradients->v[r * l.inputs + i] += h[r] * l.u[o * l.rank + r] * d.w[o * l.inputs + i];
      }
      d_h[r] += l.u[o * l.rank + r] * along_v + l.c[o * l.rank + r] * d.b[o];
      if (!gradients) continue;
      gradients->u[o * l.rank + r] += h[r] * along_v;
      gradients->c[o * l.rank + r] += h[r] * d.b[o];
    }
  return d_h;
}

}  // namespace arah::reference

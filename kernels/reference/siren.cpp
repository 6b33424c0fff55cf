#include "kernels/reference/siren.h"

#include <algorithm>
#include <cmath>

#include "kernels/reference/sizes.h"

namespace arah::reference {
namespace {

// out = W^T in for one point: [inputs] -> [outputs].
std::vector<double> apply(const SirenLayer& layer, std::span<const double> in) {
  std::vector<double> out(layer.outputs, 0.0);
  for (std::size_t i = 0; i < layer.inputs; ++i) {
    for (std::size_t o = 0; o < layer.outputs; ++o) out[o] += in[i] * layer.w[i * layer.outputs + o];
  }
  return out;
}

// The transpose: [outputs] -> [inputs].
std::vector<double> apply_transposed(const SirenLayer& layer, std::span<const double> in) {
  std::vector<double> out(layer.inputs, 0.0);
  for (std::size_t i = 0; i < layer.inputs; ++i) {
    for (std::size_t o = 0; o < layer.outputs; ++o) out[i] += in[o] * layer.w[i * layer.outputs + o];
  }
  return out;
}

// dW += a b^T with a [inputs], b [outputs].
void add_outer(SirenLayer& gradients, std::span<const double> a, std::span<const double> b) {
  for (std::size_t i = 0; i < gradients.inputs; ++i) {
    for (std::size_t o = 0; o < gradients.outputs; ++o) gradients.w[i * gradients.outputs + o] += a[i] * b[o];
  }
}

// Everything one point computes on the way to f and df/dx.
struct PointTape {
  std::vector<std::vector<double>> h;  // h_0 .. h_L
  std::vector<std::vector<double>> a;  // a_0 .. a_{L-1}
  std::vector<std::vector<double>> c;  // cos of the phase: h' per phase
  std::vector<std::vector<double>> q;  // q_0 .. q_L: df/dh_i, so that q_0 is the gradient
  std::vector<std::vector<double>> p;  // p_0 .. p_{L-1}: df/da_i
  double sdf = 0;
};

// Forward, then the reverse pass
//   q_L = W_L,   p_i = q_{i+1} cos(phase_i) omega gamma_i,   q_i = W_i^T p_i.
PointTape evaluate(const Siren& siren, std::span<const double> x) {
  const std::size_t sines = siren.layers.size() - 1;
  PointTape tape;
  tape.h.emplace_back(x.begin(), x.end());
  for (std::size_t l = 0; l < sines; ++l) {
    const SirenLayer& layer = siren.layers[l];
    std::vector<double> a = apply(layer, tape.h.back());
    std::vector<double> h(layer.outputs), c(layer.outputs);
    for (std::size_t o = 0; o < layer.outputs; ++o) {
      a[o] += layer.b[o];
      const double phase = siren.omega * (layer.gamma[o] * a[o] + layer.eta[o]);
      h[o] = std::sin(phase);
      c[o] = std::cos(phase);
    }
    tape.a.push_back(std::move(a));
    tape.c.push_back(std::move(c));
    tape.h.push_back(std::move(h));
  }
  const SirenLayer& last = siren.layers.back();
  tape.sdf = apply(last, tape.h.back())[0] + last.b[0];

  tape.q.resize(sines + 1);
  tape.p.resize(sines);
  tape.q[sines] = last.w;
  for (std::size_t l = sines; l-- > 0;) {
    const SirenLayer& layer = siren.layers[l];
    tape.p[l].resize(layer.outputs);
    for (std::size_t o = 0; o < layer.outputs; ++o) {
      tape.p[l][o] = tape.q[l + 1][o] * tape.c[l][o] * siren.omega * layer.gamma[o];
    }
    tape.q[l] = apply_transposed(layer, tape.p[l]);
  }
  return tape;
}

void check_shape(const Siren& siren, std::size_t points, std::span<const double> x) {
  check_size("siren: sine layers and a linear layer", siren.layers.size() >= 2 ? 2 : siren.layers.size(), 2);
  check_size("siren: outputs of the last layer", siren.layers.back().outputs, 1);
  for (std::size_t l = 0; l < siren.layers.size(); ++l) {
    const SirenLayer& layer = siren.layers[l];
    const bool sine = l + 1 < siren.layers.size();
    if (l > 0) check_size("siren: inputs of a layer", layer.inputs, siren.layers[l - 1].outputs);
    check_size("siren: w", layer.w.size(), layer.inputs * layer.outputs);
    check_size("siren: b", layer.b.size(), layer.outputs);
    check_size("siren: gamma", layer.gamma.size(), sine ? layer.outputs : 0);
    check_size("siren: eta", layer.eta.size(), sine ? layer.outputs : 0);
  }
  check_size("siren: x", x.size(), points * siren.input_size());
}

// Row `point` of an adjoint, zeros when the whole adjoint is empty.
std::vector<double> row(const std::vector<double>& values, std::size_t point, std::size_t width) {
  if (values.empty()) return std::vector<double>(width, 0.0);
  const auto begin = values.begin() + static_cast<std::ptrdiff_t>(point * width);
  return {begin, begin + static_cast<std::ptrdiff_t>(width)};
}

// The backward pass of one point. Every function of the parameters appears twice, in the forward pass and in its
// reverse; the reverse is differentiated first (from q_0 up), then the forward pass (from h_L down), which also takes
// what the reverse left at the phases.
std::vector<double> point_backward(const Siren& siren, const PointTape& tape, double d_sdf, std::vector<double> d_h,
                                   std::vector<double> d_q, Siren& gradients) {
  const std::size_t sines = siren.layers.size() - 1;
  std::vector<std::vector<double>> d_phase(sines);
  for (std::size_t l = 0; l < sines; ++l) {
    const SirenLayer& layer = siren.layers[l];
    SirenLayer& target = gradients.layers[l];
    // q_l = W p: dp = W^T dq and dW += dq p^T
    add_outer(target, d_q, tape.p[l]);
    const std::vector<double> d_p = apply(layer, d_q);
    d_q.assign(layer.outputs, 0.0);
    d_phase[l].resize(layer.outputs);
    for (std::size_t o = 0; o < layer.outputs; ++o) {
      const double q = tape.q[l + 1][o], c = tape.c[l][o], s = tape.h[l + 1][o];
      d_q[o] = d_p[o] * c * siren.omega * layer.gamma[o];
      target.gamma[o] += d_p[o] * q * c * siren.omega;
      d_phase[l][o] = -d_p[o] * q * s * siren.omega * layer.gamma[o];
    }
  }
  SirenLayer& last = gradients.layers.back();
  for (std::size_t i = 0; i < last.inputs; ++i) {
    last.w[i] += d_q[i] + d_sdf * tape.h.back()[i];  // q_L = W_L, and f = W_L h_L + b_L
    d_h[i] += d_sdf * siren.layers.back().w[i];
  }
  last.b[0] += d_sdf;

  for (std::size_t l = sines; l-- > 0;) {
    const SirenLayer& layer = siren.layers[l];
    SirenLayer& target = gradients.layers[l];
    std::vector<double> d_a(layer.outputs);
    for (std::size_t o = 0; o < layer.outputs; ++o) {
      const double d = siren.omega * (d_h[o] * tape.c[l][o] + d_phase[l][o]);
      target.eta[o] += d;
      target.gamma[o] += d * tape.a[l][o];
      d_a[o] = d * layer.gamma[o];
      target.b[o] += d_a[o];
    }
    add_outer(target, tape.h[l], d_a);
    d_h = apply_transposed(layer, d_a);
  }
  return d_h;
}

}  // namespace

Siren Siren::zeros() const {
  Siren result = *this;
  for (SirenLayer& layer : result.layers) {
    for (auto* values : {&layer.w, &layer.b, &layer.gamma, &layer.eta}) std::fill(values->begin(), values->end(), 0.0);
  }
  return result;
}

SirenOutput siren_forward(const Siren& siren, std::size_t points, std::span<const double> x) {
  check_shape(siren, points, x);
  SirenOutput output;
  for (std::size_t n = 0; n < points; ++n) {
    const PointTape tape = evaluate(siren, x.subspan(n * siren.input_size(), siren.input_size()));
    output.sdf.push_back(tape.sdf);
    output.feature.insert(output.feature.end(), tape.h.back().begin(), tape.h.back().end());
    output.gradient.insert(output.gradient.end(), tape.q.front().begin(), tape.q.front().end());
  }
  return output;
}

std::vector<double> siren_backward(const Siren& siren, std::size_t points, std::span<const double> x,
                                   const SirenAdjoint& adjoint, Siren& gradients) {
  check_shape(siren, points, x);
  const std::size_t width = siren.input_size(), features = siren.feature_size();
  if (!adjoint.sdf.empty()) check_size("siren backward: sdf", adjoint.sdf.size(), points);
  if (!adjoint.feature.empty()) check_size("siren backward: feature", adjoint.feature.size(), points * features);
  if (!adjoint.gradient.empty()) check_size("siren backward: gradient", adjoint.gradient.size(), points * width);
  std::vector<double> d_x;
  for (std::size_t n = 0; n < points; ++n) {
    const PointTape tape = evaluate(siren, x.subspan(n * width, width));
    const std::vector<double> d =
        point_backward(siren, tape, row(adjoint.sdf, n, 1)[0], row(adjoint.feature, n, features),
                       row(adjoint.gradient, n, width), gradients);
    d_x.insert(d_x.end(), d.begin(), d.end());
  }
  return d_x;
}

}  // namespace arah::reference

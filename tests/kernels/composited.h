// A batch of rays' samples composited on the device, forward and backward, and in double precision.
#pragma once

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "kernels/compositing/backward.h"
#include "kernels/compositing/forward.h"
#include "kernels/reduction/sum.h"
#include "kernels/reference/compositing.h"
#include "shaders/shared/empty_sample.h"
#include "tests/kernels/device_fixture.h"

namespace arah {

inline constexpr uint8_t empty_sample = 2;  // in a mask: shared::EMPTY

struct SampleBatch {
  uint32_t rays = 0, samples = 0;
  std::vector<float> sdf, rgb, depths, deltas;  // sdf in the network's units; rgb 3 a sample
  std::vector<uint8_t> mask;
  float parameter = 0.01F, metres_per_unit = 1;
  std::vector<float> d_colors;  // 4 a ray
  DensityKind density = DensityKind::laplace;
  size_t rows() const { return size_t(rays) * samples; }
};

struct CompositedBatch {
  std::vector<double> color, sums, depths, weights, transmittances, deltas, d_sdf, d_rgb;  // colour and rgb 3 a row
  double d_parameter = 0;
};

inline CompositedBatch composited_truth(const SampleBatch& batch, bool differences) {
  CompositedBatch result;
  const double b = reference::laplace_scale(batch.parameter);
  for (size_t ray = 0; ray < batch.rays; ++ray) {
    std::vector<double> sdf, depths, deltas;
    std::vector<std::array<double, 3>> rgb;
    std::vector<uint8_t> mask;
    for (size_t i = ray * batch.samples; i < (ray + 1) * batch.samples; ++i) {
      sdf.push_back(double(batch.metres_per_unit) * batch.sdf[i]);
      depths.push_back(batch.depths[i]);
      rgb.push_back({batch.rgb[3 * i], batch.rgb[3 * i + 1], batch.rgb[3 * i + 2]});
      mask.push_back(batch.mask[i]);
      if (!differences) deltas.push_back(batch.deltas[i]);
    }
    if (differences) deltas = reference::depth_differences(depths, mask);
    const auto kind = batch.density == DensityKind::laplace ? reference::DensityKind::laplace : reference::DensityKind::softplus;
    const reference::CompositingInput input{sdf, deltas, depths, rgb, mask, b, kind};
    const reference::Composite forward = reference::composite(input);
    const float* up = &batch.d_colors[4 * ray];
    const auto gradient = reference::composite_backward(input, forward, {up[0], up[1], up[2]}, up[3]);
    result.color.insert(result.color.end(), forward.colour.begin(), forward.colour.end());
    result.sums.push_back(forward.weights_sum);
    result.depths.push_back(forward.depth);
    result.weights.insert(result.weights.end(), forward.weights.begin(), forward.weights.end());
    result.transmittances.insert(result.transmittances.end(), forward.transmittance.begin(), forward.transmittance.end());
    result.deltas.insert(result.deltas.end(), deltas.begin(), deltas.end());
    for (double x : gradient.sdf) result.d_sdf.push_back(batch.metres_per_unit * x);
    for (const auto& x : gradient.rgb) result.d_rgb.insert(result.d_rgb.end(), x.begin(), x.end());
    result.d_parameter += gradient.b * reference::laplace_scale_derivative(batch.parameter);
  }
  return result;
}

class CompositingTest : public DeviceTest {
 protected:
  // A few b of sdf and depth along each ray, so that nothing saturates.
  SampleBatch random_batch(uint32_t rays, uint32_t samples, float parameter) {
    SampleBatch batch{rays, samples, {}, {}, {}, {}, {}, parameter, 0.8F, uniform(4 * rays), DensityKind::laplace};
    const double b = std::abs(parameter);
    batch.sdf = uniform(batch.rows(), -2.5 * b, 4 * b);
    batch.rgb = uniform(3 * batch.rows(), 0, 1);
    batch.deltas = uniform(batch.rows(), 0, b);
    for (size_t i = 0; i < batch.rows(); ++i) {
      batch.depths.push_back(i % samples == 0 ? 1.0F : batch.depths.back() + uniform(1, 0, 1.5 * b)[0]);
      batch.mask.push_back(generator() % 5 != 0);
    }
    return batch;
  }

  // Runs both ways. Activations have a stride of 16 and lie at column 8, the sdf is the x of a vec4 array; gradients
  // are first filled with NaN, so that what is not written shows. before: what b's gradient is added to.
  CompositedBatch run(const SampleBatch& batch, bool differences, float before = 5) {
    const uint32_t rows = static_cast<uint32_t>(batch.rows()), padded = padded_points(rows);
    std::vector<float> sdf(4 * padded, NAN), rgb(16 * padded, NAN), points(4 * padded, 0.0F);
    for (size_t i = 0; i < rows; ++i) {
      if (batch.mask[i]) {  // a skipped sample holds garbage
        sdf[4 * i] = batch.sdf[i];
        for (size_t c = 0; c < 3; ++c) rgb[16 * i + 8 + c] = batch.rgb[3 * i + c];
      }
      points[4 * i + 3] = batch.mask[i] == empty_sample ? shared::EMPTY : batch.mask[i];
    }
    std::vector<float> depths = batch.depths, deltas = batch.deltas;
    deltas.resize(padded, NAN);
    if (differences) std::fill(deltas.begin(), deltas.end(), NAN);
    const std::vector<float> nothing(16 * padded, NAN);
    Buffer sdf_buffer = filled("sdf", sdf), rgb_buffer = filled("rgb", rgb), point_buffer = filled("points", points),
           depth_buffer = filled("depths", depths), delta_buffer = filled("deltas", deltas),
           parameters = filled("parameters", std::vector<float>{7, 7, batch.parameter, 7}),
           gradients = filled("gradients", std::vector<float>{5, 5, before, 5}),
           upstream = filled("d colours", batch.d_colors), colors = empty("colours", padded_points(batch.rays) * 16),
           ray_depths = empty("ray depths", padded_points(batch.rays) * 4), weights = empty("weights", padded * 4),
           transmittances = empty("transmittances", padded * 4), d_sdf = filled("d sdf", nothing),
           d_rgb = filled("d rgb", nothing), partials = empty("partials", std::max<uint64_t>(partial_bytes(batch.rays), 256));
    CompositeSamples samples;
    samples.rays = batch.rays;
    samples.samples = batch.samples;
    samples.sdf = {sdf_buffer.slice(), 4, 0};
    samples.metres_per_unit = batch.metres_per_unit;
    samples.rgb = {rgb_buffer.slice(), 16, 8};
    samples.points = point_buffer.slice();
    samples.deltas = delta_buffer.slice();
    samples.parameters = parameters.slice();
    samples.scale_index = 2;
    samples.density = batch.density;
    CompositeForwardArgs forward;
    forward.samples = samples;
    forward.delta_mode = differences ? DeltaMode::differences : DeltaMode::given;
    forward.depths = depth_buffer.slice();
    forward.colors = colors.slice();
    forward.ray_depths = ray_depths.slice();
    forward.weights = weights.slice();
    forward.transmittances = transmittances.slice();
    record_composite_forward(commands, forward);
    CompositeBackwardArgs backward;
    backward.samples = samples;
    backward.transmittances = transmittances.slice();
    backward.colors = colors.slice();
    backward.d_colors = upstream.slice();
    backward.d_sdf = {d_sdf.slice(), 16, 8};
    backward.d_rgb = {d_rgb.slice(), 8, 0};
    backward.gradients = gradients.slice();
    backward.partials = partials.slice();
    record_composite_backward(commands, backward);
    commands.submit_and_wait();

    CompositedBatch result;
    const auto color = device.download<float>(colors.slice()), depth = device.download<float>(ray_depths.slice()),
               weight = device.download<float>(weights.slice()), transmittance = device.download<float>(transmittances.slice()), delta = device.download<float>(delta_buffer.slice()),
               sdf_gradient = device.download<float>(d_sdf.slice()),
               rgb_gradient = device.download<float>(d_rgb.slice()),
               gradient = device.download<float>(gradients.slice());
    for (size_t ray = 0; ray < batch.rays; ++ray) {
      result.color.insert(result.color.end(), &color[4 * ray], &color[4 * ray + 3]);
      result.sums.push_back(color[4 * ray + 3]);
      result.depths.push_back(depth[ray]);
    }
    for (size_t i = 0; i < padded; ++i) {
      const bool real = i < rows;
      if (real) {
        result.weights.push_back(weight[i]);
        result.transmittances.push_back(transmittance[i]);
        result.deltas.push_back(delta[i]);
        result.d_sdf.push_back(sdf_gradient[16 * i + 8]);
        result.d_rgb.insert(result.d_rgb.end(), &rgb_gradient[8 * i], &rgb_gradient[8 * i + 3]);
      }
      for (size_t c = real ? 1 : 0; c < 8; ++c) EXPECT_EQ(sdf_gradient[16 * i + 8 + c], 0) << i << " " << c;
      for (size_t c = real ? 3 : 0; c < 8; ++c) EXPECT_EQ(rgb_gradient[8 * i + c], 0) << i << " " << c;
      EXPECT_TRUE(std::isnan(sdf_gradient[16 * i])) << "a column that is not d_sdf's was written";
    }
    for (size_t i : {0, 1, 3}) EXPECT_EQ(gradient[i], 5);
    result.d_parameter = double(gradient[2]) - double(before);  // += on top of what was there
    return result;
  }
};

}  // namespace arah

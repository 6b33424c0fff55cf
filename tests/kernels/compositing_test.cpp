// Alpha compositing on the device, both ways, against double precision and the golden tensors.
#include "kernels/reference/compositing.h"

#include <algorithm>
#include <cmath>

#include "kernels/compositing/fill_queue.h"
#include "kernels/compositing/scatter_distances.h"
#include "tests/golden.h"
#include "tests/kernels/composited.h"

namespace arah {
namespace {

using Batch = SampleBatch;
using Result = CompositedBatch;

class Compositing : public CompositingTest {
 protected:
  // As run, but only the samples whose weight exceeds `threshold` have colours and gradients, by slot in random order.
  struct QueueResult {
    Result result;                 // d_sdf and d_rgb by row, 0 without a slot
    std::vector<uint32_t> flags;   // by row
    std::vector<uint32_t> samples; // by slot: the row
  };
  QueueResult run_by_slot(const Batch& batch, bool differences, float threshold) {
    const uint32_t rows = static_cast<uint32_t>(batch.rows()), padded = padded_points(rows);
    std::vector<float> sdf(4 * padded, NAN), points(4 * padded, 0.0F), deltas = batch.deltas;
    for (size_t i = 0; i < rows; ++i) {
      if (batch.mask[i]) sdf[4 * i] = batch.sdf[i];
      points[4 * i] = static_cast<float>(i), points[4 * i + 3] = batch.mask[i];
    }
    deltas.resize(padded, NAN);
    if (differences) std::fill(deltas.begin(), deltas.end(), NAN);
    Buffer sdf_buffer = filled("sdf", sdf), point_buffer = filled("points", points),
           depth_buffer = filled("depths", batch.depths), delta_buffer = filled("deltas", deltas),
           parameters = filled("parameters", std::vector<float>{7, 7, batch.parameter, 7}),
           gradients = filled("gradients", std::vector<float>{5, 5, 5, 5}),
           upstream = filled("d colours", batch.d_colors), colors = empty("colours", padded_points(batch.rays) * 16),
           ray_depths = empty("ray depths", padded_points(batch.rays) * 4), weights = empty("weights", padded * 4),
           transmittances = empty("transmittances", padded * 4), flags = filled("flags", std::vector<uint32_t>(rows, 7)),
           slots = empty("slots", padded * 4), queued = empty("queued", padded * 16), partials = empty("partials", 256);
    CompositeForwardArgs forward;
    forward.samples.rays = batch.rays;
    forward.samples.samples = batch.samples;
    forward.samples.sdf = {sdf_buffer.slice(), 4, 0};
    forward.samples.metres_per_unit = batch.metres_per_unit;
    forward.samples.points = point_buffer.slice();
    forward.samples.deltas = delta_buffer.slice();
    forward.samples.parameters = parameters.slice();
    forward.samples.scale_index = 2;
    forward.samples.density = batch.density;
    forward.delta_mode = differences ? DeltaMode::differences : DeltaMode::given;
    forward.depths = depth_buffer.slice();
    forward.colors = colors.slice();
    forward.ray_depths = ray_depths.slice();
    forward.weights = weights.slice();
    forward.transmittances = transmittances.slice();
    forward.flags = flags.slice();
    forward.least_weight = threshold;
    record_composite_forward(commands, forward);
    commands.submit_and_wait();

    QueueResult found;
    found.flags = device.download<uint32_t>(flags.slice().elements(0, rows));
    for (uint32_t row = 0; row < rows; ++row)
      if (found.flags[row]) found.samples.push_back(row);
    std::shuffle(found.samples.begin(), found.samples.end(), generator);
    const uint32_t count = static_cast<uint32_t>(found.samples.size()), room = padded_points(std::max(count, 1u));
    std::vector<uint32_t> listed = found.samples;
    listed.resize(room, 0xffffffffu);  // no row: padding is not to be followed
    std::vector<float> rgb(16 * room, NAN), nothing(16 * room, NAN);
    for (size_t slot = 0; slot < count; ++slot)
      for (size_t c = 0; c < 3; ++c) rgb[16 * slot + 8 + c] = batch.rgb[3 * found.samples[slot] + c];
    Buffer list = filled("list", listed), rgb_buffer = filled("rgb", rgb), d_sdf = filled("d sdf", nothing),
           d_rgb = filled("d rgb", nothing);
    record_fill_queue(commands, {count, rows, list.slice(), point_buffer.slice(), queued.slice(), slots.slice()});
    forward.flags = {};
    forward.delta_mode = DeltaMode::given;
    forward.samples.rgb = {rgb_buffer.slice(), 16, 8};
    forward.samples.slots = slots.slice();
    forward.samples.slot_count = std::max(count, 1u);
    record_composite_forward(commands, forward);
    CompositeBackwardArgs backward;
    backward.samples = forward.samples;
    backward.transmittances = transmittances.slice();
    backward.colors = colors.slice();
    backward.d_colors = upstream.slice();
    backward.d_sdf = {d_sdf.slice(), 16, 8};
    backward.d_rgb = {d_rgb.slice(), 8, 0};
    backward.gradients = gradients.slice();
    backward.partials = partials.slice();
    record_composite_backward(commands, backward);
    commands.submit_and_wait();

    const auto queue = device.download<float>(queued.slice());
    const auto places = device.download<uint32_t>(slots.slice().elements(0, rows));
    for (uint32_t slot = 0; slot < room; ++slot) {
      EXPECT_EQ(queue[4 * slot], slot < count ? static_cast<float>(found.samples[slot]) : 0) << slot;
      EXPECT_EQ(queue[4 * slot + 3], slot < count ? 1 : 0) << slot;
    }
    const auto color = device.download<float>(colors.slice()), depth = device.download<float>(ray_depths.slice()),
               weight = device.download<float>(weights.slice()), sdf_gradient = device.download<float>(d_sdf.slice()),
               rgb_gradient = device.download<float>(d_rgb.slice());
    for (size_t ray = 0; ray < batch.rays; ++ray) {
      found.result.color.insert(found.result.color.end(), &color[4 * ray], &color[4 * ray + 3]);
      found.result.sums.push_back(color[4 * ray + 3]);
      found.result.depths.push_back(depth[ray]);
    }
    for (size_t row = 0; row < rows; ++row) {
      const uint32_t slot = places[row];
      EXPECT_EQ(slot == no_slot, found.flags[row] == 0) << row;
      if (slot != no_slot) {
        EXPECT_EQ(found.samples.at(slot), row);
      }
      found.result.weights.push_back(weight[row]);
      found.result.d_sdf.push_back(slot == no_slot ? 0 : sdf_gradient[16 * slot + 8]);
      for (size_t c = 0; c < 3; ++c) found.result.d_rgb.push_back(slot == no_slot ? 0 : rgb_gradient[8 * slot + c]);
    }
    for (size_t i = count; i < room; ++i) EXPECT_TRUE(std::isnan(sdf_gradient[16 * i + 8])) << "padding was written";
    found.result.d_parameter = device.download<float>(gradients.slice())[2] - 5.0;
    return found;
  }

  static double largest(const std::vector<double>& values) {
    double scale = 0;
    for (double x : values) scale = std::max(scale, std::abs(x));
    return scale;
  }
  static void expect_same(const Result& actual, const Result& truth, const std::string& label) {
    golden::expect_close(label + " colour", actual.color, truth.color, 4e-6);
    golden::expect_close(label + " weights sum", actual.sums, truth.sums, 4e-6);
    golden::expect_close(label + " depth", actual.depths, truth.depths, 1e-5);
    golden::expect_close(label + " weights", actual.weights, truth.weights, 4e-6);
    golden::expect_close(label + " deltas", actual.deltas, truth.deltas, 3e-7);
    golden::expect_close(label + " d sdf", actual.d_sdf, truth.d_sdf, 1e-5 * largest(truth.d_sdf));
    golden::expect_close(label + " d rgb", actual.d_rgb, truth.d_rgb, 4e-6 * largest(truth.d_rgb));
  }
};

TEST_F(Compositing, BothWaysAndBothKindsOfDeltaFollowTheReference) {
  const struct {
    uint32_t rays, samples;
    float parameter;
  } cases[] = {{1, 1, 0.01F}, {63, 20, 0.003F}, {65, 33, -0.05F}, {150, 7, 1.0F}};
  for (const auto& shape : cases)
    for (const auto& [differences, density] : {std::pair{false, DensityKind::laplace}, {true, DensityKind::laplace}, {false, DensityKind::softplus}, {true, DensityKind::softplus}}) {
      Batch batch = random_batch(shape.rays, shape.samples, shape.parameter);
      batch.density = density;
      const Result truth = composited_truth(batch, differences), actual = run(batch, differences);
      expect_same(actual, truth, std::to_string(shape.rays) + " x " + std::to_string(shape.samples));
      double scale = 0;  // the sum over samples of what adds up to it
      for (double x : truth.d_sdf) scale += std::abs(x);
      EXPECT_NEAR(actual.d_parameter, truth.d_parameter, 4e-5 * std::max(scale, 1.0)) << shape.rays;
    }
}

// What is not shaded is black but absorbs: the truth with its colours set to zero.
TEST_F(Compositing, AQueueOfTheHeavySamplesFollowsTheReference) {
  for (const bool differences : {false, true})
    for (const float threshold : {0.0F, 0.02F, 2.0F}) {
      Batch batch = random_batch(65, 20, 0.01F);
      const QueueResult actual = run_by_slot(batch, differences, threshold);
      const Result weighed = composited_truth(batch, differences);
      for (size_t row = 0; row < batch.rows(); ++row) {
        if (std::abs(weighed.weights[row] - threshold) > 1e-6) {
          EXPECT_EQ(actual.flags[row], weighed.weights[row] > threshold ? 1u : 0u) << row << ": weight " << weighed.weights[row];
        }
        if (!actual.flags[row]) std::fill_n(&batch.rgb[3 * row], 3, 0.0F);
      }
      Result truth = composited_truth(batch, differences);
      for (size_t row = 0; row < batch.rows(); ++row)
        if (!actual.flags[row]) truth.d_sdf[row] = 0, std::fill_n(&truth.d_rgb[3 * row], 3, 0.0);
      const std::string label = "queue above " + std::to_string(threshold);
      std::printf("  %s: %zu of %zu samples\n", label.c_str(), actual.samples.size(), batch.rows());
      golden::expect_close(label + " colour", actual.result.color, truth.color, 4e-6);
      golden::expect_close(label + " weights sum", actual.result.sums, truth.sums, 4e-6);
      golden::expect_close(label + " depth", actual.result.depths, truth.depths, 1e-5);
      golden::expect_close(label + " weights", actual.result.weights, truth.weights, 4e-6);
      golden::expect_close(label + " d sdf", actual.result.d_sdf, truth.d_sdf, 1e-5 * std::max(largest(truth.d_sdf), 1e-3));
      golden::expect_close(label + " d rgb", actual.result.d_rgb, truth.d_rgb, 4e-6);
      double scale = 0;
      for (double x : weighed.d_sdf) scale += std::abs(x);
      EXPECT_NEAR(actual.result.d_parameter, truth.d_parameter, 4e-5 * std::max(scale, 1.0));
      EXPECT_EQ(actual.samples.empty(), threshold > 1);
    }
}

TEST_F(Compositing, Golden08) {
  ARAH_SKIP_WITHOUT_GOLDEN();
  const golden::Case truth("08_composite");
  Batch batch;
  batch.rays = static_cast<uint32_t>(truth.extent("in.sdf", 0));
  batch.samples = static_cast<uint32_t>(truth.extent("in.sdf", 1));
  batch.sdf = truth.tensor("in.sdf").as<float>();
  batch.rgb = truth.tensor("in.rgb").as<float>();
  batch.depths = truth.tensor("in.z").as<float>();
  batch.mask = truth.tensor("in.mask").as<uint8_t>();
  const auto upstream = truth.tensor("in.G").as<float>(), parameters = truth.tensor("in.b").as<float>();
  for (size_t ray = 0; ray < batch.rays; ++ray) {
    batch.d_colors.insert(batch.d_colors.end(), &upstream[3 * ray], &upstream[3 * ray] + 3);
    batch.d_colors.push_back(0);
  }
  batch.deltas.resize(batch.rows());
  for (size_t index = 0; index < parameters.size(); ++index) {
    batch.parameter = index == 0 ? 1e-6F : parameters[index];
    const Result actual = run(batch, true);
    const std::string out = "out." + std::to_string(index) + ".", grad = "grad." + std::to_string(index) + ".";
    golden::expect_close(out + "colour", actual.color, truth.values(out + "colour"), 1e-5);
    golden::expect_close(out + "weights_sum", actual.sums, truth.values(out + "weights_sum"), 4e-6);
    if (index == 0) continue;  // its gradients underflow in every precision but one
    const auto d_sdf = truth.values(grad + "sdf"), d_rgb = truth.values(grad + "rgb");
    golden::expect_close(grad + "sdf", actual.d_sdf, d_sdf, 1e-5 * largest(d_sdf));
    golden::expect_close(grad + "rgb", actual.d_rgb, d_rgb, 1e-5 * largest(d_rgb));
    const double d_b = truth.scalar(grad + "b");
    // 10 x the error of the reference's own single-precision run, 3.2e-5 of the value at worst.
    EXPECT_NEAR(actual.d_parameter, d_b, 3.2e-4 * std::abs(d_b) + 1e-6) << grad;
  }
}

// An empty sample counts for δ and absorbs nothing, whatever its sdf: the truth with a distance that has no density.
TEST_F(Compositing, EmptySamplesAreThereWithoutDensity) {
  Batch batch = random_batch(65, 20, 0.01F);
  for (size_t i = 0; i < batch.rows(); ++i)
    if (i % 3 == 0) batch.mask[i] = empty_sample;
  const Result actual = run(batch, true);
  Batch far = batch;
  for (size_t i = 0; i < batch.rows(); ++i)
    if (batch.mask[i] == empty_sample) far.mask[i] = 1, far.sdf[i] = 1e3F;
  expect_same(actual, composited_truth(far, true), "empty samples");
}

// A density without a bound: raw densities from 1e-3 to 1e9, σδ up to 1e12, beside empty space; b from 1e-6 to 1e6.
TEST_F(Compositing, SoftplusDensitiesStayFiniteAtEveryScale) {
  for (const float b : {1e-6F, 1e-3F, 1.0F, 1e6F}) {
    Batch batch = random_batch(64, 24, b);
    batch.density = DensityKind::softplus;
    for (size_t i = 0; i < batch.rows(); ++i) {
      const float raw = std::pow(10.0F, -3.0F + 12.0F * float(i % 24) / 23.0F);
      batch.sdf[i] = (i / 24 % 2 ? -raw : raw) * b / batch.metres_per_unit;
      batch.deltas[i] = std::min(1e3F * b, 1.0F);
    }
    const Result actual = run(batch, false), truth = composited_truth(batch, false);
    for (const auto* values : {&actual.color, &actual.sums, &actual.weights, &actual.d_sdf, &actual.d_rgb})
      for (const double value : *values) ASSERT_TRUE(std::isfinite(value)) << b;
    ASSERT_TRUE(std::isfinite(actual.d_parameter)) << b;
    golden::expect_close("softplus weights", actual.weights, truth.weights, 4e-6);
    golden::expect_close("softplus d sdf", actual.d_sdf, truth.d_sdf, 4e-5 * largest(truth.d_sdf));
  }
}

TEST_F(Compositing, AThousandOpaqueSamplesStayFinite) {
  Batch batch = random_batch(2, 1000, 1e-3F);
  for (float& s : batch.sdf) s = -0.005F / batch.metres_per_unit;  // σδ = 10: α = 1 − 5e-5
  for (float& delta : batch.deltas) delta = 0.01F;
  std::fill(batch.mask.begin(), batch.mask.end(), uint8_t(1));
  const Result truth = composited_truth(batch, false), actual = run(batch, false);
  expect_same(actual, truth, "opaque");
  for (const double sum : actual.sums) EXPECT_EQ(sum, 1);
  EXPECT_NEAR(actual.d_parameter, truth.d_parameter, 1e-4 * std::abs(truth.d_parameter));
}

TEST_F(Compositing, ThinMediaKeepTheirDigits) {
  // exp(−14): 1 − exp(−σδ) of single precision would have no digits left here.
  Batch batch = random_batch(65, 16, 0.01F);
  for (float& s : batch.sdf) s = 0.14F / batch.metres_per_unit;
  for (float& delta : batch.deltas) delta = 1e-4F;
  std::fill(batch.mask.begin(), batch.mask.end(), uint8_t(1));
  const Result truth = composited_truth(batch, false), actual = run(batch, false);
  for (size_t i = 0; i < truth.weights.size(); ++i) ASSERT_NEAR(actual.weights[i] / truth.weights[i], 1, 2e-5) << i;
  for (size_t i = 0; i < truth.d_sdf.size(); ++i)
    ASSERT_NEAR(actual.d_sdf[i], truth.d_sdf[i], 4e-5 * largest(truth.d_sdf)) << i;
}

TEST_F(Compositing, DistancesOfAQueueGoBackToTheirRows) {
  const uint32_t rows = 200, count = 67;
  std::vector<uint32_t> samples(padded_points(count), 0);
  for (uint32_t slot = 0; slot < count; ++slot) samples[slot] = (slot * 3 + 1) % rows;
  const std::vector<float> sdf = uniform(padded_points(count) * 16);
  Buffer list = filled("list", samples), values = filled("sdf", sdf), distances = filled("distances", std::vector<float>(4 * rows, 7));
  record_scatter_distances(commands, {count, list.slice(), {values.slice(), 16, 8}, distances.slice()});
  commands.submit_and_wait();
  std::vector<float> truth(4 * rows, 7);
  for (uint32_t slot = 0; slot < count; ++slot) truth[4 * samples[slot]] = sdf[16 * slot + 8], std::fill_n(&truth[4 * samples[slot] + 1], 3, 0.0F);
  EXPECT_EQ(device.download<float>(distances.slice().elements(0, truth.size())), truth);
}

TEST_F(Compositing, RunsRepeatBitForBit) {
  const Batch batch = random_batch(150, 20, 0.01F);
  const Result first = run(batch, true), second = run(batch, true);
  EXPECT_EQ(first.color, second.color);
  EXPECT_EQ(first.d_sdf, second.d_sdf);
  EXPECT_EQ(first.d_parameter, second.d_parameter);
}

TEST_F(Compositing, UnalignedColoursAreRefused) {
  CompositeForwardArgs args;
  args.samples.rays = 1;
  args.samples.samples = 1;
  args.samples.rgb.stride = 3;
  EXPECT_THROW(record_composite_forward(commands, args), std::invalid_argument);
}

}  // namespace
}  // namespace arah

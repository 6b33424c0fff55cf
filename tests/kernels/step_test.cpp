// A whole training step on the device against golden case 12: from its samples to colours, losses and the gradient of
// every parameter, each kernel at work on the others' results. In double precision are here only what has no kernel: the
// hypernetwork with the pose encoder and the penalty on its weights, and the skinning loss, whose kernel takes four target
// weights a point where the case has 24 (skinning_test.cpp compares it).
#include <gtest/gtest.h>

#include "kernels/color/assemble_inputs.h"
#include "kernels/color/posed_normals.h"
#include "kernels/color/posed_normals_backward.h"
#include "kernels/compositing/backward.h"
#include "kernels/compositing/forward.h"
#include "kernels/losses/eikonal.h"
#include "kernels/losses/image.h"
#include "kernels/losses/sdf_penalty.h"
#include "kernels/reduction/sum.h"
#include "kernels/skinning/implicit_cotangent.h"
#include "kernels/skinning/position_gradient.h"
#include "kernels/tracing/normalise_inputs.h"
#include "shaders/shared/ray.h"
#include "tests/kernels/reference/golden_step.h"
#include "tests/kernels/skinning_at.h"

namespace arah {
namespace {

using golden::expect_golden_float;
using reference::NamedTensors;

class Step : public DeviceTest {};

void name_gradients(const std::string& prefix, const std::vector<RawLayer>& layers, NamedTensors& gradients) {
  for (size_t l = 0; l < layers.size(); ++l) {
    const std::string name = prefix + "." + std::to_string(l) + ".";
    gradients[name + (layers[l][2].empty() ? "W" : "v")] = layers[l][0];
    gradients[name + "b"] = layers[l][1];
    if (!layers[l][2].empty()) gradients[name + "g"] = layers[l][2];
  }
}

TEST_F(Step, FromTheGoldenSamplesToEveryGradient) {
  ARAH_SKIP_WITHOUT_GOLDEN();
  const reference::GoldenStep given;
  const golden::Case& truth = given.truth;
  const auto weight = [](const std::string& term) { return static_cast<float>(reference::kStepWeights.at(term)); };
  const uint32_t rays = static_cast<uint32_t>(given.rays), samples = static_cast<uint32_t>(given.samples), rows = rays * samples;
  const float normaliser = static_cast<float>(rays);
  const reference::Cube& cube = given.skinning.cube;
  const std::vector<int> mask = truth.integers("in.samples.mask");
  const PointRange range{rows, {}};

  // Latent code → modulation of the SIREN.
  DeviceDense mapping(device, given.mapping, 1);
  mapping.write_input(given.latent, 1);
  mapping.network.record_pack(commands);
  mapping.network.record_forward(commands, mapping.tape, {1, {}});
  commands.submit_and_wait();
  const std::vector<double> film = mapping.output(1);
  const auto half = film.begin() + std::ptrdiff_t(film.size() / 2);
  const reference::PosedSiren posed(given);
  reference::Siren generated = posed.siren;
  reference::modulate(generated, {{film.begin(), half}, {half, film.end()}});

  // The samples, and what they are read with.
  const std::vector<double> n = truth.values("in.samples.nstar"), t = truth.values("in.samples.T"), directions = truth.values("in.dir"), depth_values = truth.values("in.samples.z");
  std::vector<double> x, transform_rows;
  for (size_t r = 0; r < rows; ++r) {
    for (const double value : cube.from_cube({n[3 * r], n[3 * r + 1], n[3 * r + 2]})) x.push_back(value);
    transform_rows.insert(transform_rows.end(), &t[16 * r], &t[16 * r] + 12);
  }
  SkinningAt skinning(device, given.skinning, given.bones, x);
  std::vector<float> points = padded_rows(x, 3, 4);
  std::vector<Ray> ray_values(padded_points(rays));
  for (size_t r = 0; r < rows; ++r) points[4 * r + 3] = static_cast<float>(mask[r]);
  for (size_t r = 0; r < rays; ++r)
    for (size_t i = 0; i < 3; ++i) ray_values[r].direction[i] = static_cast<float>(directions[3 * r + i]);
  device.upload(skinning.canonical.slice(), points);
  const BufferSlice frame = skinning.frame.slice(), canonical = skinning.canonical.slice();
  Buffer transforms = filled("transforms", padded_rows(transform_rows, 12, 12)), ray_list = filled("rays", ray_values), target = filled("targets", padded_rows(truth.values("in.target"), 3, 4, 0, 1)),
         depths = filled("depths", std::vector<float>(depth_values.begin(), depth_values.end()));
  const uint64_t padded = padded_points(rows);
  Buffer normals = empty("normals", padded * 16), d_normals = empty("d normals", padded * 16), deltas = empty("deltas", padded * 4), colors = empty("colours", padded_points(rays) * 16),
         d_colors = empty("d colours", padded_points(rays) * 16), ray_depths = empty("ray depths", padded_points(rays) * 4), weights = empty("weights", padded * 4),
         transmittances = empty("transmittances", padded * 4), d_position = empty("d n", padded * 16), upstream = empty("d x", padded * 16), losses = filled("losses", std::vector<float>(8)),
         partials = empty("partials", std::max<uint64_t>(partial_bytes(1024, 2), 256)), b = filled("b", std::vector<float>{static_cast<float>(given.b)}), d_b = filled("d b", std::vector<float>{0});

  // Field and colours at the samples.
  DeviceSiren sdf(device, generated, true, rows, SirenTape::Holds::second_order);
  DeviceDense color(device, given.color, rows, given.latent);
  sdf.siren.record_pack(commands);
  color.network.record_pack(commands, color.code_slice());
  record_normalise_inputs(commands, {{range, {}}, frame, canonical, sdf.tape.input()});
  sdf.siren.record_forward(commands, sdf.tape, range, true);
  sdf.siren.record_gradient(commands, sdf.tape, range, true);
  record_posed_normals(commands, {rows, sdf.tape.gradient(), transforms.slice(), normals.slice(), false});
  AssembleInputsArgs inputs;
  inputs.row = {true, true, sdf.shape.width};
  inputs.points = rows;
  inputs.samples_per_ray = samples;
  inputs.frame = frame;
  inputs.canonical = canonical;
  inputs.rays = ray_list.slice();
  inputs.normals = normals.slice();
  inputs.feature = sdf.tape.feature();
  inputs.rows = color.tape.input();
  inputs.channels = inputs.row.grid_column();
  record_assemble_inputs(commands, inputs);
  color.network.record_forward(commands, color.tape, range);

  // Rays and their loss, and back to the samples.
  CompositeForwardArgs forward;
  forward.samples.rays = rays;
  forward.samples.samples = samples;
  forward.samples.sdf = sdf.tape.sdf();
  forward.samples.metres_per_unit = static_cast<float>(1 / cube.scale());
  forward.samples.rgb = color.tape.output();
  forward.samples.points = canonical;
  forward.samples.deltas = deltas.slice();
  forward.samples.parameters = b.slice();
  forward.delta_mode = DeltaMode::differences;
  forward.depths = depths.slice();
  forward.colors = colors.slice();
  forward.ray_depths = ray_depths.slice();
  forward.weights = weights.slice();
  forward.transmittances = transmittances.slice();
  record_composite_forward(commands, forward);
  record_image_loss(commands, {rays, normaliser, weight("colour_loss"), 0, colors.slice(), target.slice(), d_colors.slice(), losses.slice(), 0, partials.slice(), {}});
  CompositeBackwardArgs backward;
  backward.samples = forward.samples;
  backward.transmittances = transmittances.slice();
  backward.colors = colors.slice();
  backward.d_colors = d_colors.slice();
  backward.d_sdf = sdf.tape.sdf_cotangent();
  backward.d_rgb = color.tape.output_gradient();
  backward.gradients = d_b.slice();
  backward.partials = partials.slice();
  record_composite_backward(commands, backward);
  DenseNetwork::Backward through_color;
  through_color.input_gradient = true;
  through_color.scratch = color.scratch.slice();
  color.network.record_backward(commands, color.tape, range, through_color);
  color.network.record_unpack(commands, color.code_slice(), color.code_gradient_slice());
  record_assemble_inputs_backward(commands, {inputs.row, rows, color.tape.input_gradient(), d_position.slice(), d_normals.slice(), sdf.tape.feature_cotangent()});
  record_posed_normals_backward(commands, {rows, d_normals.slice(), transforms.slice(), sdf.tape.gradient_cotangent()});
  Siren::Backward through_sdf;
  through_sdf.feature = through_sdf.gradient = through_sdf.input_gradient = true;
  through_sdf.scratch = sdf.scratch.slice();
  sdf.siren.record_backward(commands, sdf.tape, range, through_sdf);
  record_position_gradient(commands, {rows, frame, sdf.tape.input_gradient(), d_position.slice(), upstream.slice()});

  // Through the samples' roots to the skinning network.
  skinning.record_jacobians(commands);
  record_implicit_cotangent(commands, {rows, skinning.jacobians.slice(), upstream.slice(), canonical, skinning.cotangents.slice(), skinning.counts.slice()});
  skinning.record_back(commands);
  const std::vector<double> surface = truth.values("in.skin_x");
  const uint32_t surface_points = static_cast<uint32_t>(surface.size() / 3);
  DenseTape surface_tape(device, "surface", skinning.dense.shape, surface_points, true);
  Buffer surface_buffer = filled("surface", padded_rows(surface, 3, 4));
  record_normalise_inputs(commands, {{{surface_points, {}}, {}}, frame, surface_buffer.slice(), surface_tape.input()});
  skinning.dense.network.record_forward(commands, surface_tape, {surface_points, {}});
  commands.submit_and_wait();
  const std::vector<double> logits = times(read_rows(device, surface_tape.output(), surface_points, given.skinning.tree.logits()), given.skinning.logit_scale);
  const reference::ScalarLoss skinning_loss =
      reference::skinning_loss(reference::hierarchical_softmax_forward(given.skinning.tree, surface_points, logits), truth.values("in.skin_w"), int(given.skinning.tree.joints()));
  write_rows(device, surface_tape.output_gradient(), skinning.dense.shape.layers.back().padded_outputs(),
             times(reference::hierarchical_softmax_backward(given.skinning.tree, surface_points, logits, skinning_loss.gradient), given.skinning.logit_scale * weight("skinning")), surface_points);
  DenseNetwork::Backward through_weights;
  through_weights.scratch = skinning.dense.scratch.slice();
  skinning.dense.network.record_backward(commands, surface_tape, {surface_points, {}}, through_weights);
  skinning.dense.network.record_unpack(commands);

  // The other terms of the distance field, each at points of its own.
  const auto tape_at = [&](const char* tensor, SirenTape::Holds holds) {
    const uint32_t count = static_cast<uint32_t>(truth.extent(tensor, 0));
    SirenTape tape(device, tensor, sdf.shape, count, holds);
    write_rows(device, tape.input(), 8, truth.values(tensor), count);
    sdf.siren.record_forward(commands, tape, {count, {}}, true);
    return tape;
  };
  Siren::Backward add;
  add.accumulate = true;
  add.scratch = sdf.scratch.slice();
  SirenTape off = tape_at("in.off", SirenTape::Holds::first_order), inside = tape_at("in.inside", SirenTape::Holds::first_order), eikonal = tape_at("in.eikonal", SirenTape::Holds::second_order);
  const uint32_t off_points = static_cast<uint32_t>(truth.extent("in.off", 0)), inside_points = static_cast<uint32_t>(truth.extent("in.inside", 0)),
                 eikonal_points = static_cast<uint32_t>(truth.extent("in.eikonal", 0));
  record_sdf_penalty(commands, {SdfPenalty::off_surface, off_points, normaliser, weight("off"), off.sdf(), off.sdf_cotangent(), channel_padding, losses.slice(), 2, partials.slice()});
  sdf.siren.record_backward(commands, off, {off_points, {}}, add);
  record_sdf_penalty(commands, {SdfPenalty::inside, inside_points, normaliser, weight("inside"), inside.sdf(), inside.sdf_cotangent(), channel_padding, losses.slice(), 3, partials.slice()});
  sdf.siren.record_backward(commands, inside, {inside_points, {}}, add);
  sdf.siren.record_gradient(commands, eikonal, {eikonal_points, {}}, true);
  record_eikonal_loss(commands, {eikonal_points, normaliser, weight("eikonal"), eikonal.gradient(), eikonal.gradient_cotangent(), channel_padding, losses.slice(), 4, partials.slice()});
  add.gradient = true;
  sdf.siren.record_backward(commands, eikonal, {eikonal_points, {}}, add);
  sdf.siren.record_unpack(commands);
  commands.submit_and_wait();

  // Values.
  const auto where_found = [&](std::vector<double> values, size_t width) {
    for (size_t i = 0; i < values.size(); ++i) values[i] = mask[i / width] ? values[i] : 0;
    return values;
  };
  expect_golden_float(truth, "out.sdf", where_found(times(sdf.sdf(rows), 1 / cube.scale()), 1));
  expect_golden_float(truth, "out.normal", where_found(rows_of(device.download<float>(normals.slice()), rows, 3, 4), 3));
  expect_golden_float(truth, "out.rgb", where_found(color.output(rows), 3));
  expect_golden_float(truth, "out.colour", rows_of(device.download<float>(colors.slice()), rays, 3, 4));
  const std::vector<float> values = device.download<float>(losses.slice());
  const reference::ScalarLoss params = reference::parameter_loss(posed.weights());
  const std::map<std::string, double> terms{{"colour_loss", values[0]}, {"off", values[2]}, {"inside", values[3]}, {"eikonal", values[4]}, {"skinning", skinning_loss.value}, {"params", params.value}};
  // Σ exp(−100 f) / N has 100 times the error of f, and 1e-7 is what the golden README takes for that in float32. Ten times
  // the float32 reference's own error, 1.8e-6, is less than half of it: on 40 points that count its roundings cancelled.
  double total = 0;
  for (const auto& [term, value] : terms) {
    const std::string tensor = "out.loss." + term;
    const double limit = golden::float_limit(truth, tensor);
    golden::expect_close(tensor, {&value, 1}, truth.values(tensor), term == "off" ? std::max(limit, 100 * 1e-7 * truth.scalar(tensor)) : limit);
    total += value * reference::kStepWeights.at(term);
  }
  expect_golden_float(truth, "out.loss.total", {&total, 1});
  EXPECT_EQ(device.download<uint32_t>(skinning.counts.slice())[0], 0u);

  // Gradients, through the modulation to the latent code, and through the generated parameters to what made them.
  reference::Siren d_siren = generated.zeros();
  const std::vector<RawLayer> raw = sdf.tensors.download_gradients();
  size_t first = 0;
  for (size_t l = 0; l < raw.size(); ++l) {
    reference::SirenLayer& layer = d_siren.layers[l];
    layer.w = reference::transposed(raw[l][0], layer.outputs, layer.inputs);
    for (double& d : layer.w) d += weight("params") * params.gradient[first++];
    layer.b = raw[l][1], layer.gamma = raw[l][2], layer.eta = raw[l][3];
  }
  const reference::FilmModulation d_film = reference::modulation_of(d_siren);
  std::vector<double> d_output = d_film.gamma;
  d_output.insert(d_output.end(), d_film.eta.begin(), d_film.eta.end());
  mapping.run(commands, 1, d_output);
  std::vector<double> d_latent = read_rows(device, mapping.tape.input_gradient(), 1, given.latent.size());
  const std::vector<float> through_colour = device.download<float>(color.code_gradient_slice());
  for (size_t i = 0; i < d_latent.size(); ++i) d_latent[i] += through_colour[i];

  NamedTensors gradients;
  posed.backward(given, d_siren, gradients);
  name_gradients("map", mapping.tensors.download_gradients(), gradients);
  name_gradients("lbs", skinning.dense.tensors.download_gradients(), gradients);
  name_gradients("col", color.tensors.download_gradients(), gradients);
  gradients["latent"] = given.latent_gradient(d_latent);
  gradients["b"] = {device.download<float>(d_b.slice())[0]};
  size_t expected = 0;
  for (const auto& [name, tensor] : given.gradients.file().tensors) expected += name.starts_with("grad.");
  EXPECT_EQ(gradients.size(), expected);
  for (const auto& [name, found] : gradients) expect_golden_float(given.gradients, "grad." + name, found);
}

}  // namespace
}  // namespace arah

// A whole training step in double precision against golden case 12: every truth of this folder at work on the others'
// results, from rays to the gradient of every parameter.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numeric>
#include <span>

#include "kernels/reference/broyden.h"
#include "kernels/reference/color.h"
#include "kernels/reference/compositing.h"
#include "kernels/reference/density.h"
#include "kernels/reference/implicit.h"
#include "kernels/reference/sampling.h"
#include "kernels/reference/tracing.h"
#include "tests/kernels/reference/golden_step.h"
#include "tests/kernels/reference/matrix_rows.h"

namespace arah::reference {
namespace {

using golden::expect_golden;

// [rays][samples] of everything; a sample without a root has mask 0, and zeros.
struct StepSamples {
  std::vector<double> n;           // canonical points in the cube
  std::vector<double> transforms;  // T there
  std::vector<double> depths;
  std::vector<std::uint8_t> mask;

  explicit StepSamples(std::size_t rows) : n(3 * rows), transforms(16 * rows), depths(rows), mask(rows) {}
};

struct StepOutcome {
  std::vector<double> sdf, normal, rgb;  // by sample, 0 where masked
  std::vector<double> colour;            // [rays][3]
  std::map<std::string, double> losses;
  NamedTensors gradients;  // of the total
};

// Values of the masked-in samples, put where they belong among all samples.
std::vector<double> scattered(const std::vector<double>& values, std::size_t width, const std::vector<std::uint8_t>& mask) {
  std::vector<double> all(width * mask.size(), 0.0);
  auto from = values.begin();
  for (std::size_t i = 0; i < mask.size(); ++i)
    if (mask[i]) std::copy_n(from, width, all.begin() + std::ptrdiff_t(width * i)), from += std::ptrdiff_t(width);
  return all;
}
std::vector<double> gathered(const std::vector<double>& all, std::size_t width, const std::vector<std::uint8_t>& mask) {
  std::vector<double> values;
  for (std::size_t i = 0; i < mask.size(); ++i)
    if (mask[i]) values.insert(values.end(), all.begin() + std::ptrdiff_t(width * i), all.begin() + std::ptrdiff_t(width * (i + 1)));
  return values;
}

std::vector<double> scaled(std::vector<double> values, double factor) {
  for (double& value : values) value *= factor;
  return values;
}

class Step {
 public:
  Step() : siren(posed.siren) { modulate(siren, film.modulation); }

  // Samples to colours, losses and gradients.
  StepOutcome run(const StepSamples& samples) const;

  // Where the rays' samples lie, from the rays. `all_rays`: also those that sphere tracing gave up go on to the joint
  // search, as in training.
  struct Found {
    StepSamples samples;
    std::vector<TracedRay> traced;
    std::vector<BroydenResult<4>> joint;  // all 0 where not searched
    std::vector<std::uint8_t> hit;
  };
  Found find(bool all_rays) const;

  GoldenStep given;
  PosedSiren posed{given};
  FilmMappingTape film = film_mapping_forward(given.mapping, 1, given.latent);
  Siren siren;  // of the step's pose and frame
};

StepOutcome Step::run(const StepSamples& samples) const {
  StepOutcome outcome;
  const golden::Case& truth = given.truth;
  const double scale = given.skinning.cube.scale(), rays = double(given.rays);
  const auto weight = [](const std::string& term) { return kStepWeights.at(term); };

  // Field and colour at the samples.
  const std::vector<double> n = gathered(samples.n, 3, samples.mask), transforms = gathered(samples.transforms, 16, samples.mask);
  const std::size_t points = n.size() / 3;
  const SirenOutput field = siren_forward(siren, points, n);
  ColorInputs inputs{n, {}, {}, field.feature, {}, {}};
  std::vector<double> views;
  for (std::size_t i = 0; i < samples.mask.size(); ++i)
    append<3>(views, row<3>(scaled(truth.values("in.dir"), -1), i / given.samples));
  inputs.view = gathered(views, 3, samples.mask);
  for (std::size_t p = 0; p < points; ++p) {
    append<3>(inputs.normal, multiply<3>(upper_3x3(matrix<4>(transforms, p)), row<3>(field.gradient, p)));
    inputs.latent.insert(inputs.latent.end(), given.latent.begin(), given.latent.end());
  }
  const DenseTape color = color_forward(given.color, points, inputs);
  outcome.sdf = scattered(scaled(field.sdf, 1 / scale), 1, samples.mask);
  outcome.normal = scattered(inputs.normal, 3, samples.mask);
  outcome.rgb = scattered(color.output, 3, samples.mask);

  // Rays.
  const std::vector<Vector<3>> rgb = as_rows(outcome.rgb);
  const double b = laplace_scale(given.b);
  std::vector<std::vector<double>> deltas;
  std::vector<CompositingInput> ray_inputs;
  std::vector<Composite> composites;
  std::vector<Rgb> colours;
  std::vector<std::uint8_t> rendered;
  for (std::size_t r = 0; r < given.rays; ++r) {
    const auto of_ray = [&](const auto& all) { return std::span(all).subspan(r * given.samples, given.samples); };
    const std::span<const std::uint8_t> mask = of_ray(samples.mask);
    deltas.push_back(depth_differences(of_ray(samples.depths), mask));
    ray_inputs.push_back({of_ray(outcome.sdf), deltas.back(), of_ray(samples.depths), of_ray(rgb), mask, b});
    composites.push_back(composite(ray_inputs.back()));
    colours.push_back(composites.back().colour);
    rendered.push_back(std::count(mask.begin(), mask.end(), 1) > 0);
  }
  outcome.colour = flat(colours);
  const ColorLoss color_term = color_loss(colours, as_rows(truth.values("in.target")), rendered, rays);

  // The other terms, each at points of its own.
  const std::vector<double> eikonal_points = truth.values("in.eikonal"), off_points = truth.values("in.off"),
                            inside_points = truth.values("in.inside"), skinning_points = truth.values("in.skin_x");
  const auto at = [&](const std::vector<double>& x) { return siren_forward(siren, x.size() / 3, x); };
  const EikonalLoss eikonal = eikonal_loss(as_rows(at(eikonal_points).gradient), rays);
  const ScalarLoss off = off_surface_loss(at(off_points).sdf, rays), inside = inside_loss(at(inside_points).sdf, rays);
  const SkinningOutput skinned = skinning_forward(given.skinning, given.bones, skinning_points.size() / 3, skinning_points);
  const ScalarLoss skinning = skinning_loss(skinned.weights, truth.values("in.skin_w"), int(given.bones.size() / 16));
  const ScalarLoss params = parameter_loss(posed.weights());
  outcome.losses = {{"colour_loss", color_term.value}, {"eikonal", eikonal.value},   {"off", off.value},
                    {"inside", inside.value},          {"skinning", skinning.value}, {"params", params.value}};
  double total = 0;
  for (const auto& [term, value] : outcome.losses) total += weight(term) * value;
  outcome.losses["total"] = total;

  // Back to the samples.
  std::vector<double> d_sdf, d_rgb;
  double d_b = 0;
  for (std::size_t r = 0; r < given.rays; ++r) {
    const Vector<3> up = row<3>(scaled(flat(color_term.gradient), weight("colour_loss")), r);
    const CompositingGradient d = composite_backward(ray_inputs[r], composites[r], up, 0);
    d_sdf.insert(d_sdf.end(), d.sdf.begin(), d.sdf.end());
    for (const Vector<3>& of_sample : d.rgb) append<3>(d_rgb, of_sample);
    d_b += d.b;
  }
  DenseNetwork d_color = given.color.zeros();
  const ColorInputs d_inputs = color_backward(given.color, color, inputs, gathered(d_rgb, 3, samples.mask), &d_color);
  SirenAdjoint adjoint{scaled(gathered(d_sdf, 1, samples.mask), 1 / scale), d_inputs.feature, {}};
  for (std::size_t p = 0; p < points; ++p)
    append<3>(adjoint.gradient, multiply_transposed<3>(upper_3x3(matrix<4>(transforms, p)), row<3>(d_inputs.normal, p)));
  Siren d_siren = siren.zeros();
  std::vector<double> d_n = siren_backward(siren, points, n, adjoint, d_siren);
  for (std::size_t i = 0; i < d_n.size(); ++i) d_n[i] += d_inputs.x[i];

  // Through the samples' roots to the skinning network.
  std::vector<double> x;
  for (const Vector<3>& canonical : as_rows(n)) append<3>(x, given.skinning.cube.from_cube(canonical));
  const std::vector<double> jacobians = skinning_jacobian(given.skinning, given.bones, points, x);
  SkinningAdjoint through_roots;
  for (std::size_t p = 0; p < points; ++p)
    append<3>(through_roots.x_bar, implicit_point_gradient(jacobian_in_cube(matrix<3>(jacobians, p), 2 / scale), row<3>(d_n, p)).skinned);
  DenseNetwork d_skinning = given.skinning.layers.zeros();
  skinning_backward(given.skinning, given.bones, points, x, through_roots, &d_skinning, {});
  skinning_backward(given.skinning, given.bones, skinning_points.size() / 3, skinning_points,
                    {{}, scaled(skinning.gradient, weight("skinning"))}, &d_skinning, {});

  // The SIREN's other terms.
  const auto back = [&](const std::vector<double>& at_points, const SirenAdjoint& of_term) {
    siren_backward(siren, at_points.size() / 3, at_points, of_term, d_siren);
  };
  back(eikonal_points, {{}, {}, scaled(flat(eikonal.gradient), weight("eikonal"))});
  back(off_points, {scaled(off.gradient, weight("off")), {}, {}});
  back(inside_points, {scaled(inside.gradient, weight("inside")), {}, {}});
  std::size_t first = 0;
  for (SirenLayer& layer : d_siren.layers)
    for (double& d : layer.w) d += weight("params") * params.gradient[first++];

  // What made the SIREN.
  posed.backward(given, d_siren, outcome.gradients);
  DenseNetwork d_mapping = given.mapping.zeros();
  std::vector<double> d_latent = film_mapping_backward(given.mapping, film, modulation_of(d_siren), &d_mapping);
  for (std::size_t i = 0; i < d_inputs.latent.size(); ++i) d_latent[i % d_latent.size()] += d_inputs.latent[i];
  name_gradients("map", d_mapping, outcome.gradients);
  name_gradients("lbs", d_skinning, outcome.gradients);
  name_gradients("col", d_color, outcome.gradients);
  outcome.gradients["latent"] = given.latent_gradient(d_latent);
  outcome.gradients["b"] = {d_b * laplace_scale_derivative(given.b)};
  return outcome;
}

Step::Found Step::find(bool all_rays) const {
  const golden::Case& truth = given.truth;
  const Cube& cube = given.skinning.cube;
  const std::vector<double> directions = truth.values("in.dir"), near_far = truth.values("in.near_far"), vertex_weights = truth.values("in.verts_w");
  const Vector<3> camera = row<3>(truth.values("in.cam"), 0), translation = row<3>(truth.values("in.trans"), 0);
  const auto less = [](const Vector<3>& a, const Vector<3>& b) { return Vector<3>{a[0] - b[0], a[1] - b[1], a[2] - b[2]}; };
  std::vector<Vector<3>> vertices = as_rows(truth.values("in.verts"));
  for (Vector<3>& vertex : vertices) vertex = less(vertex, translation);
  std::vector<Matrix<4>> transforms;
  for (std::size_t b = 0; b < given.bones.size() / 16; ++b) transforms.push_back(matrix<4>(given.bones, b));
  const PosedTemplate body{vertices, vertex_weights, transforms};

  // Weight normalisation once, not at every evaluation.
  SkinningNetwork skinning = given.skinning;
  for (DenseLayer& layer : skinning.layers.layers) layer.v = layer.weights(), layer.g.clear();
  const auto sdf = [&](const Vector<3>& x) { return siren_forward(siren, 1, cube.to_cube(x)).sdf[0] / cube.scale(); };
  const auto skin = [&](const Vector<3>& x, Matrix<4>& transform) {
    const SkinningOutput skinned = skinning_forward(skinning, given.bones, 1, x);
    transform = matrix<4>(skinned.blended);
    return row<3>(skinned.x_bar, 0);
  };

  Found found{StepSamples(given.rays * given.samples), {}, std::vector<BroydenResult<4>>(given.rays), std::vector<std::uint8_t>(given.rays)};
  for (std::size_t r = 0; r < given.rays; ++r) {
    const Vector<3> direction = row<3>(directions, r), origin = less(camera, translation);
    const double near = near_far[2 * r], far = near_far[2 * r + 1];
    const auto posed_at = [&](double depth) { return Vector<3>{origin[0] + depth * direction[0], origin[1] + depth * direction[1], origin[2] + depth * direction[2]}; };
    const TracedRay traced = trace_sphere(origin, direction, near, far, [&](const Vector<3>& x_bar) { return template_correspondence(x_bar, body); }, sdf);
    found.traced.push_back(traced);

    if (all_rays || !traced.diverged) {
      const Vector<3>& x0 = traced.canonical;
      const SirenOutput field = siren_forward(siren, 1, cube.to_cube(x0));
      found.joint[r] = find_root<4>({x0[0], x0[1], x0[2], traced.depth}, traced.transform,
                                    joint_inverse_jacobian(row<3>(field.gradient, 0), matrix<3>(skinning_jacobian(skinning, given.bones, 1, x0)), direction),
                                    [&](const Vector<4>& u, Matrix<4>& transform) {
                                      const Vector<3> x{u[0], u[1], u[2]}, g = less(skin(x, transform), posed_at(u[3]));
                                      return Vector<4>{sdf(x), g[0], g[1], g[2]};
                                    });
      found.hit[r] = hits_surface(found.joint[r], near, far);
    }

    const RaySamples placed = found.hit[r] ? surface_samples(near, found.joint[r].root[3]) : uniform_samples(near, far, int(given.samples));
    for (std::size_t i = 0; i < placed.depths.size(); ++i) {
      const Vector<3> x_bar = posed_at(placed.depths[i]);
      const Correspondence start = template_correspondence(x_bar, body);
      Matrix<4> blended;
      skin(start.canonical, blended);
      const BroydenResult<3> root = find_root<3>(start.canonical, start.transform, point_inverse_jacobian(blended),
                                                 [&](const Vector<3>& x, Matrix<4>& transform) { return less(skin(x, transform), x_bar); });
      const std::size_t at = r * given.samples + i;
      found.samples.depths[at] = placed.depths[i];
      found.samples.mask[at] = root.converged;
      if (!root.converged) continue;
      const Vector<3> n = cube.to_cube(root.root);
      for (std::size_t c = 0; c < 3; ++c) found.samples.n[3 * at + c] = n[c];
      for (std::size_t c = 0; c < 16; ++c) found.samples.transforms[16 * at + c] = root.transform[c / 4][c % 4];
    }
  }
  return found;
}

std::vector<std::uint8_t> flags(const golden::Case& truth, const std::string& tensor) {
  const std::vector<std::int32_t> numbers = truth.integers(tensor);
  return {numbers.begin(), numbers.end()};
}

TEST(Step, FromTheGoldenSamplesToEveryGradient) {
  ARAH_SKIP_WITHOUT_GOLDEN();
  const Step step;
  const golden::Case& truth = step.given.truth;
  StepSamples samples(step.given.rays * step.given.samples);
  samples.n = truth.values("in.samples.nstar");
  samples.transforms = truth.values("in.samples.T");
  samples.depths = truth.values("in.samples.z");
  samples.mask = flags(truth, "in.samples.mask");
  const StepOutcome outcome = step.run(samples);
  expect_golden(truth, "out.sdf", outcome.sdf);
  expect_golden(truth, "out.normal", outcome.normal);
  expect_golden(truth, "out.rgb", outcome.rgb);
  expect_golden(truth, "out.colour", outcome.colour);
  for (const auto& [term, value] : outcome.losses) expect_golden(truth, "out.loss." + term, value);
  std::size_t gradients = 0;
  for (const auto& [name, tensor] : step.given.gradients.file().tensors) gradients += name.starts_with("grad.");
  EXPECT_EQ(outcome.gradients.size(), gradients);
  for (const auto& [name, values] : outcome.gradients) expect_golden(step.given.gradients, "grad." + name, values);
}

// Both sides are float64, so that the searches take the same steps: far nearer than the 1e-5 m that defines a root.
TEST(Step, FromTheRaysToEveryGradient) {
  ARAH_SKIP_WITHOUT_GOLDEN();
  const Step step;
  const golden::Case &truth = step.given.truth, &gradients = step.given.gradients;
  const Step::Found found = step.find(true);
  const std::vector<double> near_far = truth.values("in.near_far");
  std::vector<double> traced_depths, traced_points, depths, residuals;
  std::vector<int> iterations;
  for (std::size_t r = 0; r < step.given.rays; ++r) {
    traced_depths.push_back(found.traced[r].depth);
    append<3>(traced_points, found.traced[r].canonical);
    depths.push_back(found.hit[r] ? found.joint[r].root[3] : near_far[2 * r]);
    residuals.push_back(found.joint[r].residual);
    iterations.push_back(found.joint[r].iterations);
  }
  expect_golden(truth, "full.sphere_d0", traced_depths);
  expect_golden(truth, "full.sphere_x0", traced_points);
  expect_golden(truth, "full.d", depths);
  expect_golden(truth, "full.joint_residual", residuals);
  EXPECT_EQ(iterations, truth.integers("full.joint_iters"));
  EXPECT_EQ(found.hit, flags(truth, "in.samples.hit"));
  EXPECT_EQ(found.samples.mask, flags(truth, "in.samples.mask"));

  const StepOutcome outcome = step.run(found.samples);
  expect_golden(truth, "full.colour", outcome.colour);
  for (const auto& [term, value] : outcome.losses) expect_golden(truth, "full.loss." + term, value);
  for (const auto& [name, values] : outcome.gradients)
    expect_golden(gradients, "fullnorm." + name, std::sqrt(std::inner_product(values.begin(), values.end(), values.begin(), 0.0)));
}

// Rendering searches the surface only on rays that sphere tracing did not give up.
TEST(Step, FromTheRaysToRenderedColours) {
  ARAH_SKIP_WITHOUT_GOLDEN();
  const Step step;
  const golden::Case& truth = step.given.truth;
  const Step::Found found = step.find(false);
  EXPECT_EQ(found.hit, flags(truth, "eval.hit"));
  EXPECT_EQ(found.samples.mask, flags(truth, "eval.mask"));
  const std::vector<double> depths = gathered(truth.values("eval.z"), 1, found.samples.mask);  // other slots are unused
  golden::expect_close("12_step eval.z", gathered(found.samples.depths, 1, found.samples.mask), depths, golden::double_limit(truth, "eval.z"));
  expect_golden(truth, "eval.nstar", found.samples.n);
  expect_golden(truth, "eval.T", found.samples.transforms);

  const StepOutcome outcome = step.run(found.samples);
  expect_golden(truth, "eval.sdf", outcome.sdf);
  expect_golden(truth, "eval.rgb", outcome.rgb);
  expect_golden(truth, "eval.colour", outcome.colour);
}

}  // namespace
}  // namespace arah::reference

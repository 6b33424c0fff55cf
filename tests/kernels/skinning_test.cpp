// Skinning kernels against the double-precision reference.
#include "kernels/reference/skinning.h"

#include <cmath>
#include <limits>
#include <numeric>

#include "kernels/reduction/sum.h"
#include "kernels/reference/implicit.h"
#include "kernels/reference/lbs.h"
#include "kernels/reference/losses.h"
#include "kernels/skinning/implicit_cotangent.h"
#include "kernels/skinning/inverse_blend.h"
#include "kernels/skinning/jacobian.h"
#include "kernels/skinning/lbs.h"
#include "kernels/skinning/lbs_backward.h"
#include "kernels/skinning/weights_loss.h"
#include "tests/golden.h"
#include "tests/kernels/skinning_scene.h"

namespace arah {
namespace {

class Skinning : public DeviceTest {
 protected:
  std::vector<double> doubles(size_t count, double scale) {
    const std::vector<float> values = uniform(count, -scale, scale);
    return {values.begin(), values.end()};
  }
  static std::vector<double> scaled(std::vector<double> values, double factor) {
    for (double& value : values) value *= factor;
    return values;
  }
};

struct Scene {
  std::vector<int> parents;
  JointTree tree;
  reference::JointTree truth_tree;
  std::vector<double> bones;
  reference::Cube cube{{0.1, -0.2, 0.05}, -0.9, 1.1};
  Buffer frame;

  Scene(Device& device, std::mt19937_64& generator, std::vector<int> given)
      : parents(std::move(given)),
        tree(parents),
        truth_tree(parents),
        bones(random_bones(generator, parents.size(), 1.5)),
        frame(device, "frame", sizeof(FrameConstants), BufferPlace::shared) {
    const FrameConstants constants = frame_constants(cube, bones);
    device.upload(frame.slice(), &constants, sizeof(constants));
  }
};

TEST_F(Skinning, TheTreeCountsLogitsAsTheReferenceDoes) {
  for (const std::vector<int>& parents : {std::vector<int>{-1},
                                          {-1, 0},
                                          {-1, 0, 0},
                                          {-1, 0, 0, 2},
                                          smpl_tree(),
                                          random_tree(generator, 64, 5),
                                          random_tree(generator, 64, 63)}) {
    const JointTree tree(parents);
    EXPECT_EQ(tree.logits(), reference::JointTree(parents).logits());
    EXPECT_EQ(tree.specialization().size(), 66u);
  }
  EXPECT_THROW(JointTree({}), std::invalid_argument);
  EXPECT_THROW(JointTree({0}), std::invalid_argument);
  EXPECT_THROW(JointTree({-1, 2, 1}), std::invalid_argument);
  EXPECT_THROW(JointTree(std::vector<int>(65, 0)), std::invalid_argument);
}

// Forward and backward over trees of every kind, with a column offset, an index list and a count on the device.
TEST_F(Skinning, ForwardAndBackwardFollowTheReference) {
  struct Case {
    std::vector<int> parents;
    uint32_t rows;
    bool indexed;
  };
  const std::vector<Case> cases = {{{-1}, 1, false},
                                   {{-1, 0, 1}, 63, true},
                                   {smpl_tree(), 333, true},
                                   {smpl_tree(), 65, false},
                                   {random_tree(generator, 33, 9), 65, false}};
  for (const Case& c : cases) {
    Scene scene(device, generator, c.parents);
    const uint32_t rows = c.rows, joints = scene.tree.joints(), logits = scene.tree.logits();
    const uint32_t points = c.indexed ? 2 * rows : rows, stride = padded_channels(logits) + 8;
    const std::string label = std::to_string(joints) + " joints, " + std::to_string(rows) + " rows: ";
    const std::vector<double> given = doubles(rows * logits, 0.2), x_all = doubles(points * 3, 1),
                              g = doubles(rows * 3, 1);
    std::vector<uint32_t> ids(padded_points(rows), 0);
    for (uint32_t r = 0; r < rows; ++r) ids[r] = c.indexed ? (r * 7 + 3) % points : r;
    std::vector<double> x;
    for (uint32_t r = 0; r < rows; ++r)
      for (size_t i = 0; i < 3; ++i) x.push_back(x_all[ids[r] * 3 + i]);

    Buffer logit_rows = filled("logits", padded_rows(given, logits, stride, 8, 1e4f));
    Buffer canonical = filled("canonical", padded_rows(x_all, 3, 4));
    Buffer cotangents = filled("cotangents", padded_rows(g, 3, 4, 0, 1e4f));
    Buffer id_list = filled("ids", ids);
    Buffer work = filled("work", std::vector<WorkCount>{work_of(rows)});
    const uint64_t padded = padded_points(rows);
    Buffer posed = empty("posed", padded * 16), transforms = empty("transforms", padded * 48);
    Buffer weights = empty("weights", padded * 4 * stride), d_logits = empty("d_logits", padded * 4 * stride);
    Buffer d_canonical = empty("d_canonical", padded * 16);

    Rows over{{rows, {}}, {}};
    if (c.indexed) over = {{rows, work.slice()}, id_list.slice()};
    const Matrix logit_matrix{logit_rows.slice(), stride, 8}, weight_matrix{weights.slice(), stride, 0},
        d_matrix{d_logits.slice(), stride, 8};
    record_lbs(commands, {&scene.tree, over, logit_matrix, scene.frame.slice(), canonical.slice(), posed.slice(),
                          transforms.slice(), weight_matrix});
    record_lbs_backward(commands, {&scene.tree, over, logit_matrix, scene.frame.slice(), canonical.slice(),
                                   cotangents.slice(), 3, d_matrix, d_canonical.slice()});
    commands.submit_and_wait();

    const std::vector<double> scaled_logits = scaled(given, 20);
    const std::vector<double> w = reference::hierarchical_softmax_forward(scene.truth_tree, rows, scaled_logits);
    const std::vector<float> weights_found = device.download<float>(weights.slice()),
                             posed_found = device.download<float>(posed.slice());
    expect_all_near(label + "weights", rows_of(weights_found, rows, joints, stride), w, 2e-6);
    expect_all_near(label + "posed", rows_of(posed_found, rows, 3, 4), reference::lbs_forward(rows, w, scene.bones, x),
                    5e-6);
    const std::vector<double> blended = reference::blend_transforms(rows, w, scene.bones);
    std::vector<double> blended_rows;
    for (uint32_t r = 0; r < rows; ++r)
      blended_rows.insert(blended_rows.end(), &blended[r * 16], &blended[r * 16] + 12);
    expect_all_near(label + "transforms", rows_of(device.download<float>(transforms.slice()), rows, 12, 12),
                    blended_rows, 3e-6);

    const reference::LbsGradients back = reference::lbs_backward(rows, w, scene.bones, x, g, {});
    const std::vector<double> d_expected =
        scaled(reference::hierarchical_softmax_backward(scene.truth_tree, rows, scaled_logits, back.weights), 20);
    const std::vector<float> d_found = device.download<float>(d_logits.slice());
    expect_all_near(label + "d_logits", rows_of(d_found, rows, logits, stride, 8), d_expected, 5e-5);
    // Direct part: the reference's Tᵀ g.
    expect_all_near(label + "d_canonical", rows_of(device.download<float>(d_canonical.slice()), rows, 3, 4), back.x,
                    5e-6);
    for (uint32_t r = 0; r < padded; ++r)
      for (uint32_t column = 0; column < padded_channels(logits); ++column)
        if (r >= rows || column >= logits) {
          EXPECT_EQ(d_found[r * stride + 8 + column], 0) << label << r << ", " << column;
        }
    for (uint64_t r = rows; r < padded; ++r) EXPECT_EQ(posed_found[r * 4], 0) << label << r;
    for (uint32_t column = joints; column < padded_channels(joints); ++column)
      EXPECT_EQ(weights_found[column], 0) << label;
  }
}

TEST_F(Skinning, ExtremeLogitsStayFiniteAndNaNIsSeen) {
  Scene scene(device, generator, smpl_tree());
  const uint32_t rows = 200, logits = scene.tree.logits(), stride = padded_channels(logits);
  std::vector<double> given;
  for (uint32_t r = 0; r < rows; ++r) {
    const double scale = std::vector<double>{1e4, 300, 10, 1e4}[r % 4];
    std::vector<double> row = doubles(logits, scale);
    if (r % 4 == 3)
      for (double& value : row) value = value > 0 ? 1e4 : -1e4;
    given.insert(given.end(), row.begin(), row.end());
  }
  const std::vector<double> x = doubles(rows * 3, 1), g = doubles(rows * 3, 1);
  Buffer logit_rows = filled("logits", padded_rows(given, logits, stride)),
         canonical = filled("canonical", padded_rows(x, 3, 4));
  Buffer cotangents = filled("cotangents", padded_rows(g, 3, 4));
  Buffer posed = empty("posed", 256 * 16), transforms = empty("transforms", 256 * 48),
         weights = empty("weights", 256 * 4 * 24);
  Buffer d_logits = empty("d_logits", 256 * 4 * stride), d_canonical = empty("d_canonical", 256 * 16);
  const Rows over{{rows, {}}, {}};
  const Matrix logit_matrix{logit_rows.slice(), stride, 0};
  const auto run = [&] {
    record_lbs(commands, {&scene.tree,
                          over,
                          logit_matrix,
                          scene.frame.slice(),
                          canonical.slice(),
                          posed.slice(),
                          transforms.slice(),
                          {weights.slice(), 24, 0}});
    record_lbs_backward(commands, {&scene.tree,
                                   over,
                                   logit_matrix,
                                   scene.frame.slice(),
                                   canonical.slice(),
                                   cotangents.slice(),
                                   3,
                                   {d_logits.slice(), stride, 0},
                                   d_canonical.slice()});
    commands.submit_and_wait();
  };
  run();
  const std::vector<double> w = reference::hierarchical_softmax_forward(scene.truth_tree, rows, scaled(given, 20));
  expect_all_near("weights at logits up to 1e4", rows_of(device.download<float>(weights.slice()), rows, 24, 24), w,
                  5e-5);
  const reference::LbsGradients back = reference::lbs_backward(rows, w, scene.bones, x, g, {});
  expect_all_near(
      "d_logits at logits up to 1e4", rows_of(device.download<float>(d_logits.slice()), rows, logits, stride),
      scaled(reference::hierarchical_softmax_backward(scene.truth_tree, rows, scaled(given, 20), back.weights), 20),
      5e-5);

  given[5 * logits + 24] = std::nan("");
  device.upload(logit_rows.slice(), padded_rows(given, logits, stride));
  run();
  const std::vector<float> found = device.download<float>(posed.slice());
  for (uint32_t r = 0; r < rows; ++r) EXPECT_EQ(std::isnan(found[r * 4]), r == 5) << r;
}

TEST_F(Skinning, GoldenHierarchicalSoftmax) {
  ARAH_SKIP_WITHOUT_GOLDEN();
  const golden::Case truth("02_hsoftmax");
  Scene scene(device, generator, smpl_tree());
  const uint32_t rows = static_cast<uint32_t>(truth.extent("in.logits", 0)), stride = 32;
  Buffer logit_rows = filled("logits", padded_rows(scaled(truth.values("in.logits"), 1 / 20.0), 25, stride));
  Buffer canonical = filled("canonical", std::vector<float>(padded_points(rows) * 4, 0.5f));
  Buffer posed = empty("posed", padded_points(rows) * 16), transforms = empty("transforms", padded_points(rows) * 48);
  Buffer weights = empty("weights", padded_points(rows) * 4 * 24);
  record_lbs(commands, {&scene.tree,
                        {{rows, {}}, {}},
                        {logit_rows.slice(), stride, 0},
                        scene.frame.slice(),
                        canonical.slice(),
                        posed.slice(),
                        transforms.slice(),
                        {weights.slice(), 24, 0}});
  commands.submit_and_wait();
  golden::expect_close("golden skinning weights", rows_of(device.download<float>(weights.slice()), rows, 24, 24),
                       truth.values("out.w"), 5e-6);
}

// The Jacobian's parts on the device, the network's backward pass between them in the reference.
TEST_F(Skinning, JacobianFromItsParts) {
  Scene scene(device, generator, smpl_tree());
  const uint32_t rows = 130, logits = scene.tree.logits(), stride = padded_channels(logits);
  reference::SkinningNetwork network{scene.truth_tree, scene.cube, {}, 20};
  network.layers.layers = {
      {3, 16, reference::Activation::softplus, false, doubles(48, 0.6), {}, doubles(16, 0.3)},
      {16, logits, reference::Activation::none, false, doubles(16 * logits, 0.1), {}, doubles(logits, 0.05)}};
  const std::vector<double> x = doubles(rows * 3, 0.8);
  std::vector<double> n;
  for (uint32_t r = 0; r < rows; ++r)
    for (const double value : scene.cube.to_cube({x[3 * r], x[3 * r + 1], x[3 * r + 2]})) n.push_back(value);
  const reference::DenseTape tape = reference::dense_forward(network.layers, rows, n);

  const uint64_t padded = padded_points(rows);
  Buffer logit_rows = filled("logits", padded_rows(tape.output, logits, stride)),
         canonical = filled("canonical", padded_rows(x, 3, 4));
  Buffer posed = empty("posed", padded * 16), transforms = empty("transforms", padded * 48),
         d_logits = empty("d_logits", padded * 4 * stride);
  Buffer weights = empty("weights", padded * 4 * 24);
  const Rows over{{rows, {}}, {}};
  const Matrix logit_matrix{logit_rows.slice(), stride, 0};
  std::vector<Buffer> gradients;
  for (uint32_t component = 0; component < 3; ++component) {
    record_lbs_backward(commands, {&scene.tree,
                                   over,
                                   logit_matrix,
                                   scene.frame.slice(),
                                   canonical.slice(),
                                   {},
                                   component,
                                   {d_logits.slice(), stride, 0},
                                   {}});
    commands.submit_and_wait();
    const std::vector<double> d_n = reference::dense_backward(
        network.layers, tape, rows_of(device.download<float>(d_logits.slice()), rows, logits, stride), nullptr);
    gradients.push_back(filled("gradient", padded_rows(d_n, 3, 16, 8)));
  }
  Buffer jacobians = empty("jacobians", padded * 48);
  record_lbs(commands, {&scene.tree,
                        over,
                        logit_matrix,
                        scene.frame.slice(),
                        canonical.slice(),
                        posed.slice(),
                        transforms.slice(),
                        {weights.slice(), 24, 0}});
  record_jacobian(commands, {{rows, {}},
                             scene.frame.slice(),
                             transforms.slice(),
                             {Matrix{gradients[0].slice(), 16, 8}, Matrix{gradients[1].slice(), 16, 8},
                              Matrix{gradients[2].slice(), 16, 8}},
                             jacobians.slice()});
  commands.submit_and_wait();
  expect_all_near("skinning Jacobian", rows_of(device.download<float>(jacobians.slice()), rows * 3, 3, 4),
                  reference::skinning_jacobian(network, scene.bones, rows, x), 2e-5);
}

TEST_F(Skinning, ImplicitCotangentsAndTheirExceptions) {
  const uint32_t points = 131;
  const std::vector<double> upstream = doubles(points * 3, 2);
  std::vector<double> jacobians = doubles(points * 9, 1), expected;
  std::vector<float> roots(padded_points(points) * 4, 1.0f);  // w of padding rows says "root": they must not count
  uint32_t singular = 0, shortened = 0;
  for (uint32_t p = 0; p < points; ++p) {
    for (size_t i = 0; i < 3; ++i) jacobians[p * 9 + 4 * i] += 2;
    if (p % 10 == 3)  // the third row is the sum of the others, as float32 holds it
      for (size_t i = 0; i < 3; ++i)
        jacobians[p * 9 + 6 + i] = static_cast<float>(jacobians[p * 9 + i] + jacobians[p * 9 + 3 + i]);
    if (p == 20) jacobians[p * 9] = std::nan("");
    if (p % 10 == 6)  // thin in one direction: 200 times as long a gradient, or 50
      for (size_t i = 0; i < 9; ++i) jacobians[p * 9 + i] = i % 4 ? 0 : i == 8 ? (p % 20 == 6 ? 0.005 : 0.02) : 1;
    if (p % 7 == 0) roots[p * 4 + 3] = 0;
    reference::Matrix<3> j;
    for (size_t i = 0; i < 9; ++i) j[i / 3][i % 3] = jacobians[p * 9 + i];
    const bool none = p % 10 == 3 || p == 20;
    singular += none && p % 7 != 0;
    const auto gradient =
        reference::implicit_point_gradient(j, {upstream[3 * p], upstream[3 * p + 1], upstream[3 * p + 2]});
    shortened += !none && p % 7 != 0 && gradient.shortened;
    for (size_t i = 0; i < 3; ++i) expected.push_back(none || p % 7 == 0 ? 0 : gradient.skinned[i]);
  }
  EXPECT_GT(shortened, 0u);
  Buffer rows = filled("jacobians", padded_rows(jacobians, 3, 4), padded_points(points) * 48),
         above = filled("upstream", padded_rows(upstream, 3, 4));
  Buffer canonical = filled("canonical", roots), cotangents = empty("cotangents", padded_points(points) * 16);
  Buffer count = filled("counts", std::vector<shared::ImplicitCounts>{{5, 3}});
  record_implicit_cotangent(
      commands, {points, rows.slice(), above.slice(), canonical.slice(), cotangents.slice(), count.slice()});
  commands.submit_and_wait();
  expect_all_near("implicit cotangents", rows_of(device.download<float>(cotangents.slice()), points, 3, 4), expected,
                  2e-4);
  const auto counted = device.download<shared::ImplicitCounts>(count.slice())[0];
  EXPECT_EQ(counted.singular, 5 + singular);
  EXPECT_EQ(counted.shortened, 3 + shortened);
}

TEST_F(Skinning, TheBlendIsInvertedWhereItCanBe) {
  for (const uint32_t points : {1u, 63u, 200u}) {
    std::vector<double> blends(points * 16, 0.0);
    std::vector<float> transforms(padded_points(points) * 12, std::numeric_limits<float>::quiet_NaN()), targets = uniform(padded_points(points) * 4, -2, 2);
    for (uint32_t p = 0; p < padded_points(points); ++p) targets[4 * p + 3] = p % 5 == 4 ? 0.0f : 1.0f;
    std::vector<double> posed;
    for (uint32_t p = 0; p < points; ++p) {
      const std::vector<float> values = uniform(12, -0.3f, 0.3f);
      for (size_t i = 0; i < 12; ++i) blends[16 * p + i] = values[i] + float(i % 5 == 0 && i < 11);
      if (p == 7) std::copy_n(&blends[16 * p], 4, &blends[16 * p + 4]);  // two rows alike
      if (p == 11) blends[16 * p] = std::nan("");
      for (size_t i = 0; i < 12; ++i) transforms[12 * p + i] = static_cast<float>(blends[16 * p + i]), blends[16 * p + i] = transforms[12 * p + i];
      blends[16 * p + 15] = 1;
      for (size_t i = 0; i < 3; ++i) posed.push_back(targets[4 * p + i]);
    }
    Buffer target_buffer = filled("targets", targets), transform_buffer = filled("transforms", transforms),
           canonical = filled("canonical", std::vector<float>(padded_points(points) * 4, 9.0f));
    record_inverse_blend(commands, {points, target_buffer.slice(), transform_buffer.slice(), canonical.slice()});
    commands.submit_and_wait();
    const std::vector<float> result = device.download<float>(canonical.slice());
    const std::vector<double> truth = reference::inverse_blend(points, blends, posed);
    std::vector<double> found, expected;
    for (uint32_t p = 0; p < padded_points(points); ++p) {
      const bool wanted = p < points && p % 5 != 4 && p != 7 && p != 11;
      EXPECT_EQ(result[4 * p + 3], wanted ? 1 : 0) << p;
      for (size_t i = 0; i < 3; ++i) {
        if (wanted) found.push_back(result[4 * p + i]), expected.push_back(truth[3 * p + i]);
        else EXPECT_EQ(result[4 * p + i], 0) << p;
      }
    }
    expect_all_near("inverse of the blend", found, expected, 2e-5);
  }
}

TEST_F(Skinning, WeightsLossAndItsGradient) {
  Scene scene(device, generator, smpl_tree());
  const uint32_t logits = scene.tree.logits(), stride = padded_channels(logits);
  for (const auto& [points, measure] : {std::pair{1u, WeightsMeasure::absolute}, {200u, WeightsMeasure::absolute}, {200u, WeightsMeasure::cross_entropy}}) {
    const std::vector<double> given = doubles(points * logits, 0.1);
    std::vector<double> dense(points * 24, 0.0);
    std::vector<uint32_t> joints(padded_points(points), 0);
    std::vector<double> shares;
    for (uint32_t p = 0; p < points; ++p) {
      for (uint32_t k = 0; k < 4; ++k) {
        const uint32_t joint = std::uniform_int_distribution<uint32_t>(0, 23)(generator);  // sometimes named twice
        const double share = k == 3 ? 0 : as_float({std::vector<double>{0.5, 0.3, 0.2}[k]})[0];
        joints[p] |= joint << (8 * k);
        dense[p * 24 + joint] += share;
        shares.push_back(share);
      }
    }
    Buffer logit_rows = filled("logits", padded_rows(given, logits, stride)), target_joints = filled("joints", joints);
    Buffer target_weights = filled("target weights", padded_rows(shares, 4, 4)),
           d_logits = empty("d_logits", padded_points(points) * 4ull * stride);
    Buffer scratch = empty("scratch", partial_bytes(points)), losses = filled("losses", std::vector<float>{1, 2, 3});
    record_weights_loss(commands, {&scene.tree,
                                   measure,
                                   points,
                                   {logit_rows.slice(), stride, 0},
                                   target_joints.slice(),
                                   target_weights.slice(),
                                   10,
                                   {d_logits.slice(), stride, 0},
                                   scratch.slice(),
                                   losses.slice(),
                                   1});
    commands.submit_and_wait();

    const std::vector<double> w = reference::hierarchical_softmax_forward(scene.truth_tree, points, scaled(given, 20));
    reference::ScalarLoss truth = reference::skinning_loss(w, dense, 24);
    if (measure == WeightsMeasure::cross_entropy) {
      truth.value = 0;
      for (size_t i = 0; i < w.size(); ++i) {
        truth.value -= dense[i] * std::log(w[i] + 1e-12) / points;
        truth.gradient[i] = -dense[i] / (w[i] + 1e-12) / points;
      }
    }
    const std::vector<float> found = device.download<float>(losses.slice());
    EXPECT_NEAR(found[1], 2 + 10 * truth.value, 2e-5);
    EXPECT_EQ(found[0], 1);
    EXPECT_EQ(found[2], 3);
    const std::vector<double> d_w = scaled(truth.gradient, 10);
    const std::vector<double> expected =
        scaled(reference::hierarchical_softmax_backward(scene.truth_tree, points, scaled(given, 20), d_w), 20);
    const std::vector<float> d_found = device.download<float>(d_logits.slice());
    expect_all_near("skinning loss, d_logits", rows_of(d_found, points, logits, stride), expected, 2e-4 / points);
    for (uint64_t i = uint64_t(points) * stride; i < d_found.size() && i < padded_points(points) * uint64_t(stride);
         ++i)
      ASSERT_EQ(d_found[i], 0) << i;
  }
}

}  // namespace
}  // namespace arah

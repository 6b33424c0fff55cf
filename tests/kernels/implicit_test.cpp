// The implicit function theorem on the device, from the networks' Jacobians to the gradients of their parameters: golden
// cases, and the joint kernel against the double-precision truth.
#include "kernels/reference/implicit.h"

#include <cmath>

#include "kernels/reference/broyden.h"
#include "kernels/skinning/bone_gradient.h"
#include "kernels/skinning/implicit_cotangent.h"
#include "kernels/skinning/implicit_joint_cotangent.h"
#include "shaders/shared/ray.h"
#include "tests/kernels/reference/golden_networks.h"
#include "tests/kernels/skinning_at.h"

namespace arah {
namespace {

using golden::expect_golden_float;

class Implicit : public DeviceTest {
 protected:
  std::vector<double> doubles(size_t count, double scale) {
    const std::vector<float> values = uniform(count, -scale, scale);
    return {values.begin(), values.end()};
  }
};

TEST_F(Implicit, GoldenGradientsThroughTheCorrespondence) {
  ARAH_SKIP_WITHOUT_GOLDEN();
  const golden::Case truth("11_implicit_points"), lbs("03_lbs_net");
  const reference::SkinningNetwork network = reference::golden_skinning(lbs, lbs);
  const std::vector<double> n = truth.values("in.nstar");
  std::vector<double> x;
  for (size_t p = 0; p < n.size() / 3; ++p)
    for (const double value : network.cube.from_cube({n[3 * p], n[3 * p + 1], n[3 * p + 2]})) x.push_back(value);
  SkinningAt at(device, network, truth.values("in.B"), x);
  // L is a function of n, which grows cube_scale times as fast as x.
  Buffer upstream = filled("upstream", padded_rows(times(truth.values("in.G"), network.cube.scale()), 3, 4));
  at.record_jacobians(commands);
  record_implicit_cotangent(commands, {at.points, at.jacobians.slice(), upstream.slice(), at.canonical.slice(), at.cotangents.slice(), at.counts.slice()});
  BoneGradientArgs bones;
  bones.rows = at.rows();
  bones.joints = 24;
  bones.cotangents = at.cotangents.slice();
  bones.canonical = at.canonical.slice();
  bones.weights = {at.bone_weights.slice(), SkinningAt::weight_stride, 0};
  Buffer partials = empty("partials", bone_gradient_partials(at.points, 24)), sums = filled("dL/dB", std::vector<float>(24 * 12, 0.0f));
  bones.partials = partials.slice();
  bones.gradients = sums.slice();
  record_bone_gradient(commands, bones);
  at.record_back(commands);
  commands.submit_and_wait();
  std::vector<double> d_bones;
  const std::vector<float> found = device.download<float>(sums.slice());
  for (size_t b = 0; b < 24; ++b) {
    d_bones.insert(d_bones.end(), found.begin() + ptrdiff_t(12 * b), found.begin() + ptrdiff_t(12 * b + 12));
    d_bones.insert(d_bones.end(), 4, 0.0);  // the last row is no variable
  }
  expect_golden_float(truth, "grad.B", d_bones);
  expect_golden_float(truth, "grad.x_bar", times(rows_of(device.download<float>(at.cotangents.slice()), at.points, 3, 4), -1));
  expect_golden_gradients(truth, "lbs", at.dense.tensors.download_gradients());
  EXPECT_EQ(device.download<uint32_t>(at.counts.slice())[0], 0u);
}

TEST_F(Implicit, GoldenGradientsThroughTheJointSearch) {
  ARAH_SKIP_WITHOUT_GOLDEN();
  const golden::Case truth("11_implicit_joint"), lbs("03_lbs_net");
  const reference::SkinningNetwork network = reference::golden_skinning(lbs, lbs);
  const std::vector<double> x = truth.values("in.xstar"), depths = truth.values("in.dstar"), directions = truth.values("in.dir"), upstream_x = truth.values("in.Gx"),
                            upstream_d = truth.values("in.Gd");
  SkinningAt at(device, network, truth.values("in.B"), x);
  DeviceSiren sdf(device, reference::golden_siren(truth), true, at.points, SirenTape::Holds::first_order);
  std::vector<double> n, upstream;
  std::vector<Ray> rays(padded_points(at.points));
  for (size_t p = 0; p < at.points; ++p) {
    for (const double value : network.cube.to_cube({x[3 * p], x[3 * p + 1], x[3 * p + 2]})) n.push_back(value);
    for (size_t i = 0; i < 3; ++i) upstream.push_back(upstream_x[3 * p + i]), rays[p].direction[i] = static_cast<float>(directions[3 * p + i]);
    upstream.push_back(upstream_d[p]);
  }
  write_rows(device, sdf.tape.input(), 8, n, at.points);
  Buffer above = filled("upstream", padded_rows(upstream, 4, 4)), ray_list = filled("rays", rays);
  at.record_jacobians(commands);
  sdf.siren.record_pack(commands);
  sdf.siren.record_forward(commands, sdf.tape, {at.points, {}}, true);
  sdf.siren.record_gradient(commands, sdf.tape, {at.points, {}}, false);
  record_implicit_joint_cotangent(commands, {at.points, at.frame.slice(), ray_list.slice(), sdf.tape.gradient(), at.jacobians.slice(), above.slice(), at.canonical.slice(), at.cotangents.slice(),
                                             sdf.tape.sdf_cotangent(), at.counts.slice()});
  at.record_back(commands);
  Siren::Backward backward;
  backward.scratch = sdf.scratch.slice();
  sdf.siren.record_backward(commands, sdf.tape, {at.points, {}}, backward);
  sdf.siren.record_unpack(commands);
  commands.submit_and_wait();

  const std::vector<double> skinned = rows_of(device.download<float>(at.cotangents.slice()), at.points, 3, 4);
  std::vector<double> camera(3, 0.0), by_direction;
  for (size_t p = 0; p < at.points; ++p)
    for (size_t i = 0; i < 3; ++i) camera[i] -= skinned[3 * p + i], by_direction.push_back(-depths[p] * skinned[3 * p + i]);
  expect_golden_float(truth, "grad.cam", camera);
  expect_golden_float(truth, "grad.dir", by_direction);
  expect_golden_gradients(truth, "lbs", at.dense.tensors.download_gradients());
  static const char* const parts[] = {"W", "b", "gamma", "eta"};
  const std::vector<RawLayer> gradients = sdf.tensors.download_gradients();
  for (size_t l = 0; l < gradients.size(); ++l)
    for (size_t t = 0; t < 4; ++t)
      if (!gradients[l][t].empty()) expect_golden_float(truth, "grad.sdf." + std::to_string(l) + "." + parts[t], gradients[l][t]);
  EXPECT_EQ(device.download<uint32_t>(at.counts.slice())[0], 0u);
}

// Sums of bone gradients against the truth: weights by row with a column offset, and those of nearest vertices through a list;
// many rows, few, none; on top of what is there; the same bits again.
TEST_F(Implicit, BoneGradientsFollowTheReference) {
  struct Case {
    uint32_t joints, rows;
    bool by_vertex;
  };
  for (const Case& c : {Case{1, 1, false}, Case{24, 333, false}, Case{64, 130, false}, Case{24, 5000, false}, Case{3, 64, true}, Case{24, 700, true}, Case{64, 65, true}}) {
    const uint32_t padded = padded_points(c.rows), stride = padded_channels(c.joints) + 8, vertices = 37, points = 2 * c.rows;
    const std::vector<double> g = doubles(c.rows * 3, 2), x = doubles(c.rows * 3, 1);
    std::vector<double> w;
    Buffer cotangents = filled("cotangents", padded_rows(g, 3, 4)), canonical = filled("canonical", padded_rows(x, 3, 4, 0, std::nanf("")));  // nothing of the padding counts
    Buffer partials = empty("partials", bone_gradient_partials(c.rows, c.joints)), sums = filled("dL/dB", std::vector<float>(c.joints * 12, 0.5f));
    BoneGradientArgs args;
    args.rows = {{c.rows, {}}, {}};
    args.joints = c.joints;
    args.cotangents = cotangents.slice();
    args.canonical = canonical.slice();
    args.partials = partials.slice();
    args.gradients = sums.slice();
    Buffer weights, nearest, influences, ids;
    if (c.by_vertex) {
      std::vector<uint32_t> id(padded, 0), vertex(padded_points(points)), words(vertices);
      for (uint32_t r = 0; r < c.rows; ++r) id[r] = (r * 7 + 3) % points;
      for (uint32_t& v : vertex) v = static_cast<uint32_t>(generator() % vertices);
      for (uint32_t& word : words)
        for (int k = 0; k < 4; ++k) word |= static_cast<uint32_t>(generator() % c.joints) << (8 * k);  // sometimes one joint twice
      const std::vector<float> shares = uniform(vertices * 4, 0.05, 0.5);
      for (uint32_t r = 0; r < c.rows; ++r) {
        const uint32_t v = vertex[id[r]];
        std::vector<double> dense(c.joints, 0.0);
        double sum = 0;
        for (uint32_t k = 0; k < 4; ++k) dense[words[v] >> (8 * k) & 255] += double{shares[4 * v + k]}, sum += double{shares[4 * v + k]};
        for (const double share : dense) w.push_back(share / sum);
      }
      weights = filled("weights", shares), nearest = filled("nearest", vertex), influences = filled("joints", words), ids = filled("ids", id);
      args.rows.ids = ids.slice();
      args.nearest = nearest.slice();
      args.target.joints = influences.slice();
      args.target.weights = weights.slice();
    } else {
      w = doubles(c.rows * c.joints, 1);
      weights = filled("weights", padded_rows(w, c.joints, stride, 8, 1e4f));
      args.weights = {weights.slice(), stride, 8};
    }
    record_bone_gradient(commands, args);
    commands.submit_and_wait();
    const std::vector<float> found = device.download<float>(sums.slice().elements(0, 12 * c.joints));
    std::vector<double> expected = reference::implicit_pose_gradient(c.joints, w, x, g).bone_transforms;
    for (double& value : expected) value += 0.5;
    expect_all_near(std::to_string(c.joints) + " joints, " + std::to_string(c.rows) + (c.by_vertex ? " rows by vertex" : " rows"), std::vector<double>(found.begin(), found.end()), expected, 2e-6 * std::sqrt(c.rows));
    device.upload(sums.slice(), std::vector<float>(c.joints * 12, 0.5f));
    record_bone_gradient(commands, args);
    commands.submit_and_wait();
    EXPECT_EQ(device.download<float>(sums.slice().elements(0, 12 * c.joints)), found);
  }
  BoneGradientArgs args;
  args.joints = 65;
  EXPECT_THROW(record_bone_gradient(commands, args), std::invalid_argument);
}

TEST_F(Implicit, JointCotangentsAndTheirExceptions) {
  const uint32_t count = 131, stride = 16;
  std::vector<double> jacobians = doubles(count * 9, 0.5), normals = doubles(count * 3, 1), upstream = doubles(count * 4, 2), expected, expected_sdf;
  std::vector<Ray> rays(padded_points(count));
  std::vector<float> roots(padded_points(count) * 4, 1.0f);  // w of padding rows says "root": they must not count
  const reference::Cube cube{{0.1, -0.2, 0.05}, -0.9, 1.1};
  const FrameConstants constants = frame_constants(cube, {});
  uint32_t singular = 0, shortened = 0;
  for (uint32_t r = 0; r < count; ++r) {
    for (size_t i = 0; i < 3; ++i) jacobians[r * 9 + 4 * i] += 2, normals[3 * r + i] = static_cast<float>(normals[3 * r + i] + (i == 2 ? -2 : 0));
    const std::vector<double> wobble = doubles(2, 0.3);
    reference::Vector<3> direction{wobble[0], wobble[1], 1};
    if (r % 10 == 3) {  // along the surface: with J the identity the ray lies in the tangent plane
      for (size_t i = 0; i < 9; ++i) jacobians[r * 9 + i] = i % 4 == 0;
      direction = {1, 0, 0};
      normals[3 * r] = 0, normals[3 * r + 1] = 1, normals[3 * r + 2] = 0;
    }
    if (r % 10 == 6) {  // 0.005 from along it: a gradient of 200 times its cause
      for (size_t i = 0; i < 9; ++i) jacobians[r * 9 + i] = i % 4 == 0;
      direction = {1, 0.005F, 0};
      normals[3 * r] = 0, normals[3 * r + 1] = 1, normals[3 * r + 2] = 0;
    }
    if (r == 20) normals[3 * r] = std::nan("");
    if (r % 7 == 0) roots[4 * r + 3] = 0;
    reference::Matrix<3> j;
    for (size_t i = 0; i < 9; ++i) j[i / 3][i % 3] = jacobians[r * 9 + i];
    for (size_t i = 0; i < 3; ++i) rays[r].direction[i] = static_cast<float>(direction[i]);
    const bool none = r % 10 == 3 || r == 20, root = r % 7 != 0;
    singular += none && root;
    const auto gradient = none ? reference::JointImplicitGradient{}
                               : reference::implicit_joint_gradient(reference::joint_jacobian({normals[3 * r], normals[3 * r + 1], normals[3 * r + 2]}, j, direction),
                                                                    {upstream[4 * r], upstream[4 * r + 1], upstream[4 * r + 2], upstream[4 * r + 3]}, 1);
    shortened += root && gradient.shortened;
    for (size_t i = 0; i < 3; ++i) expected.push_back(root ? gradient.skinned[i] : 0);
    expected_sdf.push_back(root ? gradient.sdf / cube.scale() : 0);
  }
  const uint64_t padded = padded_points(count);
  Buffer frame = filled("frame", std::vector<FrameConstants>{constants}), ray_list = filled("rays", rays), j = filled("jacobians", padded_rows(jacobians, 3, 4), padded * 48),
         gradients = filled("gradients", padded_rows(normals, 3, stride, 8)), above = filled("upstream", padded_rows(upstream, 4, 4)), canonical = filled("canonical", roots),
         cotangents = empty("cotangents", padded * 16), sdf = filled("sdf", std::vector<float>(padded * stride, 7)), total = filled("counts", std::vector<shared::ImplicitCounts>{{5, 3}});
  record_implicit_joint_cotangent(commands, {count, frame.slice(), ray_list.slice(), {gradients.slice(), stride, 8}, j.slice(), above.slice(), canonical.slice(), cotangents.slice(),
                                             {sdf.slice(), stride, 8}, total.slice()});
  commands.submit_and_wait();
  expect_all_near("joint cotangents on LBS(x)", rows_of(device.download<float>(cotangents.slice()), count, 3, 4), expected, 2e-4);
  const std::vector<float> on_sdf = device.download<float>(sdf.slice());
  expect_all_near("joint cotangents on f", rows_of(on_sdf, count, 1, stride, 8), expected_sdf, 2e-4);
  EXPECT_EQ(on_sdf[0], 7);  // beside its columns nothing is written
  for (uint64_t row = count; row < padded; ++row) EXPECT_EQ(on_sdf[row * stride + 8], 0) << row;
  EXPECT_GT(shortened, 0u);
  const auto counted = device.download<shared::ImplicitCounts>(total.slice())[0];
  EXPECT_EQ(counted.singular, 5 + singular);
  EXPECT_EQ(counted.shortened, 3 + shortened);

  // Rays of a longer list, in another order: the same to the last bit.
  std::vector<Ray> list(3 * count);
  std::vector<uint32_t> of_row(padded, 0);
  for (uint32_t r = 0; r < count; ++r) {
    of_row[r] = 3 * (count - 1 - r) + 1;
    list[of_row[r]] = rays[r];
  }
  Buffer longer = filled("more rays", list), numbers = filled("rays of rows", of_row), again = empty("cotangents", padded * 16), sdf_again = filled("sdf", std::vector<float>(padded * stride, 7));
  record_implicit_joint_cotangent(commands, {count, frame.slice(), longer.slice(), {gradients.slice(), stride, 8}, j.slice(), above.slice(), canonical.slice(), again.slice(),
                                             {sdf_again.slice(), stride, 8}, total.slice(), numbers.slice(), static_cast<uint32_t>(list.size())});
  commands.submit_and_wait();
  EXPECT_EQ(device.download<float>(again.slice()), device.download<float>(cotangents.slice()));
  EXPECT_EQ(device.download<float>(sdf_again.slice()), on_sdf);
}

}  // namespace
}  // namespace arah

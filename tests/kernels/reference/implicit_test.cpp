#include "kernels/reference/implicit.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "kernels/reference/broyden.h"
#include "tests/golden.h"
#include "tests/kernels/reference/finite_differences.h"
#include "tests/kernels/reference/golden_networks.h"
#include "tests/kernels/reference/matrix_rows.h"

namespace arah::reference {
namespace {

TEST(ImplicitPoint, Golden11) {
  ARAH_SKIP_WITHOUT_GOLDEN();
  const golden::Case truth("11_implicit_points"), lbs("03_lbs_net");
  const SkinningNetwork network = golden_skinning(lbs, lbs);
  const auto bones = truth.values("in.B"), roots = truth.values("in.nstar"), upstream = truth.values("in.G");
  const std::size_t points = truth.extent("in.nstar", 0);
  std::vector<double> x, jacobians, posed;
  SkinningAdjoint adjoint;
  for (std::size_t i = 0; i < points; ++i) append<3>(x, network.cube.from_cube(row<3>(roots, i)));
  const auto metric = skinning_jacobian(network, bones, points, x);
  for (std::size_t i = 0; i < points; ++i) {
    const Matrix<3> jacobian = jacobian_in_cube(matrix<3>(metric, i), 1.1 * network.cube.extent());
    const PointImplicitGradient gradient = implicit_point_gradient(jacobian, row<3>(upstream, i));
    EXPECT_FALSE(gradient.singular);
    append<3>(jacobians, jacobian);
    append<3>(posed, gradient.posed);
    append<3>(adjoint.x_bar, gradient.skinned);
  }
  DenseNetwork gradients = network.layers.zeros();
  std::vector<double> bone_gradients(bones.size());
  skinning_backward(network, bones, points, x, adjoint, &gradients, bone_gradients);
  golden::expect_golden(truth, "out.Jn", jacobians);
  golden::expect_golden(truth, "grad.x_bar", posed);
  expect_golden_dense(truth, "lbs", gradients);
  golden::expect_golden(truth, "grad.B", bone_gradients);
}

TEST(ImplicitJoint, Golden11) {
  ARAH_SKIP_WITHOUT_GOLDEN();
  const golden::Case truth("11_implicit_joint"), lbs("03_lbs_net");
  const SkinningNetwork network = golden_skinning(lbs, lbs);
  const Siren siren = golden_siren(truth);
  const auto bones = truth.values("in.B"), x = truth.values("in.xstar"), depths = truth.values("in.dstar"),
             directions = truth.values("in.dir"), cam = truth.values("in.cam"), trans = truth.values("in.trans"),
             upstream_x = truth.values("in.Gx"), upstream_d = truth.values("in.Gd");
  const std::size_t points = depths.size();
  std::vector<double> n;
  for (std::size_t i = 0; i < points; ++i) append<3>(n, network.cube.to_cube(row<3>(x, i)));
  const SirenOutput field = siren_forward(siren, points, n);
  const SkinningOutput skinned = skinning_forward(network, bones, points, x);
  const auto skinning_jacobians = skinning_jacobian(network, bones, points, x);

  std::vector<double> jacobians, residuals, corrected_x, corrected_d, by_direction, by_camera(3);
  SkinningAdjoint skinning_adjoint;
  SirenAdjoint sdf_adjoint;
  for (std::size_t i = 0; i < points; ++i) {
    const Vector<3> direction = row<3>(directions, i);
    const Matrix<4> jacobian = joint_jacobian(row<3>(field.gradient, i), matrix<3>(skinning_jacobians, i), direction);
    Vector<4> residual{field.sdf[i] / network.cube.scale(), 0, 0, 0};
    for (int c = 0; c < 3; ++c)
      residual[c + 1] = skinned.x_bar[3 * i + c] - (cam[c] + depths[i] * direction[c] - trans[c]);
    const Vector<4> root{x[3 * i], x[3 * i + 1], x[3 * i + 2], depths[i]};
    const Vector<4> corrected = newton_corrected(root, jacobian, residual);
    const Vector<4> upstream{upstream_x[3 * i], upstream_x[3 * i + 1], upstream_x[3 * i + 2], upstream_d[i]};
    const JointImplicitGradient gradient = implicit_joint_gradient(jacobian, upstream, depths[i]);
    append<4>(jacobians, jacobian);
    append<4>(residuals, residual);
    append<3>(corrected_x, Vector<3>{corrected[0], corrected[1], corrected[2]});
    corrected_d.push_back(corrected[3]);
    append<3>(by_direction, gradient.direction);
    append<3>(skinning_adjoint.x_bar, gradient.skinned);
    sdf_adjoint.sdf.push_back(gradient.sdf / network.cube.scale());
    for (int c = 0; c < 3; ++c) by_camera[c] += gradient.camera[c];
  }
  golden::expect_golden(truth, "out.J", jacobians);
  // The residuals are what is left of numbers of some 3 m after subtraction: a few roundings of those, 4e-16 each, are
  // all that may differ.
  golden::expect_close("11_implicit_joint out.g", residuals, truth.values("out.g"), 2e-15);
  golden::expect_golden(truth, "out.x", corrected_x);
  golden::expect_golden(truth, "out.d", corrected_d);
  golden::expect_golden(truth, "grad.cam", by_camera);
  golden::expect_golden(truth, "grad.dir", by_direction);

  DenseNetwork gradients = network.layers.zeros();
  std::vector<double> bone_gradients(bones.size());
  skinning_backward(network, bones, points, x, skinning_adjoint, &gradients, bone_gradients);
  expect_golden_dense(truth, "lbs", gradients);
  golden::expect_golden(truth, "grad.B", bone_gradients);
  Siren sdf_gradients = siren.zeros();
  siren_backward(siren, points, n, sdf_adjoint, sdf_gradients);
  for (std::size_t i = 0; i < sdf_gradients.layers.size(); ++i) {
    const SirenLayer& layer = sdf_gradients.layers[i];
    const std::string name = "grad.sdf." + std::to_string(i) + ".";
    golden::expect_golden(truth, name + "W", transposed(layer.w, layer.inputs, layer.outputs));
    golden::expect_golden(truth, name + "b", layer.b);
    if (layer.gamma.empty()) continue;
    golden::expect_golden(truth, name + "gamma", layer.gamma);
    golden::expect_golden(truth, name + "eta", layer.eta);
  }
}

// A small articulated sphere whose roots can be searched again after every parameter was changed: "skinning"
// x̄ = x + p₀ sin(2 x_{y,z,x}) + (p₁, p₂, p₃), sdf |x| − p₄, camera p₅₋₇, direction p₈₋₁₀, translation p₁₁₋₁₃.
struct Scene {
  std::vector<double> p{0.1, 0.02, -0.03, 0.05, 0.4, 0.05, -0.1, -2, 0.03, 0.04, 0.998, 0.01, 0.02, -0.01};

  Vector<3> skin(const Vector<3>& x) const {
    return {x[0] + p[0] * std::sin(2 * x[1]) + p[1], x[1] + p[0] * std::sin(2 * x[2]) + p[2],
            x[2] + p[0] * std::sin(2 * x[0]) + p[3]};
  }
  Matrix<3> skin_jacobian(const Vector<3>& x) const {
    return {Vector<3>{1, 2 * p[0] * std::cos(2 * x[1]), 0}, Vector<3>{0, 1, 2 * p[0] * std::cos(2 * x[2])},
            Vector<3>{2 * p[0] * std::cos(2 * x[0]), 0, 1}};
  }
  Vector<3> posed(double d) const {
    Vector<3> result;
    for (int c = 0; c < 3; ++c) result[c] = p[5 + c] + d * p[8 + c] - p[11 + c];
    return result;
  }
  Matrix<4> jacobian(const Vector<4>& u) const {
    const Vector<3> x{u[0], u[1], u[2]};
    const double length = norm<3>(x);
    return joint_jacobian({x[0] / length, x[1] / length, x[2] / length}, skin_jacobian(x), {p[8], p[9], p[10]});
  }
  // To rounding, so that differences of two searches are differences of roots.
  static BroydenSettings exact() { return {50, 1e-14, 1, 1e-30}; }
  Vector<4> joint_root() const {
    const Vector<4> start{0.02, -0.03, -0.4, 1.6};
    return find_root<4>(
               start, identity<4>(), *inverse<4>(jacobian(start)),
               [this](const Vector<4>& u, Matrix<4>&) {
                 const Vector<3> x{u[0], u[1], u[2]}, skinned = skin(x), target = posed(u[3]);
                 return Vector<4>{norm<3>(x) - p[4], skinned[0] - target[0], skinned[1] - target[1],
                                  skinned[2] - target[2]};
               },
               exact())
        .root;
  }
  Vector<3> point_root(double d) const {
    const Vector<3> target = posed(d);
    return find_root<3>(
               target, identity<4>(), *inverse<3>(skin_jacobian(target)),
               [&](const Vector<3>& x, Matrix<4>&) {
                 const Vector<3> skinned = skin(x);
                 return Vector<3>{skinned[0] - target[0], skinned[1] - target[1], skinned[2] - target[2]};
               },
               exact())
        .root;
  }
  // dL/dp₀₋₃ from dL/dskinned.
  std::vector<double> skin_backward(const Vector<3>& x, const Vector<3>& upstream) const {
    const double sines =
        upstream[0] * std::sin(2 * x[1]) + upstream[1] * std::sin(2 * x[2]) + upstream[2] * std::sin(2 * x[0]);
    return {sines, upstream[0], upstream[1], upstream[2]};
  }
};

TEST(ImplicitPoint, AgreesWithSearchingAgain) {
  Scene scene;
  const Vector<3> upstream{0.3, -1.2, 0.7};
  const double depth = 1.83;
  const auto loss = [&] { return dot<3>(upstream, scene.point_root(depth)); };
  const Vector<3> x = scene.point_root(depth);
  const PointImplicitGradient gradient = implicit_point_gradient(scene.skin_jacobian(x), upstream);
  std::vector<double> analytic = scene.skin_backward(x, gradient.skinned);
  analytic.push_back(0);  // the sphere's radius
  append<3>(analytic, gradient.posed);
  for (int c = 0; c < 3; ++c) analytic.push_back(depth * gradient.posed[c]);
  for (int c = 0; c < 3; ++c) analytic.push_back(-gradient.posed[c]);
  expect_gradient("point root", loss, scene.p, analytic);
}

TEST(ImplicitJoint, AgreesWithSearchingAgain) {
  Scene scene;
  const Vector<4> upstream{0.3, -1.2, 0.7, 0.9};
  const auto loss = [&] { return dot<4>(upstream, scene.joint_root()); };
  const Vector<4> root = scene.joint_root();
  const JointImplicitGradient gradient = implicit_joint_gradient(scene.jacobian(root), upstream, root[3]);
  std::vector<double> analytic = scene.skin_backward({root[0], root[1], root[2]}, gradient.skinned);
  analytic.push_back(-gradient.sdf);
  append<3>(analytic, gradient.camera);
  append<3>(analytic, gradient.direction);
  append<3>(analytic, gradient.translation);
  expect_gradient("joint root", loss, scene.p, analytic);
}

// The gradients of bone transforms and root translation against differences of a loss on roots that are searched again, with a
// small skinning network and with weights that do not change over space, as a template's vertex gives them.
TEST(ImplicitPose, AgreesWithSearchingAgain) {
  for (const bool with_network : {true, false}) {
    // Sine instead of softplus, whose curvature would blunt the differences.
    SkinningNetwork network{JointTree({-1, 0, 1, 1}), {{0.1, -0.2, 0.3}, -0.8, 1.1}, {}};
    const std::size_t points = 5, joints = 4, sizes[] = {3, 6, network.tree.logits()};
    for (std::size_t l = 0; l < 2; ++l) {
      DenseLayer layer;
      layer.inputs = sizes[l], layer.outputs = sizes[l + 1];
      layer.activation = l < 1 ? Activation::sine : Activation::none;
      layer.v = random_values(sizes[l] * sizes[l + 1], 1, unsigned(7 + l));
      layer.g = std::vector<double>(sizes[l + 1], l < 1 ? 1 : with_network ? 0.03 : 0);
      layer.b = random_values(sizes[l + 1], 0.05, unsigned(9 + l));
      network.layers.layers.push_back(std::move(layer));
    }
    // The numbers that move: the upper three rows of the bones, near the identity, then t.
    std::vector<double> pose = random_values(joints * 12 + 3, 0.08, 1);
    for (std::size_t b = 0; b < joints; ++b)
      for (std::size_t i = 0; i < 3; ++i) pose[12 * b + 5 * i] += 1;
    const std::vector<double> x_bar = random_values(points * 3, 0.5, 2), upstream = random_values(points * 3, 1, 3);
    const auto bones = [&] {
      std::vector<double> matrices(joints * 16, 0.0);
      for (std::size_t b = 0; b < joints; ++b) {
        std::copy_n(&pose[12 * b], 12, &matrices[16 * b]);
        matrices[16 * b + 15] = 1;
      }
      return matrices;
    };
    const auto roots = [&] {
      const std::vector<double> transforms = bones();
      std::vector<double> found;
      for (std::size_t p = 0; p < points; ++p) {
        Vector<3> target = row<3>(x_bar, p);
        for (std::size_t i = 0; i < 3; ++i) target[i] -= pose[12 * joints + i];
        const std::vector<double> at(target.begin(), target.end());
        const auto result = find_root<3>(
            target, identity<4>(), *inverse<3>(matrix<3>(skinning_jacobian(network, transforms, 1, at), 0)),
            [&](const Vector<3>& x, Matrix<4>&) {
              const std::vector<double> posed = skinning_forward(network, transforms, 1, std::vector<double>(x.begin(), x.end())).x_bar;
              return Vector<3>{posed[0] - target[0], posed[1] - target[1], posed[2] - target[2]};
            },
            {50, 1e-14, 1, 1e-30});
        EXPECT_LT(result.residual, 1e-13);
        append<3>(found, result.root);
      }
      return found;
    };
    const std::vector<double> x = roots(), jacobians = skinning_jacobian(network, bones(), points, x);
    std::vector<double> skinned;
    for (std::size_t p = 0; p < points; ++p) append<3>(skinned, implicit_point_gradient(matrix<3>(jacobians, p), row<3>(upstream, p)).skinned);
    const PoseImplicitGradient gradient = implicit_pose_gradient(joints, skinning_forward(network, bones(), points, x).weights, x, skinned);
    std::vector<double> analytic = gradient.bone_transforms;
    append<3>(analytic, gradient.root_translation);
    expect_gradient(with_network ? "pose, network" : "pose, constant weights", [&] { return dot(upstream, roots()); }, pose, analytic);
    // Weights sum to 1, so the translation's gradient is that of all bones moved alike.
    for (std::size_t i = 0; i < 3; ++i) {
      double sum = 0;
      for (std::size_t b = 0; b < joints; ++b) sum += gradient.bone_transforms[12 * b + 4 * i + 3];
      EXPECT_NEAR(sum, gradient.root_translation[i], 1e-14);
    }
  }
}

// Towards a singular Jacobian the gradient grows to a hundred times its cause and no further, and keeps its direction.
TEST(Implicit, NearlySingularJacobiansAreBounded) {
  const Vector<3> upstream{0.3, -0.7, 0.4};
  double before = 0;
  for (double thin = 1; thin > 1e-12; thin /= 2) {
    Matrix<3> j = identity<3>();
    j[0][1] = 0.5, j[1][2] = -0.25, j[2][2] = thin;
    const Vector<3> newton = multiply_transposed<3>(*inverse<3>(j), upstream), found = implicit_point_gradient(j, upstream).skinned;
    const double growth = norm<3>(newton) / norm<3>(upstream);
    EXPECT_GE(norm<3>(found), before * (1 - 1e-12)) << thin;
    before = norm<3>(found);
    EXPECT_EQ(implicit_point_gradient(j, upstream).shortened, growth > most_amplification) << thin;
    if (growth <= most_amplification) {
      EXPECT_EQ(found, (Vector<3>{-newton[0], -newton[1], -newton[2]})) << thin;
    } else {
      EXPECT_NEAR(norm<3>(found), most_amplification * norm<3>(upstream), 1e-10) << thin;
    }
    EXPECT_NEAR(dot<3>(found, newton), -norm<3>(found) * norm<3>(newton), 1e-12 * norm<3>(found) * norm<3>(newton)) << thin;

    // A ray at that angle to the surface.
    const Matrix<4> grazing = joint_jacobian({0, 1, 0}, identity<3>(), {std::cos(thin), std::sin(thin), 0});
    const JointImplicitGradient joint = implicit_joint_gradient(grazing, {0.3, -0.7, 0.4, 0.2}, 2);
    EXPECT_LE(std::hypot(joint.sdf, norm<3>(joint.skinned)), most_amplification * norm<4>({0.3, -0.7, 0.4, 0.2}) * (1 + 1e-12)) << thin;
    EXPECT_EQ(joint.direction[0], 2 * joint.camera[0]);
  }
}

TEST(Implicit, SingularJacobiansTeachNothing) {
  Matrix<3> flat = identity<3>();
  flat[1] = flat[0];
  const PointImplicitGradient point = implicit_point_gradient(flat, {1, 2, 3});
  EXPECT_TRUE(point.singular);
  EXPECT_EQ(point.skinned, (Vector<3>{0, 0, 0}));
  EXPECT_EQ(point.posed, (Vector<3>{0, 0, 0}));
  const Matrix<4> grazing = joint_jacobian({1, 0, 0}, identity<3>(), {0, 0, 1});
  const JointImplicitGradient joint = implicit_joint_gradient(grazing, {1, 1, 1, 1}, 2);
  EXPECT_TRUE(joint.singular);
  EXPECT_EQ(joint.sdf, 0);
  EXPECT_EQ(newton_corrected({1, 2, 3, 4}, grazing, {1, 1, 1, 1}), (Vector<4>{1, 2, 3, 4}));
}

}  // namespace
}  // namespace arah::reference

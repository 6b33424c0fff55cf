// Skinning weights at points of the host's choice, and signed distances on a plane.
#include <gtest/gtest.h>

#include <algorithm>
#include <numeric>

#include "host/body/canonical.h"
#include "host/input_error.h"
#include "host/rendering/renderer.h"
#include "kernels/reference/skinning.h"
#include "tests/host/rendering/capsule_scene.h"

namespace arah {
namespace {

// The avatar's skinning network in double precision.
reference::DenseNetwork skinning_network(const Avatar& avatar) {
  reference::DenseNetwork network;
  const reference::JointTree tree(avatar.body.skeleton.parents);
  const std::vector<uint32_t> widths = skinning_widths(avatar.spec, static_cast<uint32_t>(tree.logits()), static_cast<uint32_t>(tree.joints()));
  for (size_t l = 0; l + 1 < widths.size(); ++l) {
    reference::DenseLayer layer;
    layer.inputs = widths[l];
    layer.outputs = widths[l + 1];
    layer.activation = l + 2 < widths.size() ? reference::Activation::softplus : reference::Activation::none;
    const std::string name = "skinning." + std::to_string(l);
    const std::span<const float> v = avatar.tensor(name + ".v"), g = avatar.tensor(name + ".g"), b = avatar.tensor(name + ".b");
    for (size_t i = 0; i < layer.inputs; ++i)
      for (size_t o = 0; o < layer.outputs; ++o) layer.v.push_back(double{v[o * layer.inputs + i]});
    layer.g.assign(g.begin(), g.end());
    layer.b.assign(b.begin(), b.end());
    network.layers.push_back(layer);
  }
  return network;
}

// [points][joints] of inputs [points][input size].
std::vector<double> reference_weights(const Avatar& avatar, size_t points, const std::vector<double>& inputs) {
  std::vector<double> logits = reference::dense_forward(skinning_network(avatar), points, inputs).output;
  for (double& logit : logits) logit *= 20;
  return reference::hierarchical_softmax_forward(reference::JointTree(avatar.body.skeleton.parents), points, logits);
}

class PointWeights : public DeviceTest {
 protected:
  // Around the capsule's canonical surface; more than are asked for at a time.
  std::vector<glm::vec3> points_near_the_body(const Avatar& avatar) {
    const std::vector<glm::dvec3> vertices = canonical_vertices(avatar.body, avatar.canonical);
    std::vector<glm::vec3> points;
    for (uint32_t i = 0; i < SkinningWeights::points_at_a_time + 500; ++i) {
      const std::vector<float> shift = uniform(3, -0.05f, 0.05f);
      points.emplace_back(glm::vec3(vertices[generator() % vertices.size()]) + glm::vec3(shift[0], shift[1], shift[2]));
    }
    return points;
  }
  // Of the pose bent_pose, after a picture in it.
  std::vector<float> weights_at(const Avatar& avatar, const std::vector<glm::vec3>& points) {
    Renderer renderer(device, avatar, render_preset(avatar, "paper"));
    EXPECT_THROW(renderer.skinning_weights(points), std::logic_error);
    renderer.render(capsule_camera(9, 9), bent_pose(avatar.body.skeleton), 0);
    return renderer.skinning_weights(points);
  }
  static void expect_partition(const std::vector<float>& weights, size_t joints) {
    double worst = 0;
    for (size_t row = 0; row < weights.size(); row += joints) {
      double sum = 0;
      for (size_t j = 0; j < joints; ++j) {
        EXPECT_GE(weights[row + j], 0);
        sum += double{weights[row + j]};
      }
      worst = std::max(worst, std::abs(sum - 1));
    }
    EXPECT_LT(worst, 1e-6);
  }
};

TEST_F(PointWeights, AreTheNetworksInDoublePrecision) {
  const Avatar avatar = capsule_avatar(device, small_paper_spec());
  const std::vector<glm::vec3> points = points_near_the_body(avatar);
  const std::vector<float> weights = weights_at(avatar, points);
  ASSERT_EQ(weights.size(), 3 * points.size());
  expect_partition(weights, 3);
  std::vector<double> inputs;
  for (const glm::vec3& point : points) {
    const glm::dvec3 n = avatar.cube.to_cube(glm::dvec3(point));
    inputs.insert(inputs.end(), {n.x, n.y, n.z});
  }
  const std::vector<double> truth = reference_weights(avatar, points.size(), inputs);
  double error = 0, mixed = 0;
  for (size_t i = 0; i < truth.size(); ++i) error = std::max(error, std::abs(double{weights[i]} - truth[i])), mixed += truth[i] > 0.1 && truth[i] < 0.9;
  std::printf("  %zu points, weights up to %.1e off; %.0f of them between 0.1 and 0.9\n", points.size(), error, mixed);
  EXPECT_GT(mixed, 1000);
  EXPECT_LT(error, 2e-5);  // float32 logits of some tens
}

TEST_F(PointWeights, OfABackwardNetworkAreThoseOfPosedPoints) {
  AvatarSpec spec = small_paper_spec();
  spec.skinning.kind = Skinning::backward;
  const Avatar avatar = capsule_avatar(device, spec);
  const Pose pose = bent_pose(avatar.body.skeleton);
  const glm::dvec3 root = root_translation(avatar.body.skeleton, pose);
  std::vector<glm::vec3> points;
  for (const glm::vec3& vertex : posed_vertices(avatar.body, pose)) points.emplace_back(glm::dvec3(vertex) - root);
  const std::vector<float> weights = weights_at(avatar, points);
  expect_partition(weights, 3);
  const glm::dmat4 from_root = glm::inverse(bone_transforms(avatar.body.skeleton, avatar.canonical, pose)[0]);
  const std::vector<float> rotations = joint_rotations(pose);
  std::vector<double> inputs;
  for (const glm::vec3& point : points) {
    const glm::dvec3 n = avatar.cube.to_cube(glm::dvec3(from_root * glm::dvec4(glm::dvec3(point), 1)));
    inputs.insert(inputs.end(), {n.x, n.y, n.z});
    inputs.insert(inputs.end(), rotations.begin(), rotations.end());
  }
  const std::vector<double> truth = reference_weights(avatar, points.size(), inputs);
  double error = 0;
  for (size_t i = 0; i < truth.size(); ++i) error = std::max(error, std::abs(double{weights[i]} - truth[i]));
  std::printf("  %zu points, weights up to %.1e off\n", points.size(), error);
  EXPECT_LT(error, 2e-5);
}

TEST_F(PointWeights, OfTheTemplateAreANearVertexs) {
  AvatarSpec spec = small_paper_spec();
  spec.skinning = {Skinning::template_weights, 0, 0};
  const Avatar avatar = capsule_avatar(device, spec);
  const std::vector<glm::dvec3> vertices = canonical_vertices(avatar.body, avatar.canonical);
  std::vector<glm::vec3> points = points_near_the_body(avatar);
  points.resize(300);
  const std::vector<float> weights = weights_at(avatar, points);
  expect_partition(weights, 3);
  size_t other = 0;
  for (size_t i = 0; i < points.size(); ++i) {
    const auto nearest = static_cast<size_t>(std::min_element(vertices.begin(), vertices.end(), [&](const glm::dvec3& a, const glm::dvec3& b) { return glm::distance(a, glm::dvec3(points[i])) < glm::distance(b, glm::dvec3(points[i])); }) - vertices.begin());
    double difference = 0;
    for (size_t k = 0; k < 3; ++k) difference = std::max(difference, std::abs(double{weights[3 * i + k]} - double{avatar.body.weights[nearest][static_cast<int>(k)]}));
    other += difference > 1e-6;
  }
  std::printf("  %zu of %zu points follow another vertex than the nearest of all\n", other, points.size());
  EXPECT_LT(other, points.size() / 50);  // where the nearest triangle has a corner that is farther than another triangle's
}

TEST_F(PointWeights, WithoutSkinningAreTheRoots) {
  AvatarSpec spec = small_paper_spec();
  spec.skinning = {Skinning::none, 0, 0};
  const Avatar avatar = capsule_avatar(device, spec);
  EXPECT_EQ(weights_at(avatar, {{0, 1, 0}, {0.1f, 0.5f, 0}}), (std::vector<float>{1, 0, 0, 1, 0, 0}));
}

class Slices : public DeviceTest {};

TEST_F(Slices, LieInThePictureThatTheirPlaneFaces) {
  const Camera camera = capsule_camera(40, 30);
  const glm::dvec3 point(0.2, 0.5, 0.3);
  const SlicePlane plane = plane_facing(camera, point);
  for (const auto& [column, row] : {std::pair{0, 0}, std::pair{39, 0}, std::pair{17, 29}}) {
    const glm::dvec3 at = plane.at(column, row, camera.width, camera.height);
    EXPECT_NEAR(camera.project(at).x, column, 1e-9);
    EXPECT_NEAR(camera.project(at).y, row, 1e-9);
    EXPECT_NEAR(camera.to_camera(at).z, camera.to_camera(point).z, 1e-12);
  }
  EXPECT_THROW(plane_facing(camera, camera.center() + glm::dvec3(0, 0, 1)), std::invalid_argument);
}

// At rest the posed points are canonical ones, and the capsule's distance is that from its axis.
TEST_F(Slices, OfACapsuleAreItsDistances) {
  for (const Skinning kind : {Skinning::network, Skinning::template_weights, Skinning::none}) {
    AvatarSpec spec = small_paper_spec();
    if (kind != Skinning::network) spec.skinning = {kind, 0, 0};
    const Avatar avatar = capsule_avatar(device, spec);
    Pose pose = kind == Skinning::none ? bent_pose(avatar.body.skeleton) : rest_pose(avatar.body.skeleton);
    if (kind != Skinning::none) pose.root_position += glm::dvec3(0.5, 0.25, -0.125);
    const glm::dvec3 root = root_translation(avatar.body.skeleton, pose);
    // Through the axis, and in another direction than any axis of the world.
    SlicePlane plane;
    plane.across = {0.36, 0, 0.48};
    plane.down = {0, -1.2, 0};
    plane.origin = root + glm::dvec3(0, 0.8, 0) - 0.5 * plane.across - 0.5 * plane.down;
    Renderer renderer(device, avatar, render_preset(avatar, "paper"));
    constexpr int width = 30, height = 60;
    const DistanceSlice slice = renderer.slice(plane, width, height, pose, 0);
    EXPECT_EQ(renderer.root_finder().counts().points, 0u) << "those of pictures";
    ASSERT_EQ(slice.distances.size(), size_t{width} * height);
    const MeshDistance body(canonical_vertices(avatar.body, avatar.canonical), avatar.body.triangles);
    double error = 0;
    size_t near = 0, inside = 0;
    for (int row = 0; row < height; ++row)
      for (int column = 0; column < width; ++column) {
        const auto i = static_cast<size_t>(row * width + column);
        EXPECT_EQ(slice.found[i], 1);
        const double truth = body.closest(plane.at(column, row, width, height) - root).signed_distance - 0.01;  // it wears 1 cm
        if (std::abs(truth) > 0.04) continue;
        near += 1;
        inside += slice.distances[i] < 0;
        error += std::abs(double{slice.distances[i]} - truth);
      }
    error /= double(near);
    std::printf("  skinning %-16s %zu pixels within 4 cm, %zu inside, %.2f mm off in the mean\n", to_string(kind), near, inside, 1000 * error);
    EXPECT_GT(near, 300u);
    EXPECT_GT(inside, near / 4);
    EXPECT_LT(error, 0.003);
  }
}

// In a pose its zero is where the picture has its surface.
TEST_F(Slices, AreZeroWhereThePictureHasItsSurface) {
  const Avatar avatar = capsule_avatar(device, small_paper_spec());
  const Pose pose = bent_pose(avatar.body.skeleton);
  const Camera camera = capsule_camera(37, 41);
  RenderSettings settings = render_preset(avatar, "preview");
  set_render_knob(settings, "surface", "search");
  set_render_knob(settings, "root_tolerance", "1e-5");
  Renderer renderer(device, avatar, settings);
  const Picture picture = renderer.render(camera, pose, 0);
  size_t seen = 0;
  double worst = 0;
  for (int v = 0; v < camera.height; v += 4)
    for (int u = 0; u < camera.width; u += 4) {
      const float depth = picture.depth[static_cast<size_t>(v * camera.width + u)];
      if (depth <= 0) continue;
      const PixelRay ray = camera.ray(u, v);
      SlicePlane plane;
      plane.across = 0.1 * ray.direction;  // its middle pixel is the surface point
      plane.down = glm::dvec3(1e-3, 0, 0);
      plane.origin = ray.origin + double{depth} * ray.direction - 0.5 * plane.across - 0.5 * plane.down;
      const DistanceSlice slice = renderer.slice(plane, 5, 1, pose, 0);
      seen += 1;
      worst = std::max(worst, std::abs(double{slice.distances[2]}));
      EXPECT_GT(slice.distances[1], slice.distances[3]) << "in front and behind";
    }
  std::printf("  %zu pixels, up to %.1e m off\n", seen, worst);
  EXPECT_GT(seen, 10u);
  EXPECT_LT(worst, 2e-5);  // two searches with a tolerance of 1e-5 m
  EXPECT_THROW(renderer.slice({}, 5, 1, pose, 0, [](double) { return false; }), std::runtime_error);
  EXPECT_EQ(renderer.render(camera, pose, 0).color, picture.color) << "slices leave nothing behind";
}

}  // namespace
}  // namespace arah

// What a pose does to the skinning: straight, everything is as it was; bent so far that the surface folds, the figures say so, as
// finite differences in double precision do.
#include "host/evaluation/conditioning_page.h"

#include <glm/geometric.hpp>
#include <glm/matrix.hpp>
#include <nlohmann/json.hpp>
#include <numeric>
#include <opencv2/imgcodecs.hpp>

#include "host/input_error.h"
#include "host/rendering/orbit_camera.h"
#include "kernels/reference/skinning.h"
#include "tests/host/rendering/capsule_scene.h"

namespace arah {
namespace {

using testing::HasSubstr;
using testing::Not;

class ConditioningOfPoses : public DeviceTest {
 protected:
  static Pose bent(const Skeleton& skeleton, double degrees) {
    Pose pose = rest_pose(skeleton);
    pose.theta[1] = {0, 0, degrees * std::numbers::pi / 180};
    pose.root_position += glm::dvec3(0.3, -0.2, 0.4);
    return pose;
  }
  static ConditioningSettings coarse() {
    ConditioningSettings settings;
    settings.cell = 0.015;
    settings.samples = 3000;
    return settings;
  }
};

// The avatar's skinning network as the reference has it: [inputs][outputs], float32 values in double precision.
reference::SkinningNetwork reference_network(const Avatar& avatar) {
  reference::SkinningNetwork network{reference::JointTree(avatar.body.skeleton.parents), {{avatar.cube.center.x, avatar.cube.center.y, avatar.cube.center.z}, avatar.cube.cmin, avatar.cube.cmax}, {}};
  for (int l = 0; avatar.layout.has("skinning." + std::to_string(l) + ".v"); ++l) {
    const std::string name = "skinning." + std::to_string(l) + ".";
    const TensorSlot& slot = avatar.layout.slot(name + "v");
    const auto outputs = static_cast<std::size_t>(slot.shape[0]), inputs = static_cast<std::size_t>(slot.shape[1]);
    reference::DenseLayer layer;
    layer.inputs = inputs;
    layer.outputs = outputs;
    layer.activation = avatar.layout.has("skinning." + std::to_string(l + 1) + ".v") ? reference::Activation::softplus : reference::Activation::none;
    const std::span<const float> v = avatar.tensor(name + "v"), g = avatar.tensor(name + "g"), b = avatar.tensor(name + "b");
    layer.v.resize(inputs * outputs);
    for (std::size_t o = 0; o < outputs; ++o)
      for (std::size_t i = 0; i < inputs; ++i) layer.v[i * outputs + o] = double{v[o * inputs + i]};
    layer.g.assign(g.begin(), g.end());
    layer.b.assign(b.begin(), b.end());
    network.layers.layers.push_back(std::move(layer));
  }
  return network;
}

// ∂x̄/∂x by central differences, row by row.
glm::dmat3 differences(const reference::SkinningNetwork& network, const std::vector<double>& bones, const glm::dvec3& x) {
  constexpr double h = 1e-6;
  glm::dmat3 jacobian;
  for (int axis = 0; axis < 3; ++axis) {
    std::vector<double> at;
    for (const double sign : {1.0, -1.0})
      for (int k = 0; k < 3; ++k) at.push_back(x[k] + (k == axis ? sign * h : 0));
    const std::vector<double> posed = reference::skinning_forward(network, bones, 2, at).x_bar;
    for (std::size_t k = 0; k < 3; ++k) jacobian[axis][static_cast<int>(k)] = (posed[k] - posed[3 + k]) / (2 * h);
  }
  return jacobian;
}

// From the invariants of JᵀJ: least of the three roots of its characteristic polynomial.
double least_singular_value(const glm::dmat3& jacobian) {
  const glm::dmat3 a = glm::transpose(jacobian) * jacobian;
  const double mean = (a[0][0] + a[1][1] + a[2][2]) / 3;
  const glm::dmat3 rest = a - glm::dmat3(mean);
  double squares = 0;
  for (int i = 0; i < 3; ++i) squares += glm::dot(rest[i], rest[i]);
  const double p = std::sqrt(squares / 6);
  if (p < 1e-12) return std::sqrt(mean);
  const double r = std::min(1.0, std::max(-1.0, glm::determinant(rest / p) / 2));
  return std::sqrt(std::max(0.0, mean + 2 * p * std::cos(std::acos(r) / 3 + 2 * std::numbers::pi / 3)));
}

TEST_F(ConditioningOfPoses, SayWhereABentCapsuleFolds) {
  const Avatar avatar = capsule_avatar(device, small_paper_spec());
  const Skeleton& skeleton = avatar.body.skeleton;
  Conditioning conditioning(device, avatar, coarse());
  const ExaminedPose straight = conditioning.examine(bent(skeleton, 0), 0, 7), folded = conditioning.examine(bent(skeleton, 150), 0, 8), again = conditioning.examine(bent(skeleton, 150), 0, 8);
  for (const ExaminedPose* pose : {&straight, &folded}) std::printf("  %s\n", describe(pose->figures).c_str());

  const ConditioningFigures &even = straight.figures, &bad = folded.figures;
  EXPECT_EQ(even.frame, 7);
  EXPECT_NEAR(even.least_singular, 1, 1e-4);
  EXPECT_NEAR(even.greatest_singular, 1, 1e-4);
  EXPECT_EQ(even.bad_share, 0);
  EXPECT_EQ(even.found, even.samples);
  EXPECT_EQ(even.several_share, 0);
  EXPECT_NEAR(even.greatest_amplification, 1, 1e-4);
  EXPECT_TRUE(straight.unsolved.empty());

  EXPECT_GT(bad.folded_share, 0);
  EXPECT_LT(bad.folded_share, 0.5);
  EXPECT_LT(bad.least_singular, nearly_singular);
  EXPECT_GE(bad.bad_share, std::max(bad.folded_share, bad.nearly_singular_share));
  EXPECT_GT(bad.several_share, 0);
  EXPECT_GE(bad.several_share, bad.several_near_share);
  EXPECT_GT(bad.greatest_amplification, 1 / nearly_singular);
  EXPECT_EQ(even.eikonal, bad.eikonal) << "the surface's shape does not follow the pose";
  for (const ConditioningFigures* f : {&even, &bad}) {
    EXPECT_EQ(f->samples, f->found + f->refused + f->diverged + f->exhausted);
    EXPECT_EQ(std::accumulate(f->steps.begin(), f->steps.end(), std::size_t{0}), f->found);
  }
  EXPECT_EQ(folded.unsolved.size(), bad.unsolved());
  EXPECT_EQ(conditioning_json(avatar, coarse(), {bad}), conditioning_json(avatar, coarse(), {again.figures}));
  EXPECT_EQ(folded.singular, again.singular);

  // Every eighth vertex against the reference.
  MeshExtraction extraction(device, avatar, MeshSettings{.cell = coarse().cell});
  const std::vector<glm::dvec3> canonical = extraction.mesh(bent(skeleton, 150), 0).canonical().vertices;
  ASSERT_EQ(canonical.size(), folded.singular.size());
  const reference::SkinningNetwork network = reference_network(avatar);
  std::vector<double> bones;
  for (const glm::dmat4& bone : extraction.frame().bones())
    for (int row = 0; row < 4; ++row)
      for (int column = 0; column < 4; ++column) bones.push_back(bone[column][row]);
  double worst = 0;
  std::size_t compared = 0, turned = 0;
  for (std::size_t v = 0; v < canonical.size(); v += 8, ++compared) {
    const glm::dvec3 at{glm::vec3(canonical[v])};
    const glm::dmat3 jacobian = differences(network, bones, at);
    const double expected = least_singular_value(jacobian), determinant = glm::determinant(jacobian);
    worst = std::max(worst, std::abs(expected - double{folded.singular[v]}));
    if (std::abs(determinant) > 1e-3) {
      EXPECT_EQ(determinant < 0, folded.determinants[v] < 0) << v;
    }
    turned += determinant < 0;
  }
  std::printf("  %zu vertices, %zu folded: least singular values differ from those of finite differences by %.1e at most\n", compared, turned, worst);
  EXPECT_GT(turned, 0u);
  EXPECT_LT(worst, 1e-3);

  // So do the slopes of the distances: central differences over 2 mm of an SDF in float32, at every eighth vertex.
  std::vector<glm::dvec3> around;
  for (std::size_t v = 0; v < canonical.size(); v += 8)
    for (int axis = 0; axis < 3; ++axis)
      for (const double sign : {1.0, -1.0}) {
        around.push_back(glm::dvec3(glm::vec3(canonical[v])));
        around.back()[axis] += sign * 1e-3;
      }
  const std::vector<double> f = extraction.distances(bent(skeleton, 150), 0, around);
  double residual = 0;
  for (std::size_t v = 0; v < compared; ++v) {
    glm::dvec3 slope;
    for (std::size_t axis = 0; axis < 3; ++axis) slope[static_cast<int>(axis)] = (f[6 * v + 2 * axis] - f[6 * v + 2 * axis + 1]) / 2e-3;
    residual += std::abs(glm::length(slope) - 1) / double(compared);
  }
  std::printf("  eikonal residual by differences %.4f, over all vertices %.4f\n", residual, bad.eikonal);
  EXPECT_NEAR(residual, bad.eikonal, 0.1 * bad.eikonal);

  // In the picture the fold is blue, through what hides it; the straight body has none.
  const auto blue = [&](const ExaminedPose& pose, double degrees) {
    const cv::Mat picture = cv::imdecode(conditioning_picture(pose, close_up(orbit_camera(pose.vertices, UpAxis::y, degrees, 160), pose.vertices), 0.02), cv::IMREAD_COLOR);
    EXPECT_EQ(picture.cols, 160);
    int count = 0;
    for (int y = 0; y < picture.rows; ++y)
      for (int x = 0; x < picture.cols; ++x) {
        const cv::Vec3b pixel = picture.at<cv::Vec3b>(y, x);  // BGR
        count += pixel[0] > pixel[2] + 60;
      }
    return count;
  };
  int seen = 0;
  for (const double degrees : {0.0, 90.0, 180.0, 270.0}) {
    EXPECT_EQ(blue(straight, degrees), 0);
    seen += blue(folded, degrees);
  }
  EXPECT_GT(seen, 20);

  const std::string page = conditioning_page("<avatar>", "folder: split <x>", avatar, coarse(), {{even, {}}, {bad, {{"front", conditioning_picture(folded, orbit_camera(folded.vertices, UpAxis::y, 0, 64), 0.02)}}}});
  EXPECT_THAT(page, testing::AllOf(HasSubstr("&lt;avatar&gt;"), HasSubstr("split &lt;x&gt;"), Not(HasSubstr("<script")), Not(HasSubstr("href=")), HasSubstr("data:image/png;base64,")));
  EXPECT_LT(page.find("<h3>Frame 8</h3>"), page.find("<h3>Frame 7</h3>")) << "the worst comes first";
}

TEST_F(ConditioningOfPoses, RefuseSkinningWithoutANetwork) {
  AvatarSpec spec = small_paper_spec();
  spec.skinning = {Skinning::template_weights};
  const BodyTemplate body = capsule_body();
  const Pose pose = rest_pose(body.skeleton);
  const Avatar avatar = make_avatar(spec, body, {0}, 5, &pose);
  try {
    Conditioning conditioning(device, avatar, {});
    FAIL() << "accepted";
  } catch (const InputError& error) {
    EXPECT_THAT(error.what(), HasSubstr("spec.skinning.kind"));
  }
}

TEST(SingularValues, AreThoseOfTurnedScalings) {
  const glm::dmat3 first(glm::dvec3(0.6, 0.8, 0), glm::dvec3(-0.8, 0.6, 0), glm::dvec3(0, 0, 1)), second(glm::dvec3(1, 0, 0), glm::dvec3(0, 0.28, 0.96), glm::dvec3(0, -0.96, 0.28));
  const glm::dmat3 scaling(glm::dvec3(-0.02, 0, 0), glm::dvec3(0, 3, 0), glm::dvec3(0, 0, 1.5));
  const std::array<double, 3> values = singular_values(first * scaling * second);
  EXPECT_NEAR(values[0], 3, 1e-12);
  EXPECT_NEAR(values[1], 1.5, 1e-12);
  EXPECT_NEAR(values[2], 0.02, 1e-12);
  EXPECT_NEAR(least_singular_value(first * scaling * second), 0.02, 1e-9);
  EXPECT_TRUE(std::isnan(singular_values(glm::dmat3(std::numeric_limits<double>::quiet_NaN()))[0]));
  EXPECT_EQ(singular_value_colour(1), singular_value_colour(7));
  EXPECT_EQ(singular_value_colour(0), singular_value_colour(std::numeric_limits<double>::quiet_NaN()));
  EXPECT_LT(singular_value_colour(0.05)[0], singular_value_colour(0.2)[0]);
}

}  // namespace
}  // namespace arah

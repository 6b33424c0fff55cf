// Distances in a grid instead of the network, and the mesh of their zero set.
#include <gtest/gtest.h>

#include <map>

#include "host/rendering/renderer.h"
#include "tests/host/rendering/capsule_scene.h"

namespace arah {
namespace {

class BakedSurface : public DeviceTest {};

TEST_F(BakedSurface, IsWhereTheNetworkSays) {
  Avatar avatar = capsule_avatar(device, small_paper_spec());
  avatar.tensor("b")[0] = 1e-3f;  // metres: full resolution within 1 cm
  AvatarNetworks networks(device, avatar, false);
  TemplateOnDevice body(device, avatar.body);
  FrameOnDevice frame(device, avatar, body, bent_pose(avatar.body.skeleton), {});
  Field field(device, networks, 1000, 1, {.capacity = point_padding}, false);
  networks.record_pack(commands, 0, {});
  commands.submit_and_wait();
  BakedDistances baked(device, avatar, 0.006);
  baked.bake(commands, field, frame.constants());
  const double metres = avatar.cube.metres_per_unit();
  const auto network = [&](const std::vector<std::array<float, 4>>& points) {
    std::vector<double> result;
    for (size_t first = 0; first < points.size(); first += 1000) {
      std::vector<std::array<float, 4>> some(points.begin() + static_cast<ptrdiff_t>(first), points.begin() + static_cast<ptrdiff_t>(std::min(points.size(), first + 1000)));
      const auto count = static_cast<uint32_t>(some.size());
      some.resize(padded_points(count), {0, 0, 0, 0});
      Buffer rows = filled("points", some);
      const Matrix answer = field.record_distances(commands, frame.constants(), rows.slice(), count, false);
      commands.submit_and_wait();
      const std::vector<float> values = device.download<float>(answer.slice.elements(0, uint64_t(count) * answer.stride));
      for (uint32_t i = 0; i < count; ++i) result.push_back(metres * double{values[i * answer.stride + answer.column]});
    }
    return result;
  };

  // Points around the capsule, up to 5 cm off its surface, on the host and on the device.
  std::vector<std::array<float, 4>> points;
  const std::vector<glm::dvec3> vertices = canonical_vertices(avatar.body, avatar.canonical);
  for (uint32_t i = 0; i < 3000; ++i) {
    const glm::dvec3& v = vertices[generator() % vertices.size()];
    const std::vector<float> shift = uniform(3, -0.04, 0.04);
    points.push_back({static_cast<float>(v.x) + shift[0], static_cast<float>(v.y) + shift[1], static_cast<float>(v.z) + shift[2], 1});
  }
  const std::vector<double> truth = network(points);
  std::vector<std::array<float, 4>> padded = points;
  padded.resize(padded_points(3000), {0, 0, 0, 0});
  Buffer rows = filled("points", padded), result = empty("distances", padded_points(3000) * 16);
  record_interpolate_distances(commands, {3000, rows.slice(), baked.nodes(), result.slice()});
  commands.submit_and_wait();
  const std::vector<float> on_device = device.download<float>(result.slice());
  double near = 0, far = 0, between = 0;
  size_t in_band = 0;
  for (size_t i = 0; i < points.size(); ++i) {
    const double host = baked.samples().between({points[i][0], points[i][1], points[i][2]});
    (std::abs(truth[i]) < 0.01 ? near : far) = std::max(std::abs(truth[i]) < 0.01 ? near : far, std::abs(host - truth[i]));
    in_band += std::abs(truth[i]) < 0.01;
    between = std::max(between, std::abs(host - metres * double{on_device[4 * i]}));
  }
  std::printf("  %llu points asked; largest error %.3f mm in the band (%zu points), %.2f mm beyond; device and host differ by %.1e mm\n", static_cast<unsigned long long>(baked.evaluated()), 1000 * near, in_band, 1000 * far, 1000 * between);
  EXPECT_GT(in_band, 500u);
  EXPECT_LT(near, 0.0002);   // h²/8 of the field's curvature: a radius of 3 cm gives 0.15 mm
  EXPECT_LT(far, 0.012);     // between nodes four times as far apart, deep inside, where distances have a ridge
  EXPECT_LT(between, 2e-6);  // float32 places in a grid of metres
  EXPECT_LT(baked.evaluated(), baked.samples().values.size() / 3);

  const SurfaceMesh mesh(device, commands, networks, avatar, smooth_net(baked.samples()), frame.constants());
  std::vector<std::array<float, 4>> corners;
  for (const glm::dvec3& p : mesh.canonical().vertices) corners.push_back({static_cast<float>(p.x), static_cast<float>(p.y), static_cast<float>(p.z), 1});
  double off = 0;
  for (const double distance : network(corners)) off = std::max(off, std::abs(distance));
  std::map<std::pair<uint32_t, uint32_t>, int> edges;
  for (const glm::uvec3& t : mesh.canonical().triangles)
    for (int k = 0; k < 3; ++k) ++edges[{t[k], t[(k + 1) % 3]}];
  std::printf("  mesh of %zu vertices, up to %.3f mm off the surface\n", corners.size(), 1000 * off);
  EXPECT_GT(corners.size(), 5000u);
  EXPECT_LT(off, 0.0002);
  for (const auto& [edge, count] : edges) {
    ASSERT_EQ(count, 1) << "an edge is there twice in one direction";
    ASSERT_TRUE(edges.contains({edge.second, edge.first})) << "the mesh has a hole";
  }
}

// Colours make a trained field steeper than a distance, twice in the mean where it was measured. Cells that its surface passes through are found all the same.
TEST_F(BakedSurface, OfASteepFieldIsWhereThatOfADistanceIs) {
  struct Baked {
    FieldSamples<float> samples;
    std::vector<glm::dvec3> vertices;
    uint64_t evaluated = 0;
  };
  const auto baked_at = [&](float slope) {
    Avatar avatar = capsule_avatar(device, small_paper_spec());
    avatar.tensor("b")[0] = 1e-4f;  // no wide band that would hide what is missed
    for (const char* const last : {"W", "b"})
      for (float& value : avatar.tensor("sdf." + std::to_string(avatar.spec.sdf.sine_layers) + "." + last)) value *= slope;
    AvatarNetworks networks(device, avatar, false);
    TemplateOnDevice body(device, avatar.body);
    FrameOnDevice frame(device, avatar, body, rest_pose(avatar.body.skeleton), {});
    Field field(device, networks, 1000, 1, {.capacity = point_padding}, false);
    networks.record_pack(commands, 0, {});
    commands.submit_and_wait();
    BakedDistances baked(device, avatar, 0.006);
    baked.bake(commands, field, frame.constants());
    const SurfaceMesh mesh(device, commands, networks, avatar, smooth_net(baked.samples()), frame.constants());
    return Baked{baked.samples(), mesh.canonical().vertices, baked.evaluated()};
  };
  const Baked plain = baked_at(1);
  EXPECT_GT(plain.vertices.size(), 5000u);
  for (const float slope : {2.0f, 4.0f}) {
    const Baked steep = baked_at(slope);
    double off = 0;
    for (const glm::dvec3& vertex : steep.vertices) off = std::max(off, std::abs(plain.samples.between(vertex)));
    std::printf("  slope %g: %llu points asked (%llu of slope 1), mesh of %zu vertices (%zu), up to %.3f mm off\n", double{slope}, static_cast<unsigned long long>(steep.evaluated), static_cast<unsigned long long>(plain.evaluated),
                steep.vertices.size(), plain.vertices.size(), 1000 * off);
    EXPECT_LT(off, 0.0004) << slope;  // twice what each may be off
    EXPECT_NEAR(double(steep.vertices.size()) / double(plain.vertices.size()), 1, 0.01) << slope;
  }
}

// What the drawn mesh shows lies where the joint search finds the surface, with every kind of skinning.
TEST_F(BakedSurface, IsSeenWhereRaysMeetIt) {
  for (const Skinning kind : {Skinning::network, Skinning::template_weights, Skinning::none}) {
    AvatarSpec spec = small_paper_spec();
    if (kind != Skinning::network) spec.skinning = {kind, 0, 0};
    const Avatar avatar = capsule_avatar(device, spec);
    const auto picture = [&](const char* surface) {
      RenderSettings settings = render_preset(avatar, "paper");
      set_render_knob(settings, "sampling_mode", "surface_only");
      set_render_knob(settings, "surface", surface);
      set_render_knob(settings, "bake_cell", "0.01");
      settings.normals = true;
      Renderer renderer(device, avatar, settings);
      return renderer.render(capsule_camera(45, 53), bent_pose(avatar.body.skeleton), 0);
    };
    const Picture search = picture("search"), mesh = picture("mesh");
    size_t both = 0, either = 0;
    double depth = 0, color = 0, angle = 0;
    for (size_t i = 0; i < mesh.alpha.size(); ++i) {
      EXPECT_TRUE(mesh.alpha[i] == 0 || mesh.alpha[i] > 0.9999F);
      both += search.alpha[i] > 0 && mesh.alpha[i] > 0, either += search.alpha[i] > 0 || mesh.alpha[i] > 0;
      if (search.alpha[i] == 0 || mesh.alpha[i] == 0) continue;
      depth += std::abs(search.depth[i] - mesh.depth[i]);
      double dot = 0;
      for (size_t c = 0; c < 3; ++c) {
        color += std::abs(search.color[3 * i + c] - mesh.color[3 * i + c]) / 3;
        dot += double{search.normal[3 * i + c]} * mesh.normal[3 * i + c];
      }
      angle += std::acos(std::clamp(dot, -1.0, 1.0));
    }
    const auto pixels = static_cast<double>(both);
    std::printf("  skinning %-16s overlap %.4f of %zu pixels; depth differs by %.2f mm, normals by %.2f degrees, colours by %.4f in the mean\n", to_string(kind), pixels / double(either), either, 1000 * depth / pixels, 57.3 * angle / pixels, color / pixels);
    EXPECT_GT(both, 300u);
    // With the template's weights a point jumps where its nearest vertex changes: the mesh bridges what rays see as steps.
    EXPECT_GT(pixels / double(either), kind == Skinning::template_weights ? 0.95 : 0.97);
    EXPECT_LT(depth / pixels, kind == Skinning::template_weights ? 0.004 : 0.001);
    EXPECT_LT(color / pixels, 0.02);
    EXPECT_LT(57.3 * angle / pixels, kind == Skinning::template_weights ? 8 : 4);
  }
}

// What is kept of a pose and a code changes nothing, and is made anew when they change.
TEST_F(BakedSurface, KeepsWhatBelongsToPoseAndCode) {
  const Avatar avatar = capsule_avatar(device, small_paper_spec());
  const Pose bent = bent_pose(avatar.body.skeleton), rest = rest_pose(avatar.body.skeleton);
  const Camera camera = capsule_camera(33, 39);
  for (const char* quality : {"balanced", "preview"}) {
    RenderSettings settings = render_preset(avatar, quality);
    set_render_knob(settings, "bake_cell", "0.02");
    const auto fresh = [&](const Pose& pose, size_t row) { return Renderer(device, avatar, settings).render(camera, pose, row).color; };
    Renderer renderer(device, avatar, settings);
    EXPECT_EQ(renderer.render(camera, bent, 0).color, fresh(bent, 0)) << quality;
    EXPECT_EQ(renderer.render(camera, bent, 0).color, fresh(bent, 0)) << quality << ", again";
    EXPECT_EQ(renderer.render(camera, rest, 0).color, fresh(rest, 0)) << quality << ", another pose";
    EXPECT_EQ(renderer.render(camera, rest, 1).color, fresh(rest, 1)) << quality << ", another code";
    EXPECT_NE(fresh(rest, 1), fresh(rest, 0)) << "the codes make no difference: the test shows less than it should";
  }
}

// Where the SDF follows the pose, what is baked belongs to the pose too, unless the SDF that all poses share will do.
TEST_F(BakedSurface, BelongsToThePoseThatTheSdfFollows) {
  Avatar avatar = capsule_avatar(device, following_the_pose(small_paper_spec()));
  let_the_pose_show(avatar, 2e-3f, generator);
  const Pose bent = bent_pose(avatar.body.skeleton), rest = rest_pose(avatar.body.skeleton);
  const Camera camera = capsule_camera(33, 39);
  for (const char* quality : {"paper", "balanced", "preview"}) {
    RenderSettings settings = render_preset(avatar, quality);
    set_render_knob(settings, "bake_cell", "0.02");
    std::vector<std::vector<float>> pictures;
    for (const char* sdf : {"frame", "shared"}) {
      set_render_knob(settings, "sdf_by_pose", sdf);
      const auto fresh = [&](const Pose& pose) { return Renderer(device, avatar, settings).render(camera, pose, 0).color; };
      Renderer renderer(device, avatar, settings);
      EXPECT_EQ(renderer.render(camera, bent, 0).color, fresh(bent)) << quality;
      pictures.push_back(fresh(rest));
      EXPECT_EQ(renderer.render(camera, rest, 0).color, pictures.back()) << quality << ", another pose";
      renderer.reset_work();
      renderer.render(camera, bent, 0);
      EXPECT_EQ(renderer.work().baking_seconds > 0, std::string(sdf) == "frame" && std::string(quality) != "paper") << quality << ", " << sdf;
    }
    EXPECT_NE(pictures[0], pictures[1]) << quality << ": the pose makes no difference: the test shows less than it should";
  }
}

}  // namespace
}  // namespace arah

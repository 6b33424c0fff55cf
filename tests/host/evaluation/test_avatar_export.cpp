// An exported avatar, read by a reader of its own, looks and moves as the avatar does.
#include <gmock/gmock.h>

#include <opencv2/imgcodecs.hpp>

#include "host/evaluation/avatar_export.h"
#include "host/input_error.h"
#include "tests/host/body/rigs.h"
#include "tests/host/evaluation/blender.h"
#include "tests/host/evaluation/glb_picture.h"
#include "tests/host/rendering/capsule_scene.h"

namespace arah {
namespace {

// Ten poses from rest to well beyond the bent one.
std::vector<ExportedFrame> ten_frames(const Skeleton& skeleton) {
  const Pose rest = rest_pose(skeleton), bent = bent_pose(skeleton);
  std::vector<ExportedFrame> frames;
  for (int f = 0; f < 10; ++f) {
    ExportedFrame frame{rest, 1};
    const double part = f / 6.0;
    for (size_t j = 0; j < rest.theta.size(); ++j) frame.pose.theta[j] = part * bent.theta[j];
    frame.pose.root_position += part * (bent.root_position - rest.root_position);
    frames.push_back(frame);
  }
  return frames;
}

class AvatarExport : public DeviceTest {
 protected:
  // The capsule, fitted, its edges as sharp as a trained avatar's.
  Avatar sharp_capsule(AvatarSpec spec = small_paper_spec()) {
    Avatar avatar = capsule_avatar(device, spec);
    avatar.tensor("b")[0] = 1e-3f;
    return avatar;
  }
};

TEST_F(AvatarExport, HasTheSilhouetteAndTheColoursOfItsRendering) {
  const Avatar avatar = sharp_capsule();
  const std::vector<ExportedFrame> frames = ten_frames(avatar.body.skeleton);
  MeshExtraction extraction(device, avatar, {.cell = 0.01});
  ModelSettings settings;
  settings.animated = true;
  settings.outlined = true;
  settings.motion = "bending";
  settings.texture_size = 512;
  ModelReport report;
  const SkinnedModel model = skinned_model(extraction, avatar, frames, settings, report);
  std::printf("  %s\n", describe(report).c_str());
  const std::vector<std::uint8_t> bytes = skinned_glb(model);
  const GlbReader file(bytes);
  EXPECT_THAT(file.complaints(), testing::IsEmpty());

  EXPECT_EQ(report.most_lost, 0) << "three joints lose no influence";
  RenderSettings exact = render_preset(avatar, "paper");
  Renderer renderer(device, avatar, exact);
  const Camera camera = capsule_camera(120, 140);
  double least = 1, color = 0;
  for (size_t f = 0; f < frames.size(); ++f) {
    const GlbPicture picture = picture_of(file, camera, double(f) / settings.frames_per_second, [](const glm::dvec3& p) { return p; });
    const Likeness like = likeness(picture, renderer.render(camera, frames[f].pose, frames[f].latent_row));
    least = std::min(least, like.overlap);
    color += like.color / 10;
  }
  std::printf("  ten poses: overlap at least %.4f, colours differ by %.4f in the mean\n", least, color);
  EXPECT_GT(least, 0.98);
  EXPECT_LT(color, 0.03);  // the colours follow view and normal, the texture knows one of each

  const TemporaryFolder folder;
  const auto khronos = khronos_report(folder.write("capsule.glb", {bytes.begin(), bytes.end()}));
  if (!khronos) GTEST_SKIP() << "neither gltf_validator nor node's package gltf-validator is installed";
  EXPECT_EQ((*khronos)["issues"]["numErrors"], 0) << (*khronos)["issues"].dump(1);
  EXPECT_EQ((*khronos)["issues"]["numWarnings"], 0) << (*khronos)["issues"].dump(1);
}

// A world with z up becomes the file's with y up, by the root's track alone.
TEST_F(AvatarExport, StandsUprightInTheFile) {
  const Avatar avatar = sharp_capsule();
  const std::vector<ExportedFrame> frames = ten_frames(avatar.body.skeleton);
  MeshExtraction extraction(device, avatar, {.cell = 0.03});
  ModelSettings settings;
  settings.animated = true;
  settings.z_up = true;
  settings.colors = MeshColors::none;
  ModelReport report;
  const GlbReader file(skinned_glb(skinned_model(extraction, avatar, frames, settings, report)));
  const std::vector<glm::vec3> expected = extraction.mesh(frames[0].pose, 1).posed(frames[7].pose);
  const std::vector<glm::dvec3> found = file.posed(7 / settings.frames_per_second);
  ASSERT_EQ(found.size(), expected.size());
  double worst = 0;
  for (size_t v = 0; v < found.size(); ++v) worst = std::max(worst, glm::distance(z_up(found[v]), glm::dvec3(expected[v])));
  std::printf("  vertices off SurfaceMesh::posed() by %.1e m at most\n", worst);
  EXPECT_LT(worst, 2e-6);
}

// A shape that follows pose and code: morph targets carry the first frame's mesh to the others' surfaces.
TEST_F(AvatarExport, FollowsTheShapeByMorphTargets) {
  Avatar avatar = sharp_capsule(following_the_pose(small_paper_spec()));
  let_the_pose_show(avatar, 2e-3f, generator);
  std::vector<ExportedFrame> frames = ten_frames(avatar.body.skeleton);
  for (size_t f = 5; f < 10; ++f) frames[f].latent_row = 0;  // another code, another shape
  MeshExtraction extraction(device, avatar, {.cell = 0.008});  // the mesh itself is off by h² / 8 R at most: 0.06 mm
  ModelSettings settings;
  settings.animated = true;
  settings.texture_size = 256;
  ModelReport report;
  const GlbReader file(skinned_glb(skinned_model(extraction, avatar, frames, settings, report)));
  std::printf("  %s\n", describe(report).c_str());
  EXPECT_THAT(file.complaints(), testing::IsEmpty());
  ASSERT_GE(report.correctives, 1u);
  // Canonical vertices with the weights of each key frame, asked of that frame's own field.
  const std::vector<glm::dvec3> base = file.attribute("POSITION");
  const auto& channels = file.json["animations"][0]["channels"];
  ASSERT_EQ(channels.back()["target"]["path"], "weights");
  const auto weights = file.values(file.json["animations"][0]["samplers"][channels.back()["sampler"].get<size_t>()]["output"]);
  double with = 0, without = 0;
  for (const auto& weight : weights) {
    EXPECT_GE(weight[0], 0.0) << "sliders begin at 0";
    EXPECT_LE(weight[0], 1.0);
  }
  for (size_t f = 0; f < frames.size(); ++f) {
    std::vector<glm::dvec3> shaped = base;
    for (size_t k = 0; k < report.correctives; ++k) {
      const std::vector<glm::dvec3> offsets = file.vectors(file.primitive()["targets"][k]["POSITION"]);
      for (size_t v = 0; v < base.size(); ++v) shaped[v] += weights[f * report.correctives + k][0] * offsets[v];
    }
    for (const double distance : extraction.distances(frames[f].pose, frames[f].latent_row, shaped)) with += std::abs(distance) / double(10 * base.size());
    for (const double distance : extraction.distances(frames[f].pose, frames[f].latent_row, base)) without += std::abs(distance) / double(10 * base.size());
  }
  std::printf("  off the frames' surfaces by %.3f mm in the mean, without morph targets %.3f mm\n", 1000 * with, 1000 * without);
  EXPECT_LT(with, 0.0003);
  EXPECT_LT(with, 0.3 * without);

  // With the outline too: whole in the eyes of the format's authors.
  settings.outlined = true;
  const std::vector<std::uint8_t> bytes = skinned_glb(skinned_model(extraction, avatar, frames, settings, report));
  ASSERT_GE(report.correctives, 1u);
  EXPECT_THAT(GlbReader(bytes).complaints(), testing::IsEmpty());
  const TemporaryFolder folder;
  const auto khronos = khronos_report(folder.write("capsule.glb", {bytes.begin(), bytes.end()}));
  if (!khronos) GTEST_SKIP() << "neither gltf_validator nor node's package gltf-validator is installed";
  EXPECT_EQ((*khronos)["issues"]["numErrors"], 0) << (*khronos)["issues"].dump(1);
  EXPECT_EQ((*khronos)["issues"]["numWarnings"], 0) << (*khronos)["issues"].dump(1);
  EXPECT_EQ((*khronos)["info"]["hasMorphTargets"], true);
}

// Blender's own morph targets, skinning and animation, against our renderer on ten poses.
TEST_F(AvatarExport, HasTheSameSilhouetteInBlender) {
  Avatar avatar = sharp_capsule(following_the_pose(small_paper_spec()));
  let_the_pose_show(avatar, 2e-3f, generator);
  const std::vector<ExportedFrame> frames = ten_frames(avatar.body.skeleton);
  MeshExtraction extraction(device, avatar, {.cell = 0.01});
  ModelSettings settings;
  settings.animated = settings.outlined = settings.z_up = true;
  settings.frames_per_second = 24;
  settings.texture_size = 256;
  ModelReport report;
  const std::vector<std::uint8_t> bytes = skinned_glb(skinned_model(extraction, avatar, frames, settings, report));
  const TemporaryFolder folder;
  const auto meshes = blender_meshes(folder.write("capsule.glb", {bytes.begin(), bytes.end()}), 10, folder.path());
  if (!meshes) GTEST_SKIP() << "there is no blender with NumPy on the PATH";
  const GlbReader file(bytes);
  Renderer renderer(device, avatar, render_preset(avatar, "paper"));
  ASSERT_GE(report.correctives, 1u);
  double least = 1, apart = 0;
  for (size_t f = 0; f < frames.size(); ++f) {
    const BlenderMesh& mesh = (*meshes)[f];
    const std::vector<glm::dvec3> read = file.posed(double(f) / 24);
    ASSERT_EQ(mesh.vertices.size(), read.size());
    for (size_t v = 0; v < read.size(); ++v) apart = std::max(apart, glm::distance(glm::dvec3(mesh.vertices[v]), z_up(read[v])));
    std::printf("  pose %zu: overlap", f);
    for (const int size : f % 3 == 0 ? std::vector<int>{256, 512} : std::vector<int>{256}) {
      const Camera camera = capsule_camera(size, size);
      const std::vector<VisiblePlace> places = visible_places(camera, mesh.vertices, mesh.triangles);
      GlbPicture picture{std::vector<bool>(places.size()), std::vector<glm::dvec3>(places.size(), glm::dvec3(0.0))};
      for (size_t i = 0; i < places.size(); ++i) picture.covered[i] = places[i].triangle != VisiblePlace::no_triangle;
      const double overlap = likeness(picture, renderer.render(camera, frames[f].pose, frames[f].latent_row)).overlap;
      std::printf(" %.4f at %d²", overlap, size);
      least = std::min(least, overlap);
    }
    std::printf("\n");
  }
  std::printf("  Blender: overlap at least %.4f, vertices within %.1e m of our own reader's\n", least, apart);
  EXPECT_GT(least, 0.98);
  EXPECT_LT(apart, 1e-4);
}

// Other kinds of skinning: the template's weights, and none at all, which gives a mesh that stands.
TEST_F(AvatarExport, TakesWhatSkinningThereIs) {
  for (const Skinning kind : {Skinning::template_weights, Skinning::none}) {
    AvatarSpec spec = small_paper_spec();
    spec.skinning = {kind, 0, 0};
    const Avatar avatar = capsule_avatar(device, spec);
    MeshExtraction extraction(device, avatar, {.cell = 0.03});
    const std::vector<ExportedFrame> frames{{bent_pose(avatar.body.skeleton), 0}};
    ModelSettings settings;
    settings.animated = true;
    settings.colors = MeshColors::vertex;
    ModelReport report;
    const GlbReader file(skinned_glb(skinned_model(extraction, avatar, frames, settings, report)));
    EXPECT_THAT(file.complaints(), testing::IsEmpty()) << to_string(kind);
    EXPECT_EQ(file.json.contains("skins"), kind != Skinning::none);
    const std::vector<glm::vec3> expected = extraction.mesh(frames[0].pose, 0).posed(frames[0].pose);
    const std::vector<glm::dvec3> found = file.posed(kind == Skinning::none ? std::nullopt : std::optional(0.0));
    ASSERT_EQ(found.size(), expected.size());
    for (size_t v = 0; v < found.size(); v += 7) EXPECT_LT(glm::distance(found[v], glm::dvec3(expected[v])), 1e-5) << to_string(kind);
  }
}

// What the vertices show is what the renderer shows, whose colours follow view and normal too.
TEST_F(AvatarExport, PosedMeshesHaveTheFieldsColours) {
  const Avatar avatar = sharp_capsule();
  MeshExtraction extraction(device, avatar, {.cell = 0.01});
  const ExportedFrame frame{bent_pose(avatar.body.skeleton), 0};
  const ColoredMesh mesh = posed_mesh(extraction, frame, true);
  ASSERT_EQ(mesh.colors.size(), mesh.vertices.size());
  Renderer renderer(device, avatar, render_preset(avatar, "paper"));
  const Camera camera = capsule_camera(90, 100);
  const Picture picture = renderer.render(camera, frame.pose, frame.latent_row);
  double difference = 0, count = 0;
  for (size_t v = 0; v < mesh.vertices.size(); ++v) {
    const glm::dvec3 to = glm::normalize(camera.center() - glm::dvec3(mesh.vertices[v]));
    if (glm::dot(to, glm::dvec3(mesh.normals[v])) < 0.95) continue;  // seen from straight ahead, as its colour was asked for
    const glm::dvec2 pixel = camera.project(mesh.vertices[v]);
    const auto at = static_cast<size_t>(std::lround(pixel.y)) * 90 + static_cast<size_t>(std::lround(pixel.x));
    if (pixel.x < 0 || pixel.y < 0 || pixel.x > 89 || pixel.y > 99 || picture.alpha[at] < 0.99f) continue;
    for (size_t c = 0; c < 3; ++c) difference += std::abs(mesh.colors[v][static_cast<int>(c)] - picture.color[3 * at + c]) / 3;
    ++count;
  }
  std::printf("  %.0f vertices differ from their pixels by %.4f in the mean\n", count, difference / count);
  EXPECT_GT(count, 200);
  EXPECT_LT(difference / count, 0.02);
}

TEST_F(AvatarExport, WithoutASurfaceIsRefused) {
  AvatarSpec spec = small_paper_spec();
  spec.sdf.kind = FieldKind::density;
  const Pose pose = rest_pose(capsule_body().skeleton);
  const Avatar avatar = make_avatar(spec, capsule_body(), {0}, 1, &pose);
  EXPECT_THROW(MeshExtraction(device, avatar, {.cell = 0.02}), InputError);
}

}  // namespace
}  // namespace arah

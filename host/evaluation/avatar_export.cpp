#include "host/evaluation/avatar_export.h"

#include <fmt/format.h>

#include <algorithm>
#include <glm/geometric.hpp>
#include <glm/mat3x3.hpp>
#include <optional>
#include <stdexcept>

#include "host/evaluation/picture.h"
#include "host/evaluation/shape_correctives.h"
#include "host/evaluation/texture_atlas.h"

namespace arah {
namespace {

constexpr std::size_t texels_at_a_time = 65536;

// A world with z up in one with y up.
const glm::dmat3 z_up_to_y_up(1, 0, 0, 0, 0, -1, 0, 1, 0);

Pose turned_upright(Pose pose) {
  pose.theta[0] = axis_angle_from_rotation(z_up_to_y_up * rotation_from_axis_angle(pose.theta[0]));
  pose.root_position = z_up_to_y_up * pose.root_position;
  return pose;
}

std::vector<glm::vec3> in_floats(const std::vector<glm::dvec3>& vectors) { return {vectors.begin(), vectors.end()}; }

// Where the mesh's vertices have their colours: on the surface, which they may lie outside of.
std::vector<glm::vec3> colored_places(const MeshExtraction& extraction, const SurfaceMesh& mesh) {
  std::vector<glm::vec3> places;
  for (size_t v = 0; v < mesh.canonical().vertices.size(); ++v) places.emplace_back(mesh.canonical().vertices[v] - extraction.outline() * mesh.normals()[v]);
  return places;
}

// The texture as a PNG.
std::vector<std::uint8_t> baked_texture(MeshExtraction& extraction, const SurfaceMesh& mesh, const TextureAtlas& atlas, const Pose& pose, const std::function<void(double)>& progress) {
  const std::vector<glm::vec3> vertices = colored_places(extraction, mesh), normals = in_floats(mesh.normals());
  const std::vector<glm::mat4> transforms = mesh.vertex_transforms(pose);
  std::vector<glm::vec3> colors;
  for (std::size_t first = 0; first < atlas.texels.size(); first += texels_at_a_time) {
    if (progress) progress(double(first) / double(atlas.texels.size()));
    std::vector<glm::vec3> points, directions;
    std::vector<glm::mat4> matrices;
    for (std::size_t i = first; i < std::min(first + texels_at_a_time, atlas.texels.size()); ++i) {
      const TextureAtlas::Texel& texel = atlas.texels[i];
      const glm::uvec3& t = mesh.canonical().triangles[texel.triangle];
      const auto between = [&](const auto& of) { return texel.barycentric.x * of[t.x] + texel.barycentric.y * of[t.y] + texel.barycentric.z * of[t.z]; };
      points.push_back(between(vertices));
      directions.push_back(between(normals));
      matrices.push_back(between(transforms));
    }
    const std::vector<glm::vec3> some = extraction.colors(points, directions, matrices);
    colors.insert(colors.end(), some.begin(), some.end());
  }
  return encode_png(atlas_picture(atlas, colors), atlas.size, atlas.size, 3);
}

// Four influences a vertex, and what is lost with the others.
void bind(SkinnedModel& model, const Avatar& avatar, const SurfaceMesh& mesh, const std::vector<ExportedFrame>& frames, ModelReport& report) {
  const std::size_t count = mesh.canonical().vertices.size();
  for (std::size_t v = 0; v < count; ++v) {
    const FourInfluences four = greatest_four(mesh.influences(v));
    model.joints.push_back(four.joints);
    model.weights.push_back(four.weights);
    report.mean_lost += four.lost / double(count);
    report.most_lost = std::max(report.most_lost, four.lost);
  }
  for (const ExportedFrame& frame : frames) {
    const std::vector<glm::vec3> exact = mesh.posed(frame.pose);
    const std::vector<glm::dmat4> bones = bone_transforms(avatar.body.skeleton, avatar.canonical, frame.pose);
    const glm::dvec3 root = root_translation(avatar.body.skeleton, frame.pose);
    for (std::size_t v = 0; v < count; ++v) {
      glm::dvec4 place(0.0);
      for (int k = 0; k < 4; ++k) place += double{model.weights[v][k]} * (bones[model.joints[v][k]] * glm::dvec4(mesh.canonical().vertices[v], 1.0));
      const double moved = glm::distance(glm::dvec3(place) + root, glm::dvec3(exact[v]));
      report.mean_moved += moved / double(count * frames.size());
      report.most_moved = std::max(report.most_moved, moved);
    }
  }
}

// What the frames' shapes differ by from the first one's. Weights are 0 to 1, a component that goes both ways two targets: sliders of
// modelling programs begin at 0, and Blender's importer (3.4) widens them by the first key's weight alone and clamps the others.
void add_correctives(SkinnedModel& model, MeshExtraction& extraction, const SurfaceMesh& mesh, const std::vector<ExportedFrame>& frames, std::size_t most, ModelReport& report) {
  std::vector<Pose> poses;
  std::vector<std::size_t> rows;
  for (const ExportedFrame& frame : frames) poses.push_back(frame.pose), rows.push_back(frame.latent_row);
  const ShapeCorrectives found = shape_correctives(extraction, mesh, poses, rows, most);
  if (!found.displacements.empty()) model.corrective_weights.resize(frames.size());
  for (std::size_t k = 0; k < found.displacements.size(); ++k) {
    const std::vector<double>& displacement = found.displacements[k];
    for (const double sign : {1.0, -1.0}) {
      const auto weight = [&](std::size_t frame) { return std::max(0.0f, static_cast<float>(sign) * found.weights[frame][k]); };
      bool used = false;
      for (std::size_t f = 0; f < frames.size(); ++f) used = used || weight(f) > 0.0f;
      if (!used) continue;
      model.correctives.push_back({fmt::format("shape_{}{}", k, sign > 0 ? "" : "_back"), {}, {}});
      std::vector<glm::dvec3> moved(model.vertices.begin(), model.vertices.end());
      for (std::size_t v = 0; v < displacement.size(); ++v) {
        model.correctives.back().offsets.emplace_back(sign * displacement[v] * mesh.normals()[v]);
        moved[v] += sign * displacement[v] * mesh.normals()[v];
      }
      // With a weight of 1; glTF adds normals' changes in proportion to the weight and programs make the sum a unit vector.
      const std::vector<glm::dvec3> normals = vertex_normals(moved, model.triangles);
      for (std::size_t v = 0; v < normals.size(); ++v) model.correctives.back().normal_offsets.emplace_back(glm::vec3(normals[v]) - model.normals[v]);
      for (std::size_t f = 0; f < frames.size(); ++f) model.corrective_weights[f].push_back(weight(f));
    }
  }
  report.correctives = model.correctives.size();
  report.mean_left = found.mean_left;
  report.most_left = found.most_left;
}

template <typename Value>
std::vector<Value> copied(const std::vector<Value>& values, const std::vector<std::uint32_t>& which) {
  std::vector<Value> copies;
  if (values.empty()) return copies;
  for (const std::uint32_t v : which) copies.push_back(values[v]);
  return copies;
}

}  // namespace

SkinnedModel skinned_model(MeshExtraction& extraction, const Avatar& avatar, const std::vector<ExportedFrame>& frames, const ModelSettings& settings, ModelReport& report, const std::function<void(double)>& progress) {
  if (frames.empty()) throw std::invalid_argument("an export without a frame");
  const ExportedFrame& first = frames.front();
  const SurfaceMesh& mesh = extraction.mesh(first.pose, first.latent_row);
  const bool moves = avatar.spec.skinning.kind != Skinning::none;
  SkinnedModel model;
  model.name = settings.name;
  model.vertices = in_floats(mesh.canonical().vertices);
  model.normals = in_floats(mesh.normals());
  model.triangles = mesh.canonical().triangles;
  report = {};
  report.simplified = extraction.simplification_error();
  if (settings.outlined) {
    const std::vector<double> farther = extraction.outlines();
    for (size_t v = 0; v < farther.size(); ++v) {
      model.vertices[v] += static_cast<float>(farther[v]) * model.normals[v];
      report.mean_outline += farther[v] / double(farther.size());
    }
  }
  if (moves) {
    model.skeleton = avatar.body.skeleton;
    model.rest_to_bind = avatar.canonical.rest_to_canonical;
    bind(model, avatar, mesh, frames, report);
    if (settings.animated) {
      model.motion = settings.motion;
      model.frames_per_second = settings.frames_per_second;
      for (const ExportedFrame& frame : frames) model.poses.push_back(settings.z_up ? turned_upright(frame.pose) : frame.pose);
    }
  } else {
    const glm::vec3 root(root_translation(avatar.body.skeleton, first.pose));
    for (glm::vec3& v : model.vertices) v += root;
    if (settings.z_up)
      for (std::vector<glm::vec3>* vectors : {&model.vertices, &model.normals})
        for (glm::vec3& v : *vectors) v = glm::mat3(z_up_to_y_up) * v;
  }
  if (settings.colors == MeshColors::vertex) model.colors = extraction.colors(colored_places(extraction, mesh), in_floats(mesh.normals()), mesh.vertex_transforms(first.pose));
  std::optional<TextureAtlas> atlas;
  if (settings.colors == MeshColors::texture) {
    atlas = make_texture_atlas(mesh.canonical(), settings.texture_size);
    model.texture_png = baked_texture(extraction, mesh, *atlas, first.pose, progress);
  }
  if (moves && settings.animated && extraction.shape_follows_frames()) add_correctives(model, extraction, mesh, frames, settings.most_correctives, report);
  if (atlas) {
    model.vertices = copied(model.vertices, atlas->vertices);
    model.normals = copied(model.normals, atlas->vertices);
    model.joints = copied(model.joints, atlas->vertices);
    model.weights = copied(model.weights, atlas->vertices);
    for (SkinnedModel::Corrective& corrective : model.correctives) {
      corrective.offsets = copied(corrective.offsets, atlas->vertices);
      corrective.normal_offsets = copied(corrective.normal_offsets, atlas->vertices);
    }
    model.triangles = atlas->triangles;
    model.uvs = atlas->uvs;
    report.charts = atlas->charts;
    report.texel = 1 / atlas->texels_per_metre;
  }
  report.vertices = model.vertices.size();
  report.triangles = model.triangles.size();
  return model;
}

std::string describe(const ModelReport& report) {
  std::string text = fmt::format("{} triangles, {} vertices", report.triangles, report.vertices);
  if (report.simplified > 0) text += fmt::format(", up to {:.2f} mm off the mesh before it was simplified", 1000 * report.simplified);
  if (report.charts) text += fmt::format("; texture: {} charts, {:.1f} mm a texel", report.charts, 1000 * report.texel);
  if (report.correctives) text += fmt::format("; {} morph targets, which leave {:.2f} mm of the frames' shapes in the mean, {:.1f} mm at most", report.correctives, 1000 * report.mean_left, 1000 * report.most_left);
  if (report.mean_outline > 0) text += fmt::format("; {:.1f} mm outside of the surface in the mean, where renderings have their outline", 1000 * report.mean_outline);
  return text + fmt::format("; influences beyond the fourth: {:.3f} % of a vertex's weight in the mean, {:.2f} % at most, which moves it by {:.3f} mm in the mean, {:.2f} mm at most", 100 * report.mean_lost,
                            100 * report.most_lost, 1000 * report.mean_moved, 1000 * report.most_moved);
}

ColoredMesh posed_mesh(MeshExtraction& extraction, const ExportedFrame& frame, bool colored) {
  const SurfaceMesh& mesh = extraction.mesh(frame.pose, frame.latent_row);
  ColoredMesh posed;
  posed.vertices = mesh.posed(frame.pose);
  posed.triangles = mesh.canonical().triangles;
  const std::vector<glm::dvec3> places(posed.vertices.begin(), posed.vertices.end());
  posed.normals = in_floats(vertex_normals(places, posed.triangles));
  if (colored) posed.colors = extraction.colors(colored_places(extraction, mesh), in_floats(mesh.normals()), mesh.vertex_transforms(frame.pose));
  return posed;
}

}  // namespace arah

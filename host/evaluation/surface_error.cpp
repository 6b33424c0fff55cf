#include "host/evaluation/surface_error.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "host/evaluation/mesh_extraction.h"
#include "host/evaluation/mesh_metrics.h"
#include "host/evaluation/true_surface.h"
#include "host/input_error.h"

namespace arah {
namespace {

constexpr double f_score_within = 0.005;  // metres

// The part above the plane. origin: of each vertex that is left one of the mesh before.
TriangleMesh above(const TriangleMesh& mesh, const glm::dvec4& plane, std::vector<uint32_t>* origin = nullptr) {
  std::vector<double> heights;
  for (const glm::dvec3& p : mesh.vertices) heights.push_back(glm::dot(plane, glm::dvec4(p, 1)));
  const CutTriangles cut = cut_triangles(mesh.triangles, heights);
  TriangleMesh kept{{}, cut.triangles};
  for (const VertexOrigin& v : cut.vertices) {
    kept.vertices.push_back(glm::mix(mesh.vertices[v.first], mesh.vertices[v.second], v.t));
    if (origin) origin->push_back(v.first);
  }
  return kept;
}

std::vector<std::pair<const MotionFrame*, std::filesystem::path>> frames_with_surface(const Capture& capture, const std::string& split) {
  std::vector<std::pair<const MotionFrame*, std::filesystem::path>> frames;
  for (const MotionFrame& frame : motion_of(capture, split).frames) {
    const std::filesystem::path path = capture.path / "meshes" / fmt::format("{}_{:06d}.ply", split, frame.number);
    if (std::filesystem::exists(path)) frames.emplace_back(&frame, path);
  }
  return frames;
}

}  // namespace

bool has_surface(const Capture& capture, const std::string& split) { return !frames_with_surface(capture, split).empty(); }

std::vector<SurfaceError> surface_errors(Device& device, const Avatar& avatar, const Capture& capture, const std::string& split, const SurfaceSettings& settings, const std::function<void(double)>& progress) {
  const auto frames = frames_with_surface(capture, split);
  if (frames.empty()) throw InputError((capture.path / "meshes").string(), "", fmt::format("{}_<frame>.ply, the true surface of some frame", split), "none", "Without the true surface leave --surface out.");
  MeshSettings meshing;
  meshing.cell = settings.cell;
  if (settings.largest_part) meshing.least_part = 1;
  MeshExtraction extraction(device, avatar, meshing);
  std::vector<SurfaceError> errors;
  for (const auto& [frame, path] : frames) {
    if (progress) progress(double(errors.size()) / double(frames.size()));
    const Pose& pose = pose_to_render(avatar.refined, split, *frame);
    const SurfaceMesh& mesh = extraction.mesh(pose, avatar.spec.latent_size > 0 ? latent_row(avatar, frame->number) : 0);
    TriangleMesh predicted{{}, mesh.canonical().triangles};
    for (const glm::vec3& p : mesh.posed(pose)) predicted.vertices.emplace_back(p);
    TrueSurface surface = read_true_surface(path);
    TriangleMesh truth{std::move(surface.vertices), std::move(surface.triangles)};
    if (settings.ground) {
      predicted = above(predicted, *settings.ground);
      std::vector<uint32_t> origin;
      truth = above(truth, *settings.ground, &origin);
      std::vector<bool> without_hair;
      for (const uint32_t v : origin) without_hair.push_back(surface.without_hair[v]);
      surface.without_hair = std::move(without_hair);
      if (predicted.triangles.empty() || std::find(surface.without_hair.begin(), surface.without_hair.end(), true) == surface.without_hair.end())
        throw InputError("--ground", "", fmt::format("a plane that both surfaces of frame {} rise above", frame->number), predicted.triangles.empty() ? "the avatar's below it" : "the true one below it",
                         "The sum a x + b y + c z + d is positive on the side that is compared.");
    }
    const MeshMetrics metrics = mesh_metrics({predicted.vertices, predicted.triangles}, {truth.vertices, truth.triangles});
    std::vector<double> distances;
    for (size_t v = 0; v < truth.vertices.size(); ++v)
      if (surface.without_hair[v]) distances.push_back(metrics.to_prediction.to_surface[v]);
    SurfaceError error{frame->number, 0, 0, metrics.chamfer(), metrics.normal_consistency(), metrics.normal_consistency_of_the_paper(), metrics.f_score(f_score_within)};
    for (const double distance : distances) error.mean += distance / double(distances.size());
    const auto rank = distances.begin() + static_cast<std::ptrdiff_t>(0.95 * double(distances.size() - 1));
    std::nth_element(distances.begin(), rank, distances.end());
    error.percentile_95 = *rank;
    errors.push_back(error);
  }
  return errors;
}

double mean_of(const std::vector<SurfaceError>& errors, double SurfaceError::*figure) {
  double sum = 0;
  for (const SurfaceError& error : errors) sum += error.*figure / double(errors.size());
  return sum;
}

std::string describe(const std::vector<SurfaceError>& errors) {
  const auto mean = [&](double SurfaceError::*figure) { return mean_of(errors, figure); };
  return fmt::format("surface: {:.2f} mm in the mean, 95 % within {:.2f} mm, Chamfer {:.2f} cm², normals {:.3f}, F-score {:.3f} at 5 mm ({} meshes)", 1000 * mean(&SurfaceError::mean),
                     1000 * mean(&SurfaceError::percentile_95), 1e4 * mean(&SurfaceError::chamfer), mean(&SurfaceError::normal_consistency), mean(&SurfaceError::f_score), errors.size());
}

}  // namespace arah

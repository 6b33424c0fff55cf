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

constexpr double mesh_cell = 0.006;  // metres, of the avatar's
constexpr double f_score_within = 0.005;  // metres

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

std::vector<SurfaceError> surface_errors(Device& device, const Avatar& avatar, const Capture& capture, const std::string& split, const std::function<void(double)>& progress) {
  const auto frames = frames_with_surface(capture, split);
  if (frames.empty()) throw InputError((capture.path / "meshes").string(), "", fmt::format("{}_<frame>.ply, the true surface of some frame", split), "none", "Without the true surface leave --surface out.");
  MeshExtraction extraction(device, avatar, mesh_cell);
  std::vector<SurfaceError> errors;
  for (const auto& [frame, path] : frames) {
    if (progress) progress(double(errors.size()) / double(frames.size()));
    const Pose& pose = pose_to_render(avatar.refined, split, *frame);
    const SurfaceMesh& mesh = extraction.mesh(pose, avatar.spec.latent_size > 0 ? latent_row(avatar, frame->number) : 0);
    std::vector<glm::dvec3> vertices;
    for (const glm::vec3& p : mesh.posed(pose)) vertices.emplace_back(p);
    const TrueSurface surface = read_true_surface(path);
    const MeshMetrics metrics = mesh_metrics({vertices, mesh.canonical().triangles}, {surface.vertices, surface.triangles});
    std::vector<double> distances;
    for (size_t v = 0; v < surface.vertices.size(); ++v)
      if (surface.without_hair[v]) distances.push_back(metrics.to_prediction.to_surface[v]);
    SurfaceError error{frame->number, 0, 0, metrics.chamfer(), metrics.normal_consistency(), metrics.f_score(f_score_within)};
    for (const double distance : distances) error.mean += distance / double(distances.size());
    const auto rank = distances.begin() + static_cast<std::ptrdiff_t>(0.95 * double(distances.size() - 1));
    std::nth_element(distances.begin(), rank, distances.end());
    error.percentile_95 = *rank;
    errors.push_back(error);
  }
  return errors;
}

std::string describe(const std::vector<SurfaceError>& errors) {
  const auto mean = [&](double SurfaceError::*figure) {
    double sum = 0;
    for (const SurfaceError& error : errors) sum += error.*figure / double(errors.size());
    return sum;
  };
  return fmt::format("surface: {:.2f} mm in the mean, 95 % within {:.2f} mm, Chamfer {:.2f} cm², normals {:.3f}, F-score {:.3f} at 5 mm ({} meshes)", 1000 * mean(&SurfaceError::mean),
                     1000 * mean(&SurfaceError::percentile_95), 1e4 * mean(&SurfaceError::chamfer), mean(&SurfaceError::normal_consistency), mean(&SurfaceError::f_score), errors.size());
}

}  // namespace arah

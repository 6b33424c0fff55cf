#include "host/evaluation/surface_error.h"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <fstream>
#include <sstream>

#include "host/evaluation/mesh_extraction.h"
#include "host/evaluation/mesh_metrics.h"
#include "host/input_error.h"

namespace arah {
namespace {

static_assert(std::endian::native == std::endian::little, "meshes are read as they lie in the file");

constexpr uint8_t hair_part = 3;
constexpr double f_score_within = 0.005;  // metres

struct TrueSurface {
  TriangleMesh mesh;
  std::vector<bool> without_hair;  // by vertex: of a face that is not hair
};

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

TrueSurface true_surface(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  const auto refuse = [&](const std::string& expected, const std::string& found) { return InputError(path.string(), "", expected, found); };
  if (!file) throw refuse("a mesh", "a file that cannot be read");
  std::string line;
  std::vector<std::string> header;
  while (std::getline(file, line) && line != "end_header") {
    if (line.starts_with("comment")) continue;
    header.push_back(line);
    if (header.size() > 64) break;
  }
  size_t vertices = 0, faces = 0;
  std::string form;
  for (const std::string& entry : header) {
    std::istringstream words(entry);
    std::string word, what;
    words >> word >> what;
    if (word == "element") (what == "vertex" ? vertices : faces) = [&] { size_t count = 0; words >> count; return count; }();
    else form += entry + ";";
  }
  if (line != "end_header" || form != "ply;format binary_little_endian 1.0;property float x;property float y;property float z;property list uchar int vertex_indices;property uchar part;")
    throw refuse("a PLY of binary_little_endian, float x y z and faces with a uchar part", "'" + form.substr(0, 200) + "'");
  if (vertices == 0 || vertices > 100'000'000 || faces > 100'000'000) throw refuse("1 to 10^8 vertices and faces", fmt::format("{} and {}", vertices, faces));
  const auto read = [&](void* to, size_t bytes) {
    if (!file.read(static_cast<char*>(to), static_cast<std::streamsize>(bytes))) throw refuse(fmt::format("{} vertices and {} faces", vertices, faces), "the file's end");
  };
  std::vector<std::array<float, 3>> places(vertices);
  read(places.data(), vertices * sizeof places[0]);
  TrueSurface surface;
  surface.without_hair.resize(vertices, false);
  for (size_t f = 0; f < faces; ++f) {
    uint8_t corners = 0, part = 0;
    read(&corners, 1);
    std::vector<int32_t> at(corners);
    read(at.data(), corners * sizeof at[0]);
    read(&part, 1);
    for (const int32_t v : at) {
      if (v < 0 || static_cast<size_t>(v) >= vertices) throw refuse(fmt::format("indices below {}", vertices), fmt::format("{}", v));
      if (part != hair_part) surface.without_hair[static_cast<size_t>(v)] = true;
    }
    for (size_t k = 2; k < at.size(); ++k) surface.mesh.triangles.emplace_back(at[0], at[k - 1], at[k]);
  }
  for (const auto& p : places) surface.mesh.vertices.emplace_back(p[0], p[1], p[2]);
  if (std::find(surface.without_hair.begin(), surface.without_hair.end(), true) == surface.without_hair.end()) throw refuse("faces that are not hair", "none");
  return surface;
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
    TrueSurface surface = true_surface(path);
    if (settings.ground) {
      predicted = above(predicted, *settings.ground);
      std::vector<uint32_t> origin;
      surface.mesh = above(surface.mesh, *settings.ground, &origin);
      std::vector<bool> without_hair;
      for (const uint32_t v : origin) without_hair.push_back(surface.without_hair[v]);
      surface.without_hair = std::move(without_hair);
      if (predicted.triangles.empty() || std::find(surface.without_hair.begin(), surface.without_hair.end(), true) == surface.without_hair.end())
        throw InputError("--ground", "", fmt::format("a plane that both surfaces of frame {} rise above", frame->number), predicted.triangles.empty() ? "the avatar's below it" : "the true one below it",
                         "The sum a x + b y + c z + d is positive on the side that is compared.");
    }
    const MeshMetrics metrics = mesh_metrics({predicted.vertices, predicted.triangles}, {surface.mesh.vertices, surface.mesh.triangles});
    std::vector<double> distances;
    for (size_t v = 0; v < surface.mesh.vertices.size(); ++v)
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

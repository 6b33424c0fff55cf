#include "host/evaluation/shape_correctives.h"

#include <algorithm>
#include <cmath>
#include <opencv2/core.hpp>
#include <stdexcept>

namespace arah {
namespace {

constexpr int newton_steps = 5;
constexpr double farthest_follow = 0.05;     // metres: beyond, the normal meets another part of the body or nothing
constexpr double slight_shape = 1e-4;       // metres
constexpr std::size_t shaping_frames = 64;  // that the components are found from, evenly among all

// Along the normals to where the frame's distances are zero. The slope of a distance is 1.
std::vector<double> followed(MeshExtraction& extraction, const SurfaceMesh& mesh, const Pose& pose, std::size_t row) {
  const std::vector<glm::dvec3>& vertices = mesh.canonical().vertices;
  std::vector<double> moved(vertices.size(), 0.0);
  for (int step = 0; step < newton_steps; ++step) {
    std::vector<glm::dvec3> points;
    for (std::size_t v = 0; v < vertices.size(); ++v) points.push_back(vertices[v] + moved[v] * mesh.normals()[v]);
    const std::vector<double> distances = extraction.distances(pose, row, points);
    for (std::size_t v = 0; v < vertices.size(); ++v) moved[v] = std::clamp(moved[v] - distances[v], -farthest_follow, farthest_follow);
  }
  return moved;
}

double dot(const std::vector<double>& a, const std::vector<double>& b) {
  double sum = 0;
  for (std::size_t i = 0; i < a.size(); ++i) sum += a[i] * b[i];
  return sum;
}

void add(std::vector<double>& to, double factor, const std::vector<double>& what) {
  for (std::size_t i = 0; i < to.size(); ++i) to[i] += factor * what[i];
}

double root_mean_square(const std::vector<double>& values) { return std::sqrt(dot(values, values) / double(values.size())); }

}  // namespace

ShapeCorrectives shape_correctives(MeshExtraction& extraction, const SurfaceMesh& mesh, const std::vector<Pose>& poses, const std::vector<std::size_t>& rows, std::size_t most, const std::function<void(double)>& progress) {
  if (poses.empty() || rows.size() != poses.size()) throw std::invalid_argument("correctives of no frames");
  // What the mesh is off the surface it was made of is no corrective.
  const std::vector<double> first = followed(extraction, mesh, poses[0], rows[0]);
  const auto of_frame = [&](std::size_t f) {
    if (progress) progress(double(f) / double(poses.size()));
    std::vector<double> moved = f == 0 ? first : followed(extraction, mesh, poses[f], rows[f]);
    add(moved, -1, first);
    return moved;
  };
  const std::size_t shaping = std::min(shaping_frames, poses.size());
  std::vector<std::vector<double>> left;
  for (std::size_t i = 0; i < shaping; ++i) left.push_back(of_frame(i * poses.size() / shaping));

  // Principal components without centring, so that weights of 0 are the first frame: eigenvectors of the Gram matrix D Dᵀ.
  cv::Mat gram(static_cast<int>(shaping), static_cast<int>(shaping), CV_64F), values, vectors;
  for (int a = 0; a < gram.rows; ++a)
    for (int b = 0; b <= a; ++b) gram.at<double>(a, b) = gram.at<double>(b, a) = dot(left[static_cast<std::size_t>(a)], left[static_cast<std::size_t>(b)]);
  cv::eigen(gram, values, vectors);
  ShapeCorrectives correctives;
  std::vector<std::vector<double>> axes;  // of unit length
  for (int k = 0; k < gram.rows && axes.size() < most; ++k) {
    double worst = 0;
    for (const std::vector<double>& frame : left) worst = std::max(worst, root_mean_square(frame));
    const double length = std::sqrt(std::max(0.0, values.at<double>(k)));
    if (worst < slight_shape || !(length > 1e-9)) break;
    std::vector<double> axis(first.size(), 0.0);
    for (int f = 0; f < gram.rows; ++f) {
      // From the residuals: the same as from the frames, whose parts along earlier axes are orthogonal to this one.
      add(axis, vectors.at<double>(k, f) / length, left[static_cast<std::size_t>(f)]);
    }
    const double norm = std::sqrt(dot(axis, axis));
    for (double& value : axis) value /= norm;
    for (std::vector<double>& frame : left) add(frame, -dot(frame, axis), axis);
    axes.push_back(std::move(axis));
  }
  if (axes.empty()) return correctives;

  std::vector<double> greatest(axes.size(), 0.0);
  std::vector<std::vector<double>> along;
  for (std::size_t f = 0; f < poses.size(); ++f) {
    std::vector<double> rest = of_frame(f);
    along.emplace_back();
    for (std::size_t k = 0; k < axes.size(); ++k) {
      along.back().push_back(dot(rest, axes[k]));
      greatest[k] = std::max(greatest[k], std::abs(along.back()[k]));
    }
    for (std::size_t k = 0; k < axes.size(); ++k) add(rest, -along.back()[k], axes[k]);
    for (const double off : rest) {
      correctives.mean_left += std::abs(off) / double(rest.size() * poses.size());
      correctives.most_left = std::max(correctives.most_left, std::abs(off));
    }
  }
  for (std::size_t k = 0; k < axes.size(); ++k) {
    for (double& value : axes[k]) value *= greatest[k];
    correctives.displacements.push_back(axes[k]);
  }
  for (const std::vector<double>& frame : along) {
    correctives.weights.emplace_back();
    for (std::size_t k = 0; k < axes.size(); ++k) correctives.weights.back().push_back(static_cast<float>(greatest[k] > 0 ? frame[k] / greatest[k] : 0));
  }
  return correctives;
}

}  // namespace arah

#include "host/evaluation/mesh_metrics.h"

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <nanoflann.hpp>

#include "host/body/mesh_distance.h"
#include "host/capture/implicit_surface.h"

namespace arah {
namespace {

// Nearest vertices by a k-d tree.
class NearestVertex {
 public:
  explicit NearestVertex(std::span<const glm::dvec3> vertices) : cloud_{vertices}, tree_(3, cloud_) {}

  size_t of(const glm::dvec3& point) const {
    size_t index = 0;
    double squared = 0;
    nanoflann::KNNResultSet<double> nearest(1);
    nearest.init(&index, &squared);
    tree_.findNeighbors(nearest, &point.x, nanoflann::SearchParams());
    return index;
  }

 private:
  // What the library asks of a set of points.
  struct Cloud {
    std::span<const glm::dvec3> points;
    size_t kdtree_get_point_count() const { return points.size(); }
    double kdtree_get_pt(size_t index, size_t axis) const { return points[index][static_cast<glm::length_t>(axis)]; }
    template <class Box>
    bool kdtree_get_bbox(Box&) const { return false; }
  };
  Cloud cloud_;
  nanoflann::KDTreeSingleIndexAdaptor<nanoflann::L2_Simple_Adaptor<double, Cloud>, Cloud, 3, size_t> tree_;
};

// A mesh ready to be asked.
struct Side {
  explicit Side(const MeshView& mesh)
      : vertices(mesh.vertices), surface(mesh.vertices, mesh.triangles), nearest(mesh.vertices),
        normals(vertex_normals({mesh.vertices.begin(), mesh.vertices.end()}, {mesh.triangles.begin(), mesh.triangles.end()})) {}

  std::span<const glm::dvec3> vertices;
  MeshDistance surface;  // first: it refuses what is no mesh
  NearestVertex nearest;
  std::vector<glm::dvec3> normals;
};

DirectedMeshMetrics directed(const Side& from, const Side& to) {
  const double share = 1 / double(from.vertices.size());
  DirectedMeshMetrics result;
  for (size_t i = 0; i < from.vertices.size(); ++i) {
    const size_t j = to.nearest.of(from.vertices[i]);
    const double to_vertex = glm::distance(from.vertices[i], to.vertices[j]), along = glm::dot(from.normals[i], to.normals[j]);
    const double to_surface = std::abs(to.surface.closest(from.vertices[i]).signed_distance);
    result.to_surface.push_back(to_surface);
    result.vertex_squared += share * to_vertex * to_vertex;
    result.vertex_mean += share * to_vertex;
    result.surface_mean += share * to_surface;
    result.surface_squared += share * to_surface * to_surface;
    result.surface_max = std::max(result.surface_max, to_surface);
    result.normals += share * along;
    result.normals_unsigned += share * std::abs(along);
    result.normals_apart += share * glm::distance(from.normals[i], to.normals[j]);
  }
  return result;
}

}  // namespace

double DirectedMeshMetrics::share_within(double metres) const {
  return double(std::count_if(to_surface.begin(), to_surface.end(), [&](double d) { return d <= metres; })) / double(to_surface.size());
}

double MeshMetrics::f_score(double metres) const {
  const double precision = to_truth.share_within(metres), recall = to_prediction.share_within(metres);
  return precision + recall > 0 ? 2 * precision * recall / (precision + recall) : 0;
}

MeshMetrics mesh_metrics(const MeshView& prediction, const MeshView& truth) {
  const Side predicted(prediction), real(truth);
  return {directed(predicted, real), directed(real, predicted)};
}

}  // namespace arah

#include "host/body/mesh_distance.h"

#include <embree3/rtcore.h>

#include <cmath>
#include <glm/geometric.hpp>
#include <stdexcept>

namespace arah {

struct MeshDistance::Scene {
  RTCDevice device = nullptr;
  RTCScene scene = nullptr;
  std::vector<glm::dvec3> vertices;
  std::vector<glm::uvec3> triangles;

  ~Scene() {
    if (scene) rtcReleaseScene(scene);
    if (device) rtcReleaseDevice(device);
  }
};

namespace {

// Barycentric coordinates of the point of triangle abc that is closest to p: Ericson, Real-Time Collision Detection, §5.1.5
// (the region of p among vertices, edges and face decides).
glm::dvec3 closest_barycentric(const glm::dvec3& p, const glm::dvec3& a, const glm::dvec3& b, const glm::dvec3& c) {
  const auto part = [](double from, double length) { return length > 0 ? from / length : 0; };  // of an edge; of one without length its start
  const glm::dvec3 ab = b - a, ac = c - a, ap = p - a;
  const double d1 = glm::dot(ab, ap), d2 = glm::dot(ac, ap);
  if (d1 <= 0 && d2 <= 0) return {1, 0, 0};
  const glm::dvec3 bp = p - b;
  const double d3 = glm::dot(ab, bp), d4 = glm::dot(ac, bp);
  if (d3 >= 0 && d4 <= d3) return {0, 1, 0};
  const double vc = d1 * d4 - d3 * d2;
  if (vc <= 0 && d1 >= 0 && d3 <= 0) {
    const double v = part(d1, d1 - d3);
    return {1 - v, v, 0};
  }
  const glm::dvec3 cp = p - c;
  const double d5 = glm::dot(ab, cp), d6 = glm::dot(ac, cp);
  if (d6 >= 0 && d5 <= d6) return {0, 0, 1};
  const double vb = d5 * d2 - d1 * d6;
  if (vb <= 0 && d2 >= 0 && d6 <= 0) {
    const double w = part(d2, d2 - d6);
    return {1 - w, 0, w};
  }
  const double va = d3 * d6 - d5 * d4;
  if (va <= 0 && d4 - d3 >= 0 && d5 - d6 >= 0) {
    const double w = part(d4 - d3, (d4 - d3) + (d5 - d6));
    return {0, 1 - w, w};
  }
  const double total = va + vb + vc;
  if (!(total > 0)) return {1, 0, 0};  // a triangle without area
  return {va / total, vb / total, vc / total};
}

struct Query {
  const std::vector<glm::dvec3>* vertices;
  const std::vector<glm::uvec3>* triangles;
  glm::dvec3 point;
  ClosestPoint best;
  double best_distance = INFINITY;
};

bool visit(RTCPointQueryFunctionArguments* arguments) {
  Query& query = *static_cast<Query*>(arguments->userPtr);
  const glm::uvec3 t = (*query.triangles)[arguments->primID];
  const glm::dvec3 &a = (*query.vertices)[t.x], &b = (*query.vertices)[t.y], &c = (*query.vertices)[t.z];
  const glm::dvec3 weights = closest_barycentric(query.point, a, b, c);
  const glm::dvec3 position = weights.x * a + weights.y * b + weights.z * c;
  const double distance = glm::distance(position, query.point);
  if (distance >= query.best_distance) return false;
  query.best_distance = distance;
  query.best = {distance, position, arguments->primID, weights};
  arguments->query->radius = static_cast<float>(distance);
  return true;
}

}  // namespace

MeshDistance::MeshDistance(std::span<const glm::dvec3> vertices, std::span<const glm::uvec3> triangles) : scene_(std::make_unique<Scene>()) {
  if (vertices.empty() || triangles.empty()) throw std::invalid_argument("a mesh without vertices or triangles has no distance");
  for (const glm::uvec3& t : triangles)
    if (t.x >= vertices.size() || t.y >= vertices.size() || t.z >= vertices.size()) throw std::invalid_argument("a triangle names a vertex that does not exist");
  Scene& s = *scene_;
  s.vertices.assign(vertices.begin(), vertices.end());
  s.triangles.assign(triangles.begin(), triangles.end());
  s.device = rtcNewDevice("threads=1");
  if (!s.device) throw std::runtime_error("Embree does not start");
  s.scene = rtcNewScene(s.device);
  rtcSetSceneFlags(s.scene, RTC_SCENE_FLAG_ROBUST);
  RTCGeometry geometry = rtcNewGeometry(s.device, RTC_GEOMETRY_TYPE_TRIANGLE);
  auto* v = static_cast<float*>(rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, 12, s.vertices.size()));
  auto* t = static_cast<uint32_t*>(rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, 12, s.triangles.size()));
  for (size_t i = 0; i < s.vertices.size(); ++i)
    for (int k = 0; k < 3; ++k) v[3 * i + static_cast<size_t>(k)] = static_cast<float>(s.vertices[i][k]);
  for (size_t i = 0; i < s.triangles.size(); ++i)
    for (int k = 0; k < 3; ++k) t[3 * i + static_cast<size_t>(k)] = s.triangles[i][k];
  rtcSetGeometryPointQueryFunction(geometry, visit);
  rtcCommitGeometry(geometry);
  rtcAttachGeometry(s.scene, geometry);
  rtcReleaseGeometry(geometry);
  rtcCommitScene(s.scene);
}

MeshDistance::~MeshDistance() = default;

ClosestPoint MeshDistance::closest(const glm::dvec3& point) const {
  Query query{&scene_->vertices, &scene_->triangles, point, {}, INFINITY};
  RTCPointQuery box{static_cast<float>(point.x), static_cast<float>(point.y), static_cast<float>(point.z), 0, INFINITY};
  RTCPointQueryContext context;
  rtcInitPointQueryContext(&context);
  rtcPointQuery(scene_->scene, &box, &context, nullptr, &query);

  // No axis of the mesh's own symmetry, so that rays do not run along edges.
  static constexpr std::array<std::array<float, 3>, 3> directions{{{0.573f, 0.811f, 0.117f}, {-0.707f, 0.211f, 0.675f}, {0.134f, -0.519f, -0.844f}}};
  int inside = 0;
  for (const auto& d : directions) {
    RTCRayHit ray{};
    ray.ray = {box.x, box.y, box.z, 0, d[0], d[1], d[2], 0, INFINITY, ~0u, 0, 0};
    ray.hit.geomID = RTC_INVALID_GEOMETRY_ID;
    RTCIntersectContext intersect;
    rtcInitIntersectContext(&intersect);
    rtcIntersect1(scene_->scene, &intersect, &ray);
    if (ray.hit.geomID != RTC_INVALID_GEOMETRY_ID && ray.hit.Ng_x * d[0] + ray.hit.Ng_y * d[1] + ray.hit.Ng_z * d[2] > 0) ++inside;
  }
  if (inside >= 2) query.best.signed_distance = -query.best.signed_distance;
  return query.best;
}

}  // namespace arah

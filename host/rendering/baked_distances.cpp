#include "host/rendering/baked_distances.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <glm/common.hpp>

#include "host/body/canonical.h"
#include "host/rendering/surface_reach.h"
#include "host/rendering/template_distances.h"

namespace arah {
namespace {

constexpr int coarse_edge = 4;      // cells: two halvings
constexpr double rough_reach = 0.06;  // metres from the template: the network answers here; the shell ends at 5.5 cm

// Metres from the surface in full resolution: 10 b away the density is within e⁻¹⁰ of what it is far away. At most 1 cm, at least
// half a cell.
double full_band(const Avatar& avatar, double cell) { return std::clamp(10 * density_scale(avatar), cell / 2, std::max(0.01, cell / 2)); }

}  // namespace

BakedDistances::BakedDistances(Device& device, const Avatar& avatar, double cell) : device_(device), avatar_(avatar) {
  if (avatar.spec.sdf.kind == FieldKind::density) require_surface(avatar.spec, "baked distances and meshes");
  const std::vector<glm::dvec3> vertices = canonical_vertices(avatar.body, avatar.canonical);
  ShellGrid coarse = grid_around(vertices, rough_reach + coarse_edge * cell, coarse_edge * cell, 16e6 / (coarse_edge * coarse_edge * coarse_edge));
  rough_ = template_distances(coarse, vertices, avatar.body.triangles, rough_reach);
  coarse_nodes_ = glm::ivec3(coarse.nodes[0], coarse.nodes[1], coarse.nodes[2]);
  // Nodes that no vertex reaches lie deep inside or far outside. Along a line of nodes the side changes only within reach.
  for (size_t line = 0; line < size_t(coarse.nodes[1]) * coarse.nodes[2]; ++line) {
    float side = 1;
    for (uint32_t x = 0; x < coarse.nodes[0]; ++x) {
      float& distance = rough_[line * coarse.nodes[0] + x];
      if (distance < static_cast<float>(rough_reach)) side = distance < 0 ? -1.0f : 1.0f;
      else distance *= side;
    }
  }
  grid_ = coarse;
  grid_.cell = coarse.cell / coarse_edge;
  for (uint32_t& nodes : grid_.nodes) nodes = coarse_edge * (nodes - 1) + 1;
  samples_.low = {grid_.origin[0], grid_.origin[1], grid_.origin[2]};
  samples_.cell = grid_.cell;
  samples_.nodes = coarse_edge * (coarse_nodes_ - 1) + 1;
  distances_ = Buffer(device, "baked distances", padded_points(node_count(grid_)) * 4ull, BufferPlace::device);
}

void BakedDistances::make_room_for_points(uint32_t at_a_time) {
  if (points_.bytes() < padded_points(at_a_time) * 16ull) points_ = Buffer(device_, "baked distances: points asked for", padded_points(at_a_time) * 16ull, BufferPlace::device);
}

void BakedDistances::evaluate(Commands& commands, Field& field, const BufferSlice& frame, const std::vector<uint32_t>& nodes, const std::function<void()>& between) {
  const uint32_t room = field.capacity();
  make_room_for_points(room);
  const auto metres = static_cast<float>(avatar_.cube.metres_per_unit());
  for (size_t first = 0; first < nodes.size(); first += room) {
    if (between) between();
    const auto count = static_cast<uint32_t>(std::min<size_t>(room, nodes.size() - first));
    std::vector<std::array<float, 4>> points(padded_points(count), {0, 0, 0, 0});
    for (uint32_t i = 0; i < count; ++i) {
      const uint32_t node = nodes[first + i];
      const auto at = samples_.position(static_cast<int>(node % grid_.nodes[0]), static_cast<int>(node / grid_.nodes[0] % grid_.nodes[1]), static_cast<int>(node / (grid_.nodes[0] * grid_.nodes[1])));
      points[i] = {static_cast<float>(at.x), static_cast<float>(at.y), static_cast<float>(at.z), 1};
    }
    device_.upload(points_.slice(), points);
    const Matrix answer = field.record_distances(commands, frame, points_.slice(), count, false);
    commands.submit_and_wait();
    const std::vector<float> values = device_.download<float>(answer.slice.elements(0, uint64_t(count) * answer.stride));
    for (uint32_t i = 0; i < count; ++i) samples_.values[nodes[first + i]] = metres * values[size_t(i) * answer.stride + answer.column];
  }
  evaluated_ += nodes.size();
}

// Trilinear between the corners of the cell that begins at node `first`, where the network has not answered.
void BakedDistances::interpolate_cell(const glm::ivec3& first, int edge) {
  std::array<double, 8> corner{};  // number: x + 2 y + 4 z
  for (int i = 0; i < 8; ++i) corner[static_cast<size_t>(i)] = double{samples_.values[samples_.index(first.x + edge * (i & 1), first.y + edge * (i >> 1 & 1), first.z + edge * (i >> 2))]};
  for (int z = 0; z <= edge; ++z)
    for (int y = 0; y <= edge; ++y) {
      const double v = double(y) / edge, w = double(z) / edge;
      const double low = glm::mix(glm::mix(corner[0], corner[2], v), glm::mix(corner[4], corner[6], v), w);
      const double high = glm::mix(glm::mix(corner[1], corner[3], v), glm::mix(corner[5], corner[7], v), w);
      for (int x = 0; x <= edge; ++x) {
        const size_t node = samples_.index(first.x + x, first.y + y, first.z + z);
        if (!known_[node]) samples_.values[node] = static_cast<float>(glm::mix(low, high, double(x) / edge));
      }
    }
}

void BakedDistances::bake(Commands& commands, Field& field, const BufferSlice& frame, const std::function<void()>& between) {
  const uint32_t nodes = node_count(grid_);
  samples_.values.assign(nodes, 0);
  known_.assign(nodes, 0);
  evaluated_ = 0;
  std::vector<uint32_t> asked;
  const auto ask = [&](const glm::ivec3& at) {
    const size_t node = samples_.index(at.x, at.y, at.z);
    if (!known_[node]) asked.push_back(static_cast<uint32_t>(node));
    known_[node] = 1;
  };
  std::vector<glm::ivec3> cells;
  for (int z = 0; z < coarse_nodes_.z; ++z)
    for (int y = 0; y < coarse_nodes_.y; ++y)
      for (int x = 0; x < coarse_nodes_.x; ++x) {
        const float rough = rough_[static_cast<size_t>((z * coarse_nodes_.y + y) * coarse_nodes_.x + x)];
        const glm::ivec3 at = coarse_edge * glm::ivec3(x, y, z);
        samples_.values[samples_.index(at.x, at.y, at.z)] = rough;
        if (std::abs(rough) < static_cast<float>(rough_reach)) ask(at);
        if (x + 1 < coarse_nodes_.x && y + 1 < coarse_nodes_.y && z + 1 < coarse_nodes_.z) cells.push_back(at);
      }
  evaluate(commands, field, frame, asked, between);
  for (const glm::ivec3& cell : cells) interpolate_cell(cell, coarse_edge);

  for (int edge = coarse_edge; edge > 1; edge /= 2) {
    const int half = edge / 2;
    // Of a corner. Between corners the distance falls below theirs by the field's curvature, h²/8 of it: a quarter of an edge h about
    // a finger whose radius is half of one. And no surface may be missed.
    const double h = edge * samples_.cell, band = full_band(avatar_, samples_.cell) + h / 2;
    std::vector<glm::ivec3> finer;
    asked.clear();
    for (const glm::ivec3& cell : cells) {
      std::array<double, 8> corners{};
      for (int i = 0; i < 8; ++i) corners[static_cast<size_t>(i)] = double{samples_.values[samples_.index(cell.x + edge * (i & 1), cell.y + edge * (i >> 1 & 1), cell.z + edge * (i >> 2))]};
      const double near = std::max(band, surface_reach(corners, h));
      if (std::none_of(corners.begin(), corners.end(), [near](double distance) { return std::abs(distance) < near; })) continue;
      for (int i = 0; i < 27; ++i) ask(cell + half * glm::ivec3(i % 3, i / 3 % 3, i / 9));
      for (int i = 0; i < 8; ++i) finer.push_back(cell + half * glm::ivec3(i & 1, i >> 1 & 1, i >> 2));
    }
    evaluate(commands, field, frame, asked, between);
    if (half > 1)
      for (const glm::ivec3& cell : finer) interpolate_cell(cell, half);
    cells = std::move(finer);
  }

  std::vector<float> in_units(samples_.values);
  const auto units = static_cast<float>(1 / avatar_.cube.metres_per_unit());
  for (float& value : in_units) value *= units;
  in_units.resize(padded_points(nodes), 0);
  device_.upload(distances_.slice(), in_units);
}

}  // namespace arah

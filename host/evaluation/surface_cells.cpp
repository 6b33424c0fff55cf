#include "host/evaluation/surface_cells.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <glm/common.hpp>
#include <stdexcept>
#include <unordered_map>
#include <unordered_set>

#include "host/rendering/surface_reach.h"
#include "kernels/meshing/marching_cubes.h"

namespace arah {
namespace {

constexpr double rough_cells_to_trust = 2;  // from the level: there the rough field's own error, h² / 8R, cannot bring it

// A place of the finest grid as one number; grids have fewer than 2²¹ nodes along an axis. Its order is x first, z last.
uint64_t key_of(const glm::ivec3& at) { return static_cast<uint64_t>(at.z) << 42 | static_cast<uint64_t>(at.y) << 21 | static_cast<uint64_t>(at.x); }
glm::ivec3 place_of(uint64_t key) { return {static_cast<int>(key & 0x1fffff), static_cast<int>(key >> 21 & 0x1fffff), static_cast<int>(key >> 42)}; }
glm::ivec3 corner_of(int i) { return {i & 1, i >> 1 & 1, i >> 2}; }

class Refinement {
 public:
  Refinement(const FieldSamples<float>& rough, int halvings, double level, const DistancesAt& distances)
      : rough_(rough), scale_(1 << halvings), level_(level), distances_(distances), last_(scale_ * (rough.nodes - 1)), cell_(rough.cell / scale_) {}

  SurfaceCells run() {
    std::vector<glm::ivec3> cells;
    for (int z = 0; z + 1 < rough_.nodes.z; ++z)
      for (int y = 0; y + 1 < rough_.nodes.y; ++y)
        for (int x = 0; x + 1 < rough_.nodes.x; ++x) {
          const glm::ivec3 cell = scale_ * glm::ivec3(x, y, z);
          if (!may_reach(scale_, [&](int i) {
                const glm::ivec3 node = glm::ivec3(x, y, z) + corner_of(i);
                return of_node(scale_ * node, double{rough_.values[rough_.index(node.x, node.y, node.z)]} - level_);
              }))
            continue;
          for (int i = 0; i < 8; ++i) ask(cell + scale_ * corner_of(i), true);
          cells.push_back(cell);
        }
    answer();
    for (int edge = scale_; edge > 1; edge /= 2) {
      const int half = edge / 2;
      for (const glm::ivec3& cell : cells)
        for (int i = 0; i < 27; ++i) ask(cell + half * glm::ivec3(i % 3, i / 3 % 3, i / 9), true);
      answer();
      std::vector<glm::ivec3> finer;
      for (const glm::ivec3& cell : cells)
        for (int i = 0; i < 8; ++i) {
          const glm::ivec3 part = cell + half * corner_of(i);
          if (may_reach(half, [&](int k) { return double{values_.at(key_of(part + half * corner_of(k)))}; })) finer.push_back(part);
        }
      cells = std::move(finer);
    }
    return gathered(closed(std::move(cells)));
  }

 private:
  // Whether the level may lie in a cube of that edge with such values at its corners. Of the finest cubes, whether they show it.
  template <typename Values>
  bool may_reach(int edge, const Values& at) const {
    std::array<double, 8> corners{};
    for (int i = 0; i < 8; ++i) corners[static_cast<size_t>(i)] = at(i);
    if (edge == 1) {
      const auto inside = std::count_if(corners.begin(), corners.end(), [](double value) { return value < 0; });
      return inside > 0 && inside < 8;
    }
    const double near = surface_reach(corners, edge * cell_);
    return std::any_of(corners.begin(), corners.end(), [near](double value) { return std::abs(value) < near; });
  }

  double of_node(const glm::ivec3& node, double value) const {
    const bool on_face = node.x == 0 || node.y == 0 || node.z == 0 || node.x == last_.x || node.y == last_.y || node.z == last_.z;
    return on_face ? std::max(value, cell_) : value;
  }

  // trusted: the level may be near, so that the rough field does not do between its nodes.
  void ask(const glm::ivec3& node, bool trusted) {
    const auto [entry, is_new] = values_.try_emplace(key_of(node), 0.0f);
    if (!is_new) return;
    const glm::ivec3 coarse = node / scale_;
    if (coarse * scale_ == node) {
      entry->second = static_cast<float>(of_node(node, double{rough_.values[rough_.index(coarse.x, coarse.y, coarse.z)]} - level_));
      return;
    }
    if (!trusted) {
      const double value = rough_.between(position(node)) - level_;
      if (std::abs(value) > rough_cells_to_trust * rough_.cell) {
        entry->second = static_cast<float>(of_node(node, value));
        return;
      }
    }
    asked_.push_back(node);
  }

  void answer() {
    std::vector<glm::dvec3> points;
    for (const glm::ivec3& node : asked_) points.push_back(position(node));
    const std::vector<double> found = points.empty() ? std::vector<double>{} : distances_(points);
    for (size_t i = 0; i < found.size(); ++i) {
      if (!std::isfinite(found[i])) throw std::runtime_error(fmt::format("the signed distance at canonical ({:.4f}, {:.4f}, {:.4f}) m is {}: no surface can be meshed", points[i].x, points[i].y, points[i].z, found[i]));
      values_[key_of(asked_[i])] = static_cast<float>(of_node(asked_[i], found[i] - level_));
    }
    evaluated_ += found.size();
    asked_.clear();
  }

  // With every cube beside a face that the surface crosses, in the nodes' order.
  std::vector<uint64_t> closed(std::vector<glm::ivec3> cells) {
    std::unordered_set<uint64_t> known;
    for (const glm::ivec3& cell : cells) known.insert(key_of(cell));
    while (!cells.empty()) {
      std::vector<glm::ivec3> beside;
      for (const glm::ivec3& cell : cells)
        for (int axis = 0; axis < 3; ++axis)
          for (const int side : {0, 1}) {
            int inside = 0;
            for (int i = 0; i < 8; ++i)
              if ((i >> axis & 1) == side) inside += values_.at(key_of(cell + corner_of(i))) < 0;
            if (inside == 0 || inside == 4) continue;
            glm::ivec3 other = cell;
            other[axis] += side == 0 ? -1 : 1;
            if (known.insert(key_of(other)).second) beside.push_back(other);
          }
      for (const glm::ivec3& cell : beside)
        for (int i = 0; i < 8; ++i) ask(cell + corner_of(i), false);
      answer();
      cells = std::move(beside);
    }
    std::vector<uint64_t> keys(known.begin(), known.end());
    std::sort(keys.begin(), keys.end());
    return keys;
  }

  SurfaceCells gathered(const std::vector<uint64_t>& keys) const {
    SurfaceCells result;
    result.cell = cell_;
    result.evaluated = evaluated_;
    std::unordered_map<uint64_t, uint32_t> numbers;
    for (const uint64_t key : keys) {
      auto& corners = result.corners.emplace_back();
      for (int i = 0; i < 8; ++i) {
        const glm::ivec3 node = place_of(key) + corner_of(i);
        const auto [entry, is_new] = numbers.try_emplace(key_of(node), static_cast<uint32_t>(result.nodes.size()));
        corners[static_cast<size_t>(i)] = entry->second;
        if (!is_new) continue;
        const glm::vec3 p(position(node));
        result.nodes.push_back({p.x, p.y, p.z, values_.at(key_of(node))});
      }
    }
    return result;
  }

  glm::dvec3 position(const glm::ivec3& node) const { return rough_.low + cell_ * glm::dvec3(node); }

  const FieldSamples<float>& rough_;
  int scale_;  // finest cubes along a rough one
  double level_;
  const DistancesAt& distances_;
  glm::ivec3 last_;  // node of the box
  double cell_;
  std::unordered_map<uint64_t, float> values_;  // by node, to the level
  std::vector<glm::ivec3> asked_;
  uint64_t evaluated_ = 0;
};

}  // namespace

std::vector<uint32_t> SurfaceCells::cell_of_node() const {
  std::vector<uint32_t> cells(nodes.size(), no_cell);
  for (uint32_t c = 0; c < corners.size(); ++c) cells[corners[c][0]] = c;
  return cells;
}

SurfaceCells surface_cells(const FieldSamples<float>& rough, int halvings, double level, const DistancesAt& distances) { return Refinement(rough, halvings, level, distances).run(); }

}  // namespace arah

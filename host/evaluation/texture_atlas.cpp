#include "host/evaluation/texture_atlas.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <glm/geometric.hpp>
#include <limits>
#include <map>
#include <stdexcept>
#include <unordered_set>

#include "host/input_error.h"

namespace arah {
namespace {

constexpr std::uint32_t no_triangle = 0xffffffff;
constexpr int chart_margin = 3;            // texels around each chart: two bilinear footprints, and one more for half-size versions
constexpr double edge_reach = 1.5;        // texels: colours beyond a chart's edge that filters read
constexpr int label_rounds = 4;
constexpr double least_facing = 0.35;  // cosine: what a triangle may be turned from the way of its chart to even out borders
constexpr double well_filled = 0.6, small_chart = 0.05;  // of a chart's box by its triangles; metres
constexpr std::size_t few_triangles = 24;

struct Chart {
  std::vector<std::uint32_t> triangles;
  int way = 0;                                  // axis · 2 + 1 for the negative side
  glm::dvec2 along{1, 0}, low{0.0}, high{0.0};  // its long side in the projection, its box turned so, metres
  glm::ivec2 place{0};                          // of the box's corner in the picture, texels
};

double facing(const glm::dvec3& normal, int way) { return (way & 1 ? -1 : 1) * normal[way / 2]; }

// The other two axes, so that the projection keeps triangles counter-clockwise.
glm::dvec2 projected(const glm::dvec3& p, int way) {
  const int axis = way / 2, u = (axis + 1) % 3, v = (axis + 2) % 3;
  return way & 1 ? glm::dvec2(p[v], p[u]) : glm::dvec2(p[u], p[v]);
}

glm::dvec2 turned(const glm::dvec2& p, const glm::dvec2& along) { return {along.x * p.x + along.y * p.y, along.x * p.y - along.y * p.x}; }

double cross(const glm::dvec2& a, const glm::dvec2& b) { return a.x * b.y - a.y * b.x; }

// Neighbours across each triangle's three edges (k: corner k to k + 1).
std::vector<std::array<std::uint32_t, 3>> edge_neighbours(const TriangleMesh& mesh) {
  std::map<std::pair<std::uint32_t, std::uint32_t>, std::uint32_t> owner;  // by directed edge
  const auto edge = [&](std::uint32_t t, int k) { return std::pair(mesh.triangles[t][k], mesh.triangles[t][(k + 1) % 3]); };
  for (std::uint32_t t = 0; t < mesh.triangles.size(); ++t)
    for (int k = 0; k < 3; ++k) owner[edge(t, k)] = t;
  std::vector<std::array<std::uint32_t, 3>> neighbours(mesh.triangles.size());
  for (std::uint32_t t = 0; t < mesh.triangles.size(); ++t)
    for (int k = 0; k < 3; ++k) {
      const auto found = owner.find({edge(t, k).second, edge(t, k).first});
      neighbours[t][static_cast<std::size_t>(k)] = found == owner.end() ? no_triangle : found->second;
    }
  return neighbours;
}

// The way that each triangle faces, evened out so that borders are short.
std::vector<int> ways(const TriangleMesh& mesh, const std::vector<std::array<std::uint32_t, 3>>& neighbours) {
  const std::vector<glm::dvec3> smooth = vertex_normals(mesh.vertices, mesh.triangles);
  std::vector<glm::dvec3> normals;
  std::vector<int> labels;
  for (const glm::uvec3& t : mesh.triangles) {
    const glm::dvec3 area = glm::cross(mesh.vertices[t.y] - mesh.vertices[t.x], mesh.vertices[t.z] - mesh.vertices[t.x]);
    const double length = glm::length(area);
    normals.push_back(length > 0 ? area / length : smooth[t.x]);
    const auto nearest = [](const glm::dvec3& n) {
      int best = 0;
      for (int way = 1; way < 6; ++way)
        if (facing(n, way) > facing(n, best)) best = way;
      return best;
    };
    const int by_smooth = nearest(smooth[t.x] + smooth[t.y] + smooth[t.z]);
    labels.push_back(facing(normals.back(), by_smooth) > least_facing ? by_smooth : nearest(normals.back()));
  }
  for (int round = 0; round < label_rounds; ++round) {
    const std::vector<int> before = labels;
    for (std::size_t t = 0; t < labels.size(); ++t) {
      std::array<int, 6> count{};
      for (const std::uint32_t n : neighbours[t])
        if (n != no_triangle) ++count[static_cast<std::size_t>(before[n])];
      const auto most = static_cast<int>(std::max_element(count.begin(), count.end()) - count.begin());
      if (most != before[t] && count[static_cast<std::size_t>(most)] >= 2 && facing(normals[t], most) > least_facing) labels[t] = most;
    }
  }
  return labels;
}

// Visits the whole places (x, y) of the triangle's box grown by `grow`.
template <typename Visit>
void cover(const std::array<glm::dvec2, 3>& p, double grow, const Visit& visit) {
  const glm::dvec2 low = glm::min(glm::min(p[0], p[1]), p[2]) - grow, high = glm::max(glm::max(p[0], p[1]), p[2]) + grow;
  for (int y = static_cast<int>(std::floor(low.y)); y <= static_cast<int>(std::ceil(high.y)); ++y)
    for (int x = static_cast<int>(std::floor(low.x)); x <= static_cast<int>(std::ceil(high.x)); ++x) visit(x, y);
}

// Barycentric coordinates of the place of the triangle nearest to q, and its distance.
std::pair<glm::dvec3, double> nearest_place(const std::array<glm::dvec2, 3>& p, const glm::dvec2& q) {
  const double area = cross(p[1] - p[0], p[2] - p[0]);
  if (area > 0) {
    const glm::dvec3 b(cross(p[1] - q, p[2] - q) / area, cross(p[2] - q, p[0] - q) / area, cross(p[0] - q, p[1] - q) / area);
    if (b.x >= 0 && b.y >= 0 && b.z >= 0) return {b, 0};
  }
  std::pair<glm::dvec3, double> best{glm::dvec3(1, 0, 0), std::numeric_limits<double>::infinity()};
  for (int k = 0; k < 3; ++k) {
    const glm::dvec2 &a = p[static_cast<std::size_t>(k)], side = p[static_cast<std::size_t>((k + 1) % 3)] - a;
    const double squared = glm::dot(side, side), t = squared > 0 ? std::clamp(glm::dot(q - a, side) / squared, 0.0, 1.0) : 0.0;
    const double distance = glm::length(q - a - t * side);
    if (distance >= best.second) continue;
    best.second = distance;
    best.first = glm::dvec3(0.0);
    best.first[k] = 1 - t;
    best.first[(k + 1) % 3] = t;
  }
  return best;
}

std::array<glm::dvec2, 3> corners(const TriangleMesh& mesh, std::uint32_t triangle, int way) {
  std::array<glm::dvec2, 3> p;
  for (int k = 0; k < 3; ++k) p[static_cast<std::size_t>(k)] = projected(mesh.vertices[mesh.triangles[triangle][k]], way);
  return p;
}

// Connected triangles of one way, none of which lies over another in the projection: what would, begins another chart.
std::vector<Chart> connected_charts(const TriangleMesh& mesh, const std::vector<std::array<std::uint32_t, 3>>& neighbours, const std::vector<int>& labels) {
  double edges = 0;
  for (const glm::uvec3& t : mesh.triangles) edges += glm::distance(mesh.vertices[t.x], mesh.vertices[t.y]) / double(mesh.triangles.size());
  const double place = edges / 4;  // where two triangles could meet is looked at this finely, metres
  std::vector<Chart> charts;
  std::vector<bool> taken(mesh.triangles.size(), false);
  for (std::uint32_t seed = 0; seed < mesh.triangles.size(); ++seed) {
    if (taken[seed]) continue;
    Chart chart;
    chart.way = labels[seed];
    std::unordered_set<std::uint64_t> occupied;
    std::vector<std::uint32_t> queue{seed};
    taken[seed] = true;
    std::vector<std::uint32_t> over;  // left for other charts
    for (std::size_t next = 0; next < queue.size(); ++next) {
      const std::uint32_t t = queue[next];
      std::array<glm::dvec2, 3> p = corners(mesh, t, chart.way);
      for (glm::dvec2& corner : p) corner /= place;
      std::vector<std::uint64_t> inside;
      bool free = true;
      const double area = cross(p[1] - p[0], p[2] - p[0]);
      cover(p, 0, [&](int x, int y) {
        const glm::dvec2 q(x, y);
        for (std::size_t k = 0; k < 3; ++k)
          if (cross(p[(k + 1) % 3] - p[k], q - p[k]) <= 1e-9 * area) return;
        inside.push_back(static_cast<std::uint64_t>(static_cast<std::uint32_t>(x)) << 32 | static_cast<std::uint32_t>(y));
        free = free && !occupied.contains(inside.back());
      });
      if (!free) {
        over.push_back(t);
        continue;
      }
      occupied.insert(inside.begin(), inside.end());
      chart.triangles.push_back(t);
      for (const std::uint32_t n : neighbours[t])
        if (n != no_triangle && !taken[n] && labels[n] == chart.way) taken[n] = true, queue.push_back(n);
    }
    for (const std::uint32_t t : over) taken[t] = false;  // all after the seed: they become seeds in turn
    charts.push_back(std::move(chart));
  }
  return charts;
}

// Its long side along x, and its box.
void turn(const TriangleMesh& mesh, Chart& chart) {
  glm::dvec2 mean(0.0);
  double xx = 0, xy = 0, yy = 0;
  std::vector<glm::dvec2> middles;
  for (const std::uint32_t t : chart.triangles) {
    const std::array<glm::dvec2, 3> p = corners(mesh, t, chart.way);
    middles.push_back((p[0] + p[1] + p[2]) / 3.0);
    mean += middles.back() / double(chart.triangles.size());
  }
  for (const glm::dvec2& m : middles) {
    const glm::dvec2 d = m - mean;
    xx += d.x * d.x, xy += d.x * d.y, yy += d.y * d.y;
  }
  const double angle = 0.5 * std::atan2(2 * xy, xx - yy);
  chart.along = {std::cos(angle), std::sin(angle)};
  chart.low = glm::dvec2(std::numeric_limits<double>::infinity());
  chart.high = -chart.low;
  for (const std::uint32_t t : chart.triangles)
    for (const glm::dvec2& p : corners(mesh, t, chart.way)) {
      const glm::dvec2 q = turned(p, chart.along);
      chart.low = glm::min(chart.low, q);
      chart.high = glm::max(chart.high, q);
    }
}

// Adds the chart, or its two halves, and theirs.
void add_filled(const TriangleMesh& mesh, Chart chart, std::vector<Chart>& filled) {
  turn(mesh, chart);
  const glm::dvec2 box = chart.high - chart.low;
  double area = 0;
  for (const std::uint32_t t : chart.triangles) {
    const std::array<glm::dvec2, 3> p = corners(mesh, t, chart.way);
    area += std::abs(cross(p[1] - p[0], p[2] - p[0])) / 2;
  }
  const int side = box.x >= box.y ? 0 : 1;
  if (chart.triangles.size() > few_triangles && box[side] > small_chart && area < well_filled * box.x * box.y) {
    Chart halves[2];
    for (const std::uint32_t t : chart.triangles) {
      const std::array<glm::dvec2, 3> p = corners(mesh, t, chart.way);
      const double middle = turned((p[0] + p[1] + p[2]) / 3.0, chart.along)[side];
      halves[middle < 0.5 * (chart.low[side] + chart.high[side]) ? 0 : 1].triangles.push_back(t);
    }
    if (!halves[0].triangles.empty() && !halves[1].triangles.empty()) {
      for (Chart& half : halves) {
        half.way = chart.way;
        add_filled(mesh, std::move(half), filled);
      }
      return;
    }
  }
  filled.push_back(std::move(chart));
}

glm::ivec2 box_texels(const Chart& chart, double scale) {
  const glm::dvec2 box = scale * (chart.high - chart.low);
  return glm::ivec2(static_cast<int>(std::ceil(box.x)), static_cast<int>(std::ceil(box.y))) + 2 * chart_margin + 1;
}

// Rows of charts, the highest first; whether all fit.
bool pack(std::vector<Chart>& charts, double scale, int size) {
  std::vector<std::size_t> order(charts.size());
  for (std::size_t i = 0; i < order.size(); ++i) order[i] = i;
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) { return box_texels(charts[a], scale).y > box_texels(charts[b], scale).y; });
  int x = 0, y = 0, row = 0;
  for (const std::size_t i : order) {
    const glm::ivec2 box = box_texels(charts[i], scale);
    if (box.x > size) return false;
    if (x + box.x > size) x = 0, y += row, row = 0;
    row = std::max(row, box.y);
    if (y + row > size) return false;
    charts[i].place = {x, y};
    x += box.x;
  }
  return true;
}

}  // namespace

TextureAtlas make_texture_atlas(const TriangleMesh& mesh, int size) {
  if (mesh.triangles.empty() || size < 16 || size > 16384) throw std::invalid_argument(fmt::format("a texture of {} texels for {} triangles", size, mesh.triangles.size()));
  const auto neighbours = edge_neighbours(mesh);
  std::vector<Chart> charts;
  for (Chart& chart : connected_charts(mesh, neighbours, ways(mesh, neighbours))) add_filled(mesh, std::move(chart), charts);

  double fits = 0, too_much = 1e7;  // texels per metre
  for (int step = 0; step < 60; ++step) {
    const double scale = fits > 0 ? 0.5 * (fits + too_much) : too_much / 2;
    (pack(charts, scale, size) ? fits : too_much) = scale;
    if (fits > 0 && too_much / fits < 1.001) break;
  }
  if (!(fits > 0) || !pack(charts, fits, size))
    throw InputError("texture size", "", fmt::format("room for the {} charts of the mesh", charts.size()), fmt::format("{} texels", size), "A larger texture, larger cells or vertex colours will do.");

  TextureAtlas atlas;
  atlas.size = size;
  atlas.charts = charts.size();
  atlas.texels_per_metre = fits;
  atlas.triangles.resize(mesh.triangles.size());
  std::vector<double> distances(static_cast<std::size_t>(size) * static_cast<std::size_t>(size), std::numeric_limits<double>::infinity());
  std::vector<std::uint32_t> texel_of(distances.size(), no_triangle);
  for (const Chart& chart : charts) {
    std::map<std::uint32_t, std::uint32_t> copies;
    const auto placed = [&](std::uint32_t vertex) {
      return glm::dvec2(chart.place) + double(chart_margin) + 0.5 + fits * (turned(projected(mesh.vertices[vertex], chart.way), chart.along) - chart.low);
    };
    for (const std::uint32_t t : chart.triangles) {
      std::array<glm::dvec2, 3> p;
      for (int k = 0; k < 3; ++k) {
        const std::uint32_t vertex = mesh.triangles[t][k];
        p[static_cast<std::size_t>(k)] = placed(vertex);
        const auto [copy, fresh] = copies.try_emplace(vertex, static_cast<std::uint32_t>(atlas.vertices.size()));
        if (fresh) {
          atlas.vertices.push_back(vertex);
          atlas.uvs.emplace_back(p[static_cast<std::size_t>(k)] / double(size));
        }
        atlas.triangles[t][k] = copy->second;
      }
      for (glm::dvec2& corner : p) corner -= 0.5;  // texel (x, y) has its centre at x + ½
      cover(p, edge_reach, [&](int x, int y) {
        if (x < chart.place.x || y < chart.place.y || x >= size || y >= size) return;
        const auto [barycentric, distance] = nearest_place(p, {x, y});
        const std::size_t pixel = static_cast<std::size_t>(y) * static_cast<std::size_t>(size) + static_cast<std::size_t>(x);
        if (distance > edge_reach || distance >= distances[pixel]) return;
        distances[pixel] = distance;
        if (texel_of[pixel] == no_triangle) {
          texel_of[pixel] = static_cast<std::uint32_t>(atlas.texels.size());
          atlas.texels.emplace_back();
        }
        atlas.texels[texel_of[pixel]] = {static_cast<std::uint32_t>(pixel), t, glm::vec3(barycentric)};
      });
    }
  }
  return atlas;
}

std::vector<float> atlas_picture(const TextureAtlas& atlas, std::span<const glm::vec3> colors) {
  if (colors.size() != atlas.texels.size()) throw std::invalid_argument(fmt::format("{} colours for {} texels", colors.size(), atlas.texels.size()));
  const auto size = static_cast<std::size_t>(atlas.size);
  std::vector<float> picture(3 * size * size, 0.0f);
  std::vector<std::uint32_t> front;
  std::vector<bool> known(size * size, false);
  for (std::size_t i = 0; i < colors.size(); ++i) {
    const std::uint32_t pixel = atlas.texels[i].pixel;
    for (int c = 0; c < 3; ++c) picture[3 * std::size_t{pixel} + static_cast<std::size_t>(c)] = colors[i][c];
    known[pixel] = true;
    front.push_back(pixel);
  }
  // Breadth first: each pixel takes the colour of the neighbour that reached it.
  for (std::size_t next = 0; next < front.size(); ++next) {
    const std::size_t pixel = front[next], x = pixel % size, y = pixel / size;
    const auto spread = [&](std::size_t to) {
      if (known[to]) return;
      known[to] = true;
      std::copy_n(picture.begin() + static_cast<std::ptrdiff_t>(3 * pixel), 3, picture.begin() + static_cast<std::ptrdiff_t>(3 * to));
      front.push_back(static_cast<std::uint32_t>(to));
    };
    if (x > 0) spread(pixel - 1);
    if (x + 1 < size) spread(pixel + 1);
    if (y > 0) spread(pixel - size);
    if (y + 1 < size) spread(pixel + size);
  }
  return picture;
}

}  // namespace arah

// The search for the nearest vertex against brute force, and the vertex grid behind it.
#include "kernels/tracing/nearest_vertex.h"

#include <limits>

#include "kernels/reference/tracing.h"
#include "tests/kernels/skinning_scene.h"

namespace arah {
namespace {

using Points = std::vector<std::array<float, 3>>;

class NearestVertex : public DeviceTest {
 protected:
  // Shells of a few ellipsoids, like a body's parts, with every tenth vertex given twice.
  Points body(size_t count) {
    std::normal_distribution<double> normal;
    Points vertices;
    while (vertices.size() < count) {
      const size_t part = generator() % 3;
      double v[3] = {normal(generator), normal(generator), normal(generator)};
      const double length = std::sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
      const double radius[3][3] = {{0.2, 0.45, 0.12}, {0.7, 0.06, 0.05}, {0.09, 0.12, 0.1}}, height[3] = {0, 0.35, 0.7};
      std::array<float, 3> vertex;
      for (size_t i = 0; i < 3; ++i)
        vertex[i] = static_cast<float>(radius[part][i] * v[i] / length + (i == 1 ? height[part] : 0));
      vertices.push_back(vertex);
      if (vertices.size() % 10 == 0 && vertices.size() < count) vertices.push_back(vertices[vertices.size() / 2]);
    }
    return vertices;
  }

  struct Found {
    std::vector<uint32_t> nearest;
    std::vector<float> canonical;
  };

  // Searches for the points of `ids` (all, without).
  Found search(const Points& vertices, uint32_t cells, const Points& points, const std::vector<uint32_t>& ids = {}) {
    PosedVertices target;
    target.grid = build_vertex_grid(vertices, cells);
    Buffer sorted = filled("vertices", target.grid.vertices), starts = filled("cell start", target.grid.cell_start);
    Buffer seeds = filled("cell seed", target.grid.cell_seed), joint_words = filled("joints", joints_),
           weight_rows = filled("weights", weights_);
    target.vertices = sorted.slice(), target.cell_start = starts.slice(), target.cell_seed = seeds.slice();
    target.joints = joint_words.slice(), target.weights = weight_rows.slice();
    std::vector<double> flat;
    for (const auto& point : points) flat.insert(flat.end(), point.begin(), point.end());
    const FrameConstants constants = frame_constants({}, bones_);
    Buffer frame = filled("frame", std::vector<FrameConstants>{constants}),
           posed = filled("posed", padded_rows(flat, 3, 4));
    const uint32_t count = static_cast<uint32_t>(points.size());
    Buffer canonical = filled("canonical", std::vector<float>(padded_points(count) * 4, -7.0f));
    Buffer nearest = filled("nearest", std::vector<uint32_t>(padded_points(count), 99999));
    const uint32_t rows = ids.empty() ? count : static_cast<uint32_t>(ids.size());
    std::vector<uint32_t> padded_ids = ids;
    padded_ids.resize(padded_points(rows), 0);
    Buffer id_list = filled("ids", padded_ids), work = filled("work", std::vector<WorkCount>{work_of(rows)});
    Rows over{{rows, {}}, {}};
    if (!ids.empty()) over = {{rows, work.slice()}, id_list.slice()};
    record_nearest_vertex(commands, {over, frame.slice(), posed.slice(), target, canonical.slice(), nearest.slice()});
    commands.submit_and_wait();
    return {device.download<uint32_t>(nearest.slice()), device.download<float>(canonical.slice())};
  }

  void give_influences(size_t vertices) {
    for (size_t v = 0; v < vertices; ++v) {
      joints_.push_back(static_cast<uint32_t>(generator() % 24 | generator() % 24 << 8 | generator() % 24 << 16 |
                                              generator() % 24 << 24));
      for (const float weight : {0.5f, 0.25f, 0.15f, 0.0999f}) weights_.push_back(weight);  // not quite 1
    }
  }

  // Compares with brute force; of vertices that float32 cannot tell apart either one may be found.
  void expect_nearest(const Points& vertices, const Points& points, const Found& found, double tolerance = 1e-6) {
    std::vector<reference::Vector<3>> truth_vertices;
    for (const auto& v : vertices) truth_vertices.push_back({v[0], v[1], v[2]});
    size_t ties = 0;
    for (size_t p = 0; p < points.size(); ++p) {
      const reference::Vector<3> q{points[p][0], points[p][1], points[p][2]};
      const size_t truth = reference::nearest_vertex(q, truth_vertices);
      ASSERT_LT(found.nearest[p], vertices.size()) << p;
      const auto distance = [&](size_t v) {
        return std::hypot(q[0] - truth_vertices[v][0], q[1] - truth_vertices[v][1], q[2] - truth_vertices[v][2]);
      };
      if (found.nearest[p] != truth) {
        ++ties;
        EXPECT_NE(vertices[found.nearest[p]], vertices[truth])
            << "point " << p << ": of equal vertices the lowest index wins";
        EXPECT_NEAR(distance(found.nearest[p]), distance(truth), tolerance * (distance(truth) + 1e-3)) << p;
      }
      EXPECT_NEAR(found.canonical[4 * p + 3], distance(truth), tolerance * (distance(truth) + 1)) << p;
    }
    std::printf("  %zu points, %zu ties\n", points.size(), ties);
    EXPECT_LE(ties, points.size() / 200);
  }

  std::vector<double> bones_ = random_bones(generator, 24, 1.0);
  std::vector<uint32_t> joints_;
  std::vector<float> weights_;
};

TEST_F(NearestVertex, EqualsBruteForceAtEveryDistance) {
  const Points vertices = body(3000);
  give_influences(vertices.size());
  Points points;
  std::normal_distribution<double> normal;
  for (size_t i = 0; i < 1001; ++i) {
    const double away = std::vector<double>{0, 0.005, 0.05, 0.3, 2, 20}[i % 6];  // metres
    std::array<float, 3> point = vertices[generator() % vertices.size()];
    for (float& c : point) c += static_cast<float>(away * normal(generator));
    points.push_back(point);
  }
  for (const uint32_t cells : {1u, 40u, 64u}) expect_nearest(vertices, points, search(vertices, cells, points));
}

TEST_F(NearestVertex, MapsToCanonicalSpaceThroughTheVertexsInfluences) {
  const Points vertices = body(500);
  give_influences(vertices.size());
  Points points;
  for (size_t i = 0; i < 65; ++i) {
    const std::vector<float> q = uniform(3);
    points.push_back({q[0], q[1], q[2]});
  }
  const Found found = search(vertices, 20, points);
  std::vector<double> dense(vertices.size() * 24, 0.0), expected;
  std::vector<reference::Vector<3>> truth_vertices;
  std::vector<reference::Matrix<4>> transforms(24);
  for (size_t v = 0; v < vertices.size(); ++v) {
    truth_vertices.push_back({vertices[v][0], vertices[v][1], vertices[v][2]});
    for (uint32_t k = 0; k < 4; ++k) dense[v * 24 + (joints_[v] >> (8 * k) & 255)] += weights_[4 * v + k];
  }
  for (size_t i = 0; i < bones_.size(); ++i) transforms[i / 16][i / 4 % 4][i % 4] = bones_[i];
  for (const auto& q : points) {
    const auto truth = reference::template_correspondence({q[0], q[1], q[2]}, {truth_vertices, dense, transforms});
    expected.insert(expected.end(), truth.canonical.begin(), truth.canonical.end());
  }
  expect_all_near("canonical starts", rows_of(found.canonical, points.size(), 3, 4), expected, 1e-5);
}

TEST_F(NearestVertex, SmallAndFlatTemplates) {
  give_influences(200);
  Points plane, line, same;
  for (int i = 0; i < 200; ++i) {
    const std::vector<float> q = uniform(2);
    plane.push_back({q[0], q[1], 0.25f});
    line.push_back({0, q[0], 0});
    same.push_back({1, 2, 3});
  }
  Points points;
  for (int i = 0; i < 65; ++i) {
    const std::vector<float> q = uniform(3, -2, 2);
    points.push_back({q[0], q[1], q[2]});
  }
  for (const Points& vertices : {Points{{0.1f, 0.2f, 0.3f}}, plane, line, same})
    expect_nearest(vertices, points, search(vertices, 16, points));
}

TEST_F(NearestVertex, OnlyListedPointsAreWrittenAndBadOnesGetIndexZero) {
  const Points vertices = body(300);
  give_influences(vertices.size());
  const float nan = std::numeric_limits<float>::quiet_NaN(), infinity = std::numeric_limits<float>::infinity();
  Points points(100, {0.1f, 0.2f, 0.3f});
  points[3][1] = nan;
  points[5][2] = infinity;
  points[7] = {1e30f, -1e30f, 1e30f};
  const Found found = search(vertices, 30, points, {3, 5, 7, 99});
  EXPECT_EQ(found.nearest[3], 0u);
  EXPECT_EQ(found.nearest[5], 0u);
  EXPECT_TRUE(std::isnan(found.canonical[3 * 4]));
  EXPECT_LT(found.nearest[7], vertices.size());
  for (size_t p = 0; p < 100; ++p) {
    if (p == 3 || p == 5 || p == 7 || p == 99) continue;
    EXPECT_EQ(found.nearest[p], 99999u) << p;
    EXPECT_EQ(found.canonical[p * 4], -7) << p;
  }
}

TEST(VertexGrid, HoldsEveryVertexOnceAndSeedsEveryCell) {
  std::mt19937_64 generator(1);
  std::uniform_real_distribution<float> unit(-1, 1);
  Points vertices;
  for (int i = 0; i < 700; ++i)
    vertices.push_back({unit(generator), 0.3f * unit(generator) + 2, i < 350 ? 0.1f : 0.9f});
  const VertexGrid grid = build_vertex_grid(vertices, 25);
  std::vector<int> seen(vertices.size(), 0);
  EXPECT_EQ(grid.cell_start.size(), size_t(grid.cells[0]) * grid.cells[1] * grid.cells[2] + 1);
  EXPECT_EQ(grid.cell_start.back(), vertices.size());
  for (size_t cell = 0; cell + 1 < grid.cell_start.size(); ++cell) {
    EXPECT_LT(grid.cell_seed[cell], vertices.size()) << cell;
    for (uint32_t place = grid.cell_start[cell]; place < grid.cell_start[cell + 1]; ++place) {
      const auto& v = grid.vertices[place];
      ++seen[static_cast<size_t>(v[3])];
      const size_t at[3] = {cell % grid.cells[0], cell / grid.cells[0] % grid.cells[1],
                            cell / grid.cells[0] / grid.cells[1]};
      for (size_t i = 0; i < 3; ++i) {
        const float low = grid.origin[i] + grid.cell_size * static_cast<float>(at[i]);
        EXPECT_GE(v[i], low - 1e-5f);
        EXPECT_LE(v[i], low + grid.cell_size + 1e-5f);
      }
    }
  }
  for (const int times : seen) EXPECT_EQ(times, 1);
  EXPECT_THROW(build_vertex_grid({}), std::invalid_argument);
  EXPECT_THROW(build_vertex_grid(vertices, 65), std::invalid_argument);
  vertices[4][1] = std::numeric_limits<float>::quiet_NaN();
  EXPECT_THROW(build_vertex_grid(vertices), std::invalid_argument);
}

}  // namespace
}  // namespace arah

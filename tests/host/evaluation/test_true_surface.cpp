// The true surfaces of captures: what is written reads back, and files that lie about their sizes are refused cheaply.
#include "host/evaluation/true_surface.h"

#include <cmath>

#include "tests/host/body/memory_of_refusal.h"
#include "tests/host/body/python_files.h"
#include "tests/host/body/rigs.h"

namespace arah {
namespace {

std::string header(const std::string& vertices, const std::string& faces) {
  return "ply\nformat binary_little_endian 1.0\ncomment made up\nelement vertex " + vertices + "\nproperty float x\nproperty float y\nproperty float z\nelement face " + faces +
         "\nproperty list uchar int vertex_indices\nproperty uchar part\nend_header\n";
}
std::string places() { return python::raw<float>({0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1}); }
std::string face(const std::vector<std::int32_t>& corners, char part) { return std::string(1, static_cast<char>(corners.size())) + python::raw(corners) + part; }

TEST(TrueSurface, ReadsPolygonsAndTheirParts) {
  const TemporaryFolder folder;
  const TrueSurface surface = read_true_surface(folder.write("a.ply", header("4", "2") + places() + face({0, 1, 2, 3}, 1) + face({0, 1, 2}, 3)));
  EXPECT_EQ(surface.vertices[3], glm::dvec3(0, 0, 1));
  EXPECT_THAT(surface.triangles, testing::ElementsAre(glm::uvec3(0, 1, 2), glm::uvec3(0, 2, 3), glm::uvec3(0, 1, 2)));
  EXPECT_THAT(surface.without_hair, testing::Each(true));
  expect_input_error([&] { read_true_surface(folder.write("hair.ply", header("4", "1") + places() + face({0, 1, 2}, 3))); }, {"hair.ply", "faces that are not hair"});
}

TEST(TrueSurface, RefusesWhatIsDamagedOrHostile) {
  const TemporaryFolder folder;
  const std::string whole = header("4", "1") + places() + face({0, 1, 2}, 1);
  for (std::size_t size = 0; size < whole.size(); ++size) {
    expect_input_error([&] { read_true_surface(folder.write("cut.ply", whole.substr(0, size))); }, {"cut.ply"});
  }
  const auto refuse = [&](const std::string& content, const std::string& part) {
    const auto path = folder.write("bad.ply", content);
    expect_input_error([&] { read_true_surface(path); }, {"bad.ply", part});
    EXPECT_LT(memory_of_refusal([&] { read_true_surface(path); }), kMostMemoryOfRefusal);
  };
  for (const char* count : {"100000000", "18446744073709551615", "-1", "0", "many"}) {
    refuse(header(count, "1") + places() + face({0, 1, 2}, 1), "vertices and faces that");
    if (std::string(count) != "0") refuse(header("4", count) + places() + face({0, 1, 2}, 1), std::string(count) == "many" ? "not hair" : "vertices and faces that");
  }
  refuse(header("4", "1") + places() + face({0, 1, 4}, 1), "indices below 4, found 4");
  refuse(header("4", "1") + places() + face({0, 1, -1}, 1), "found -1");
  refuse(header("4", "1") + python::raw<float>({0, 0, 0, NAN, 0, 0, 0, 1, 0, 0, 0, 1}) + face({0, 1, 2}, 1), "finite places");
  refuse(std::string(50'000'000, 'x'), "a PLY");
}

}  // namespace
}  // namespace arah

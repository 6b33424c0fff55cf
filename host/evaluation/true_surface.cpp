#include "host/evaluation/true_surface.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <sstream>
#include <string>

#include "host/body/mapped_file.h"
#include "host/input_error.h"

namespace arah {
namespace {

static_assert(std::endian::native == std::endian::little, "meshes are read as they lie in the file");

constexpr std::uint8_t kHairPart = 3;
constexpr std::size_t kMostHeaderBytes = 1 << 14, kMostFileBytes = std::size_t{1} << 27;
constexpr std::size_t kVertexBytes = 12, kLeastFaceBytes = 2;  // three floats; a count of 0 corners and a part

}  // namespace

TrueSurface read_true_surface(const std::filesystem::path& path) {
  const auto refuse = [&](const std::string& expected, const std::string& found) { return InputError(path.string(), "", expected, found); };
  const MappedFile file(path, kMostFileBytes);
  const std::string_view bytes = file.bytes();
  constexpr std::string_view kEnd = "end_header\n";
  const std::size_t end = bytes.substr(0, kMostHeaderBytes).find(kEnd);
  std::size_t vertices = 0, faces = 0;
  std::string form;
  if (end != bytes.npos) {
    std::istringstream header{std::string(bytes.substr(0, end))};
    for (std::string line; std::getline(header, line);) {
      if (line.starts_with("comment")) continue;
      std::istringstream words(line);
      std::string word, what;
      words >> word >> what;
      if (word == "element") words >> (what == "vertex" ? vertices : faces);
      else form += line + ";";
    }
  }
  if (form != "ply;format binary_little_endian 1.0;property float x;property float y;property float z;property list uchar int vertex_indices;property uchar part;") {
    throw refuse("a PLY of binary_little_endian, float x y z and faces with a uchar part", "'" + form.substr(0, 200) + "'");
  }
  std::string_view rest = bytes.substr(end + kEnd.size());
  // Each count is compared with what there is before anything is made of it.
  if (vertices == 0 || vertices > rest.size() / kVertexBytes || faces > (rest.size() - vertices * kVertexBytes) / kLeastFaceBytes) {
    throw refuse(fmt::format("vertices and faces that {} bytes hold", rest.size()), fmt::format("{} and {}", vertices, faces));
  }
  const auto read = [&](void* to, std::size_t count) {
    if (count > rest.size()) throw refuse(fmt::format("{} vertices and {} faces", vertices, faces), "the file's end");
    std::memcpy(to, rest.data(), count);
    rest.remove_prefix(count);
  };
  TrueSurface surface;
  for (std::size_t v = 0; v < vertices; ++v) {
    std::array<float, 3> place;
    read(place.data(), kVertexBytes);
    surface.vertices.emplace_back(place[0], place[1], place[2]);
    if (!std::isfinite(place[0]) || !std::isfinite(place[1]) || !std::isfinite(place[2])) throw refuse("finite places", fmt::format("vertex {} at {}, {}, {}", v, place[0], place[1], place[2]));
  }
  surface.without_hair.resize(vertices, false);
  std::array<std::int32_t, 255> corners;
  for (std::size_t f = 0; f < faces; ++f) {
    std::uint8_t count = 0, part = 0;
    read(&count, 1);
    read(corners.data(), count * sizeof corners[0]);
    read(&part, 1);
    for (std::size_t k = 0; k < count; ++k) {
      const std::int32_t v = corners[k];
      if (v < 0 || static_cast<std::size_t>(v) >= vertices) throw refuse(fmt::format("indices below {}", vertices), fmt::format("{}", v));
      if (part != kHairPart) surface.without_hair[static_cast<std::size_t>(v)] = true;
    }
    for (std::size_t k = 2; k < count; ++k) surface.triangles.emplace_back(corners[0], corners[k - 1], corners[k]);
  }
  if (std::find(surface.without_hair.begin(), surface.without_hair.end(), true) == surface.without_hair.end()) throw refuse("faces that are not hair", "none");
  return surface;
}

}  // namespace arah

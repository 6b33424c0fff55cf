// How a surface cuts a cube, for each of the 256 ways in which its corners can lie inside or outside: worked out from one rule
// instead of a table that was typed in.
//
// Corner i lies at (i & 1, i >> 1 & 1, i >> 2); edge 4 axis + k begins at the k-th of the four corners that are low along that axis
// and runs along it. On each face the surface cuts off every run of inside corners by itself (corners that touch only across
// the face's diagonal stay apart). Both cubes of a face draw the same lines on it so, and the mesh closes.
#pragma once

#include <array>
#include <cstdint>

namespace arah {

// A vertex keeps so far from its edge's ends, in parts of the edge: no triangle loses its area where the surface meets a node.
inline constexpr double least_edge_part = 1.0 / 1024;

constexpr uint32_t cube_edge_corner(uint32_t edge) {
  const uint32_t axis = edge / 4, k = edge % 4;
  return axis == 0 ? 2 * k : axis == 1 ? (k & 1) | (k & 2) << 1 : k;
}
constexpr uint32_t cube_edge_axis(uint32_t edge) { return edge / 4; }
constexpr uint32_t cube_edge_between(uint32_t corner, uint32_t other) {
  const uint32_t low = corner < other ? corner : other, bit = corner ^ other;
  return bit == 1 ? low / 2 : bit == 2 ? 4 + ((low & 1) | (low & 4) >> 1) : 8 + low;
}

// The triangles by the edges that their corners lie on, counter-clockwise seen from outside: three edges each.
struct CubeCase {
  uint8_t triangles = 0;
  std::array<uint8_t, 15> edges{};
};

// Whether both edges bound one face: a line between places on them lies in that face.
constexpr bool cube_edges_share_face(uint32_t a, uint32_t b) {
  for (uint32_t axis = 0; axis < 3; ++axis) {
    if (cube_edge_axis(a) == axis || cube_edge_axis(b) == axis) continue;
    if ((cube_edge_corner(a) >> axis & 1) == (cube_edge_corner(b) >> axis & 1)) return true;
  }
  return false;
}

// inside: bit i for corner i.
constexpr CubeCase cube_case(uint32_t inside) {
  // The line from each edge that the surface crosses to the next, seen from outside counter-clockwise around the surface. Going around
  // a face as seen from outside the cube, it leads from where the walk enters the inside to where it leaves it.
  std::array<int, 12> next{};
  for (int& edge : next) edge = -1;
  for (uint32_t axis = 0; axis < 3; ++axis)
    for (uint32_t side = 0; side < 2; ++side) {
      const uint32_t u = 1u << (axis + 1) % 3, v = 1u << (axis + 2) % 3, base = side << axis;
      std::array<uint32_t, 4> ring{base, base | u, base | u | v, base | v};  // counter-clockwise seen from the high side
      if (side == 0) {
        ring[1] = base | v;
        ring[3] = base | u;
      }
      for (uint32_t i = 0; i < 4; ++i) {
        if (inside >> ring[i] & 1 || !(inside >> ring[(i + 1) % 4] & 1)) continue;
        uint32_t last = (i + 1) % 4;
        while (inside >> ring[(last + 1) % 4] & 1) last = (last + 1) % 4;
        next[cube_edge_between(ring[i], ring[(i + 1) % 4])] = static_cast<int>(cube_edge_between(ring[last], ring[(last + 1) % 4]));
      }
    }

  CubeCase result;
  std::array<bool, 12> done{};
  for (uint32_t first = 0; first < 12; ++first) {
    if (next[first] < 0 || done[first]) continue;
    std::array<uint32_t, 12> loop{};
    uint32_t count = 0;
    for (uint32_t edge = first; !done[edge]; edge = static_cast<uint32_t>(next[edge])) {
      done[edge] = true;
      loop[count++] = edge;
    }
    // A fan, from the corner whose diagonals lie in the fewest faces: there a neighbouring cube could draw the same line.
    uint32_t apex = 0, fewest = 12;
    for (uint32_t a = 0; a < count; ++a) {
      uint32_t in_faces = 0;
      for (uint32_t i = 2; i + 1 < count; ++i) in_faces += cube_edges_share_face(loop[a], loop[(a + i) % count]);
      if (in_faces < fewest) {
        fewest = in_faces;
        apex = a;
      }
    }
    for (uint32_t i = 1; i + 1 < count; ++i) {
      const uint32_t at = 3u * result.triangles++;
      result.edges[at] = static_cast<uint8_t>(loop[apex]);
      result.edges[at + 1] = static_cast<uint8_t>(loop[(apex + i) % count]);
      result.edges[at + 2] = static_cast<uint8_t>(loop[(apex + i + 1) % count]);
    }
  }
  return result;
}

constexpr std::array<CubeCase, 256> cube_cases() {
  std::array<CubeCase, 256> cases{};
  for (uint32_t inside = 0; inside < 256; ++inside) cases[inside] = cube_case(inside);
  return cases;
}

}  // namespace arah

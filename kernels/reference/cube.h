// The isotropic map between canonical metres and the cube [-1, 1]^3 that the networks read (ARAH.md section 1):
//   n(x) = 2 ((x - center) - minimum + 0.05 r) / (1.1 r) - 1   with r = maximum - minimum
#pragma once

#include <array>

namespace arah::reference {

using Vec3 = std::array<double, 3>;

struct Cube {
  Vec3 center{};        // mean of the canonical vertices, metres
  double minimum = -1;  // least and largest coordinate, over all axes, of the vertices about the center, metres
  double maximum = 1;

  double extent() const { return maximum - minimum; }
  // dn/dx, per metre. Its inverse turns an SDF in cube units into metres.
  double scale() const { return 2 / (1.1 * extent()); }
  Vec3 to_cube(const Vec3& x) const {
    Vec3 n;
    for (int i = 0; i < 3; ++i) n[i] = 2 * ((x[i] - center[i] - minimum + 0.05 * extent()) / (1.1 * extent())) - 1;
    return n;
  }
  Vec3 from_cube(const Vec3& n) const {
    Vec3 x;
    for (int i = 0; i < 3; ++i) x[i] = (n[i] / 2 + 0.5) * 1.1 * extent() + minimum - 0.05 * extent() + center[i];
    return x;
  }
};

}  // namespace arah::reference

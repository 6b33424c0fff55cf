#include "host/rendering/surface_reach.h"

#include <algorithm>
#include <cmath>

namespace arah {

double surface_reach(const std::array<double, 8>& corners, double edge) {
  std::array<double, 3> largest{};  // difference along each axis
  for (std::size_t i = 0; i < 8; ++i)
    for (std::size_t axis = 0; axis < 3; ++axis)
      if (!(i >> axis & 1)) largest[axis] = std::max(largest[axis], std::abs(corners[i | std::size_t{1} << axis] - corners[i]));
  return std::sqrt(3.0) / 2 * std::max(least_assumed_slope * edge, std::hypot(largest[0], largest[1], largest[2]));
}

}  // namespace arah

// Which cubes of a grid a surface may pass through, judged by the distances at their corners.
#pragma once

#include <array>

namespace arah {

// A network is a distance only nearly. Its slope between a cube's corners is taken for at least this, and for more where they differ by more.
inline constexpr double least_assumed_slope = 1.2;

// How far from 0 the nearest corner of a cube may be that the surface passes through: half the diagonal times the slope. corners: distances in
// metres, number x + 2 y + 4 z; edge: metres. The slope is measured: its component along an axis is the largest difference along the four edges that
// run there. So no cube is passed over whose corners lie on both sides, however steep the field.
double surface_reach(const std::array<double, 8>& corners, double edge);

}  // namespace arah

#include "host/capture/figure_variation.h"

#include <algorithm>
#include <cmath>
#include <random>

namespace arah {

namespace {

// Of the average build (figure_anatomy.cpp).
constexpr double kAverageShoulder = 0.18, kAverageWrist = 0.68;            // from the middle
constexpr double kAverageAnkle = 0.085, kAverageHip = 0.875, kAverageNeck = 1.44;  // above the ground

// x moved by (factor − 1) times how far it is on from `from`, at most to `to`; and the other way.
double stretched(double x, double from, double to, double factor) {
  return x + (factor - 1) * (std::clamp(x, from, to) - from);
}
double relaxed(double x, double from, double to, double factor) {
  const double end = from + factor * (to - from);
  return x - (1 - 1 / factor) * (std::clamp(x, from, end) - from);
}

}  // namespace

glm::dvec3 Stretch::from_average(const glm::dvec3& p) const {
  if (none()) return p;
  const double x = std::copysign(stretched(std::abs(p.x), kAverageShoulder, kAverageWrist, arm_), p.x);
  // The upper piece first: the lower one then moves it as a whole.
  const double y = stretched(stretched(p.y, kAverageHip, kAverageNeck, trunk_), kAverageAnkle, kAverageHip, leg_);
  return {x, y, p.z};
}

glm::dvec3 Stretch::to_average(const glm::dvec3& p) const {
  if (none()) return p;
  const double x = std::copysign(relaxed(std::abs(p.x), kAverageShoulder, kAverageWrist, arm_), p.x);
  const double y = relaxed(relaxed(p.y, kAverageAnkle, kAverageHip, leg_), kAverageHip, kAverageNeck, trunk_);
  return {x, y, p.z};
}

FigureVariation varied_figure(std::uint64_t seed) {
  FigureVariation v;
  if (seed == 0) return v;
  std::mt19937_64 random(seed ^ 0xb0d1e5ull);
  const auto between = [&](double low, double high) {
    return low + (high - low) * static_cast<double>(random() >> 11) * 0x1p-53;
  };
  v.build.height = between(0.92, 1.08);
  v.build.arm_length = between(0.92, 1.08);
  v.build.leg_length = between(0.92, 1.08);
  v.build.trunk_length = between(0.94, 1.06);
  const double girth = between(0.92, 1.10);
  v.build.arm_girth = girth * between(0.93, 1.08);
  v.build.leg_girth = girth * between(0.94, 1.08);
  v.build.trunk_girth = girth * between(0.95, 1.08);
  v.clothes.shirt = between(0, 1) < 0.85;
  v.clothes.shorts = between(0, 1) < 0.9;
  v.clothes.shoes = between(0, 1) < 0.8;
  v.clothes.shirt_hem = between(0.76, 0.90);
  v.clothes.sleeve_end = between(0.24, 0.64);
  v.clothes.shorts_hem = between(0.14, 0.64);
  v.clothes.looseness = between(0.6, 1.4);
  return v;
}

}  // namespace arah

#include "kernels/reference/half.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace arah::reference {
namespace {
constexpr double largest = 65504;
}

double nearest_half(double value) {
  if (!std::isfinite(value)) return value;
  int exponent = 0;
  std::frexp(value, &exponent);  // value = f · 2^exponent with ½ ≤ |f| < 1
  const double spacing = std::ldexp(1.0, std::max(exponent - 11, -24));
  const double rounded = std::nearbyint(value / spacing) * spacing;  // the default rounding mode is to nearest, ties to even
  return std::abs(rounded) > largest ? std::copysign(largest, rounded) : rounded;
}

uint16_t half_bits(double half) {
  const auto sign = static_cast<uint16_t>(std::signbit(half) ? 0x8000 : 0);
  if (std::isnan(half)) return 0x7e00;
  const double size = std::abs(half);
  if (std::isinf(half)) return static_cast<uint16_t>(sign | 0x7c00);
  if (size < std::ldexp(1.0, -14)) return static_cast<uint16_t>(sign | static_cast<uint16_t>(std::ldexp(size, 24)));
  const int exponent = std::ilogb(size);
  return static_cast<uint16_t>(sign | (exponent + 15) << 10 | (static_cast<int>(std::ldexp(size, 10 - exponent)) & 0x3ff));
}

double half_value(uint16_t bits) {
  const double sign = bits & 0x8000 ? -1 : 1;
  const int exponent = bits >> 10 & 31, fraction = bits & 0x3ff;
  if (exponent == 31) return fraction ? std::numeric_limits<double>::quiet_NaN() : sign * std::numeric_limits<double>::infinity();
  return sign * (exponent ? std::ldexp(1024 + fraction, exponent - 25) : std::ldexp(fraction, -24));
}

}  // namespace arah::reference

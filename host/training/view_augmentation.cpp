#include "host/training/view_augmentation.h"

#include <cmath>
#include <numbers>

namespace arah {

std::optional<std::array<float, 9>> draw_view_rotation(double probability, std::mt19937_64& generator) {
  if (!std::bernoulli_distribution(probability)(generator)) return std::nullopt;
  std::normal_distribution<double> angle(0, std::numbers::pi / 4);
  const double roll = angle(generator), pitch = angle(generator), yaw = angle(generator);
  const double cx = std::cos(roll), sx = std::sin(roll), cy = std::cos(pitch), sy = std::sin(pitch), cz = std::cos(yaw), sz = std::sin(yaw);
  const std::array<double, 9> product{cy * cz, -cy * sz, sy,
                                      cx * sz + sx * sy * cz, cx * cz - sx * sy * sz, -sx * cy,
                                      sx * sz - cx * sy * cz, sx * cz + cx * sy * sz, cx * cy};
  std::array<float, 9> rotation;
  for (size_t i = 0; i < 9; ++i) rotation[i] = static_cast<float>(product[i]);
  return rotation;
}

}  // namespace arah

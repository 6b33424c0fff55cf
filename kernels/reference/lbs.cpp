#include "kernels/reference/lbs.h"

#include <array>

#include "kernels/reference/sizes.h"
#include "kernels/reference/small_matrix.h"

namespace arah::reference {
namespace {

std::size_t joint_count(std::size_t points, std::span<const double> weights, std::span<const double> bone_transforms) {
  const std::size_t joints = bone_transforms.size() / 16;
  check_size("lbs: bone_transforms", bone_transforms.size(), joints * 16);
  check_size("lbs: weights", weights.size(), points * joints);
  return joints;
}

}  // namespace

std::vector<double> blend_transforms(std::size_t points, std::span<const double> weights,
                                     std::span<const double> bone_transforms) {
  const std::size_t joints = joint_count(points, weights, bone_transforms);
  std::vector<double> blended(points * 16, 0.0);
  for (std::size_t p = 0; p < points; ++p) {
    for (std::size_t b = 0; b < joints; ++b) {
      for (std::size_t k = 0; k < 16; ++k) blended[p * 16 + k] += weights[p * joints + b] * bone_transforms[b * 16 + k];
    }
  }
  return blended;
}

std::vector<double> lbs_forward(std::size_t points, std::span<const double> weights,
                                std::span<const double> bone_transforms, std::span<const double> x) {
  check_size("lbs: x", x.size(), points * 3);
  const std::vector<double> blended = blend_transforms(points, weights, bone_transforms);
  std::vector<double> x_bar(points * 3);
  for (std::size_t p = 0; p < points; ++p) {
    for (std::size_t i = 0; i < 3; ++i) {
      const double* t = blended.data() + p * 16 + i * 4;
      x_bar[p * 3 + i] = t[0] * x[p * 3] + t[1] * x[p * 3 + 1] + t[2] * x[p * 3 + 2] + t[3];
    }
  }
  return x_bar;
}

namespace {

Matrix<3> upper_block(std::span<const double> t) {
  return {{{t[0], t[1], t[2]}, {t[4], t[5], t[6]}, {t[8], t[9], t[10]}}};
}

}  // namespace

std::vector<double> inverse_blend(std::size_t points, std::span<const double> transforms,
                                  std::span<const double> x_bar) {
  check_size("inverse blend: transforms", transforms.size(), points * 16);
  check_size("inverse blend: x_bar", x_bar.size(), points * 3);
  std::vector<double> x;
  for (std::size_t p = 0; p < points; ++p) {
    const auto t = transforms.subspan(16 * p, 16);
    const auto inverted = inverse<3>(upper_block(t));
    const Vector<3> found = multiply<3>(inverted ? *inverted : not_a_matrix<3>(), {x_bar[3 * p] - t[3], x_bar[3 * p + 1] - t[7], x_bar[3 * p + 2] - t[11]});
    x.insert(x.end(), found.begin(), found.end());
  }
  return x;
}

std::vector<double> inverse_blend_backward(std::size_t points, std::span<const double> weights,
                                           std::span<const double> bone_transforms, std::span<const double> x,
                                           std::span<const double> d_x) {
  check_size("inverse blend backward: d_x", d_x.size(), points * 3);
  const std::vector<double> blended = blend_transforms(points, weights, bone_transforms);
  std::vector<double> cotangents;
  for (std::size_t p = 0; p < points; ++p) {
    const auto inverted = inverse<3>(upper_block(std::span(blended).subspan(16 * p, 16)));
    const Vector<3> g = inverted ? multiply_transposed<3>(*inverted, {d_x[3 * p], d_x[3 * p + 1], d_x[3 * p + 2]}) : Vector<3>{};
    for (double value : g) cotangents.push_back(-value);
  }
  return lbs_backward(points, weights, bone_transforms, x, cotangents, {}).weights;
}

LbsGradients lbs_backward(std::size_t points, std::span<const double> weights, std::span<const double> bone_transforms,
                          std::span<const double> x, std::span<const double> d_x_bar,
                          std::span<double> d_bone_transforms) {
  const std::size_t joints = joint_count(points, weights, bone_transforms);
  check_size("lbs backward: x", x.size(), points * 3);
  check_size("lbs backward: d_x_bar", d_x_bar.size(), points * 3);
  const bool wants_bones = !d_bone_transforms.empty();
  if (wants_bones) check_size("lbs backward: d_bone_transforms", d_bone_transforms.size(), joints * 16);
  LbsGradients result{std::vector<double>(points * joints, 0.0), std::vector<double>(points * 3, 0.0)};
  for (std::size_t p = 0; p < points; ++p) {
    const std::array<double, 4> homogeneous = {x[p * 3], x[p * 3 + 1], x[p * 3 + 2], 1};
    for (std::size_t b = 0; b < joints; ++b) {
      const double w = weights[p * joints + b];
      for (std::size_t i = 0; i < 3; ++i) {
        const double d = d_x_bar[p * 3 + i];
        for (std::size_t k = 0; k < 4; ++k) {
          const double element = bone_transforms[b * 16 + i * 4 + k];
          result.weights[p * joints + b] += d * element * homogeneous[k];
          if (k < 3) result.x[p * 3 + k] += d * w * element;
          if (wants_bones) d_bone_transforms[b * 16 + i * 4 + k] += d * w * homogeneous[k];
        }
      }
    }
  }
  return result;
}

}  // namespace arah::reference

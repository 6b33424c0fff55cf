// A rig in a pose, for tests of the skinning and tracing kernels: the same in double precision and on the device.
#pragma once

#include <cmath>
#include <span>
#include <string>
#include <vector>

#include "kernels/linear/matrix.h"
#include "kernels/reference/cube.h"
#include "kernels/reference/small_matrix.h"
#include "shaders/shared/frame.h"
#include "shaders/shared/work_count.h"
#include "tests/kernels/device_fixture.h"

namespace arah {

inline std::vector<int> smpl_tree() {
  return {-1, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 9, 9, 12, 13, 14, 16, 17, 18, 19, 20, 21};
}

// Parents drawn at random; with `width` 1 a chain.
inline std::vector<int> random_tree(std::mt19937_64& generator, int joints, int width) {
  std::vector<int> parents{-1};
  for (int j = 1; j < joints; ++j)
    parents.push_back(std::uniform_int_distribution<int>(std::max(0, j - width), j - 1)(generator));
  return parents;
}

// Rotations by up to `angle` about random axes and shifts by up to 0.3 m. As float32 holds them, in doubles.
inline std::vector<double> random_bones(std::mt19937_64& generator, size_t joints, double angle) {
  std::uniform_real_distribution<double> unit(-1, 1);
  std::vector<double> bones(joints * 16, 0.0);
  for (size_t j = 0; j < joints; ++j) {
    double axis[3] = {unit(generator), unit(generator), unit(generator) + 1.5};
    const double length = std::sqrt(axis[0] * axis[0] + axis[1] * axis[1] + axis[2] * axis[2]);
    for (double& a : axis) a /= length;
    const double turn = angle * unit(generator), c = std::cos(turn), s = std::sin(turn);
    for (size_t i = 0; i < 3; ++i) {
      for (size_t k = 0; k < 3; ++k) {
        const double cross = i == k ? 0 : ((k + 3 - i) % 3 == 1 ? -1 : 1) * axis[3 - i - k];
        bones[j * 16 + i * 4 + k] = static_cast<float>((i == k ? c : 0) + (1 - c) * axis[i] * axis[k] + s * cross);
      }
      bones[j * 16 + i * 4 + 3] = static_cast<float>(0.3 * unit(generator));
    }
    bones[j * 16 + 15] = 1;
  }
  return bones;
}

inline FrameConstants frame_constants(const reference::Cube& cube, const std::vector<double>& bones) {
  FrameConstants frame{};
  frame.cube_scale = static_cast<float>(cube.scale());
  const reference::Vec3 offset = cube.to_cube({0, 0, 0});
  for (size_t i = 0; i < 3; ++i) frame.cube_offset[i] = static_cast<float>(offset[i]);
  frame.joint_count = static_cast<uint32_t>(bones.size() / 16);
  for (size_t j = 0; j < bones.size() / 16; ++j)
    for (size_t i = 0; i < 12; ++i) frame.bones[3 * j + i / 4][i % 4] = static_cast<float>(bones[j * 16 + i]);
  return frame;
}

// Numbers as float32 holds them, so that both sides start from the same.
inline std::vector<double> as_float(std::vector<double> values) {
  for (double& value : values) value = static_cast<float>(value);
  return values;
}

// [rows][width] values as vec4 or matrix rows of `stride` floats from `column` on, in padded rows; the rest is
// `filler`.
inline std::vector<float> padded_rows(std::span<const double> values, size_t width, size_t stride, size_t column = 0,
                                      float filler = 0) {
  const size_t rows = values.size() / width;
  std::vector<float> padded(size_t(padded_points(static_cast<uint32_t>(rows))) * stride, filler);
  for (size_t r = 0; r < rows; ++r)
    for (size_t c = 0; c < width; ++c) padded[r * stride + column + c] = static_cast<float>(values[r * width + c]);
  return padded;
}

// The way back: `width` values of each of the first `rows` rows.
inline std::vector<double> rows_of(const std::vector<float>& padded, size_t rows, size_t width, size_t stride,
                                   size_t column = 0) {
  std::vector<double> values;
  for (size_t r = 0; r < rows; ++r)
    for (size_t c = 0; c < width; ++c) values.push_back(padded[r * stride + column + c]);
  return values;
}

inline WorkCount work_of(uint32_t count) {
  return {(count + 63) / 64, 1, 1, count};
}

// Largest |actual − expected|, printed; every one must be at most `limit`, and NaN fails.
inline void expect_all_near(const std::string& what, std::span<const double> actual, std::span<const double> expected,
                            double limit) {
  ASSERT_EQ(actual.size(), expected.size()) << what;
  double largest = 0;
  size_t where = 0;
  for (size_t i = 0; i < actual.size(); ++i) {
    const double error = std::abs(actual[i] - expected[i]);
    if (!(error <= largest)) largest = error, where = i;
    if (std::isnan(error)) break;
  }
  std::printf("  %-52s largest error %.2e\n", what.c_str(), largest);
  EXPECT_LE(largest, limit) << what << " at " << where << ": " << actual[where] << ", expected " << expected[where];
}

}  // namespace arah

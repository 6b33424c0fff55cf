// Normals turned to posed space, and the way back, against the double-precision products.
#include "kernels/color/posed_normals.h"

#include "kernels/color/posed_normals_backward.h"
#include "tests/kernels/closeness.h"
#include "tests/kernels/device_fixture.h"

namespace arah {
namespace {

class PosedNormals : public DeviceTest {};

// One sample, less than a workgroup, one more than one; matrices with columns beside the kernel's own.
TEST_F(PosedNormals, AreTurnedByTheBlendAndBack) {
  for (const uint32_t rows : {1u, 63u, 65u, 1000u}) {
    const uint32_t padded = padded_points(rows), stride = 24, column = 8;
    std::vector<float> gradients = uniform(padded * stride), transforms = uniform(padded * 12, -2, 2), d_normals = uniform(padded * 4);
    for (uint32_t i = 0; i < 4; ++i) d_normals[4 * (rows / 2) + i] = 0;  // a sample without influence
    for (uint32_t i = 0; i < 12; ++i) transforms[12 * (rows / 2) + i] = std::numeric_limits<float>::quiet_NaN();
    Buffer gradient_buffer = filled("gradients", gradients), transform_buffer = filled("transforms", transforms), d_normal_buffer = filled("d normals", d_normals);
    Buffer normal_buffer = filled("normals", std::vector<float>(padded * 4, -9.0f)), d_gradient_buffer = filled("d gradients", std::vector<float>(padded * stride, -9.0f));
    record_posed_normals(commands, {rows, {gradient_buffer.slice(), stride, column}, transform_buffer.slice(), normal_buffer.slice(), false});
    record_posed_normals_backward(commands, {rows, d_normal_buffer.slice(), transform_buffer.slice(), {d_gradient_buffer.slice(), stride, column}});
    commands.submit_and_wait();
    const std::vector<float> normals = device.download<float>(normal_buffer.slice()), d_gradients = device.download<float>(d_gradient_buffer.slice());

    std::vector<double> found, truth, found_back, truth_back;
    for (uint32_t p = 0; p < rows; ++p) {
      const bool without_influence = p == rows / 2;
      for (uint32_t i = 0; i < 3; ++i) {
        double normal = 0, back = 0;
        for (uint32_t j = 0; j < 3; ++j) {
          normal += double(transforms[12 * p + 4 * i + j]) * gradients[p * stride + column + j];
          back += double(transforms[12 * p + 4 * j + i]) * d_normals[4 * p + j];
        }
        if (!without_influence) found.push_back(normals[4 * p + i]), truth.push_back(normal);
        found_back.push_back(d_gradients[p * stride + column + i]), truth_back.push_back(without_influence ? 0 : back);
      }
      for (uint32_t c = 0; c < stride; ++c) {
        if (c >= column && c < column + 3) continue;
        ASSERT_EQ(d_gradients[p * stride + c], c >= column && c < column + 8 ? 0.0f : -9.0f) << "row " << p << ", column " << c;
      }
    }
    expect_close("normals", found, truth, 1e-6);
    expect_close("cotangents of gradients", found_back, truth_back, 1e-6);
  }
}

TEST_F(PosedNormals, StayCanonicalWithoutTransforms) {
  for (const uint32_t rows : {1u, 65u}) {
    const uint32_t padded = padded_points(rows), stride = 16, column = 8;
    const std::vector<float> gradients = uniform(padded * stride), d_normals = uniform(padded * 4);
    Buffer gradient_buffer = filled("gradients", gradients), d_normal_buffer = filled("d normals", d_normals);
    Buffer normal_buffer = filled("normals", std::vector<float>(padded * 4, -9.0f)), d_gradient_buffer = filled("d gradients", std::vector<float>(padded * stride, -9.0f));
    record_posed_normals(commands, {rows, {gradient_buffer.slice(), stride, column}, {}, normal_buffer.slice(), false});
    record_posed_normals_backward(commands, {rows, d_normal_buffer.slice(), {}, {d_gradient_buffer.slice(), stride, column}});
    commands.submit_and_wait();
    const std::vector<float> normals = device.download<float>(normal_buffer.slice()), d_gradients = device.download<float>(d_gradient_buffer.slice());
    for (uint32_t p = 0; p < rows; ++p)
      for (uint32_t i = 0; i < 4; ++i) {
        ASSERT_EQ(normals[4 * p + i], i < 3 ? gradients[p * stride + column + i] : 0.0f);
        ASSERT_EQ(d_gradients[p * stride + column + i], i < 3 ? d_normals[4 * p + i] : 0.0f);
      }
  }
}

TEST_F(PosedNormals, RefuseGradientsWithoutRoom) {
  Buffer buffer = filled("rows", std::vector<float>(64 * 12));
  EXPECT_THROW(record_posed_normals_backward(commands, {64, buffer.slice(), buffer.slice(), {buffer.slice(), 8, 8}}), std::invalid_argument);
}

}  // namespace
}  // namespace arah

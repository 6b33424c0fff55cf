// Correspondences by the template's own weights: what is accepted, and the transforms that go with it.
#include "kernels/tracing/template_correspondence.h"

#include <limits>

#include "shaders/shared/frame.h"
#include "tests/kernels/closeness.h"
#include "tests/kernels/device_fixture.h"
#include "tests/kernels/skinning_scene.h"

namespace arah {
namespace {

class TemplateCorrespondence : public DeviceTest {};

TEST_F(TemplateCorrespondence, TakesWantedFiniteStartsAlone) {
  for (const uint32_t points : {1u, 63u, 65u, 500u}) {
    const uint32_t padded = padded_points(points);
    std::vector<float> targets = uniform(padded * 4), starts = uniform(padded * 4, -2, 2);
    for (uint32_t p = 0; p < padded; ++p) targets[4 * p + 3] = p < points && p % 3 != 1 ? 1.0f : 0.0f;
    for (uint32_t p = 0; p < points; p += 5) starts[4 * p + p % 3] = p % 2 ? std::numeric_limits<float>::infinity() : std::numeric_limits<float>::quiet_NaN();
    Buffer target_buffer = filled("targets", targets), start_buffer = filled("starts", starts), canonical_buffer = filled("canonical", std::vector<float>(padded * 4, -9.0f));
    record_accept_starts(commands, {points, target_buffer.slice(), start_buffer.slice(), canonical_buffer.slice()});
    commands.submit_and_wait();
    const std::vector<float> canonical = device.download<float>(canonical_buffer.slice());
    for (uint32_t p = 0; p < padded; ++p) {
      const bool taken = p < points && p % 3 != 1 && p % 5 != 0;
      for (uint32_t i = 0; i < 3; ++i) ASSERT_EQ(canonical[4 * p + i], taken ? starts[4 * p + i] : 0.0f) << p;
      ASSERT_EQ(canonical[4 * p + 3], taken ? 1.0f : 0.0f) << p;
    }
  }
}

TEST_F(TemplateCorrespondence, TakesTracedRaysThatReachedTheSurface) {
  const uint32_t rays = 70, padded = padded_points(rays);
  // trace: depth, sdf, evaluations, status. In turn: on the surface; within the tolerance when out of iterations; not; one
  // that left the box; one that never entered it.
  const std::vector<std::array<float, 4>> kinds{{2.5f, -4e-6f, 9, 1}, {2.25f, 9e-4f, 50, 0}, {2, 2e-3f, 50, 0}, {4, 1e-4f, 12, 2}, {0, 0, 0, 2}};
  std::vector<float> traces, ends = uniform(padded * 4);
  for (uint32_t r = 0; r < padded; ++r) traces.insert(traces.end(), kinds[r % 5].begin(), kinds[r % 5].end());
  ends[4 * 10] = std::numeric_limits<float>::quiet_NaN();  // would be a hit
  Buffer trace_buffer = filled("traces", traces), end_buffer = filled("ends", ends), canonical_buffer = filled("canonical", std::vector<float>(padded * 4, -9.0f)),
         depth_buffer = filled("depths", std::vector<float>(padded, -9.0f));
  record_accept_traced(commands, {rays, 1e-3f, trace_buffer.slice(), end_buffer.slice(), canonical_buffer.slice(), depth_buffer.slice()});
  commands.submit_and_wait();
  const std::vector<float> canonical = device.download<float>(canonical_buffer.slice()), depths = device.download<float>(depth_buffer.slice());
  for (uint32_t r = 0; r < padded; ++r) {
    const bool hit = r < rays && r % 5 < 2 && r != 10;
    EXPECT_EQ(canonical[4 * r + 3], hit ? 1.0f : 0.0f) << r;
    EXPECT_EQ(canonical[4 * r], hit ? ends[4 * r] : 0.0f) << r;
    EXPECT_EQ(depths[r], hit ? traces[4 * r] : 0.0f) << r;
  }
}

TEST_F(TemplateCorrespondence, TransformsBlendTheNearestVertexsBones) {
  const uint32_t points = 130, padded = padded_points(points), vertices = 37, joints = 24;
  const std::vector<double> bones = random_bones(generator, joints, 0.8);
  const FrameConstants constants = frame_constants({}, bones);
  std::vector<uint32_t> nearest(padded), words(vertices);
  for (uint32_t& vertex : nearest) vertex = static_cast<uint32_t>(generator() % vertices);
  for (uint32_t& word : words)
    for (uint32_t k = 0; k < 4; ++k) word |= static_cast<uint32_t>(generator() % joints) << (8 * k);
  const std::vector<float> weights = uniform(vertices * 4, 0.1, 0.4);
  Buffer frame = filled("frame", std::vector<FrameConstants>{constants}), nearest_buffer = filled("nearest", nearest), joint_buffer = filled("joints", words),
         weight_buffer = filled("weights", weights), transform_buffer = filled("transforms", std::vector<float>(padded * 12, -9.0f));
  PosedVertices target;
  target.joints = joint_buffer.slice();
  target.weights = weight_buffer.slice();
  record_vertex_transforms(commands, {{{points, {}}, {}}, frame.slice(), nearest_buffer.slice(), target, transform_buffer.slice()});
  commands.submit_and_wait();
  std::vector<double> truth;
  for (uint32_t p = 0; p < padded; ++p) {
    const uint32_t vertex = nearest[p];
    double sum = 0;
    for (uint32_t k = 0; k < 4; ++k) sum += weights[4 * vertex + k];
    for (uint32_t i = 0; i < 12; ++i) {
      double value = 0;
      for (uint32_t k = 0; k < 4; ++k) value += double(weights[4 * vertex + k]) * constants.bones[3 * (words[vertex] >> (8 * k) & 255u) + i / 4][i % 4];
      truth.push_back(value / sum);
    }
  }
  expect_close("transforms", as_doubles(device.download<float>(transform_buffer.slice())), truth, 2e-6);

  // Rows of a queue: row r is point ids[r].
  std::vector<uint32_t> ids(padded);
  std::vector<double> turned;
  for (uint32_t r = 0; r < padded; ++r) {
    ids[r] = (7 * r + 3) % points;
    turned.insert(turned.end(), truth.begin() + 12l * ids[r], truth.begin() + 12l * ids[r] + 12);
  }
  Buffer id_buffer = filled("ids", ids);
  record_vertex_transforms(commands, {{{points, {}}, id_buffer.slice()}, frame.slice(), nearest_buffer.slice(), target, transform_buffer.slice()});
  commands.submit_and_wait();
  expect_close("transforms of a queue", as_doubles(device.download<float>(transform_buffer.slice())), turned, 2e-6);
}

}  // namespace
}  // namespace arah

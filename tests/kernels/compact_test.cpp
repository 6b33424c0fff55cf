// Compaction of flagged rows, and the networks' input rows.
#include "kernels/tracing/compact.h"

#include "kernels/tracing/normalise_inputs.h"
#include "tests/kernels/skinning_scene.h"

namespace arah {
namespace {

class Compact : public DeviceTest {};

TEST_F(Compact, KeepsTheFlaggedRowsInOrder) {
  struct Case {
    uint32_t rows, counted;  // buffers for `rows`, of which the device counts so many
    double density;
    bool listed;
  };
  for (const Case& c : {Case{1, 1, 1, false},
                        {1, 1, 0, false},
                        {63, 63, 0.5, true},
                        {65, 0, 1, true},
                        {2048, 2048, 1, false},
                        {2049, 2049, 1, true},
                        {5000, 3001, 0.3, true},
                        {300000, 300000, 0.02, false},
                        {140000, 139999, 0.9, true}}) {
    std::vector<uint32_t> flags(padded_points(c.rows), 1), ids(padded_points(c.rows), 0),
        expected;  // padding rows are flagged
    for (uint32_t r = 0; r < c.rows; ++r) {
      flags[r] = uniform(1, 0, 1)[0] < c.density ? 1 + r % 3 : 0;
      ids[r] = c.listed ? 2 * r + 5 : r;
      if (r < c.counted && flags[r]) expected.push_back(ids[r]);
    }
    Buffer flag_buffer = filled("flags", flags), id_buffer = filled("ids", ids),
           work = filled("work", std::vector<WorkCount>{work_of(c.counted)});
    Buffer scratch = empty("scratch", compact_blocks(c.rows) * 4),
           compacted = empty("compacted", padded_points(c.rows) * 4), count = empty("count", sizeof(WorkCount));
    Rows over{{c.rows, {}}, {}};
    if (c.listed) over = {{c.rows, work.slice()}, id_buffer.slice()};
    record_compact(commands, {over, flag_buffer.slice(), {}, scratch.slice(), compacted.slice(), count.slice()});
    commands.submit_and_wait();
    const WorkCount found = device.download<WorkCount>(count.slice().sub(0, sizeof(WorkCount)))[0];
    EXPECT_EQ(found.count, expected.size()) << c.rows;
    EXPECT_EQ(found.groups_x, (expected.size() + 63) / 64) << c.rows;
    EXPECT_EQ(found.groups_y, 1u);
    EXPECT_EQ(found.groups_z, 1u);
    std::vector<uint32_t> list = device.download<uint32_t>(compacted.slice());
    for (size_t i = expected.size(); i < padded_points(static_cast<uint32_t>(expected.size())); ++i)
      EXPECT_EQ(list[i], ids[0]) << "padding";
    list.resize(expected.size());
    EXPECT_TRUE(list == expected) << c.rows;
  }
  EXPECT_THROW(record_compact(commands, {{{compact_most_rows + 1, {}}, {}}, {}, {}, {}, {}, {}}),
               std::invalid_argument);
}

TEST_F(Compact, TakesFlagsFromPointsAndNoRowsAtAll) {
  std::vector<float> points(padded_points(1000) * 4, 1.0f);
  std::vector<uint32_t> expected;
  for (uint32_t r = 0; r < 1000; ++r) {
    points[4 * r + 3] = r % 3 == 0 ? 1.0f : 0.0f;
    if (r % 3 == 0) expected.push_back(r);
  }
  Buffer point_buffer = filled("points", points), scratch = empty("scratch", 4), compacted = empty("compacted", 4096),
         count = empty("count", sizeof(WorkCount));
  record_compact(commands,
                 {{{1000, {}}, {}}, {}, point_buffer.slice(), scratch.slice(), compacted.slice(), count.slice()});
  commands.submit_and_wait();
  std::vector<uint32_t> list = device.download<uint32_t>(compacted.slice());
  list.resize(expected.size());
  EXPECT_EQ(list, expected);
  EXPECT_EQ(device.download<WorkCount>(count.slice().sub(0, sizeof(WorkCount)))[0].count, expected.size());

  record_compact(commands,
                 {{{0, {}}, {}}, {}, point_buffer.slice(), scratch.slice(), compacted.slice(), count.slice()});
  commands.submit_and_wait();
  EXPECT_EQ(device.download<WorkCount>(count.slice().sub(0, sizeof(WorkCount)))[0].count, 0u);
}

TEST_F(Compact, InputRowsHoldCubeCoordinatesAndZeros) {
  const reference::Cube cube{{0.1, -0.2, 0.05}, -0.9, 1.1};
  Buffer frame = filled("frame", std::vector<FrameConstants>{frame_constants(cube, random_bones(generator, 1, 1))});
  const uint32_t rows = 65;
  const std::vector<float> x = uniform(100 * 4);
  std::vector<uint32_t> ids(128, 0);
  std::vector<double> expected;
  for (uint32_t r = 0; r < rows; ++r) {
    ids[r] = 99 - r;
    for (const double n : cube.to_cube({x[ids[r] * 4], x[ids[r] * 4 + 1], x[ids[r] * 4 + 2]})) expected.push_back(n);
  }
  Buffer canonical = filled("canonical", x), id_buffer = filled("ids", ids),
         inputs = filled("inputs", std::vector<float>(128 * 16, 3.0f));
  record_normalise_inputs(commands,
                          {{{rows, {}}, id_buffer.slice()}, frame.slice(), canonical.slice(), {inputs.slice(), 16, 8}});
  commands.submit_and_wait();
  const std::vector<float> found = device.download<float>(inputs.slice());
  expect_all_near("n(x)", rows_of(found, rows, 3, 16, 8), expected, 5e-7);

  // From the root: a point that joint 0's transform made of x has the coordinates of x.
  const std::vector<double> bone = random_bones(generator, 1, 1);
  Buffer posed_frame = filled("posed frame", std::vector<FrameConstants>{frame_constants(cube, bone)});
  std::vector<float> posed(x);
  for (size_t p = 0; p < 100; ++p)
    for (size_t i = 0; i < 3; ++i) posed[4 * p + i] = static_cast<float>(bone[4 * i] * x[4 * p] + bone[4 * i + 1] * x[4 * p + 1] + bone[4 * i + 2] * x[4 * p + 2] + bone[4 * i + 3]);
  Buffer posed_buffer = filled("posed", posed), from_root = filled("from the root", std::vector<float>(128 * 8, 3.0f));
  record_normalise_inputs(commands, {{{rows, {}}, id_buffer.slice()}, posed_frame.slice(), posed_buffer.slice(), {from_root.slice(), 8, 0}, true});
  commands.submit_and_wait();
  expect_all_near("n(B_0⁻¹ x)", rows_of(device.download<float>(from_root.slice()), rows, 3, 8), expected, 2e-6);

  for (uint32_t r = 0; r < 128; ++r)
    for (uint32_t column = 0; column < 16; ++column) {
      const bool outside = column < 8;
      if (outside || column >= 11 || r >= rows) {
        EXPECT_EQ(found[r * 16 + column], outside ? 3 : 0) << r << ", " << column;
      }
    }
}

}  // namespace
}  // namespace arah

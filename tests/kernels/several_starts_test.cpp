// Starts that bones give to the search of a posed point, against double precision, and which of several roots is kept.
#include "kernels/tracing/several_starts.h"

#include <cmath>

#include "kernels/reference/tracing.h"
#include "tests/kernels/skinning_scene.h"

namespace arah {
namespace {

class SeveralStarts : public DeviceTest {
 protected:
  // Rows: all points, or those of `ids`, as many as are counted.
  struct List {
    Buffer ids, work;
  };
  List list(const std::vector<uint32_t>& ids) {
    std::vector<uint32_t> padded = ids;
    padded.resize(192, ids.front());  // room for all points
    return {filled("ids", padded), filled("work", std::vector<WorkCount>{work_of(static_cast<uint32_t>(ids.size()))})};
  }
};

TEST_F(SeveralStarts, BonesGiveTheirStartsByTheirNearness) {
  for (const uint32_t bones : {1u, 3u, 24u, 64u}) {
    const uint32_t points = 131, padded = padded_points(points);
    const std::vector<double> transforms = random_bones(generator, bones, 2.0);
    std::vector<reference::Matrix<4>> truth_bones(bones);
    std::vector<reference::BoneSegment> truth_segments(bones);
    std::vector<float> segments = uniform(8 * bones, -1, 1), posed = uniform(4 * padded, -1, 1);
    for (size_t b = 0; b < bones; ++b) {
      for (size_t i = 0; i < 16; ++i) truth_bones[b][i / 4][i % 4] = transforms[16 * b + i];
      if (b % 4 == 3) std::copy_n(&segments[8 * b], 3, &segments[8 * b + 4]);  // no child: a point
      for (size_t i = 0; i < 3; ++i) truth_segments[b].from[i] = segments[8 * b + i], truth_segments[b].to[i] = segments[8 * b + 4 + i];
    }
    const FrameConstants constants = frame_constants({}, transforms);
    Buffer frame = filled("frame", std::vector<FrameConstants>{constants}), ends = filled("segments", segments), q = filled("posed", posed);
    for (const uint32_t rank : {0u, 1u, 5u}) {
      Buffer starts = filled("starts", std::vector<float>(4 * padded, 7));
      record_bone_starts(commands, {{{points, {}}, {}}, frame.slice(), q.slice(), ends.slice(), bones, rank, starts.slice()});
      commands.submit_and_wait();
      const std::vector<float> found = device.download<float>(starts.slice());
      std::vector<double> actual, expected;
      for (uint32_t p = 0; p < points; ++p) {
        const reference::Vector<3> x = reference::bone_start({posed[4 * p], posed[4 * p + 1], posed[4 * p + 2]}, truth_bones, truth_segments, std::min(rank, bones - 1));
        for (size_t i = 0; i < 3; ++i) actual.push_back(found[4 * p + i]), expected.push_back(x[i]);
      }
      expect_all_near("starts from bone of rank " + std::to_string(rank) + " of " + std::to_string(bones), actual, expected, 2e-6);
      for (uint32_t p = points; p < padded; ++p) EXPECT_EQ(found[4 * p], 7) << p;
    }
    // Rows of some points alone.
    List some = list({130, 7, 64});
    Buffer starts = filled("starts", std::vector<float>(4 * padded, 7));
    record_bone_starts(commands, {{{points, some.work.slice()}, some.ids.slice()}, frame.slice(), q.slice(), ends.slice(), bones, 0, starts.slice()});
    commands.submit_and_wait();
    const std::vector<float> found = device.download<float>(starts.slice());
    for (uint32_t p = 0; p < points; ++p) EXPECT_EQ(found[4 * p] != 7, p == 7 || p == 64 || p == 130) << p;
  }
}

TEST_F(SeveralStarts, TheRootWithTheLeastDistanceIsKept) {
  const uint32_t points = 100, padded = padded_points(points), stride = 8;
  std::vector<float> kept = uniform(4 * padded), other = uniform(4 * padded), first_sdf = uniform(points, -1, 1), other_sdf = uniform(points, -1, 1);
  std::vector<uint32_t> first_rows, other_rows;
  for (uint32_t p = 0; p < points; ++p) {
    if (p == 20) other_sdf[p] = first_sdf[p];  // the first one stays
    kept[4 * p + 3] = p % 3 == 1 ? 0.0f : p % 13 == 5 ? -1.0f : 1.0f;  // none; EMPTY
    other[4 * p + 3] = p % 5 == 2 || p % 13 == 5 ? 0.0f : 1.0f;
    if (kept[4 * p + 3] > 0) first_rows.push_back(p);
    if (other[4 * p + 3] > 0) other_rows.push_back(p);
  }
  const auto by_row = [&](const std::vector<uint32_t>& rows, const std::vector<float>& values) {
    std::vector<float> matrix(size_t(padded) * stride, -9.0f);
    for (size_t r = 0; r < rows.size(); ++r) matrix[r * stride + 4] = values[rows[r]];
    return matrix;
  };
  List first = list(first_rows), second = list(other_rows);
  Buffer k = filled("kept", kept), o = filled("other", other), distances = filled("distances", std::vector<float>(padded, 5.0f)), a = filled("sdf", by_row(first_rows, first_sdf)),
         b = filled("sdf", by_row(other_rows, other_sdf));
  record_keep_root(commands, {{{points, first.work.slice()}, first.ids.slice()}, true, {a.slice(), stride, 4}, k.slice(), k.slice(), distances.slice()});
  record_keep_root(commands, {{{points, second.work.slice()}, second.ids.slice()}, false, {b.slice(), stride, 4}, o.slice(), k.slice(), distances.slice()});
  commands.submit_and_wait();
  const std::vector<float> roots = device.download<float>(k.slice()), least = device.download<float>(distances.slice());
  uint32_t replaced = 0;
  for (uint32_t p = 0; p < points; ++p) {
    const bool had = kept[4 * p + 3] > 0, has = other[4 * p + 3] > 0, takes = has && (!had || other_sdf[p] < first_sdf[p]);
    replaced += takes;
    for (size_t i = 0; i < 4; ++i) EXPECT_EQ(roots[4 * p + i], takes ? other[4 * p + i] : kept[4 * p + i]) << p;
    EXPECT_EQ(least[p], takes ? other_sdf[p] : had ? first_sdf[p] : 5.0f) << p;
  }
  EXPECT_GT(replaced, points / 4);
  EXPECT_LT(replaced, points * 3 / 4);
}

}  // namespace
}  // namespace arah

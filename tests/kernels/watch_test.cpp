// The watch over a tensor's numbers, against the reference: what is bad is counted and its first place found, whatever lies
// beside it, and nothing else is.
#include "kernels/watch/scan.h"

#include <limits>

#include "kernels/reference/watch.h"
#include "tests/kernels/device_fixture.h"

namespace arah {
namespace {

constexpr float nan = std::numeric_limits<float>::quiet_NaN(), infinity = std::numeric_limits<float>::infinity();

class WatchScan : public DeviceTest {
 protected:
  struct Shape {
    uint32_t rows, channels, stride, column;
    bool masked, indexed;
    uint32_t first_row;
    float limit;
  };
  // The record of `values`, between two neighbours that must stay as they are.
  shared::WatchRecord record_of(const Shape& shape, const std::vector<float>& values, const std::vector<float>& w, const std::vector<uint32_t>& ids) {
    std::vector<float> points(4 * size_t(shape.rows), nan);  // of which only w is read
    for (size_t row = 0; row < w.size(); ++row) points[4 * row + 3] = w[row];
    Buffer numbers = filled("values", values), at = filled("points", points), numbers_of_rows = filled("ids", ids);
    std::vector<shared::WatchRecord> around(64, {7, 7, 7, 7});
    around[32] = {0, 0, 0, 0};
    Buffer records = filled("records", around);
    WatchArgs args;
    args.values = {numbers.slice(), shape.stride, shape.column};
    args.rows = shape.rows;
    args.channels = shape.channels;
    args.limit = shape.limit;
    if (shape.masked) args.points = at.slice();
    if (shape.indexed) args.row_ids = numbers_of_rows.slice();
    args.first_row = shape.first_row;
    args.record = records.slice().sub(32 * sizeof(shared::WatchRecord), sizeof(shared::WatchRecord));
    record_watch(commands, args);
    commands.submit_and_wait();
    const auto all = device.download<shared::WatchRecord>(records.slice().sub(0, around.size() * sizeof(shared::WatchRecord)));
    for (const size_t neighbour : {31u, 33u}) EXPECT_EQ(all[neighbour].nan + all[neighbour].infinite + all[neighbour].beyond + all[neighbour].first_inverted, 28u) << "a neighbour's record changed";
    return all[32];
  }
};

TEST_F(WatchScan, FindsWhatTheReferenceFinds) {
  for (const Shape& shape : {Shape{1, 1, 1, 0, false, false, 0, infinity}, {63, 1, 1, 0, false, false, 0, 2}, {1000, 1, 1, 0, true, true, 5, 2}, {64, 3, 4, 0, true, false, 640, 2},
                             {65, 3, 8, 0, false, true, 0, infinity}, {4097, 4, 4, 0, true, true, 77, 2}, {200, 2, 24, 8, false, false, 1, 0.5f}, {777, 1, 8, 0, true, true, 0, 1e30f}}) {
    for (const double share : {0.0, 0.001, 0.5}) {
      std::vector<float> values = uniform(size_t(shape.rows) * shape.stride, -1, 1);
      for (float& value : values) {
        if (std::uniform_real_distribution<double>(0, 1)(generator) >= share) continue;
        const float bad[] = {nan, -nan, infinity, -infinity, 3.0f, -3e38f, std::numeric_limits<float>::denorm_min(), -0.0f};
        value = bad[generator() % 8];
      }
      const std::vector<float> draws = uniform(shape.rows, -1, 1);
      std::vector<float> w;
      for (const float draw : draws) w.push_back(draw > 0.2f ? 1.0f : draw > -0.4f ? 0.0f : -1.0f);
      std::vector<uint32_t> ids;
      for (uint32_t row = 0; row < shape.rows; ++row) ids.push_back((row * 2654435761u) % 100003u);
      const reference::Watched truth = reference::watch(values, shape.rows, shape.channels, shape.stride, shape.column, shape.limit, shape.masked ? std::span<const float>(w) : std::span<const float>(),
                                                        shape.indexed ? std::span<const uint32_t>(ids) : std::span<const uint32_t>(), shape.first_row);
      const shared::WatchRecord found = record_of(shape, values, w, ids);
      SCOPED_TRACE(testing::Message() << shape.rows << " rows of " << shape.channels << ", stride " << shape.stride << ", share " << share);
      EXPECT_EQ(found.nan, truth.nan);
      EXPECT_EQ(found.infinite, truth.infinite);
      EXPECT_EQ(found.beyond, truth.beyond);
      const bool any = truth.first >= 0;
      EXPECT_EQ(found.first_inverted != 0, any);
      if (any) {
        EXPECT_EQ(first_place(found), static_cast<uint32_t>(truth.first));
      }
      if (share > 0.4 && shape.rows > 60) {
        EXPECT_GT(truth.nan, 0u);
        EXPECT_GT(truth.infinite, 0u);
      }
    }
  }
}

// What a step's passes find adds up, and the first place is that of all of them.
TEST_F(WatchScan, RecordsAddUpOverLaunches) {
  std::vector<float> values(128, 1.0f);
  values[100] = nan;
  values[30] = infinity;
  Buffer numbers = filled("values", values), records = filled("records", std::vector<shared::WatchRecord>(1, {0, 0, 0, 0}));
  for (const uint32_t first : {64u, 0u}) {
    WatchArgs args;
    args.values = {numbers.slice().elements(first, 64), 1, 0};
    args.rows = 64;
    args.first_row = first;
    args.record = records.slice().sub(0, sizeof(shared::WatchRecord));
    record_watch(commands, args);
  }
  commands.submit_and_wait();
  const auto found = device.download<shared::WatchRecord>(records.slice().sub(0, sizeof(shared::WatchRecord)))[0];
  EXPECT_EQ(found.nan, 1u);
  EXPECT_EQ(found.infinite, 1u);
  EXPECT_EQ(found.beyond, 0u);
  EXPECT_EQ(first_place(found), 30u);
}

TEST_F(WatchScan, RefusesShapesThatItCannotRead) {
  Buffer numbers = filled("values", std::vector<float>(256, 0.0f)), records = empty("records", 256);
  WatchArgs good;
  good.values = {numbers.slice(), 4, 0};
  good.rows = 4;
  good.channels = 3;
  good.record = records.slice();
  for (int which = 0; which < 6; ++which) {
    WatchArgs args = good;
    if (which == 0) args.rows = 0;
    if (which == 1) args.channels = 5;
    if (which == 2) args.channels = 0;
    if (which == 3) args.values.stride = 3;
    if (which == 4) args.limit = nan;
    if (which == 5) args.values.element = Element::half;
    EXPECT_THROW(record_watch(commands, args), std::invalid_argument) << which;
  }
}

}  // namespace
}  // namespace arah

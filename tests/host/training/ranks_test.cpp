// How ranks share things out. What they do together is a story of mpirun's (tests/stories/ranks_story_test.cpp).
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "host/input_error.h"
#include "host/training/ranks.h"

namespace arah {
namespace {

TEST(Ranks, PartsFollowEachOtherInWholeUnitsAndNobodyGoesWithout) {
  for (const std::vector<uint32_t>& shares : {std::vector<uint32_t>{1}, {1, 1, 1}, {3, 1}, {1, 100}, {100, 1, 1, 100}, {16, 16, 1, 1, 1, 1, 1}})
    for (const uint32_t count : {0u, 1u, 7u, 448u, 1000u, 4000000000u})
      for (const uint32_t unit : {1u, 64u}) {
        const uint64_t units = (uint64_t{count} + unit - 1) / unit;
        uint32_t end = 0;
        uint64_t all = 0;
        for (const uint32_t share : shares) all += share;
        for (uint32_t rank = 0; rank < shares.size(); ++rank) {
          const Ranks::Part part = Ranks::part_of(count, unit, rank, shares);
          EXPECT_EQ(part.begin, end);
          EXPECT_TRUE(part.begin % unit == 0 || part.begin == count);
          if (units >= shares.size()) {
            EXPECT_GT(part.size(), 0u) << count << " things in " << unit << "s, rank " << rank << " of " << shares.size();
          }
          // Within the units that the others must have at least, and the rounding of both ends.
          EXPECT_NEAR(double(part.size()) / unit, double(units) * shares[rank] / double(all), double(shares.size()) + 1);
          end = part.end;
        }
        EXPECT_EQ(end, count);
      }
}

TEST(Ranks, OneExchangesNothing) {
  Ranks ranks;
  std::vector<float> values{1, 2};
  ranks.sum(std::span(values));
  ranks.broadcast(std::span(values));
  EXPECT_THAT(values, testing::ElementsAre(1, 2));
  EXPECT_EQ(ranks.broadcast(3), 3u);
  EXPECT_EQ(ranks.before(5), 0u);
  EXPECT_THAT(ranks.gather("one"), testing::ElementsAre("one"));
  EXPECT_TRUE(ranks.all_alike("anything"));
  EXPECT_THROW(ranks.set_shares({1, 1}), InputError);
  std::vector<uint64_t> done;
  EXPECT_FALSE(ranks.share(5, [&](uint64_t number) { done.push_back(number); return number < 2; }));
  EXPECT_THAT(done, testing::ElementsAre(0, 1, 2)) << "no more is begun";
}

}  // namespace
}  // namespace arah

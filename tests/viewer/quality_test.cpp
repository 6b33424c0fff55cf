#include "viewer/quality.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "tests/host/rendering/capsule_scene.h"

namespace arah {
namespace {

Avatar any_avatar(FieldKind kind = FieldKind::sdf) {
  AvatarSpec spec = small_paper_spec();
  spec.sdf.kind = kind;
  return make_avatar(spec, capsule_body(), {0, 7}, 5);
}

TEST(QualityTest, RefinesFromCoarseToWhatIsAskedFor) {
  const Avatar avatar = any_avatar();
  EXPECT_THAT(refinement(avatar, "balanced"), testing::ElementsAre(Quality{"preview", 1}, Quality{"fast", 1}, Quality{"balanced", 1}));
  EXPECT_THAT(refinement(avatar, "preview"), testing::ElementsAre(Quality{"preview", 1}));
  EXPECT_EQ(refinement(avatar, "paper").back(), (Quality{"paper", 1}));
  EXPECT_EQ(to_string(Quality{"preview", 4}), "preview 1/4");
}

TEST(QualityTest, ADensityHasNoPreview) {
  const Avatar avatar = any_avatar(FieldKind::density);
  for (const Quality& quality : qualities(avatar)) EXPECT_NE(quality.preset, "preview");
  EXPECT_EQ(qualities(avatar).back().preset, "fast");
  EXPECT_EQ(refinement(avatar, "balanced").front(), (Quality{"fast", 1}));
}

TEST(MovingQualityTest, BeginsWithTheCoarsestAndClimbsAsFarAsTheBudgetHolds) {
  // A device that takes a microsecond for a pixel of "preview", and four times as much for each finer preset.
  const Avatar avatar = any_avatar();
  const double pixels = 640 * 480;
  const auto takes = [&](const Quality& quality) {
    const double finer = quality.preset == "preview" ? 1 : quality.preset == "fast" ? 4 : quality.preset == "balanced" ? 16 : 64;
    return 1e-6 * finer * pixels / (quality.pixel_step * quality.pixel_step);
  };
  for (const double budget : {0.01, 0.1, 0.6, 2.0, 100.0}) {
    MovingQuality moving(avatar, budget);
    Quality chosen = moving.choose(pixels, false, "paper");
    EXPECT_EQ(chosen, qualities(avatar).back());
    for (int picture = 0; picture < 40; ++picture) {
      moving.took(chosen, pixels, false, takes(chosen));
      chosen = moving.choose(pixels, false, "paper");
      if (chosen != qualities(avatar).back()) {
        EXPECT_LE(takes(chosen), budget) << to_string(chosen);
      }
    }
    // The next finer one would not leave a quarter of the budget.
    const auto all = qualities(avatar);
    const auto at = std::find(all.begin(), all.end(), chosen);
    if (at != all.begin()) {
      EXPECT_GT(takes(*(at - 1)), 0.75 * budget) << budget;
    }
  }
}

TEST(MovingQualityTest, GivesWayWhereTheDeviceIsBusy) {
  const Avatar avatar = any_avatar();
  MovingQuality moving(avatar, 0.05);
  Quality chosen = moving.choose(1e5, false, "fast");
  for (int picture = 0; picture < 20; ++picture) {
    moving.took(chosen, 1e5, false, 0.001);
    chosen = moving.choose(1e5, false, "fast");
  }
  EXPECT_EQ(chosen, (Quality{"fast", 1})) << "no finer than asked for";
  for (int picture = 0; picture < 6; ++picture) {
    moving.took(chosen, 1e5, false, 1.0);
    chosen = moving.choose(1e5, false, "fast");
  }
  EXPECT_NE(chosen, (Quality{"fast", 1}));
}

TEST(MovingQualityTest, OneSlowPictureIsForgotten) {
  const Avatar avatar = any_avatar();
  MovingQuality moving(avatar, 0.07);
  Quality chosen = moving.choose(3e5, true, "balanced");
  moving.took(chosen, 3e5, true, 5);  // shaders were compiled
  for (int picture = 0; picture < 30; ++picture) {
    chosen = moving.choose(3e5, picture % 2 == 0, "balanced");
    moving.took(chosen, 3e5, picture % 2 == 0, 0.004);
  }
  EXPECT_EQ(chosen.preset, "balanced");
  EXPECT_TRUE(std::isfinite(moving.expected(chosen, 3e5, true)));
}

}  // namespace
}  // namespace arah

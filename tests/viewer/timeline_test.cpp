#include "viewer/timeline.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "host/body/pose_blend.h"

namespace arah {
namespace {

// Frames 10, 13, 16, …: numbers are names, not times.
Motion five_frames(double frames_per_second = 10) {
  Motion motion;
  motion.frames_per_second = frames_per_second;
  motion.skeleton = {{"root"}, {-1}, {{0, 1, 0}}};
  for (int f = 0; f < 5; ++f) motion.frames.push_back({10 + 3 * f, Pose{{{0.1 * f, 7, 0}}, {f, 0, 0}}, ""});
  return motion;
}

Timeline playing(Loop loop, double place = 0) {
  Timeline timeline;
  timeline.playing = true;
  timeline.loop = loop;
  timeline.place = place;
  return timeline;
}

TEST(TimelineTest, AtTheTimeOfAFrameItIsThatFrame) {
  for (const double pace : {7.0, 10.0, 24.0, 29.97, 60.0}) {
    const Motion motion = five_frames(pace);
    for (std::size_t f = 0; f < 5; ++f) {
      const Timeline at = scrubbed_to_time({}, motion, static_cast<double>(f) / pace);
      EXPECT_EQ(pose_at(at, motion), motion.frames[f].pose);
      EXPECT_EQ(frame_at(at, motion), f);
    }
  }
}

TEST(TimelineTest, BetweenFramesItBlends) {
  const Motion motion = five_frames();
  const Timeline at = scrubbed_to_time({}, motion, 0.125);
  EXPECT_EQ(frame_at(at, motion), 1u);
  EXPECT_EQ(pose_at(at, motion), blended(motion.frames[1].pose, motion.frames[2].pose, 0.25));
  EXPECT_EQ(pose_at(at, motion).root_position.x, 1.25);
  EXPECT_DOUBLE_EQ(time_of(at, motion), 0.125);
}

TEST(TimelineTest, GoesAroundStopsOrTurns) {
  const Motion motion = five_frames();  // 0.1 s a frame
  EXPECT_NEAR(advanced(playing(Loop::around), motion, 0.25).place, 2.5, 1e-12);
  EXPECT_NEAR(advanced(playing(Loop::around), motion, 0.45).place, 4.5, 1e-12);
  EXPECT_EQ(pose_at(advanced(playing(Loop::around), motion, 0.45), motion), motion.frames[4].pose);  // as long as any other
  EXPECT_NEAR(advanced(playing(Loop::around), motion, 0.55).place, 0.5, 1e-12);

  const Timeline stopped = advanced(playing(Loop::once), motion, 0.7);
  EXPECT_EQ(stopped.place, 4);
  EXPECT_FALSE(stopped.playing);
  EXPECT_EQ(played(stopped, motion).place, 0);
  EXPECT_TRUE(played(stopped, motion).playing);
  EXPECT_EQ(played(playing(Loop::once, 2), motion).place, 2);

  const Timeline back = advanced(playing(Loop::there_and_back), motion, 0.55);
  EXPECT_NEAR(back.place, 2.5, 1e-12);
  EXPECT_TRUE(back.backwards);
  EXPECT_NEAR(advanced(back, motion, 0.2).place, 0.5, 1e-12);
  const Timeline again = advanced(back, motion, 0.3);
  EXPECT_NEAR(again.place, 0.5, 1e-12);
  EXPECT_FALSE(again.backwards);
}

// However often it is told.
TEST(TimelineTest, ManyShortTimesAreOneLong) {
  const Motion motion = five_frames(30);
  for (const Loop loop : {Loop::around, Loop::once, Loop::there_and_back}) {
    Timeline often = playing(loop);
    often.speed = 0.7;
    const Timeline at_once = advanced(often, motion, 1.234);
    for (int i = 0; i < 1234; ++i) often = advanced(often, motion, 0.001);
    EXPECT_NEAR(often.place, at_once.place, 1e-9) << to_string(loop);
    EXPECT_EQ(often.backwards, at_once.backwards);
    EXPECT_EQ(often.playing, at_once.playing);
  }
}

TEST(TimelineTest, KeepsItsPaceWithinBounds) {
  const Motion motion = five_frames();
  Timeline timeline = playing(Loop::around);
  timeline.speed = 1000;
  EXPECT_NEAR(advanced(timeline, motion, 0.1).place, 4, 1e-12);
  timeline.speed = 0;
  EXPECT_NEAR(advanced(timeline, motion, 0.1).place, 0.1, 1e-12);
  EXPECT_EQ(pace_of(five_frames(0)), 25);
  EXPECT_EQ(pace_of(motion), 10);
}

TEST(TimelineTest, StepsFromFrameToFrame) {
  const Motion motion = five_frames();
  const Timeline between = playing(Loop::around, 1.5);
  EXPECT_EQ(stepped(between, motion, 1).place, 2);
  EXPECT_EQ(stepped(between, motion, -1).place, 1);
  EXPECT_FALSE(stepped(between, motion, 1).playing);
  EXPECT_EQ(stepped(playing(Loop::around, 4), motion, 1).place, 0);
  EXPECT_EQ(stepped(playing(Loop::around, 4.5), motion, 1).place, 0);
  EXPECT_EQ(stepped(playing(Loop::around, 0), motion, -1).place, 4);
  EXPECT_EQ(stepped(playing(Loop::once, 4), motion, 1).place, 4);
  EXPECT_EQ(stepped(playing(Loop::there_and_back, 0), motion, -1).place, 0);
}

TEST(TimelineTest, StaysInTheMotionWhateverItIsTold) {
  Motion motion = five_frames();
  for (const Loop loop : {Loop::around, Loop::once, Loop::there_and_back}) {
    for (const double seconds : {0.0, -1.0, std::nan(""), std::numeric_limits<double>::infinity(), 1e9, 1e300}) {
      const Timeline next = advanced(playing(loop, 2.5), motion, seconds);
      EXPECT_GE(next.place, 0);
      EXPECT_LE(next.place, 5);
      EXPECT_EQ(pose_at(next, motion).theta.size(), 1u);
    }
    for (const double place : {-1.0, 1e300, std::nan("")}) EXPECT_LT(frame_at(scrubbed(playing(loop), motion, place), motion), 5u);
  }
  motion.frames.resize(1);
  for (const Loop loop : {Loop::around, Loop::once, Loop::there_and_back}) EXPECT_EQ(pose_at(advanced(playing(loop), motion, 0.33), motion), motion.frames[0].pose);
  motion.frames.clear();
  EXPECT_THROW(pose_at({}, motion), std::invalid_argument);
}

}  // namespace
}  // namespace arah

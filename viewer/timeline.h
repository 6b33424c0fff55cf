// Where a motion stands that is played. It has no clock: it is told how much time went by.
#pragma once

#include <cstddef>

#include "host/body/motion.h"

namespace arah {

enum class Loop {
  around,          // after the last frame the first
  once,            // stops at the last
  there_and_back,  // turns at both ends
};
constexpr const char* to_string(Loop loop) { return loop == Loop::around ? "around" : loop == Loop::once ? "once" : "there_and_back"; }

inline constexpr double kSlowest = 0.1, kFastest = 4;

// Frames follow each other evenly, whatever their numbers, as in resampled(). The first stands at place 0, the last at frames − 1; going around, it is
// shown as long as any other.
struct Timeline {
  double place = 0;        // frames since the first
  bool playing = false;
  bool backwards = false;  // on the way back of there_and_back
  double speed = 1;        // of the motion's own pace, kSlowest to kFastest
  Loop loop = Loop::around;

  bool operator==(const Timeline&) const = default;
};

// Frames a second of a motion: as it states, 25 where it does not.
double pace_of(const Motion& motion);

// The timeline after so many seconds. Nothing where it does not play, or where the seconds are not finite or not above 0.
Timeline advanced(const Timeline& timeline, const Motion& motion, double seconds);
// Played from here; from the first frame where it stands at the end of `once`.
Timeline played(const Timeline& timeline, const Motion& motion);
// By whole frames, on a frame, at rest: from between two to the next or the one before; beyond an end to the other where it goes around, else not.
Timeline stepped(const Timeline& timeline, const Motion& motion, int frames);
// At a place in frames, or in seconds of the motion's own pace; what is outside becomes the end. It goes on playing where it did.
Timeline scrubbed(const Timeline& timeline, const Motion& motion, double place);
Timeline scrubbed_to_time(const Timeline& timeline, const Motion& motion, double seconds);

// Its own time, seconds at the motion's own pace.
double time_of(const Timeline& timeline, const Motion& motion);
// The frame that is shown, or the one before the place: index into motion.frames. A place within a millionth of a frame is the frame.
std::size_t frame_at(const Timeline& timeline, const Motion& motion);
// That frame's own pose, bit for bit, or between two a blend of both. Nothing lies between the last frame and the first.
Pose pose_at(const Timeline& timeline, const Motion& motion);

}  // namespace arah

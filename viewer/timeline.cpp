#include "viewer/timeline.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "host/body/pose_blend.h"

namespace arah {
namespace {

constexpr double kOnTheFrame = 1e-6;

double last_place(const Motion& motion) {
  if (motion.frames.empty()) throw std::invalid_argument("a motion without frames to play");
  return static_cast<double>(motion.frames.size() - 1);
}

// The nearest frame where that is as good as the place, and never outside the motion.
double settled(double place, const Motion& motion) {
  const double nearest = std::round(place);
  return std::clamp(std::abs(place - nearest) < kOnTheFrame ? nearest : place, 0.0, last_place(motion));
}

// x in [0, period), also for x below 0.
double wrapped(double x, double period) {
  const double rest = std::fmod(x, period);
  return rest < 0 ? rest + period : rest;
}

}  // namespace

double pace_of(const Motion& motion) { return motion.frames_per_second > 0 ? motion.frames_per_second : 25; }

Timeline advanced(const Timeline& timeline, const Motion& motion, double seconds) {
  const double last = last_place(motion);
  const double way = seconds * pace_of(motion) * std::clamp(timeline.speed, kSlowest, kFastest);
  Timeline next = timeline;
  if (!timeline.playing || !std::isfinite(way) || !(way > 0)) return next;
  if (timeline.loop == Loop::around) {
    next.place = wrapped(timeline.place + way, last + 1);
  } else if (timeline.loop == Loop::once) {
    next.place = std::min(timeline.place + way, last);
    next.playing = next.place < last;
  } else if (last > 0) {
    const double along = wrapped((timeline.backwards ? 2 * last - timeline.place : timeline.place) + way, 2 * last);
    next.backwards = along > last;
    next.place = next.backwards ? 2 * last - along : along;
  }
  return next;
}

Timeline played(const Timeline& timeline, const Motion& motion) {
  Timeline next = timeline;
  next.playing = true;
  if (timeline.loop == Loop::once && timeline.place >= last_place(motion)) next.place = 0;
  return next;
}

Timeline stepped(const Timeline& timeline, const Motion& motion, int frames) {
  const double place = settled(timeline.place, motion), count = last_place(motion) + 1;
  const double to = (frames > 0 ? std::floor(place) : std::ceil(place)) + frames;
  Timeline next = timeline;
  next.playing = false;
  next.place = timeline.loop == Loop::around ? wrapped(to, count) : std::clamp(to, 0.0, count - 1);
  return next;
}

Timeline scrubbed(const Timeline& timeline, const Motion& motion, double place) {
  Timeline next = timeline;
  next.place = std::isnan(place) ? timeline.place : settled(place, motion);
  return next;
}

Timeline scrubbed_to_time(const Timeline& timeline, const Motion& motion, double seconds) { return scrubbed(timeline, motion, seconds * pace_of(motion)); }

double time_of(const Timeline& timeline, const Motion& motion) { return timeline.place / pace_of(motion); }

std::size_t frame_at(const Timeline& timeline, const Motion& motion) { return static_cast<std::size_t>(settled(timeline.place, motion)); }

Pose pose_at(const Timeline& timeline, const Motion& motion) {
  const double place = settled(timeline.place, motion);
  const std::size_t before = static_cast<std::size_t>(place), after = std::min(before + 1, motion.frames.size() - 1);
  return blended(motion.frames[before].pose, motion.frames[after].pose, place - static_cast<double>(before));
}

}  // namespace arah

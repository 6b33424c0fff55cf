// Whose poses a command draws or writes: a split's of a capture, a motion file's, or the one that the avatar rests in.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "host/avatar/avatar.h"
#include "host/capture/capture.h"
#include "host/rendering/orbit_camera.h"

namespace CLI {
class App;
}

namespace arah {

struct MotionOptions {
  std::filesystem::path capture, motion;
  std::string split = "train";

  bool rests() const { return capture.empty() && motion.empty(); }
};
// "--capture FOLDER", "--split NAME", "--motion FILE".
void add_motion_options(CLI::App& command, MotionOptions& options);

struct ChosenMotion {
  std::vector<MotionFrame> frames;  // never empty, joints in the avatar's order; training frames as the avatar refined them
  UpAxis up = UpAxis::z;            // of their world; y at rest
  std::optional<Capture> capture;   // where they come from one
  bool trained = false;             // frames of training, which have codes of their own
  std::string where;                // names them in errors
  double frames_per_second = 0;     // 0: not known
};
// At rest: one frame, number 0; an avatar without skinning has no other pose. Throws InputError as open_capture, motion_of,
// read_motion and adapt_motion do.
ChosenMotion chosen_motion(const MotionOptions& options, const Avatar& avatar);

// The frame of this number. Throws InputError naming those that there are.
const MotionFrame& frame_of(const ChosenMotion& motion, int number);

// "--fps RATE" for pictures or key frames: `what` they are. Left out, it stays empty.
void add_rate_option(CLI::App& command, std::optional<double>& rate, const std::string& what);
// As stated, else such that every so-many-th frame goes on at the motion's own pace; 25 where that is not known or a single frame is shown.
double rate_of(const ChosenMotion& motion, const std::optional<double>& stated, int every, bool single);

// Row of the avatar's codes for a frame; 0 where it has none.
std::size_t latent_row_of(const ChosenMotion& motion, const Avatar& avatar, int number);

}  // namespace arah

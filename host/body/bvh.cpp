#include "host/body/bvh.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <glm/trigonometric.hpp>
#include <set>

#include "host/body/mapped_file.h"
#include "host/input_error.h"

namespace arah {
namespace {

constexpr std::size_t kMostBvhDepth = 64;
constexpr double kMostBvhNumber = 1e9;

struct BvhChannel {
  bool rotates = false;
  int axis = 0;
};

struct BvhJoint {
  std::string name;
  int parent = -1;
  glm::dvec3 offset{0.0};
  std::vector<BvhChannel> channels;

  bool moves() const {
    return std::any_of(channels.begin(), channels.end(), [](const BvhChannel& channel) { return !channel.rotates; });
  }
};

// Where a joint's channels put it in its parent's frame.
struct BvhPlace {
  glm::dmat3 rotation{1.0};
  glm::dvec3 position{0.0};
};

class BvhReader {
 public:
  explicit BvhReader(const std::filesystem::path& path) : where_(path.string()), file_(path), rest_(file_.bytes()) {}

  Motion read(double metres_per_unit) {
    read_hierarchy();
    Motion motion;
    std::size_t root = 0;  // the joint that becomes the motion's root, with all above it
    while (children_of(root) == 1 && root + 1 < joints_.size() && joints_[root + 1].moves()) ++root;
    glm::dvec3 at(0.0);
    for (std::size_t j = 0; j < joints_.size(); ++j) {
      if (j <= root) at += joints_[j].offset;
      if (j < root) continue;
      const bool is_root = j == root;
      const auto parent = static_cast<std::size_t>(std::max(0, joints_[j].parent));
      motion.skeleton.names.push_back(joints_[j].name);
      motion.skeleton.parents.push_back(is_root ? -1 : static_cast<int>(parent - root));
      motion.skeleton.rest_joints.push_back(
          is_root ? metres_per_unit * at : motion.skeleton.rest_joints[parent - root] + metres_per_unit * joints_[j].offset);
    }
    read_frames(motion, root, metres_per_unit);
    return motion;
  }

 private:
  [[noreturn]] void fail(const std::string& expected, const std::string& found, const std::string& advice = "") const {
    throw InputError(where_, fmt::format("line {}", line_), expected, found, advice);
  }
  static bool is_space(char c) { return c == ' ' || c == '\t' || c == '\r' || c == '\n' || c == '\f' || c == '\v'; }

  // The next word, or nothing at the end of the line (where `in_line`) or of the file.
  std::string_view next(bool in_line = false) {
    while (!rest_.empty() && is_space(rest_.front()) && !(in_line && rest_.front() == '\n')) {
      line_ += rest_.front() == '\n' ? 1 : 0;
      rest_.remove_prefix(1);
    }
    std::size_t length = 0;
    while (length < rest_.size() && !is_space(rest_[length])) ++length;
    const std::string_view word = rest_.substr(0, length);
    rest_.remove_prefix(length);
    return word;
  }
  static std::string shown(std::string_view word) {
    if (word.empty()) return "the end of the file";
    std::string text = "'";
    for (const char c : word.substr(0, 40)) text += c >= ' ' && c <= '~' ? c : '?';
    return text + "'";
  }
  void expect(std::string_view keyword) {
    const std::string_view word = next();
    if (word != keyword) fail(fmt::format("'{}'", keyword), shown(word));
  }
  double number(std::string_view word, const char* what) const {
    double value = 0.0;
    const std::string_view digits = !word.empty() && word.front() == '+' ? word.substr(1) : word;
    const auto [stop, error] = std::from_chars(digits.data(), digits.data() + digits.size(), value);
    if (error != std::errc() || stop != digits.data() + digits.size() || !(std::abs(value) <= kMostBvhNumber)) {
      fail(fmt::format("{}: a finite number, at most 1e9", what), shown(word));
    }
    return value;
  }
  std::size_t count(std::string_view word, const char* what) const {
    std::size_t value = 0;
    const auto [stop, error] = std::from_chars(word.data(), word.data() + word.size(), value);
    if (error != std::errc() || stop != word.data() + word.size()) fail(fmt::format("{}: a whole number", what), shown(word));
    return value;
  }
  // A name is what stands before the line's end or the brace, spaces within it too.
  std::string name() {
    const std::size_t length = std::min(rest_.find_first_of("\n{"), rest_.size());
    std::string_view text = rest_.substr(0, length);
    rest_.remove_prefix(length);
    while (!text.empty() && is_space(text.front())) text.remove_prefix(1);
    while (!text.empty() && is_space(text.back())) text.remove_suffix(1);
    if (text.empty() || text.size() > 200) fail("a joint's name", text.empty() ? "none" : fmt::format("{} letters", text.size()));
    return std::string(text);
  }
  glm::dvec3 offset() {
    expect("OFFSET");
    glm::dvec3 value;
    for (int k = 0; k < 3; ++k) value[k] = number(next(), "OFFSET");
    return value;
  }

  void read_hierarchy() {
    expect("HIERARCHY");
    expect("ROOT");
    open_joint(-1);
    std::vector<int> open{0};  // the joints whose braces are open
    while (!open.empty()) {
      const std::string_view word = next();
      if (word == "}") {
        open.pop_back();
      } else if (word == "JOINT") {
        if (open.size() >= kMostBvhDepth) fail(fmt::format("joints nested at most {} deep", kMostBvhDepth), "one deeper");
        open_joint(open.back());
        open.push_back(static_cast<int>(joints_.size()) - 1);
      } else if (word == "End") {
        expect("Site");
        expect("{");
        offset();
        expect("}");
      } else {
        fail("'JOINT', 'End Site' or '}'", shown(word));
      }
    }
  }

  void open_joint(int parent) {
    if (joints_.size() >= kMostBvhJoints) fail(fmt::format("at most {} joints", kMostBvhJoints), "more");
    BvhJoint joint;
    joint.parent = parent;
    joint.name = name();
    if (!names_.insert(joint.name).second) fail("distinct joint names", fmt::format("{} twice", shown(joint.name)));
    expect("{");
    joint.offset = offset();
    expect("CHANNELS");
    const std::size_t channels = count(next(), "CHANNELS");
    if (channels > 6) fail("at most 6 channels", fmt::format("{}", channels));
    for (std::size_t c = 0; c < channels; ++c) joint.channels.push_back(channel(joint));
    joints_.push_back(std::move(joint));
    channels_ += channels;
  }

  BvhChannel channel(const BvhJoint& joint) {
    const std::string_view word = next();
    for (int axis = 0; axis < 3; ++axis) {
      for (const bool rotates : {false, true}) {
        if (word != fmt::format("{}{}", "XYZ"[axis], rotates ? "rotation" : "position")) continue;
        for (const BvhChannel& other : joint.channels) {
          if (other.axis == axis && other.rotates == rotates) fail("each channel once", fmt::format("{} twice", shown(word)));
        }
        return {rotates, axis};
      }
    }
    fail("Xposition, Yposition, Zposition, Xrotation, Yrotation or Zrotation", shown(word));
  }

  std::size_t children_of(std::size_t joint) const {
    return static_cast<std::size_t>(std::count_if(joints_.begin(), joints_.end(), [&](const BvhJoint& other) { return other.parent == static_cast<int>(joint); }));
  }

  void read_frames(Motion& motion, std::size_t root, double metres_per_unit) {
    if (channels_ == 0) fail("joints with channels", "none");
    expect("MOTION");
    expect("Frames:");
    const std::size_t frames = count(next(), "Frames");
    if (frames < 1) fail("1 or more frames", "0");
    check_motion_size(frames, joints_.size(), where_, fmt::format("line {}: Frames", line_));
    expect("Frame");
    expect("Time:");
    const double seconds = number(next(), "Frame Time");
    if (!(seconds >= 1e-6)) fail("Frame Time: seconds above 0", fmt::format("{}", seconds));
    motion.frames_per_second = 1.0 / seconds;
    const double whole = std::round(motion.frames_per_second);
    if (whole > 0.0 && std::abs(motion.frames_per_second / whole - 1.0) < 5e-4) motion.frames_per_second = whole;

    for (std::size_t f = 0; f < frames; ++f) {
      MotionFrame frame;
      frame.number = static_cast<int>(f);
      frame.pose.theta.reserve(joints_.size() - root);
      BvhPlace above;  // of the joints that the root takes in
      bool first = true;
      for (std::size_t j = 0; j < joints_.size(); ++j) {
        const BvhPlace place = read_place(joints_[j], f, frames, first);
        if (j <= root) {
          above.position += above.rotation * place.position;
          above.rotation = above.rotation * place.rotation;
          frame.pose.root_position = metres_per_unit * above.position;
        }
        if (j >= root) frame.pose.theta.push_back(axis_angle_from_rotation(j == root ? above.rotation : place.rotation));
      }
      if (const std::string_view word = next(true); !word.empty()) {
        fail(fmt::format("{} numbers a line, as the joints have channels", channels_), shown(word) + " after them");
      }
      motion.frames.push_back(std::move(frame));
    }
    if (const std::string_view word = next(); !word.empty()) fail(fmt::format("the end after {} frames", frames), shown(word));
  }

  BvhPlace read_place(const BvhJoint& joint, std::size_t frame, std::size_t frames, bool& first) {
    BvhPlace place{glm::dmat3(1.0), joint.offset};
    for (const BvhChannel& channel : joint.channels) {
      const std::string_view word = next(!first);
      if (word.empty() && !rest_.empty()) fail(fmt::format("{} numbers a line, as the joints have channels", channels_), "fewer");
      if (word.empty()) fail(fmt::format("{} frames of {} numbers", frames, channels_), fmt::format("the end of the file in frame {}", frame));
      first = false;
      const double value = number(word, "a channel");
      if (channel.rotates) {
        glm::dvec3 turn(0.0);
        turn[channel.axis] = glm::radians(value);
        place.rotation = place.rotation * rotation_from_axis_angle(turn);
      } else {
        place.position[channel.axis] = value;
      }
    }
    return place;
  }

  std::string where_;
  MappedFile file_;
  std::string_view rest_;
  std::size_t line_ = 1;
  std::vector<BvhJoint> joints_;
  std::set<std::string> names_;
  std::size_t channels_ = 0;
};

}  // namespace

Motion read_bvh(const std::filesystem::path& path, double metres_per_unit) {
  return BvhReader(path).read(metres_per_unit);
}

}  // namespace arah

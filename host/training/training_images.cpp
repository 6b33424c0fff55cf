#include "host/training/training_images.h"

#include <algorithm>
#include <glm/geometric.hpp>
#include <set>

#include "host/input_error.h"

namespace arah {

TrainingImages::TrainingImages(Device& device, Avatar& avatar, const Capture& capture, int size, const ShellSettings& shell)
    : device_(device), avatar_(avatar), capture_(capture), size_(size), shell_(shell), body_(device, avatar.body) {
  const Motion& motion = motion_of(capture, "train");
  frames_.resize(motion.frames.size());
  for (const MotionFrame& frame_of_motion : motion.frames) poses_.push_back(frame_of_motion.pose);
  shell_poses_ = poses_;
  shell_shapes_ = shapes_ = std::vector(poses_.size(), avatar.body.shape.beta);
  for (const Camera& camera : capture.cameras) cameras_.push_back(size > 0 ? camera.scaled(size) : camera);
  for (size_t camera = 0; camera < capture.cameras.size(); ++camera) {
    if (capture.cameras[camera].role != "train") continue;
    const std::vector<int> with_picture = frames_with_images(capture, "train", camera);
    for (size_t frame = 0; frame < motion.frames.size(); ++frame)
      if (std::find(with_picture.begin(), with_picture.end(), motion.frames[frame].number) != with_picture.end()) places_.push_back({camera, frame});
  }
  std::sort(places_.begin(), places_.end(), [](const Place& a, const Place& b) { return a.frame != b.frame ? a.frame < b.frame : a.camera < b.camera; });
  if (places_.empty()) throw InputError(capture.path.string(), "images/train", "pictures from cameras of the role train", "none");
}

int TrainingImages::frame_number(size_t frame) const { return motion_of(capture_, "train").frames[frame].number; }

FrameOnDevice& TrainingImages::frame(size_t frame) {
  std::unique_ptr<FrameOnDevice>& slot = frames_[frame];
  if (!slot) {
    const InShape of_shell(avatar_.body, shell_shapes_[frame]);
    slot = std::make_unique<FrameOnDevice>(device_, avatar_, body_, shell_poses_[frame], shell_);
    shapes_[frame] = shell_shapes_[frame];
    if (poses_[frame] != shell_poses_[frame]) set_pose(frame, poses_[frame]);
  }
  if (shapes_[frame] != avatar_.body.shape.beta) set_pose(frame, poses_[frame]);
  return *slot;
}

void TrainingImages::set_pose(size_t frame, const Pose& pose) {
  poses_[frame] = pose;
  if (!frames_[frame]) return;
  frames_[frame]->set_pose(device_, avatar_, pose);
  shapes_[frame] = avatar_.body.shape.beta;
}

bool TrainingImages::renew(size_t frame, double drift) {
  const std::vector<double> shape = avatar_.body.shape.beta;
  if (poses_[frame] == shell_poses_[frame] && shape == shell_shapes_[frame]) return false;
  const std::vector<glm::vec3> now = posed_vertices(avatar_.body, poses_[frame]);
  const std::vector<glm::vec3> then = [&] {
    const InShape of_shell(avatar_.body, shell_shapes_[frame]);
    return posed_vertices(avatar_.body, shell_poses_[frame]);
  }();
  double farthest = 0;
  for (size_t v = 0; v < now.size(); ++v) farthest = std::max(farthest, double{glm::distance(now[v], then[v])});
  if (drift > 0 && farthest <= drift) return false;
  shell_poses_[frame] = poses_[frame];
  shell_shapes_[frame] = shape;
  frames_[frame].reset();
  std::erase_if(images_, [&](const auto& entry) { return entry.first.second == frame; });
  return true;
}

void TrainingImages::make_frames(bool correspondences, uint64_t besides) {
  std::set<size_t> wanted;
  for (const Place& place : places_) wanted.insert(place.frame);
  for (const size_t number : wanted) {
    FrameOnDevice& made = frame(number);
    if (correspondences && !made.correspondences()) made.make_correspondences(device_, shell_);
    const uint64_t rest = made.bytes() * (wanted.size() - 1) + besides;
    if (number == *wanted.begin() && device_.memory_ceiling() && device_.allocated_bytes() + rest > device_.memory_ceiling())
      throw device_.beyond_ceiling(fmt::format("training on {} frames of {:.1f} MB", wanted.size(), 1e-6 * static_cast<double>(made.bytes())), rest);
  }
}

uint64_t TrainingImages::frame_bytes() const {
  uint64_t bytes = 0;
  for (const auto& frame_made : frames_)
    if (frame_made) bytes += frame_made->bytes();
  return bytes;
}

const TrainingImage& TrainingImages::image(Commands& commands, RaySamples& finder, const Place& place) {
  const auto [slot, made] = images_.try_emplace({place.camera, place.frame});
  TrainingImage& image = slot->second;
  if (!made) return image;
  const Image picture = load_image(capture_, "train", place.camera, frame_number(place.frame), size_);
  const PixelMask border = load_border(capture_, "train", place.camera, frame_number(place.frame), size_);
  FrameOnDevice& frame_here = frame(place.frame);
  {
    const InShape of_shell(avatar_.body, shell_shapes_[place.frame]);
    frame_here.set_pose(device_, avatar_, shell_poses_[place.frame]);  // not of the moment when the picture is first asked for
  }
  std::vector<uint32_t> pixels;
  for (int v = 0; v < picture.height; ++v)
    for (int u = 0; u < picture.width; ++u) pixels.push_back(static_cast<uint32_t>(u) | static_cast<uint32_t>(v) << 16);
  for (size_t first = 0; first < pixels.size(); first += finder.capacity_pixels()) {
    const size_t count = std::min<size_t>(finder.capacity_pixels(), pixels.size() - first);
    finder.set_pixels(commands, frame_here, cameras_[place.camera], {pixels.begin() + static_cast<ptrdiff_t>(first), pixels.begin() + static_cast<ptrdiff_t>(first + count)});
    const std::vector<uint32_t> drawn = finder.drawn_from(static_cast<uint32_t>(count));
    for (size_t i = 0; i < count; ++i) {
      if (drawn[i] == 0 || (!border.inside.empty() && border.inside[first + i])) continue;
      const float* rgba = &picture.rgba[4 * (first + i)];
      const bool person = rgba[3] >= 0.5f;
      (person ? image.person : image.around).push_back({pixels[first + i], {rgba[0], rgba[1], rgba[2], person ? 1.0f : 0.0f}});
    }
  }
  frame_here.set_pose(device_, avatar_, poses_[place.frame]);
  return image;
}

}  // namespace arah

// The pictures that training looks at, reduced to what it reads of them: pixels whose rays can meet the person.
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <memory>
#include <vector>

#include "host/capture/capture.h"
#include "host/rendering/frame_on_device.h"
#include "host/rendering/ray_samples.h"

namespace arah {

// Pixels of one picture whose rays enter the template's shell.
struct TrainingImage {
  struct Pixel {
    uint32_t place = 0;              // column | row << 16
    std::array<float, 4> target{};  // rgb on black, mask 0 or 1
  };
  std::vector<Pixel> person;  // mask set
  std::vector<Pixel> around;  // mask not set
};

// Frames and pictures of the capture's training split, made when first asked for and kept.
class TrainingImages {
 public:
  struct Place {
    size_t camera = 0;  // of the capture
    size_t frame = 0;   // of the training motion
  };

  // size: columns that pictures are reduced to; 0: as they are. Throws InputError where there is no training picture.
  // The avatar's body has the shape that frames are asked for in; to make what stays of another it takes that for a moment.
  TrainingImages(Device& device, Avatar& avatar, const Capture& capture, int size, const ShellSettings& shell);

  const std::vector<Place>& places() const { return places_; }  // every training picture, by frame, then by camera
  FrameOnDevice& frame(size_t frame);

  // The frames' poses: the capture's, until others are set. A frame's bone transforms and box follow its pose at once. What is
  // slow to make (posed vertices and shell, correspondences between them, and which pixels' rays meet the shell) stays that of
  // the pose and shape in which it was made, until renew() finds a vertex that has moved farther than `drift` metres in the world (0: until
  // they differ at all): then it is dropped, to be made again when next asked for. Neither waits: not while launches that read the frame run.
  const std::vector<Pose>& poses() const { return poses_; }
  const std::vector<Pose>& shell_poses() const { return shell_poses_; }
  const std::vector<std::vector<double>>& shell_shapes() const { return shell_shapes_; }  // β by frame
  void set_pose(size_t frame, const Pose& pose);
  bool renew(size_t frame, double drift);
  // All frames that have a picture, with room for their correspondences where wanted. Throws MemoryCeilingError where the
  // device's ceiling leaves too little for them, all as large as the first, and for `besides` bytes.
  void make_frames(bool correspondences, uint64_t besides);
  uint64_t frame_bytes() const;  // of all frames made so far
  // `finder` lends its ray buffers for the test of which rays enter the shell. Submits where the picture is new.
  const TrainingImage& image(Commands& commands, RaySamples& finder, const Place& place);
  const Camera& camera(size_t index) const { return cameras_[index]; }
  int frame_number(size_t frame) const;

 private:
  Device& device_;
  Avatar& avatar_;
  const Capture& capture_;
  int size_;
  ShellSettings shell_;
  TemplateOnDevice body_;
  std::vector<Camera> cameras_;
  std::vector<Place> places_;
  std::vector<Pose> poses_, shell_poses_;  // by frame
  std::vector<std::vector<double>> shell_shapes_, shapes_;  // by frame: of its shell, and that its bone transforms are of
  std::vector<std::unique_ptr<FrameOnDevice>> frames_;
  std::map<std::pair<size_t, size_t>, TrainingImage> images_;
};

}  // namespace arah

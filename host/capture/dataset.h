// Sequences of public datasets as they lie on disk: cameras, frames, where pictures, masks and fitted bodies are. What
// import.h makes captures of.
#pragma once

#include <filesystem>
#include <glm/vec3.hpp>
#include <optional>
#include <string>
#include <vector>

#include "host/body/pose.h"
#include "host/capture/camera.h"

namespace arah {

// A body fitted to a frame: x_world = R(Rh) · LBS(poses)(x_rest) + Th, the rotation about the world's origin.
struct BodyFit {
  std::vector<glm::dvec3> poses;  // [24] axis-angles; the root's own is usually 0 (52 for SMPL-H, 55 for SMPL-X)
  glm::dvec3 Rh{0.0};             // axis-angle
  glm::dvec3 Th{0.0};             // metres
  std::vector<double> shapes;     // betas
};

struct DatasetPicture {
  std::size_t camera = 0;  // of the dataset
  std::filesystem::path image, mask;
  // Which frame of `image`, where that is a video, and of `mask`, where that is HDF5's `masks`; −1: files of their own.
  int image_frame = -1, mask_frame = -1;
};

struct DatasetFrame {
  int number = 0;
  std::filesystem::path fit;      // the body's pose, for read_body_fit()
  std::optional<BodyFit> fitted;  // the same, where one file has that of all frames
  std::vector<DatasetPicture> pictures;
};

struct Dataset {
  std::string sequence;          // the folder's name: "CoreView_377"
  std::vector<Camera> cameras;   // metres; `width` and `height`: of the pictures that K is for
  bool resize_pictures = false;  // pictures of another size are resized to the cameras' before anything else
  std::vector<DatasetFrame> frames;
  std::vector<std::string> notes;  // what a user should know
};

// ZJU-MoCap as Neural Body lays it out (ARAH.md §8): annots.npy with cameras (T in millimetres) and the pictures of every
// frame, mask_cihp/ (or mask/), new_params/ (or the older params/). Cameras are called as their folders, "Camera (7)" of
// the sequences 313 and 315 as "Camera_7"; their frames count from 1 in file names and from 0 here. Reads the sizes of the
// cameras' first pictures. Throws InputError: what is missing or not as described.
Dataset read_zju_mocap(const std::filesystem::path& folder);

// Human3.6M as Animatable NeRF lays it out: the same in S*/Posing, with intrinsics for pictures of 1000 x 1002 pixels.
Dataset read_h36m(const std::filesystem::path& folder);

// EasyMocap's own: intri.yml and extri.yml (metres), images/<camera>/<frame>.jpg, masks of the same names in mask/, masks/,
// mask-schp/ or mask_cihp/, fits in output-smpl-3d/smpl/, output/smpl/smpl/, output/smpl/ or smpl/. Frames are those that
// have a fit.
Dataset read_easymocap(const std::filesystem::path& folder);

// People Snapshot: one camera, which stands still, before a person who turns. camera.pkl (focal lengths, centre, distortion and
// size), and for every frame its picture in <name>.mp4 or image/, its mask in masks.hdf5 (`masks`) or mask/, and its body in
// reconstructed_poses.hdf5 (`pose` of 72 numbers, `trans`, `betas`) or in models/*.npz (root_orient, pose_body, pose_hand, trans),
// as loaders of that set have them. Files of one frame each are called by consecutive numbers. Frames count from 0. The published
// files are in the camera's axes, y down; here the world has +Z up, as a capture's has: (x, y, z) ↦ (x, z, −y). Poses,
// pictures and masks may differ by one in number (published are 649 poses for 648 frames): the last is left out then. A
// pose and a place that are all zeros are of a frame that was not fitted.
Dataset read_people_snapshot(const std::filesystem::path& folder);

// Whether the frame has a body, and that body.
bool has_fit(const DatasetFrame& frame);
BodyFit fit_of(const DatasetFrame& frame);

// A body fitted by EasyMocap. From new_params/<frame>.npy (a pickled dictionary) or EasyMocap's <frame>.json (a list of people, or one under "annots";
// the one with the lowest id is taken). 69 numbers of poses lack the root's, which are 0 then. Throws InputError.
BodyFit read_body_fit(const std::filesystem::path& path);

// The same as a pose of a rig whose root rests at `root_rest`: θ_0 = log(R(Rh) R(poses_0)), root at R(Rh) J_0 + Th.
Pose pose_of_fit(const BodyFit& fit, const glm::dvec3& root_rest);

}  // namespace arah

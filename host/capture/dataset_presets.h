// The official splits of public datasets, and splits in general: which frames and cameras of a sequence learn, and which
// measure.
#pragma once

#include <string>
#include <vector>

namespace arah {

// Every `step`-th frame from `first` on, before `end`.
struct FrameRange {
  std::string split;  // "train", "novel", …
  int first = 0, end = 0, step = 1;

  bool has(int frame) const { return frame >= first && frame < end && (frame - first) % step == 0; }
};

struct SplitPlan {
  std::vector<std::string> train_cameras;  // names, or the numbers at the end of them; empty: all
  std::vector<std::string> test_cameras;   // held out; empty: all others
  std::vector<FrameRange> ranges;          // in the sequence's own frame numbers
  int held_out_step = 6;       // of the training frames, which held-out cameras see
  bool only_held_out = false;  // in other splits than "train": pictures of held-out cameras alone
  int training_band = 0;       // pixels on either side of the mask's edge that training leaves out
  int evaluation_band = 0;     // pixels by which masks of held-out cameras are grown
};

struct DatasetPreset {
  std::string name;      // "zju-377"
  std::string layout;    // "zju-mocap" or "h36m"
  std::string sequence;  // the folder whose import takes it without being asked to
  SplitPlan plan;
  int frame_step = 1;  // the published frame number k is the sequence's frame k · frame_step
};

// The nine sequences of ZJU-MoCap and seven of H36M as ARAH.md §8 gives them: train, and "novel", the held-out poses.
const std::vector<DatasetPreset>& dataset_presets();
// Throws InputError naming what there is.
const DatasetPreset& dataset_preset(const std::string& name);
// A table for people, one preset a line.
std::string preset_table();

// "novel=60:79" or "train=0:300:2", Python's first:end:step. Throws InputError.
FrameRange parse_frame_range(const std::string& text);

// Whether the camera called `name` is meant by `word`: its name, or the number at its end.
bool camera_is(const std::string& name, const std::string& word);

}  // namespace arah

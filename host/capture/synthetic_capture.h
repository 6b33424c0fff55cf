// Writes a capture of an invented subject: everything that a recording would hold, and the truth besides.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>

namespace arah {

struct SyntheticSettings {
  std::filesystem::path rig;  // a skinned glTF file to use as the body; empty: the built-in figure
  int frames = 40;         // of the training motion, 1..10000; the held-out motion has a third as many (at least one)
  int size = 256;          // pixels, width and height of the pictures, 16..4096
  std::uint64_t seed = 0;  // build, colours, motion and cameras; the same seed gives the same bytes
  std::uint64_t body_seed = 0;  // another build and other clothes for the built-in figure (varied_figure); 0: its own
};

// Called from the writing threads, one call at a time: the part done in 0..1 and what is being done.
using SyntheticProgress = std::function<void(double fraction, const std::string& what)>;

// Writes a capture in the native layout to the folder `out`:
//   template.glb                           the naked body, with its shape as morph targets (body_with_shape), or the rig
//   cameras.json                           cam_00..cam_03 for training around the subject, cam_04..cam_07 held out in
//   between, at
//                                          other heights
//   motion_train.json, motion_novel.json   two different motions, numbered through
//   images/<split>/<camera>/<frame>.png    train: training cameras in all frames, held-out cameras in every 6th; novel:
//   all cameras meshes/<split>_<frame>.ply             the clothed surface in the world, every 12th training and every
//   6th novel frame synthetic.json                         the settings; marks the folder as one that may be written
//   again
// The folder appears under its name once it is complete (it is built as <out>.partial). An empty folder or an earlier
// synthetic capture is replaced. Throws InputError: settings out of range, a rig that cannot be read, `out` is a file
// or a folder with anything else in it. Throws std::runtime_error when the disk refuses.
void write_synthetic_capture(const std::filesystem::path& out, const SyntheticSettings& settings,
                             const SyntheticProgress& progress = {});

}  // namespace arah

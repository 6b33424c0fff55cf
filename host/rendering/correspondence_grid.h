// The canonical correspondences of one posed frame, kept: roots at the nodes of its shell's grid, between which the
// correspondence of any sample in the shell can be interpolated. Skinning is smooth where the body is of one part, so a node
// every 2.5 cm serves; where parts meet, the grid cannot tell.
#pragma once

#include <functional>

#include "kernels/tracing/interpolate_correspondences.h"
#include "kernels/vulkan/commands.h"

namespace arah {

class FrameOnDevice;
class PointRootFinder;
struct RootFindingSettings;
struct ShellSettings;

class CorrespondenceGrid {
 public:
  // Room for the nodes that samples in the shell lie between.
  CorrespondenceGrid(Device& device, FrameOnDevice& frame, const ShellSettings& shell);

  // Searches the roots at all nodes, from the nearest posed vertices, with the networks as they are packed now. Submits. The
  // finder's counts stay as they were. `between`: called before each chunk of nodes; what it throws passes, and the grid is not solved.
  void solve(Commands& commands, PointRootFinder& finder, FrameOnDevice& frame, const RootFindingSettings& settings, const std::function<void()>& between = {});

  bool solved() const { return solved_; }
  CorrespondenceNodes nodes() { return {grid_, longest_, slots_.slice(), canonical_.slice()}; }
  uint32_t node_count() const { return count_; }  // with a search
  uint64_t bytes() const { return slots_.bytes() + targets_.bytes() + canonical_.bytes(); }

 private:
  shared::ShellGrid grid_;
  float longest_ = 0;
  uint32_t count_ = 0;
  bool solved_ = false;
  Buffer slots_, targets_, canonical_;  // canonical_: by slot, the first one holds zeros
};

}  // namespace arah

#include "host/rendering/correspondence_grid.h"

#include <algorithm>
#include <array>

#include "host/rendering/frame_on_device.h"
#include "host/rendering/root_finder.h"

namespace arah {
namespace {

// Neighbouring nodes of one part of the body keep their distance up to the stretch of a bent joint, a factor of two or three.
// Beyond, they belong to different parts.
constexpr float most_stretch = 3;

}  // namespace

CorrespondenceGrid::CorrespondenceGrid(Device& device, FrameOnDevice& frame, const ShellSettings& shell) : grid_(frame.shell_grid()), longest_(most_stretch * frame.shell_grid().cell) {
  const uint32_t nodes = arah::node_count(grid_);
  const std::vector<float> distances = device.download<float>(frame.shell_distances().elements(0, nodes));
  // A sample lies up to half a bin beyond the shell, its cell's corners up to a cell's diagonal farther.
  const double room = 2 * double(grid_.cell);
  std::vector<uint32_t> slots(nodes, 0);
  std::vector<std::array<float, 4>> targets;
  for (uint32_t node = 0; node < nodes; ++node) {
    if (distances[node] > shell.outer + room || distances[node] < -(shell.inner + room)) continue;
    const std::array<uint32_t, 3> at{node % grid_.nodes[0], node / grid_.nodes[0] % grid_.nodes[1], node / (grid_.nodes[0] * grid_.nodes[1])};
    std::array<float, 4> target{0, 0, 0, 1};
    for (size_t axis = 0; axis < 3; ++axis) target[axis] = grid_.origin[axis] + grid_.cell * static_cast<float>(at[axis]);
    targets.push_back(target);
    slots[node] = static_cast<uint32_t>(targets.size());
  }
  count_ = static_cast<uint32_t>(targets.size());
  slots_ = Buffer(device, "correspondence grid: slots", nodes * 4ull, BufferPlace::device);
  targets_ = Buffer(device, "correspondence grid: nodes", std::max<uint64_t>(padded_points(count_), 1) * 16, BufferPlace::device);
  // Results are written from slot 64 on, so that every chunk of them begins at an aligned place.
  for (uint32_t& slot : slots)
    if (slot) slot += point_padding - 1;
  canonical_ = Buffer(device, "correspondence grid: roots", (point_padding + uint64_t(padded_points(count_))) * 16, BufferPlace::device);
  device.upload(slots_.slice(), slots);
  targets.resize(padded_points(count_), {0, 0, 0, 0});
  device.upload(targets_.slice(), targets);
  device.upload(canonical_.slice(), std::vector<float>(canonical_.bytes() / 4, 0.0f));
}

void CorrespondenceGrid::solve(Commands& commands, PointRootFinder& finder, FrameOnDevice& frame, const RootFindingSettings& settings, const std::function<void()>& between) {
  RootFindingSettings own = settings;
  own.correspondence = Correspondence::search;
  const RootFindingCounts before = finder.counts();
  for (uint32_t first = 0; first < count_; first += finder.capacity()) {
    if (between) between();
    const uint32_t points = std::min(finder.capacity(), count_ - first);
    const uint64_t bytes = uint64_t(padded_points(points)) * 16;
    finder.solve(commands, frame, points, targets_.slice().sub(first * 16ull, bytes), canonical_.slice().sub((uint64_t(point_padding) + first) * 16, bytes), own);
  }
  finder.restore_counts(before);
  solved_ = true;
}

}  // namespace arah

// Canonical correspondences of posed points: the search that DESIGN.md's story calls tracing, as launches over queues
// (ARAH.md §§4, 5). Loops that depend on how many points are still searching are decided here, between submissions.
#pragma once

#include <optional>
#include <vector>

#include "host/rendering/avatar_networks.h"
#include "host/rendering/frame_on_device.h"
#include "host/rendering/root_rescue.h"
#include "kernels/tracing/broyden_state.h"
#include "shaders/shared/tracing.h"

namespace arah {

// Where correspondences come from.
enum class Correspondence {
  search,            // each point's own search, from the nearest posed vertex (the paper)
  search_from_grid,  // each point's own search, from between the roots at the nodes of the frame's grid
  grid,              // between the roots at the nodes; a search only where they cannot tell
  grid_alone,        // between the roots at the nodes; none where they cannot tell
};
const char* to_string(Correspondence correspondence);

struct RootFindingSettings {
  uint32_t max_iterations = 50;  // the paper's; fewer drop the slow tail (98 % converge within 11)
  float tolerance = 1e-5f;       // metres
  Correspondence correspondence = Correspondence::search;
  // Starts of each point's own search: the nearest vertex's, and from the nearest initialisations − 1 bones, what the bone alone
  // would make of the point (the paper's ablation: 3). Of several roots the one with the least signed distance is kept, a union
  // as in SNARF, whose paper this one follows without saying; all are roots to the tolerance, so that residuals tell nothing.
  // A point whose search begins in the grid has that one start; the grid's nodes have these.
  uint32_t initialisations = 1;
  // Points whose search ended without a root are searched again by damped Newton, so many steps from the best iterate and from what each of
  // the nearest rescue_bones bones alone would make of the point (root_rescue.h). 0 steps: they are dropped, as in the paper.
  uint32_t rescue_steps = 0;
  uint32_t rescue_bones = 2;
  // Whether sphere tracing begins where a ray enters the template's shell (SphereTracing::from_shell) and not at the body's box.
  bool trace_from_shell = false;
  float trace_tolerance = 1e-5f;  // metres, of the distance at which sphere tracing leaves the rest to the joint search
};

// What became of the searches since the last reset.
struct RootFindingCounts {
  uint64_t points = 0, steps = 0, converged = 0, diverged = 0, exhausted = 0;  // converged: those from the grid as well
  uint64_t newton = 0, restarted = 0, rescue_evaluations = 0;  // of those converged: rescued from the best iterate, from a bone's start (root_rescue.h)
};


// Point-wise search: for each target, x̂ with LBS(x̂) = target, from the nearest posed vertex.
class PointRootFinder {
 public:
  // capacity: points at a time. most: what searches will ask for; of it initialisations, and whether there are rescue_steps.
  PointRootFinder(Device& device, AvatarNetworks& networks, uint32_t capacity, const RootFindingSettings& most = {});

  // targets: vec4 by point (posed space, w > 0: wanted). canonical: vec4 by point, w = 1 found, 0 not.
  // Records into commands and submits: on return the work is done.
  // With template weights the nearest vertex decides and every wanted point counts as found; without skinning x̂ = target.
  // With several starts the networks' SDF decides, as it is packed now. Throws std::invalid_argument for more starts than there is
  // room for, or a rescue that there is no room for. The frame's grid is read where it has one and the settings want it (correspondence_grid.h).
  void solve(Commands& commands, FrameOnDevice& frame, uint32_t points, const BufferSlice& targets, const BufferSlice& canonical,
             const RootFindingSettings& settings);
  // The same from what the bone of that rank, nearest first, alone would make of each target; without a rescue. Only with a
  // skinning network and room for several initialisations: std::invalid_argument else.
  void solve_from_bone(Commands& commands, FrameOnDevice& frame, uint32_t points, const BufferSlice& targets, const BufferSlice& canonical, const RootFindingSettings& settings, uint32_t rank);
  // Of the last search, vec4 by point: BroydenState::status(), whatever a rescue found after it. Only with a skinning network.
  BufferSlice states() const { return state_.status(); }
  // For inspection: from the next search on, notes Broyden's steps by point of the last solve, those from all starts together; of
  // points that were not searched 0. Costs a download each search.
  void note_steps() { notes_steps_ = true; }
  const std::vector<uint32_t>& steps() const { return steps_; }
  uint32_t capacity() const { return capacity_; }
  bool searches() const { return networks_.spec().skinning.kind == Skinning::network; }  // there is a skinning network, and its inverse has to be searched
  // Skinning::backward: the targets of the last solve, as long as its caller keeps them.
  const BufferSlice& targets() const { return targets_; }

  // Three vec4 by row: the rows of Σ_b w_b B_b at the canonical points, vec4 by row. `rows` says which points of the last
  // solve they are: with template weights the nearest vertices found there decide,
  // with a backward network the targets given there, which must still be. Overwritten by the next solve.
  BufferSlice record_transforms(Commands& commands, FrameOnDevice& frame, const Rows& rows, const BufferSlice& canonical);

  // With template weights, of the last solve: uint32 by point, the vertex that decides.
  BufferSlice nearest_vertices() { return nearest_.slice(); }

  RootFindingCounts counts() const { return counts_; }
  void reset_counts() { counts_ = {}; }
  void restore_counts(const RootFindingCounts& counts) { counts_ = counts; }  // of before a search that is not to count

 private:
  // From the nearest vertex or what the grid says, or from the bone of that rank.
  void search(Commands& commands, FrameOnDevice& frame, uint32_t points, const BufferSlice& targets, const BufferSlice& canonical, const RootFindingSettings& settings, std::optional<uint32_t> bone);
  void found_late(uint64_t points, const RootFindingCounts& before);
  void search_from_several(Commands& commands, FrameOnDevice& frame, uint32_t points, const BufferSlice& targets, const BufferSlice& canonical, const RootFindingSettings& settings);
  // A network gives the weights at the targets.
  void solve_backward(Commands& commands, FrameOnDevice& frame, uint32_t points, const BufferSlice& targets, const BufferSlice& canonical);
  void record_blend(Commands& commands, FrameOnDevice& frame, const Rows& inputs, const BufferSlice& at, const BufferSlice& canonical);
  void solve_by_template(Commands& commands, FrameOnDevice& frame, uint32_t points, const BufferSlice& targets, const BufferSlice& canonical);

  Device& device_;
  AvatarNetworks& networks_;
  uint32_t capacity_;
  RootFindingCounts counts_;
  bool notes_steps_ = false;
  std::vector<uint32_t> steps_;
  std::optional<DenseTape> tape_;
  BufferSlice targets_;
  std::optional<RootRescue> rescue_;
  std::optional<SirenTape> sdf_tape_;  // with several starts, as the next
  Buffer found_, kept_sdf_, bone_segments_;
  BroydenState state_;
  Buffer state_buffer_, posed_, transforms_, starts_, interpolated_, nearest_, active_, ids_[2], count_[2], scratch_, search_counts_;
};

}  // namespace arah

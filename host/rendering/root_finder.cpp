#include "host/rendering/root_finder.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <stdexcept>

#include "host/rendering/correspondence_grid.h"
#include "kernels/skinning/inverse_blend.h"
#include "kernels/skinning/lbs.h"
#include "kernels/tracing/broyden_finish.h"
#include "kernels/tracing/broyden_start.h"
#include "kernels/tracing/broyden_step.h"
#include "kernels/tracing/compact.h"
#include "kernels/tracing/interpolate_correspondences.h"
#include "kernels/tracing/nearest_vertex.h"
#include "kernels/tracing/normalise_inputs.h"
#include "kernels/tracing/several_starts.h"
#include "kernels/tracing/template_correspondence.h"
#include "shaders/shared/work_count.h"

namespace arah {

PointRootFinder::PointRootFinder(Device& device, AvatarNetworks& networks, uint32_t capacity, const RootFindingSettings& most)
    : device_(device), networks_(networks), capacity_(padded_points(capacity)) {
  const uint64_t vec4_bytes = uint64_t(capacity_) * 16;
  auto make = [&](const char* what, uint64_t bytes, BufferPlace place = BufferPlace::device) { return Buffer(device, std::string("root search: ") + what, bytes, place); };
  transforms_ = make("transforms", vec4_bytes * 3);
  if (networks.spec().skinning.kind == Skinning::none) {  // no bone moves
    std::vector<std::array<float, 12>> identity(capacity_, {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0});
    device.upload(transforms_.slice(), identity);
    return;
  }
  if (networks.spec().skinning.kind == Skinning::backward) {
    tape_.emplace(device, "backward skinning", networks.skinning_shape(), capacity_, false);
    posed_ = make("posed points", vec4_bytes);
    return;
  }
  nearest_ = make("nearest vertex", capacity_ * 4ull);
  device.upload(nearest_.slice(), std::vector<uint32_t>(capacity_, 0));  // a vertex for points that are not searched
  for (Buffer& list : ids_) list = make("active points", capacity_ * 4ull);
  for (Buffer& count : count_) count = make("active count", sizeof(WorkCount), BufferPlace::shared);
  scratch_ = make("compaction", compact_blocks(capacity_) * 4ull);
  starts_ = make("starts", vec4_bytes);
  if (networks.spec().skinning.kind != Skinning::network) return;
  tape_.emplace(device, "root search", networks.skinning_shape(), capacity_, false);
  posed_ = make("posed points", vec4_bytes);
  interpolated_ = make("correspondences from the grid", vec4_bytes);
  active_ = make("active flags", capacity_ * 4ull);
  search_counts_ = make("counts", sizeof(shared::SearchCounts), BufferPlace::shared);
  state_buffer_ = make("state", BroydenState::bytes(capacity_, Unknowns::point, false));
  state_ = {state_buffer_.slice(), capacity_, Unknowns::point, false};
  if (most.rescue_steps > 0) rescue_.emplace(device, networks, capacity_);
  if (most.initialisations <= 1) return;
  sdf_tape_.emplace(device, "root search: distances at roots", networks.sdf_shape(), capacity_, SirenTape::Holds::values, Element::float32, false);
  found_ = make("roots from another start", vec4_bytes);
  kept_sdf_ = make("least distances of roots", capacity_ * 4ull);
  bone_segments_ = make("bones", networks.bone_segments().size() * 16ull);
  device.upload(bone_segments_.slice(), networks.bone_segments());
}

void PointRootFinder::solve(Commands& commands, FrameOnDevice& frame, uint32_t points, const BufferSlice& targets, const BufferSlice& canonical,
                            const RootFindingSettings& settings) {
  if (points > capacity_) throw std::invalid_argument(fmt::format("root search of {} points in room for {}", points, capacity_));
  commands.stage("correspondence search");
  steps_.assign(notes_steps_ ? points : 0, 0);
  const uint64_t bytes = uint64_t(padded_points(points)) * 16;
  if (networks_.spec().skinning.kind == Skinning::none) {
    commands.copy(targets.sub(0, bytes), canonical.sub(0, bytes));
    return;
  }
  if (networks_.spec().skinning.kind == Skinning::template_weights) return solve_by_template(commands, frame, points, targets, canonical);
  if (networks_.spec().skinning.kind == Skinning::backward) return solve_backward(commands, frame, points, targets, canonical);
  const bool from_grid = settings.correspondence != Correspondence::search && frame.correspondences() && frame.correspondences()->solved();
  const RootFindingCounts before = counts_;
  if (settings.initialisations > 1 && !from_grid) search_from_several(commands, frame, points, targets, canonical, settings);
  else search(commands, frame, points, targets, canonical, settings, {});
  const bool all_found = counts_.converged - before.converged == counts_.points - before.points;
  if (settings.rescue_steps == 0 || all_found) return;
  if (!rescue_) throw std::invalid_argument("root search with a rescue in room for none");
  rescue_->counts = {};
  rescue_->solve(commands, frame, points, targets, canonical, settings.rescue_steps, settings.rescue_bones, settings.tolerance);
  counts_.newton += rescue_->counts.newton;
  counts_.restarted += rescue_->counts.restarted;
  counts_.rescue_evaluations += rescue_->counts.evaluations;
  found_late(rescue_->counts.newton + rescue_->counts.restarted, before);
}

void PointRootFinder::solve_from_bone(Commands& commands, FrameOnDevice& frame, uint32_t points, const BufferSlice& targets, const BufferSlice& canonical, const RootFindingSettings& settings, uint32_t rank) {
  if (points > capacity_ || !bone_segments_.bytes()) throw std::invalid_argument(fmt::format("root search of {} points from a bone in room for {}", points, bone_segments_.bytes() ? capacity_ : 0));
  RootFindingSettings alone = settings;
  alone.correspondence = Correspondence::search;
  commands.stage("correspondence search");
  steps_.assign(notes_steps_ ? points : 0, 0);
  search(commands, frame, points, targets, canonical, alone, rank);
}

// Points that count as not found since `before` have been found after all.
void PointRootFinder::found_late(uint64_t points, const RootFindingCounts& before) {
  const uint64_t of_exhausted = std::min(points, counts_.exhausted - before.exhausted);
  counts_.converged += points;
  counts_.exhausted -= of_exhausted;
  counts_.diverged -= points - of_exhausted;
}

void PointRootFinder::search_from_several(Commands& commands, FrameOnDevice& frame, uint32_t points, const BufferSlice& targets, const BufferSlice& canonical, const RootFindingSettings& settings) {
  if (!sdf_tape_) throw std::invalid_argument(fmt::format("root search from {} starts in room for one", settings.initialisations));
  const RootFindingCounts before = counts_;
  const auto listed = [&](const BufferSlice& with_root) {
    CompactArgs args;
    args.rows.range.points = points;
    args.flagged_points = with_root;
    args.scratch = scratch_.slice();
    args.compacted = ids_[0].slice();
    args.count = count_[0].slice();
    record_compact(commands, args);
    return Rows{{points, count_[0].slice()}, ids_[0].slice()};
  };
  search(commands, frame, points, targets, canonical, settings, {});
  RootFindingCounts counts = counts_;
  for (uint32_t start = 0; start < settings.initialisations; ++start) {
    const BufferSlice found = start == 0 ? canonical : found_.slice();
    if (start > 0) {
      search(commands, frame, points, targets, found, settings, start - 1);
      commands.stage("correspondence search");
    }
    const Rows rows = listed(found);
    record_normalise_inputs(commands, {rows, frame.constants(), found, sdf_tape_->input()});
    networks_.sdf().record_forward(commands, *sdf_tape_, rows.range, false);
    record_keep_root(commands, {rows, start == 0, sdf_tape_->sdf(), found, canonical, kept_sdf_.slice()});
  }
  // A point counts once: what became of it from its first start, unless another one led to a root.
  listed(canonical);
  commands.submit_and_wait();
  WorkCount with_root{};
  device_.download(count_[0].slice(), &with_root, sizeof with_root);
  counts.steps = counts_.steps;
  counts_ = counts;
  found_late(with_root.count - (counts.converged - before.converged), before);
}

void PointRootFinder::search(Commands& commands, FrameOnDevice& frame, uint32_t points, const BufferSlice& targets, const BufferSlice& canonical, const RootFindingSettings& settings,
                             std::optional<uint32_t> bone) {
  CorrespondenceGrid* grid = settings.correspondence == Correspondence::search ? nullptr : frame.correspondences();
  const bool from_grid = grid && grid->solved(), alone = from_grid && settings.correspondence == Correspondence::grid_alone,
             answers = alone || (from_grid && settings.correspondence == Correspondence::grid);
  const BufferSlice interpolated = answers ? interpolated_.slice() : starts_.slice();
  if (from_grid) record_interpolate_correspondences(commands, {points, targets, grid->nodes(), interpolated, active_.slice()});

  auto finish = [&] {
    BroydenFinishArgs end;
    end.points = points;
    end.state = state_;
    end.targets = targets;
    end.canonical = canonical;
    end.counts = search_counts_.slice();
    if (answers) end.interpolated = interpolated;
    commands.fill(search_counts_.slice(), 0);
    record_broyden_finish(commands, end);
    commands.submit_and_wait();
    shared::SearchCounts counts{};
    device_.download(search_counts_.slice(), &counts, sizeof counts);
    counts_.points += counts.converged + counts.diverged + counts.exhausted;
    counts_.steps += counts.steps;
    counts_.converged += counts.converged;
    counts_.diverged += counts.diverged;
    counts_.exhausted += counts.exhausted;
    if (!notes_steps_) return;
    const auto states = device_.download<std::array<float, 4>>(state_.status().sub(0, points * 16ull));
    for (size_t i = 0; i < points; ++i) steps_[i] += static_cast<uint32_t>(states[i][1]);
  };
  if (alone) {
    commands.fill(state_.status(), 0);  // no search was started
    return finish();
  }

  // The points that are searched, in order: all wanted ones, or where the grid answers, those that it cannot tell.
  CompactArgs searched;
  searched.rows.range.points = points;
  (answers ? searched.flags : searched.flagged_points) = answers ? active_.slice() : targets;
  searched.scratch = scratch_.slice();
  searched.compacted = ids_[0].slice();
  searched.count = count_[0].slice();
  record_compact(commands, searched);
  int current = 0;
  auto rows = [&] { return Rows{{points, count_[current].slice()}, ids_[current].slice()}; };

  // Their starts: the nearest vertex', except where the grid gave one.
  Rows without_start = rows();
  if (from_grid && !answers) {
    CompactArgs untold = searched;
    untold.flagged_points = {};
    untold.flags = active_.slice();
    untold.compacted = ids_[1].slice();
    untold.count = count_[1].slice();
    record_compact(commands, untold);
    without_start = {{points, count_[1].slice()}, ids_[1].slice()};
  }
  NearestVertexArgs nearest;
  nearest.rows = without_start;
  nearest.frame = frame.constants();
  nearest.posed = targets;
  nearest.target = frame.vertices();
  nearest.canonical = starts_.slice();
  nearest.nearest = nearest_.slice();

  auto evaluate = [&](const BufferSlice& at, bool transforms) {
    record_normalise_inputs(commands, {rows(), frame.constants(), at, tape_->input()});
    networks_.skinning().record_forward(commands, *tape_, rows().range);
    LbsArgs lbs;
    lbs.tree = &networks_.tree();
    lbs.rows = rows();
    lbs.logits = tape_->output();
    lbs.frame = frame.constants();
    lbs.canonical = at;
    lbs.posed = posed_.slice();
    if (transforms) lbs.transforms = transforms_.slice();
    record_lbs(commands, lbs);
  };
  auto compact = [&] {
    CompactArgs args;
    args.rows = rows();
    args.flags = active_.slice();
    args.scratch = scratch_.slice();
    args.compacted = ids_[1 - current].slice();
    args.count = count_[1 - current].slice();
    record_compact(commands, args);
    current = 1 - current;
  };

  auto left = [&] {
    commands.submit_and_wait();
    WorkCount count{};
    device_.download(count_[current].slice(), &count, sizeof count);
    return count.count;
  };

  if (answers && left() == 0) {
    commands.fill(state_.status(), 0);  // never started
    return finish();
  }
  if (bone) record_bone_starts(commands, {without_start, frame.constants(), targets, bone_segments_.slice(), static_cast<uint32_t>(networks_.bone_segments().size() / 2), *bone, starts_.slice()});
  else record_nearest_vertex(commands, nearest);
  evaluate(starts_.slice(), true);
  BroydenStartArgs start;
  start.rows = rows();
  start.state = state_;
  start.frame = frame.constants();
  start.starts = starts_.slice();
  start.posed = posed_.slice();
  start.transforms = transforms_.slice();
  start.targets = targets;
  start.active = active_.slice();
  start.max_iterations = settings.max_iterations;
  if (from_grid) start.start_tolerance = settings.tolerance;
  record_broyden_start(commands, start);
  if (from_grid) compact();  // many starts are roots already

  // Most points need three steps (ARAH.md §11): look at how many are left only now and then. Compaction costs as much as
  // evaluating some 15 % of the points, so it waits for the second step, after which a quarter is left.
  for (uint32_t iteration = 0, batch = 4; iteration < settings.max_iterations;) {
    for (const uint32_t end = std::min(iteration + batch, settings.max_iterations); iteration < end; ++iteration) {
      evaluate(state_.iterates(), false);
      BroydenStepArgs step;
      step.rows = rows();
      step.state = state_;
      step.frame = frame.constants();
      step.posed = posed_.slice();
      step.targets = targets;
      step.active = active_.slice();
      step.max_iterations = settings.max_iterations;
      step.tolerance = settings.tolerance;
      record_broyden_step(commands, step);
      if (iteration > 0) compact();
    }
    if (left() == 0) break;
    batch = iteration < 8 ? 2 : 8;
  }
  finish();
}

void PointRootFinder::solve_backward(Commands& commands, FrameOnDevice& frame, uint32_t points, const BufferSlice& targets, const BufferSlice& canonical) {
  targets_ = targets;
  record_blend(commands, frame, {{points, {}}, {}}, targets, targets);
  record_inverse_blend(commands, {points, targets, transforms_.slice(), canonical});
  commands.submit_and_wait();
}

// `inputs`: the points among `at` whose weights are asked for; canonical is by row.
void PointRootFinder::record_blend(Commands& commands, FrameOnDevice& frame, const Rows& inputs, const BufferSlice& at, const BufferSlice& canonical) {
  record_normalise_inputs(commands, {inputs, frame.constants(), at, tape_->input(), networks_.spec().skinning.kind == Skinning::backward});
  networks_.skinning().record_forward(commands, *tape_, inputs.range);
  LbsArgs lbs;
  lbs.tree = &networks_.tree();
  lbs.rows = {inputs.range, {}};
  lbs.logits = tape_->output();
  lbs.frame = frame.constants();
  lbs.canonical = canonical;
  lbs.posed = posed_.slice();
  lbs.transforms = transforms_.slice();
  record_lbs(commands, lbs);
}

void PointRootFinder::solve_by_template(Commands& commands, FrameOnDevice& frame, uint32_t points, const BufferSlice& targets, const BufferSlice& canonical) {
  CompactArgs wanted;
  wanted.rows.range.points = points;
  wanted.flagged_points = targets;
  wanted.scratch = scratch_.slice();
  wanted.compacted = ids_[0].slice();
  wanted.count = count_[0].slice();
  record_compact(commands, wanted);
  NearestVertexArgs nearest;
  nearest.rows = {{points, count_[0].slice()}, ids_[0].slice()};
  nearest.frame = frame.constants();
  nearest.posed = targets;
  nearest.target = frame.vertices();
  nearest.canonical = starts_.slice();
  nearest.nearest = nearest_.slice();
  record_nearest_vertex(commands, nearest);
  record_accept_starts(commands, {points, targets, starts_.slice(), canonical});
  commands.submit_and_wait();
  WorkCount found{};
  device_.download(count_[0].slice(), &found, sizeof found);
  counts_.points += found.count;
  counts_.converged += found.count;
}

BufferSlice PointRootFinder::record_transforms(Commands& commands, FrameOnDevice& frame, const Rows& points, const BufferSlice& canonical) {
  if (networks_.spec().skinning.kind == Skinning::none) return transforms_.slice();
  if (networks_.spec().skinning.kind == Skinning::template_weights) {
    record_vertex_transforms(commands, {points, frame.constants(), nearest_.slice(), frame.vertices(), transforms_.slice()});
    return transforms_.slice();
  }
  if (networks_.spec().skinning.kind == Skinning::backward) record_blend(commands, frame, points, targets_, canonical);
  else record_blend(commands, frame, {points.range, {}}, canonical, canonical);  // canonical is by row
  return transforms_.slice();
}

}  // namespace arah

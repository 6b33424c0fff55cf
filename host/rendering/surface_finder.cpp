#include "host/rendering/surface_finder.h"

#include <fmt/format.h>

#include <algorithm>
#include <stdexcept>

#include "kernels/tracing/broyden_finish.h"
#include "kernels/tracing/broyden_start.h"
#include "kernels/tracing/broyden_step.h"
#include "kernels/tracing/compact.h"
#include "kernels/tracing/normalise_inputs.h"
#include "kernels/tracing/template_correspondence.h"
#include "shaders/shared/tracing.h"
#include "shaders/shared/work_count.h"

namespace arah {
namespace {

constexpr uint32_t trace_iterations = 50;  // ARAH.md §4
constexpr uint32_t first_look = 8;         // iterations before the host asks for the first time how many rays are left …
constexpr uint32_t look_every = 8;         // … and between its later questions

}  // namespace

SurfaceFinder::SurfaceFinder(Device& device, AvatarNetworks& networks, uint32_t capacity)
    : device_(device), networks_(networks), capacity_(padded_points(capacity)) {
  require_surface(networks.spec(), "the search for surfaces (sampling_mode surface)");
  const uint64_t vec4_each = uint64_t(capacity_) * 16, word_each = uint64_t(capacity_) * 4;
  auto make = [&](const char* what, uint64_t bytes, BufferPlace place = BufferPlace::device) {
    Buffer buffer(device, std::string("surface search: ") + what, bytes, place);
    Commands zero(device);
    zero.fill(buffer.slice(), 0);
    zero.submit_and_wait();
    return buffer;
  };
  for (Queue* queue : {&queues_[0], &queues_[1], &in_box_}) *queue = {make("rays in a queue", word_each), make("length of a queue", sizeof(WorkCount), BufferPlace::shared)};
  trace_ = make("traces", vec4_each);
  posed_ = make("posed points", vec4_each);
  candidates_ = make("candidates", word_each);
  active_ = make("active flags", word_each);
  scratch_ = make("compaction", compact_blocks(capacity_) * 4ull);
  starts_ = make("starts", vec4_each);
  nearest_ = make("nearest vertex", word_each);
  canonical_ = make("surface points", vec4_each);
  depths_ = make("surface depths", word_each);
  const bool joint = networks.spec().skinning.kind == Skinning::network;
  sdf_tape_.emplace(device, "surface search: sdf", networks.sdf_shape(), capacity_, joint ? SirenTape::Holds::gradient : SirenTape::Holds::values);
  if (!joint) return;
  skinning_.emplace(device, networks, capacity_, "surface search");
  search_counts_ = make("counts", sizeof(shared::SearchCounts), BufferPlace::shared);
  state_buffer_ = make("state", BroydenState::bytes(capacity_, Unknowns::point_and_depth, false));
  state_ = {state_buffer_.slice(), capacity_, Unknowns::point_and_depth, false};
}

Rows SurfaceFinder::rows_of(uint32_t rays, Queue& queue) const { return {{rays, queue.count.slice()}, queue.ids.slice()}; }

uint32_t SurfaceFinder::length(Queue& queue) {
  WorkCount count{};
  device_.download(queue.count.slice(), &count, sizeof count);
  return count.count;
}

void SurfaceFinder::record_compaction(Commands& commands, const Rows& rows, Buffer& flags, Queue& to) {
  CompactArgs args;
  args.rows = rows;
  args.flags = flags.slice();
  args.scratch = scratch_.slice();
  args.compacted = to.ids.slice();
  args.count = to.count.slice();
  record_compact(commands, args);
}

void SurfaceFinder::record_sdf(Commands& commands, FrameOnDevice& frame, const Rows& rows, const BufferSlice& at, bool gradient) {
  record_normalise_inputs(commands, {rows, frame.constants(), at, sdf_tape_->input()});
  networks_.sdf().record_forward(commands, *sdf_tape_, rows.range, gradient);
  if (gradient) networks_.sdf().record_gradient(commands, *sdf_tape_, rows.range, false);
}

void SurfaceFinder::trace(Commands& commands, FrameOnDevice& frame, uint32_t rays, const SphereTracing& tracing, float tolerance) {
  commands.stage("sphere tracing");
  record_sphere_start(commands, {{rays, {}}, {}}, tracing);
  record_compaction(commands, {{rays, {}}, {}}, active_, in_box_);
  Queue* from = &in_box_;
  int next = 0;
  for (uint32_t iteration = 0, batch = first_look; iteration < trace_iterations; batch = look_every) {
    for (const uint32_t end = std::min(iteration + batch, trace_iterations); iteration < end; ++iteration) {
      const Rows rows = rows_of(rays, *from);
      NearestVertexArgs nearest;
      nearest.rows = rows;
      nearest.frame = frame.constants();
      nearest.posed = posed_.slice();
      nearest.target = frame.vertices();
      nearest.canonical = starts_.slice();
      nearest.nearest = nearest_.slice();
      record_nearest_vertex(commands, nearest);
      record_sdf(commands, frame, rows, starts_.slice(), false);
      SphereStepArgs step;
      step.rows = rows;
      step.tracing = tracing;
      step.sdf = sdf_tape_->sdf();
      step.tolerance = tolerance;
      record_sphere_step(commands, step);
      record_compaction(commands, rows, active_, queues_[next]);
      from = &queues_[next];
      next = 1 - next;
    }
    commands.submit_and_wait();
    if (length(*from) == 0) break;
  }
}

void SurfaceFinder::search(Commands& commands, FrameOnDevice& frame, uint32_t rays, const BufferSlice& ray_list, Queue& start, const RootFindingSettings& settings) {
  commands.stage("joint search");
  Rows rows = rows_of(rays, start);
  record_sdf(commands, frame, rows, starts_.slice(), true);
  skinning_->record(commands, frame, rows, starts_.slice(), true);
  BroydenStartArgs first;
  first.rows = rows;
  first.state = state_;
  first.frame = frame.constants();
  first.starts = starts_.slice();
  first.posed = skinning_->posed();
  first.transforms = skinning_->transforms();
  first.surface = {ray_list, sdf_tape_->sdf()};
  first.depths = trace_.slice();
  first.sdf_gradients = sdf_tape_->gradient();
  first.jacobians = skinning_->jacobians();
  first.active = active_.slice();
  first.max_iterations = settings.max_iterations;
  record_broyden_start(commands, first);
  int next = &start == &queues_[0] ? 1 : 0;
  Queue* from = &queues_[next];
  record_compaction(commands, rows, active_, *from);

  for (uint32_t iteration = 0, batch = first_look; iteration < settings.max_iterations; batch = look_every) {
    for (const uint32_t end = std::min(iteration + batch, settings.max_iterations); iteration < end; ++iteration) {
      rows = rows_of(rays, *from);
      record_sdf(commands, frame, rows, state_.iterates(), false);
      skinning_->record(commands, frame, rows, state_.iterates(), false);
      BroydenStepArgs step;
      step.rows = rows;
      step.state = state_;
      step.frame = frame.constants();
      step.posed = skinning_->posed();
      step.surface = {ray_list, sdf_tape_->sdf()};
      step.active = active_.slice();
      step.max_iterations = settings.max_iterations;
      step.tolerance = settings.tolerance;
      record_broyden_step(commands, step);
      next = 1 - next;
      record_compaction(commands, rows, active_, queues_[next]);
      from = &queues_[next];
    }
    commands.submit_and_wait();
    if (length(*from) == 0) break;
  }

  BroydenFinishArgs finish;
  finish.points = rays;
  finish.state = state_;
  finish.rays = ray_list;
  finish.canonical = canonical_.slice();
  finish.depth = depths_.slice();
  finish.counts = search_counts_.slice();
  commands.fill(search_counts_.slice(), 0);
  record_broyden_finish(commands, finish);
  commands.submit_and_wait();
  shared::SearchCounts counts{};
  device_.download(search_counts_.slice(), &counts, sizeof counts);
  counts_.rays += counts.converged + counts.diverged + counts.exhausted;
  counts_.steps += counts.steps;
  counts_.hits += counts.hits;
}

void SurfaceFinder::find(Commands& commands, FrameOnDevice& frame, uint32_t rays, const BufferSlice& ray_list, const BufferSlice& kept, Candidates candidates, const RootFindingSettings& settings) {
  if (rays > capacity_) throw std::invalid_argument(fmt::format("surface search of {} rays in room for {}", rays, capacity_));
  SphereTracing tracing;
  tracing.frame = frame.constants();
  tracing.rays = ray_list;
  tracing.kept = kept;
  tracing.from_shell = settings.trace_from_shell;
  tracing.trace = trace_.slice();
  tracing.posed = posed_.slice();
  tracing.candidates = candidates_.slice();
  tracing.active = active_.slice();
  trace(commands, frame, rays, tracing, settings.trace_tolerance);
  if (networks_.spec().skinning.kind != Skinning::network) {
    AcceptTracedArgs accept;
    accept.rays = rays;
    accept.trace = trace_.slice();
    accept.ends = starts_.slice();
    accept.canonical = canonical_.slice();
    accept.depths = depths_.slice();
    record_accept_traced(commands, accept);
    return;
  }
  if (candidates == Candidates::in_box) return search(commands, frame, rays, ray_list, in_box_, settings);
  record_compaction(commands, {{rays, {}}, {}}, candidates_, queues_[0]);
  search(commands, frame, rays, ray_list, queues_[0], settings);
}

}  // namespace arah

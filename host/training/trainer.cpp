#include "host/training/trainer.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <nlohmann/json.hpp>
#include <numeric>
#include <random>
#include <sstream>
#include <stdexcept>
#include <utility>

#include "host/avatar/avatar_file.h"
#include "host/input_error.h"
#include "host/rendering/memory_plan.h"
#include "host/training/loss_slots.h"
#include "host/training/view_augmentation.h"
#include "kernels/compositing/backward.h"
#include "kernels/losses/image.h"
#include "kernels/reduction/sum.h"

namespace arah {
namespace {

// Nodes of a frame's grid that are searched at a time: a frame has some 20,000.
constexpr uint32_t grid_nodes_at_a_time = 32768;

// Streams of random numbers of a step, apart from the jitter's own counter-based ones.
std::mt19937_64 step_generator(uint64_t seed, uint64_t step, uint64_t stream) {
  std::seed_seq sequence{uint32_t(seed), uint32_t(seed >> 32), uint32_t(step), uint32_t(step >> 32), uint32_t(stream)};
  return std::mt19937_64(sequence);
}

// Rays of a step that go forward and back together, a multiple of 64 unless all do; gradients of several passes add up.
// Unless stated, as many as the device can bind the activations of.
// of_step: how many there are.
uint32_t rays_of_a_pass(Device& device, const AvatarSpec& spec, const TrainingSettings& settings, uint32_t of_step) {
  if (settings.rays_at_a_time) return std::min(padded_points(settings.rays_at_a_time), of_step);
  const uint64_t rows = device.report().max_storage_buffer_bytes / (4 * std::max({64u, spec.sdf.width, spec.skinning.width}));
  const uint64_t rays = std::max<uint64_t>(rows / settings.color_sampling().samples / point_padding, 1) * point_padding;
  return static_cast<uint32_t>(std::min<uint64_t>(rays, of_step));
}

// Samples of a pass that can be shaded: few are worth it, and each keeps much for the way back. What they keep is to fit twelve
// times the most that the device binds at once (a CPU device: 1.5 GiB).
uint32_t shaded_in_a_pass(Device& device, const AvatarSpec& spec, const TrainingSettings& settings, uint32_t pass_rays) {
  const uint64_t widest = std::max<uint64_t>(512, color_widths(spec).front() + spec.color.narrow);
  const uint64_t sdf = uint64_t(spec.sdf.sine_layers) * spec.sdf.width * (spec.color.normal ? 7 : 4);
  const uint64_t color = 4 * widest + 2ull * spec.color.hidden_layers * spec.color.width;
  const uint64_t skinning = 3ull * spec.skinning.hidden_layers * spec.skinning.width;
  const uint64_t bound = device.report().max_storage_buffer_bytes;
  const uint64_t room = std::min(bound / (4 * widest), 12 * bound / (4 * (sdf + color + skinning))) / point_padding * point_padding;
  const uint64_t rows = settings.shaded_at_a_time ? std::min<uint64_t>(room, padded_points(settings.shaded_at_a_time)) : room;
  const uint32_t samples = settings.color_sampling().samples;
  // at least those of 64 rays, which cannot be halved
  return static_cast<uint32_t>(std::min<uint64_t>(std::max<uint64_t>(rows, point_padding * samples), padded_points(pass_rays * samples)));
}

// In the shape that training begins with.
Avatar in_start_shape(Avatar avatar, const TrainingSettings& settings) {
  if (shape_is_refined(settings) && !avatar.refined.start_shape.empty()) set_shape(avatar.body, avatar.refined.start_shape);
  if (settings.pose_refinement) avatar.refined = {};  // avatar() says what they are
  return avatar;
}

// Rays of a pass whose least distance is looked for together.
uint32_t mask_rays_of_a_pass(Device& device, const AvatarSpec& spec, const TrainingSettings& settings, uint32_t pass_rays) {
  const uint64_t rows = device.report().max_storage_buffer_bytes / (4 * std::max({64u, spec.sdf.width, spec.skinning.width}));
  const uint64_t rays = std::max<uint64_t>(rows / settings.mask_samples / point_padding, 1) * point_padding;
  return static_cast<uint32_t>(std::min<uint64_t>(rays, padded_points(pass_rays)));
}

// What a step has too few of for so many ranks is refused.
const TrainingSettings& for_ranks(const TrainingSettings& settings, const AvatarSpec& spec, const Ranks& ranks) {
  if (ranks.count() == 1) return settings;
  const std::string where = fmt::format("training on {} ranks", ranks.count());
  const auto at_least = [&](const char* name, uint32_t found, uint32_t wanted) {
    if (found < wanted) throw InputError(where, name, fmt::format("at least {}", wanted), fmt::format("{}", found), fmt::format("Start fewer ranks, or set --set {}={}.", name, wanted));
  };
  at_least("rays", settings.rays, (ranks.count() - 1) * point_padding + 1);
  if (spec.sdf.kind == FieldKind::sdf) {
    at_least("eikonal_points", settings.eikonal_points, ranks.count());
    at_least("off_surface_points", settings.off_surface_points, ranks.count());
    at_least("inside_points", settings.inside_points, ranks.count());
  }
  if (spec.skinning.learned()) at_least("skinning_points", settings.skinning_points, ranks.count());
  return settings;
}

}  // namespace

Trainer::Room::Room(Device& device, AvatarNetworks& networks, const TrainingSettings& settings, uint32_t pass_rays, const Ranks& ranks)
    : updates(device, networks, settings),
      watch(device),
      samples(device, networks, pass_rays, settings.color_sampling()),
      shaded(device, networks, pass_rays, settings.color_sampling().samples, shaded_in_a_pass(device, networks.spec(), settings, pass_rays)) {
  check_settings(settings, networks.spec(), "training");
  if (networks.spec().sdf.kind == FieldKind::sdf) regularisers.emplace(device, networks, settings, ranks);
  const uint32_t rays = padded_points(pass_rays), rows = padded_points(pass_rays * samples.samples());
  if (samples.has_gaps()) shaded.field().make_room_for_gaps();
  if (settings.view_augmentation > 0 && networks.spec().color.view) shaded.field().make_room_for_normals();
  const bool of_surface = settings.rendering == Rendering::surface;
  const uint32_t mask_rays = of_surface ? mask_rays_of_a_pass(device, networks.spec(), settings, pass_rays) : 0;
  auto make = [&](const char* what, uint64_t bytes, BufferPlace place = BufferPlace::device) {
    Buffer buffer(device, std::string("training: ") + what, bytes, place);
    Commands commands(device);
    commands.fill(buffer.slice(), 0);
    commands.submit_and_wait();
    return buffer;
  };
  implicit_counts = make("counts of implicit gradients", sizeof(shared::ImplicitCounts), BufferPlace::shared);
  if (networks.spec().skinning.learned()) skinning.emplace(device, networks, std::max(shaded.field().shaded_capacity(), mask_rays), ranks.part(settings.skinning_points).size(), implicit_counts.slice());
  if (settings.pose_refinement) pose_gradient.emplace(device, networks, shaded.field().shaded_capacity(), implicit_counts.slice());
  if (of_surface) {
    shaded.field().opaque_distances();
    surface_gradient.emplace(device, networks, shaded.field().shaded_capacity(), skinning ? &*skinning : nullptr, implicit_counts.slice());
    mask_loss.emplace(device, networks, settings, mask_rays);
  }
  if (asks_for_surface(settings.color_sampling().mode)) surface_finder.emplace(device, networks, std::min({settings.rays, 4 * pass_rays, 4096u}));
  // Where memory is too short for all rays together, it is short for this too.
  if (with_grids(networks.spec(), settings)) grid_finder.emplace(device, networks, pass_rays < settings.rays ? std::min(rows, grid_nodes_at_a_time) : grid_nodes_at_a_time);
  grid_clamped = make("count of clamped gradients", 4, BufferPlace::shared);
  losses = make("losses", loss_slots * 4, BufferPlace::shared);
  const uint64_t pictures = uint64_t(settings.frames_per_step) * settings.pictures_per_frame;
  targets = make("photographs", pictures * padded_points(settings.rays) * 16ull);
  if (settings.ray_importance > 0) ray_weights = make("weights of rays", pictures * padded_points(settings.rays) * 4ull);
  d_colors = make("gradient of colours", rays * 16ull);
  if (ranks.count() > 1) {
    uint64_t bytes = 0;
    for (const BufferSlice& layer : networks.effective_gradients({})) bytes += layer.bytes;
    exchange = make("gradients of all ranks", bytes);
  }
  partials = make("partial sums of losses", partial_bytes(std::max({rays, settings.eikonal_points, settings.off_surface_points, settings.inside_points}), 2));
  scratch = make("partial sums of weight gradients", 4 * std::max({regularisers ? regularisers->scratch_floats() : 64,
                                                                   skinning ? skinning->scratch_floats() : 64, mask_loss ? mask_loss->scratch_floats() : 64, shaded.field().scratch_floats()}));
}

Trainer::Trainer(Device& device, const Capture& capture, Avatar avatar, const TrainingSettings& settings, const Ranks& ranks)
    : device_(device),
      avatar_(in_start_shape(std::move(avatar), settings)),
      settings_(for_ranks(settings, avatar_.spec, ranks)),
      ranks_(ranks),
      rays_(ranks.part(settings.rays, point_padding)),
      skinning_points_(ranks.part(settings.skinning_points)),
      commands_(device),
      images_(device, avatar_, capture, settings.size, settings.sampling.shell),
      template_samples_(draw_template_samples(avatar_, settings.seed)),
      pass_rays_(planned_rays()),
      networks_(device, avatar_, true, settings.frames_per_step),
      room_(device, networks_, settings_, pass_rays_, ranks_),
      mask_sharpness_(settings.mask_alpha, settings.mask_alpha_rate) {
  alike_ = ranks_.all_alike(device.report().name + device.report().driver);
  if (settings_.disturb_degrees > 0 || settings_.disturb_metres > 0)
    for (size_t frame = 0; frame < images_.poses().size(); ++frame) {
      images_.set_pose(frame, disturbed_pose(images_.poses()[frame], settings_.disturb_degrees, settings_.disturb_metres, settings_.seed, images_.frame_number(frame)));
      images_.renew(frame, 0);
    }
  if (settings_.pose_refinement) {
    if (avatar_.spec.skinning.kind == Skinning::none) throw InputError("settings", "pose_refinement", "false for an avatar without skinning: its one pose is what is canonical", "true");
    const Correspondence from = settings_.sampling.root.correspondence;
    if (with_grids() && from != Correspondence::search_from_grid) throw InputError("settings", "root_correspondence", "search or search_from_grid with pose_refinement", to_string(from));
    refinement_.emplace(avatar_, images_.poses());
    if (settings_.shape_refinement) {
      if (!avatar_.body.shape.moves_joints()) throw InputError("settings", "shape_refinement", "false for a template without morph targets that move its joints", "true");
      shape_.emplace(avatar_.body.shape.beta);
    }
  }
  room_.updates.start(avatar_.parameters);
  if (const size_t frames = pictured_frames().size(); settings_.frames_per_step > frames)
    throw InputError("settings", "frames_per_step", fmt::format("at most the {} training frames", frames), fmt::format("{}", settings_.frames_per_step));
}

uint32_t Trainer::planned_rays() {
  const auto make = [&](uint32_t rays) {
    AvatarNetworks networks(device_, avatar_, true, settings_.frames_per_step);
    Room(device_, networks, settings_, rays, ranks_);
  };
  // Under a ceiling all frames come first, so that what is left for a pass is known; else each is made when a step asks for it.
  if (device_.memory_ceiling()) images_.make_frames(with_grids(), device_.bytes_of([&] { make(std::min(rays_.size(), point_padding)); }));
  // The shell of another pose may need more room than the one that it replaces.
  const uint64_t for_shells = settings_.pose_refinement ? images_.frame_bytes() / 8 : 0;
  return rays_that_fit(device_, "training", rays_of_a_pass(device_, avatar_.spec, settings_, rays_.size()), for_shells, make);
}

std::vector<size_t> Trainer::pictured_frames() const {
  std::vector<size_t> frames;
  for (const TrainingImages::Place& place : images_.places())  // by frame
    if (frames.empty() || frames.back() != place.frame) frames.push_back(place.frame);
  return frames;
}

void Trainer::follow_shape() {
  set_shape(avatar_.body, shape_->beta());
  refinement_->set_skeleton(avatar_.body.skeleton);
}

bool Trainer::renew_shell(size_t frame, double drift) {
  if (!images_.renew(frame, drift)) return false;
  for (size_t number = 0; number < images_.places().size(); ++number)
    if (images_.places()[number].frame == frame) importance_.forget(number);
  return true;
}

void Trainer::solve_correspondences_again(const std::vector<size_t>& frames) {
  const ParameterGroup& group = networks_.layout().group("skinning");
  const BufferSlice skinning = networks_.parameters().elements(group.begin, group.size());
  const std::vector<float> now = device_.download<float>(skinning);
  device_.upload(skinning, grid_parameters_);
  commands_.stage("weights");
  networks_.record_pack(commands_, 0, {});  // the skinning network reads neither code nor pose
  for (const size_t frame : frames) solve_correspondences(images_.frame(frame));
  device_.upload(skinning, now);
}

void Trainer::solve_correspondences(FrameOnDevice& frame) {
  if (!frame.correspondences()) frame.make_correspondences(device_, settings_.sampling.shell);
  frame.correspondences()->solve(commands_, *room_.grid_finder, frame, settings_.sampling.root);
}

void Trainer::solve_correspondences() {
  const ParameterGroup& group = networks_.layout().group("skinning");
  grid_parameters_ = device_.download<float>(networks_.parameters().elements(group.begin, group.size()));
  commands_.stage("weights");
  networks_.record_pack(commands_, 0, {});  // the skinning network reads neither code nor pose
  for (const size_t frame : pictured_frames()) {
    renew_shell(frame, 0);  // of one pose with the grid: what a resumed run makes again
    solve_correspondences(images_.frame(frame));
  }
}

std::vector<std::vector<Trainer::Batch>> Trainer::draw_batches() {
  std::mt19937_64 generator = step_generator(settings_.seed, steps_, 0);
  const std::vector<TrainingImages::Place>& places = images_.places();
  std::vector<size_t> left(places.size());  // pictures of frames that the step has not yet
  std::iota(left.begin(), left.end(), size_t{0});
  std::vector<std::vector<Batch>> frames;
  for (uint32_t f = 0; f < settings_.frames_per_step; ++f) {
    std::vector<Batch> batches{draw_batch(generator, left)};
    const size_t frame = batches[0].place.frame;
    const auto others = std::stable_partition(left.begin(), left.end(), [&](size_t number) { return places[number].frame != frame; });
    std::vector<size_t> of_frame(others, left.end());
    left.erase(others, left.end());
    while (batches.size() < settings_.pictures_per_frame) {
      batches.push_back(draw_batch(generator, of_frame));
      batches.back().first_of_frame = false;
    }
    for (Batch& batch : batches) batch.picture = static_cast<uint32_t>(f * settings_.pictures_per_frame + (&batch - batches.data()));
    frames.push_back(std::move(batches));
  }
  return frames;
}

Trainer::Batch Trainer::draw_batch(std::mt19937_64& generator, const std::vector<size_t>& numbers) {
  auto below = [&](size_t count) { return std::uniform_int_distribution<size_t>(0, count - 1)(generator); };
  Batch batch;
  // A picture in which no ray meets the shell (the person out of view) has nothing to teach; a few may be met in a row.
  for (int tries = 0;; ++tries) {
    batch.number = numbers[below(numbers.size())];
    batch.place = images_.places()[batch.number];
    if (renew_shell(batch.place.frame, settings_.shell_drift) && with_grids()) solve_correspondences_again({batch.place.frame});
    const TrainingImage& image = images_.image(commands_, room_.samples, batch.place);
    if (image.person.empty() && image.around.empty()) {
      if (tries > 1000) throw InputError("capture", "pictures", "a person in view of the training cameras", "no ray that comes near the posed template", "Check cameras and poses with arah inspect.");
      continue;
    }
    batch.on_person = image.around.empty() ? settings_.rays : image.person.empty() ? 0u : static_cast<uint32_t>(std::lround(settings_.rays * settings_.mask_fraction));
    if (settings_.ray_importance > 0) {
      draw_by_importance(batch, image, generator);
      return batch;
    }
    for (uint32_t ray = 0; ray < settings_.rays; ++ray) {
      const auto& pool = ray < batch.on_person ? image.person : image.around;
      const TrainingImage::Pixel& pixel = pool[below(pool.size())];
      batch.pixels.push_back(pixel.place);
      batch.targets.push_back(pixel.target);
    }
    return batch;
  }
}

std::vector<float> Trainer::draw_pose_input(size_t frame, uint32_t number) {
  std::vector<float> input = pose_input(avatar_, images_.poses()[frame]);
  if (input.empty() || settings_.pose_noise == 0) return input;
  std::mt19937_64 generator = step_generator(settings_.seed, steps_, 4 + 16 * number);
  if (!(std::uniform_real_distribution<double>(0, 1)(generator) < settings_.pose_noise_probability)) return input;
  std::normal_distribution<double> noise(0, settings_.pose_noise);
  for (size_t i = 0; i < 9 * avatar_.body.skeleton.size(); ++i) input[i] += static_cast<float>(noise(generator));
  return input;
}

void Trainer::draw_by_importance(Batch& batch, const TrainingImage& image, std::mt19937_64& generator) {
  for (const bool person : {true, false}) {
    const uint32_t rays = person ? batch.on_person : settings_.rays - batch.on_person;
    if (rays == 0) continue;
    const auto& pixels = person ? image.person : image.around;
    PoolImportance& pool = importance_.pool(batch.number, person, pixels);
    pool.prepare(settings_.ray_importance);
    for (uint32_t ray = 0; ray < rays; ++ray) {
      const PoolImportance::Drawn drawn = pool.draw(generator);
      batch.pixels.push_back(pixels[drawn.pixel].place);
      batch.targets.push_back(pixels[drawn.pixel].target);
      batch.drawn.push_back(drawn.pixel);
      batch.weights.push_back(drawn.weight);
    }
  }
}

void Trainer::note_errors(const Batch& batch, uint32_t first, uint32_t rays) {
  commands_.submit_and_wait();
  const auto colors = device_.download<float>(room_.shaded.colors().elements(0, 4ull * rays));
  for (uint32_t ray = 0; ray < rays; ++ray) {
    // |rgb - photograph| summed over channels, and |Σw - mask|: bounded, unlike the cross entropy, so that no ray drowns the others.
    double& error = noted_errors_[size_t(batch.picture) * settings_.rays + first + ray] = 0;
    for (size_t channel = 0; channel < 4; ++channel) error += std::abs(double{colors[4 * ray + channel]} - double{batch.targets[first + ray][channel]});
  }
}

void Trainer::see_errors(const Batch& batch) {
  const TrainingImage& image = images_.image(commands_, room_.samples, batch.place);  // in store since its rays were drawn
  for (uint32_t ray = 0; ray < settings_.rays; ++ray) {
    const bool person = ray < batch.on_person;
    importance_.pool(batch.number, person, person ? image.person : image.around).see(batch.drawn[ray], noted_errors_[size_t(batch.picture) * settings_.rays + ray]);
  }
}

void Trainer::run_pass(FrameOnDevice& frame, const Batch& batch, const SurfaceHits& hits, uint32_t first, uint32_t rays, bool skinning_step) {
  const RootFindingCounts counts = room_.samples.root_finder().counts();
  room_.samples.set_pixels(commands_, frame, images_.camera(batch.place.camera), {batch.pixels.begin() + first, batch.pixels.begin() + first + rays});
  if (room_.surface_finder) {
    const uint32_t of_own = first - rays_.begin;
    SurfaceHits some{{hits.points.begin() + of_own, hits.points.begin() + of_own + rays}, {hits.depths.begin() + of_own, hits.depths.begin() + of_own + rays}};
    some.points.resize(padded_points(rays), {0, 0, 0, 0});
    room_.samples.set_surface(some);
  }
  const uint32_t first_of_step = batch.picture * padded_points(settings_.rays) + first;
  const bool accumulate = first > rays_.begin || !batch.first_of_frame;
  room_.samples.place(commands_, frame, rays, {true, static_cast<uint32_t>(settings_.seed), static_cast<uint32_t>(steps_), first_of_step});
  if (!room_.shaded.record_forward(commands_, frame, room_.samples, rays, {.least_weight = settings_.least_weight, .view_rotation = view_rotation_})) {
    room_.samples.root_finder().restore_counts(counts);  // of a pass that did not happen
    const uint32_t half = padded_points(rays / 2);
    run_pass(frame, batch, hits, first, half, skinning_step);
    return run_pass(frame, batch, hits, first + half, rays - half, skinning_step);
  }
  passes_done_ += 1;
  shaded_samples_ += room_.shaded.queue().shaded();

  // Losses and the way back.
  commands_.stage("losses");
  ImageLossArgs image;
  image.rays = rays;
  image.normaliser = float(all_rays(settings_));
  image.color_weight = static_cast<float>(settings_.color_weight);
  image.alpha_weight = static_cast<float>(room_.mask_loss ? 0 : settings_.alpha_weight);
  image.colors = room_.shaded.colors();
  image.targets = room_.targets.slice().sub(first_of_step * 16ull, padded_points(rays) * 16ull);
  image.d_colors = room_.d_colors.slice();
  image.losses = room_.losses.slice();
  image.slot = color_slot;
  image.partials = room_.partials.slice();
  if (settings_.ray_importance > 0) image.weights = room_.ray_weights.slice().sub(first_of_step * 4ull, padded_points(rays) * 4ull);
  record_image_loss(commands_, image);
  commands_.stage("compositing backward");
  Field& field = room_.shaded.field();
  CompositeBackwardArgs back;
  back.samples = room_.shaded.composited();
  back.transmittances = room_.shaded.transmittances();
  back.colors = room_.shaded.colors();
  back.d_colors = room_.d_colors.slice();
  back.d_sdf = field.d_sdf();
  back.d_rgb = field.d_rgb();
  back.gradients = networks_.gradient("b");
  back.partials = room_.partials.slice();
  field.record_clear_cotangents(commands_, room_.shaded.queue().shaded());
  record_composite_backward(commands_, back);
  commands_.stage("shading backward");
  Field::Backward field_back;
  field_back.accumulate = accumulate;
  field_back.position = skinning_step || pose_step_ || room_.surface_gradient;
  field_back.grid_scale = room_.updates.grid_scale();
  field_back.grid_sums = room_.updates.grid_sums();
  field_back.grid_clamped = room_.grid_clamped.slice();
  field.record_backward(commands_, room_.shaded.inputs(), field_back);
  watch_pass(rays, first_of_step, field_back.position);
  commands_.stage("skinning backward");
  const Field::Inputs& at = room_.shaded.inputs();
  PoseGradient* pose = pose_step_ ? &*room_.pose_gradient : nullptr;
  if (room_.surface_gradient)
    room_.surface_gradient->record(commands_, frame, room_.samples, room_.shaded, rays, skinning_step, accumulate, room_.scratch.slice());
  else if (room_.skinning && (skinning_step || pose))
    room_.skinning->record_from_positions(commands_, frame, at.rows, at.canonical, field.position_gradient(), accumulate, room_.scratch.slice(),
                                          {.weights = skinning_step, .pose = pose, .targets = room_.samples.root_finder().targets(), .samples = at.samples});
  else if (pose)
    pose->record_add_by_vertex(commands_, frame, room_.samples.root_finder(), {{at.rows, {}}, at.samples}, at.canonical, field.position_gradient());
  if (settings_.ray_importance > 0) note_errors(batch, first, rays);
}

bool Trainer::of_mask_loss(const Batch& batch, const SurfaceHits& hits, uint32_t ray) const { return hits.points[ray - rays_.begin][3] <= 0 || batch.targets[ray][3] < 0.5f; }

void Trainer::record_mask_loss_of(FrameOnDevice& frame, const Batch& batch, const SurfaceHits& hits, bool skinning_step) {
  MaskLoss::Rays rays;
  for (uint32_t ray = rays_.begin; ray < rays_.end; ++ray) {
    if (!of_mask_loss(batch, hits, ray)) continue;
    rays.pixels.push_back(batch.pixels[ray]);
    rays.masks.push_back(batch.targets[ray][3]);
    if (settings_.ray_importance > 0) rays.weights.push_back(batch.weights[ray]);
  }
  rays.first = static_cast<uint32_t>(ranks_.before(rays.pixels.size()));
  commands_.submit_and_wait();
  room_.mask_loss->record(commands_, frame, images_.camera(batch.place.camera), rays, mask_sharpness_.alpha(), static_cast<uint32_t>(steps_), skinning_step ? &*room_.skinning : nullptr,
                          room_.losses.slice(), mask_slot, room_.scratch.slice());
}

void Trainer::run_frame(const std::vector<Batch>& batches, uint32_t frame_of_step, bool skinning_step) {
  const size_t number = batches[0].place.frame;
  FrameOnDevice& frame = images_.frame(number);
  const std::size_t row = avatar_.spec.latent_size ? latent_row(avatar_, images_.frame_number(number)) : 0;
  if (room_.regularisers) {
    std::mt19937_64 generator = step_generator(settings_.seed, steps_, 1 + 16 * frame_of_step);
    room_.regularisers->draw(template_samples_, generator);
  }
  commands_.stage("weights");
  networks_.record_pose(commands_, frame.joint_rotations());
  networks_.record_pack(commands_, row, draw_pose_input(number, frame_of_step));
  for (const Batch& batch : batches) {
    const uint64_t first_of_step = uint64_t(batch.picture) * padded_points(settings_.rays);
    if (settings_.ray_importance > 0) device_.upload(room_.ray_weights.slice().elements(first_of_step, batch.weights.size()), batch.weights);
    SurfaceHits hits;
    if (room_.surface_finder) {
      // A ray that sphere tracing led astray may be rescued by the joint search.
      hits = room_.samples.search_surface(commands_, frame, images_.camera(batch.place.camera), {batch.pixels.begin() + rays_.begin, batch.pixels.begin() + rays_.end}, *room_.surface_finder, SurfaceFinder::Candidates::in_box);
      for (uint32_t ray = rays_.begin; ray < std::min(batch.on_person, rays_.end); ++ray) person_rays_ += 1, person_hits_ += hits.points[ray - rays_.begin][3] > 0;
    }
    std::vector<std::array<float, 4>> targets = batch.targets;
    // In surface rendering a ray has a colour to learn where it hits the surface and shows the person.
    for (uint32_t ray = rays_.begin; room_.mask_loss && ray < rays_.end; ++ray)
      if (of_mask_loss(batch, hits, ray)) targets[ray][3] = -1;
    device_.upload(room_.targets.slice().elements(4 * first_of_step, 4 * targets.size()), targets);
    for (uint32_t first = rays_.begin; first < rays_.end; first += pass_rays_) run_pass(frame, batch, hits, first, std::min(pass_rays_, rays_.end - first), skinning_step);
    if (room_.mask_loss) record_mask_loss_of(frame, batch, hits, skinning_step);
  }
  const bool last_frame = frame_of_step + 1 == settings_.frames_per_step;
  if (ranks_.count() > 1) take_passes(last_frame);
  commands_.stage("regularisers");
  if (room_.regularisers) room_.regularisers->record(commands_, room_.losses.slice(), {eikonal_slot, off_surface_slot, inside_slot}, room_.partials.slice(), room_.scratch.slice());
  if (room_.regularisers) {
    commands_.stage("watch");
    SdfRegularisers& of_sdf = *room_.regularisers;
    room_.watch.record(commands_, Watched::eikonal_gradients, {.values = of_sdf.eikonal_gradients(), .rows = of_sdf.eikonal_points().size(), .first_row = frame_of_step * settings_.eikonal_points + of_sdf.eikonal_points().begin, .after_previous = true});
    room_.watch.record(commands_, Watched::sign_distances, {.values = of_sdf.sign_distances(), .rows = of_sdf.sign_rows(), .first_row = frame_of_step * of_sdf.sign_rows()});
    commands_.stage("regularisers");
  }
  // Of the body, not of a frame: once a step.
  if (skinning_step && frame_of_step == 0) room_.skinning->record_surface_loss(commands_, frame.constants(), WeightsMeasure::absolute, settings_.skinning_weight * (double(skinning_points_.size()) / std::max(settings_.skinning_points, 1u)), true, room_.losses.slice(), skinning_slot, room_.scratch.slice());
  if (ranks_.count() > 1) add_up_frame(skinning_step);
  commands_.stage("weights");
  networks_.record_unpack(commands_, row, {true, skinning_step, true}, room_.scratch.slice(), frame_of_step,
                          {static_cast<float>(settings_.parameter_weight / settings_.frames_per_step), room_.losses.slice(), parameter_slot});
}

void Trainer::download_counts() {
  searches_ = searches();
  device_.download(room_.implicit_counts.slice(), &implicit_counts_, sizeof implicit_counts_);
  device_.download(room_.grid_clamped.slice().elements(0, 1), &grid_clamped_, sizeof grid_clamped_);
}

StepReport Trainer::step(uint64_t steps_left) {
  if (with_grids() && steps_ % settings_.grid_steps == 0) solve_correspondences();
  const std::vector<std::vector<Batch>> frames = draw_batches();
  if (avatar_.spec.color.view) {
    std::mt19937_64 generator = step_generator(settings_.seed, steps_, 3);
    view_rotation_ = draw_view_rotation(settings_.view_augmentation, generator);
  }
  const bool skinning_step = room_.skinning && settings_.skinning_every && steps_ % settings_.skinning_every == 0 && rate_factor(settings_.skinning, settings_, steps_, done_) > 0;
  if (skinning_step) {
    std::mt19937_64 generator = step_generator(settings_.seed, steps_, 2);
    room_.skinning->set_surface(template_samples_.surface, generator, images_.frame(frames[0][0].place.frame).bones(), skinning_points_.begin);
  }

  const double pose_factor = refinement_ ? rate_factor(settings_.poses, settings_, steps_, done_) : 0, shape_factor = shape_ ? rate_factor(settings_.shape, settings_, steps_, done_) : 0;
  pose_step_ = steps_ % settings_.poses_every == 0 && (pose_factor > 0 || shape_factor > 0);
  const uint64_t dense_floats = networks_.layout().group("grid").begin;
  commands_.fill(networks_.gradients().elements(0, dense_floats), 0);
  commands_.fill(room_.losses.slice(), 0);
  commands_.fill(room_.implicit_counts.slice(), 0);
  room_.watch.record_clear(commands_);
  noted_errors_.assign(settings_.ray_importance > 0 ? all_rays(settings_) : 0, 0.0);
  room_.samples.root_finder().reset_counts();
  if (room_.mask_loss) room_.mask_loss->root_finder().reset_counts();
  shaded_samples_ = passes_done_ = 0;
  person_rays_ = person_hits_ = 0;
  room_.samples.set_half_width(half_width(settings_, steps_));
  std::vector<PoseGradients> pose_gradients;  // by frame
  for (uint32_t f = 0; f < frames.size(); ++f) {
    if (f > 0) commands_.submit_and_wait();  // what was recorded reads what is uploaded next
    if (pose_step_) room_.pose_gradient->record_clear(commands_);
    run_frame(frames[f], f, skinning_step);
    if (!pose_step_) continue;
    commands_.submit_and_wait();
    pose_gradients.push_back({room_.pose_gradient->download(), networks_.download_pose_gradient(device_)});
  }
  if (ranks_.count() > 1) add_up_step(pose_gradients);
  commands_.stage("optimiser");
  room_.updates.record_norms(commands_, skinning_step);
  commands_.submit_and_wait();
  if (ranks_.count() == 1) download_counts();
  const auto losses = device_.download<float>(room_.losses.slice().elements(0, loss_slots));
  // Nothing of what training learns has changed so far, and nothing does where a number is bad: the step can be repeated.
  if (BadValues bad = of_all_ranks(bad_values(frames, losses, pose_gradients, !std::exchange(state_watched_, true))); !bad.tensors.empty())
    return skip(std::move(bad), steps_left);
  skipped_in_a_row_ = 0;
  for (const std::vector<Batch>& batches : frames)
    for (const Batch& batch : batches)
      if (settings_.ray_importance > 0) see_errors(batch);
  room_.updates.record(commands_, steps_, done_, skinning_step);
  commands_.submit_and_wait();
  if (!alike_) follow_first();

  std::vector<double> of_shape(avatar_.body.shape.size(), 0.0);  // of the poses that the step saw
  for (size_t f = 0; shape_factor > 0 && f < pose_gradients.size(); ++f) {
    const std::vector<double> of_frame = shape_gradient(avatar_, images_.poses()[frames[f][0].place.frame], pose_gradients[f]);
    for (size_t b = 0; b < of_shape.size(); ++b) of_shape[b] += of_frame[b];
  }
  for (size_t f = 0; pose_factor > 0 && f < pose_gradients.size(); ++f) {
    const size_t frame = frames[f][0].place.frame;
    refinement_->step(frame, pose_gradients[f], settings_.poses, pose_factor);
    images_.set_pose(frame, refinement_->pose(frame));
  }
  if (shape_factor > 0 && pose_step_) {
    shape_->step(of_shape, settings_.shape, shape_factor);
    follow_shape();
  }

  StepReport report;
  report.skipped = skipped_;
  report.color = losses[color_slot], report.alpha = losses[alpha_slot], report.eikonal = losses[eikonal_slot];
  report.off_surface = losses[off_surface_slot], report.inside = losses[inside_slot];
  if (skinning_step) last_skinning_loss_ = losses[skinning_slot] / (settings_.skinning_weight > 0 ? settings_.skinning_weight : 1);
  report.skinning = last_skinning_loss_;
  report.parameters = losses[parameter_slot] / double(settings_.frames_per_step);
  report.hits = person_rays_ ? double(person_hits_) / double(person_rays_) : 0;
  report.passes = passes_done_;
  if (room_.mask_loss) {
    report.mask = losses[mask_slot];
    report.mask_alpha = mask_sharpness_.alpha();
    report.alpha = 0;
    mask_sharpness_.learn(settings_.mask_weight * losses[mask_alpha_slot]);
    report.total = settings_.mask_weight * report.mask;
  }
  report.total += settings_.color_weight * report.color + settings_.alpha_weight * report.alpha + settings_.eikonal_weight * report.eikonal + settings_.off_surface_weight * report.off_surface +
                  settings_.inside_weight * report.inside + settings_.skinning_weight * report.skinning + settings_.parameter_weight * report.parameters;
  report.sdf_norm = room_.updates.sdf_norm();
  report.shaded = double(shaded_samples_) / double(uint64_t(room_.samples.rows(settings_.rays)) * settings_.frames_per_step * settings_.pictures_per_frame);
  report.converged = searches_.points ? double(searches_.converged) / double(searches_.points) : 1;
  report.implicit = implicit_counts_;
  report.grid_clamped = grid_clamped_;
  float b = 0;
  device_.download(networks_.parameter("b").elements(0, 1), &b, 4);
  report.b = std::abs(b);
  steps_ += 1;
  done_ += (1 - done_) / double(std::max<uint64_t>(steps_left, 1));
  report.step = steps_;
  return report;
}

Avatar Trainer::avatar() {
  Avatar result = avatar_;
  result.parameters = device_.download<float>((settings_.average_decay > 0 ? room_.updates.averages() : networks_.parameters()).elements(0, networks_.layout().floats));
  // Kernels read |b| clipped to [1e-6, 1e6] metres, so training may let b change its sign; an avatar holds it above 0.
  float& b = result.tensor("b")[0];
  b = std::max(std::abs(b), 1e-6f);
  result.seed = settings_.seed;
  result.steps = steps_;
  result.settings = settings_to_json(settings_);
  if (refinement_)
    for (const size_t frame : pictured_frames()) {
      result.refined.frames.push_back(images_.frame_number(frame));
      result.refined.poses.push_back(images_.poses()[frame]);
      result.refined.starts.push_back(refinement_->starts()[frame]);
    }
  if (shape_) result.refined.start_shape = shape_->start();
  return result;
}

SafetensorsFile Trainer::checkpoint() { return state(avatar()); }

SafetensorsFile Trainer::state(const Avatar& shown) {
  SafetensorsFile file = avatar_tensors(shown);
  room_.updates.save(file);
  if (!grid_parameters_.empty()) file.tensors["training.grid_parameters"] = Tensor::from<float>({static_cast<int64_t>(grid_parameters_.size())}, grid_parameters_);
  if (settings_.ray_importance > 0) importance_.save(file, images_.places().size());
  if (refinement_) {
    refinement_->save(file);
    refinement_->save_poses(file, "training.shell_poses", images_.shell_poses());
  }
  if (shape_) {
    shape_->save(file);
    std::vector<double> shapes;
    for (const std::vector<double>& shape : images_.shell_shapes()) shapes.insert(shapes.end(), shape.begin(), shape.end());
    file.tensors["training.shell_shapes"] = Tensor::from<double>({static_cast<int64_t>(images_.shell_shapes().size()), static_cast<int64_t>(shape_->start().size())}, shapes);
  }
  if (room_.mask_loss) mask_sharpness_.save(file);
  file.tensors["training.done"] = Tensor::from<double>({}, std::vector<double>{done_});
  file.tensors["training.last_skinning_loss"] = Tensor::from<double>({}, std::vector<double>{last_skinning_loss_});
  file.tensors["training.skipped"] = Tensor::from<int64_t>({}, std::vector<int64_t>{static_cast<int64_t>(skipped_)});
  return file;
}

void Trainer::resume(const SafetensorsFile& file) {
  const Avatar saved = avatar_from_tensors(file);
  if (!(saved.layout == avatar_.layout)) throw InputError(file.path.string(), "spec", "the avatar that this training is about", "one with other parts or sizes");
  room_.updates.load(file);
  done_ = file.values<double>("training.done", {})[0];
  last_skinning_loss_ = file.values<double>("training.last_skinning_loss", {})[0];
  skipped_ = static_cast<uint64_t>(file.values<int64_t>("training.skipped", {})[0]);
  skipped_in_a_row_ = 0;
  state_watched_ = false;
  steps_ = saved.steps;
  if (settings_.ray_importance > 0) importance_.load(file, images_.places().size());
  if (room_.mask_loss) mask_sharpness_.load(file);
  // Shells and grids as they were: of the poses and shapes, and solved with the parameters, of then.
  std::vector<std::vector<double>> shell_shapes;  // by frame, where the shape is refined
  if (refinement_) {
    refinement_->load(file);
    const std::vector<Pose> shells = refinement_->load_poses(file, "training.shell_poses");
    if (shape_) {
      shape_->load(file);
      const size_t count = shape_->start().size();
      const std::vector<double> shapes = file.values<double>("training.shell_shapes", {static_cast<int64_t>(shells.size()), static_cast<int64_t>(count)});
      for (size_t frame = 0; frame < shells.size(); ++frame) shell_shapes.emplace_back(shapes.begin() + static_cast<ptrdiff_t>(frame * count), shapes.begin() + static_cast<ptrdiff_t>((frame + 1) * count));
    }
    for (size_t frame = 0; frame < shells.size(); ++frame) {
      if (shape_) set_shape(avatar_.body, shell_shapes[frame]);
      images_.set_pose(frame, shells[frame]), images_.renew(frame, 0);
    }
  }
  if (file.tensors.contains("training.grid_parameters")) {
    grid_parameters_ = file.values<float>("training.grid_parameters", {static_cast<int64_t>(networks_.layout().group("skinning").size())});
    if (!shape_) solve_correspondences_again(pictured_frames());
    else
      for (const size_t frame : pictured_frames()) {
        set_shape(avatar_.body, shell_shapes[frame]);
        solve_correspondences_again({frame});
      }
  }
  if (shape_) follow_shape();
  if (refinement_)
    for (size_t frame = 0; frame < images_.poses().size(); ++frame) images_.set_pose(frame, refinement_->pose(frame));
}

}  // namespace arah

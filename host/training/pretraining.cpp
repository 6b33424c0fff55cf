#include "host/training/pretraining.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>
#include <optional>
#include <random>

#include "host/input_error.h"
#include "host/training/pretrain_tasks.h"
#include "host/training/reptile.h"

namespace arah {
namespace {

enum PretrainStream : uint32_t { sdf_stream = 1, skinning_stream = 2, pose_stream = 3, held_out_stream = 4 };

// Random numbers of an outer step's task `place`, or, with place 0, of the choice of its tasks.
std::mt19937_64 pretrain_generator(uint64_t seed, PretrainStream stream, uint64_t step, uint32_t place) {
  std::seed_seq sequence{uint32_t(seed), uint32_t(seed >> 32), uint32_t(stream), uint32_t(step), uint32_t(step >> 32), place};
  return std::mt19937_64(sequence);
}

// `count` of 0 … all − 1 in random order, distinct while there are enough.
std::vector<std::size_t> choose_tasks(std::size_t all, std::size_t count, std::mt19937_64& generator) {
  std::vector<std::size_t> order(all), chosen;
  for (std::size_t i = 0; i < all; ++i) order[i] = i;
  for (std::size_t i = 0; i < count; ++i) {
    const std::size_t from = i % all;
    std::swap(order[from], order[std::uniform_int_distribution<std::size_t>(from, all - 1)(generator)]);
    chosen.push_back(order[from]);
  }
  return chosen;
}

ReptileGroup reptile_group(const ParameterLayout& layout, const std::string& name, const ReptileSettings& settings) {
  const ParameterGroup& group = layout.group(name);
  return {name, group.begin, group.end, settings.inner_rate, settings.outer_rate};
}

}  // namespace

struct Pretraining::State {
  State(Device& device_, const AvatarSpec& spec, const BodyFamily& family_, const PretrainSettings& settings_)
      : device(device_), settings(settings_), family(family_), avatar(make_avatar(prior_spec(spec), family.members.front().figure.body, {}, settings_.seed)),
        networks(device_, avatar, true, std::min(settings_.pose_batch, static_cast<uint32_t>(settings_.poses))), loss(device, networks, settings) {
    const bool skins = avatar.spec.skinning.kind == Skinning::network;
    AvatarSpec plain = avatar.spec;  // a member's avatar is for its cube and its joints
    plain.sdf.pose = PoseConditioning::none;
    plain.sdf.pose_width = plain.sdf.pose_hidden_layers = 0;
    std::vector<std::vector<WeightSample>> pools;
    for (std::size_t m = 0; m < family.members.size(); ++m) {
      Avatar& member = members.emplace_back(make_avatar(plain, family.members[m].figure.body, {}, settings.seed));
      cubes.push_back(member.cube);
      const std::vector<glm::dvec3> member_places = joint_places(member);
      places.resize(member_places.size(), glm::dvec3(0.0));
      for (std::size_t j = 0; j < places.size(); ++j) places[j] += member_places[j] / double(family.members.size());
      if (skins) pools.push_back(draw_weight_samples(member, settings.seed + m));
      member.spec.sdf = avatar.spec.sdf;
      member.parameters.clear();
    }
    scans = family_scans(family, settings.poses, settings.seed);
    for (const FamilyScan& scan : scans) points.emplace_back(scan, cubes[scan.member]);
    sdf_tasks.emplace(networks, loss, points);
    sdf.emplace(device, networks.parameters(), networks.gradients(), std::vector{reptile_group(networks.layout(), "sdf", settings.sdf)}, settings.sdf.inner_steps);
    if (skins) {
      skinning_tasks.emplace(device, networks, std::move(pools), cubes, settings);
      skinning.emplace(device, networks.parameters(), networks.gradients(), std::vector{reptile_group(networks.layout(), "skinning", settings.skinning)}, settings.skinning.inner_steps);
    }
    if (avatar.spec.sdf.pose != PoseConditioning::none) make_pose_stage();
  }

  void make_pose_stage() {
    // A body whose surface only follows its joints has one scan: its canonical surface is the same in all poses.
    for (std::size_t s = 0, m = 0; m < members.size(); ++m) {
      const std::size_t first = s;
      while (s < scans.size() && scans[s].member == m) ++s;
      std::vector<PosedScan>& body = bodies.emplace_back();
      for (const Pose& taken : member_poses(family, m, settings.poses, settings.seed)) body.push_back({std::min(first + body.size(), s - 1), pose_input(members[m], taken)});
    }
    pose_tasks.emplace(device, networks, loss, points, bodies, settings);
    ReptileSettings encoder = settings.pose;
    encoder.inner_rate = encoder.outer_rate = settings.pose_encoder_rate;
    std::vector<ReptileGroup> groups{reptile_group(networks.layout(), "pose_code", encoder), reptile_group(networks.layout(), "hyper", settings.pose)};
    if (avatar.spec.sdf.pose == PoseConditioning::low_rank) {
      groups.push_back(reptile_group(networks.layout(), "low_rank", settings.pose));
    } else {
      groups.push_back(reptile_group(networks.layout(), "hyper_last", settings.pose));
      groups.back().outer_gradients = [this] {
        std::vector<OuterGradient> gradients;
        for (const AvatarNetworks::LastGradient& part : networks.hyper_last_gradients(pose_tasks->frames()))
          gradients.push_back({part.slot.offset, part.slot.offset + (part.slot.count + kSlotAlignment - 1) / kSlotAlignment * kSlotAlignment, part.product});
        return gradients;
      };
    }
    pose.emplace(device, networks.parameters(), networks.gradients(), std::move(groups), pose_tasks->inner_steps());
  }

  // One outer step of any network: the same loop, with other tasks. inner_steps: of a task.
  template <typename Tasks>
  double step(Reptile& reptile, Tasks& tasks, const ReptileSettings& rates, uint32_t inner_steps, PretrainStream stream) {
    std::mt19937_64 choice = pretrain_generator(settings.seed, stream, reptile.steps(), 0);
    const std::vector<std::size_t> chosen = choose_tasks(tasks.count(), rates.tasks, choice);
    Commands clear(device);
    tasks.clear_losses(clear);
    clear.submit_and_wait();
    uint32_t place = 0;
    std::mt19937_64 generator;
    reptile.step(chosen, [&](Commands& commands, std::size_t task, uint32_t inner_step) {
      if (inner_step == 0) generator = pretrain_generator(settings.seed, stream, reptile.steps(), ++place);
      tasks.draw(task, inner_step, generator);
      tasks.record(commands);
    }, rates.end_fraction + (1 - rates.end_fraction) * 0.5 * (1 + std::cos(std::numbers::pi * std::min(1.0, double(reptile.steps()) / double(std::max<uint64_t>(rates.steps, 1))))));
    return tasks.loss() / (double(rates.tasks) * inner_steps);
  }

  Device& device;
  PretrainSettings settings;
  BodyFamily family;
  Avatar avatar;
  AvatarNetworks networks;
  ScanLoss loss;
  std::vector<Avatar> members;           // without parameters
  std::vector<CubeNormalization> cubes;  // by member
  std::vector<glm::dvec3> places;        // of joints, mean over members
  std::vector<FamilyScan> scans;
  std::vector<ScanPoints> points;               // of each scan
  std::vector<std::vector<PosedScan>> bodies;   // by member, where the SDF follows the pose
  std::optional<SdfTasks> sdf_tasks;
  std::optional<SkinningTasks> skinning_tasks;
  std::optional<PoseTasks> pose_tasks;
  std::optional<Reptile> sdf, skinning, pose;
};

Pretraining::Pretraining(Device& device, const AvatarSpec& spec, const BodyFamily& family, const PretrainSettings& settings) {
  if (device.memory_ceiling()) {
    const BodyFamily one{{family.members.front()}, family.description};  // buffers are as large for one body as for many
    const uint64_t needed = device.bytes_of([&] { State(device, spec, one, settings); });
    if (device.allocated_bytes() + needed > device.memory_ceiling()) throw device.beyond_ceiling("pre-training", needed);
  }
  state_ = std::make_unique<State>(device, spec, family, settings);
}
Pretraining::~Pretraining() = default;

double Pretraining::sdf_step() {
  State& s = *state_;
  return s.step(*s.sdf, *s.sdf_tasks, s.settings.sdf, s.settings.sdf.inner_steps, sdf_stream);
}

double Pretraining::skinning_step() {
  State& s = *state_;
  if (!s.skinning) throw std::logic_error("pre-training without a skinning network");
  return s.step(*s.skinning, *s.skinning_tasks, s.settings.skinning, s.settings.skinning.inner_steps, skinning_stream);
}

double Pretraining::pose_step() {
  State& s = *state_;
  if (!s.pose) throw std::logic_error("pre-training of an SDF that follows no pose");
  return s.step(*s.pose, *s.pose_tasks, s.settings.pose, s.pose_tasks->inner_steps(), pose_stream);
}

uint64_t Pretraining::sdf_steps() const { return state_->sdf->steps(); }
uint64_t Pretraining::skinning_steps() const { return state_->skinning ? state_->skinning->steps() : state_->settings.skinning.steps; }
uint64_t Pretraining::pose_steps() const { return state_->pose ? state_->pose->steps() : state_->settings.pose.steps; }

Pretraining::HeldOut Pretraining::held_out() {
  State& s = *state_;
  const double between = 0.5;
  const std::vector<FamilyScan> scans = family_scans(s.family, s.settings.poses, s.settings.seed, between);
  HeldOut sums;
  Commands commands(s.device);
  const auto loss = [&](const ScanBatch& batch, const std::vector<float>& pose) {
    s.loss.upload(batch);
    s.loss.clear(commands);
    s.networks.record_pack(commands, 0, pose);
    s.loss.record(commands, static_cast<uint32_t>(scans.size()), false);
    commands.submit_and_wait();
    return s.loss.value();
  };
  std::mt19937_64 generator = pretrain_generator(s.settings.seed, held_out_stream, 0, 0);
  for (const FamilyScan& scan : scans) {
    const ScanBatch batch = s.loss.draw(ScanPoints(scan, s.cubes[scan.member]), generator);
    sums.posed += loss(batch, pose_input(s.members[scan.member], scan.pose));
    sums.shared += loss(batch, {});
  }
  return sums;
}

SafetensorsFile Pretraining::tensors() {
  State& s = *state_;
  s.avatar.parameters = s.device.download<float>(s.networks.parameters().elements(0, s.networks.layout().floats));
  SafetensorsFile file = prior_tensors(s.avatar, s.settings, s.family.description, s.places);
  s.sdf->save(file);
  if (s.skinning) s.skinning->save(file);
  if (s.pose) s.pose->save(file);
  return file;
}

void Pretraining::resume(const SafetensorsFile& file) {
  State& s = *state_;
  const std::string where = file.path.string();
  const auto metadata = [&](const char* key) {
    const auto found = file.metadata.find(key);
    return found == file.metadata.end() ? std::string("none") : found->second;
  };
  const std::string advice = "Leave the option out, or write another file.";
  if (metadata("family") != s.family.description) throw InputError(where, "family", metadata("family"), s.family.description, advice);
  PretrainSettings saved = pretrain_settings_from_json(metadata("settings"), where + ": settings");
  saved.sdf.steps = s.settings.sdf.steps;
  saved.skinning.steps = s.settings.skinning.steps;
  saved.pose.steps = s.settings.pose.steps;
  const auto before = nlohmann::json::parse(pretrain_settings_to_json(saved)).flatten(), now = nlohmann::json::parse(pretrain_settings_to_json(s.settings)).flatten();
  for (const auto& [name, value] : before.items())
    if (now.at(name) != value) throw InputError(where, "settings" + name, "what it began with, " + value.dump(), now.at(name).dump(), advice);
  if (metadata("spec") != spec_to_json(s.avatar.spec)) throw InputError(where, "spec", "the networks that it began with", "others", advice);
  for (const TensorSlot& slot : s.avatar.layout.slots)
    if (of_prior(slot)) s.device.upload(s.networks.parameter(slot.name), file.values<float>(slot.name, slot.shape));
  s.sdf->load(file);
  if (s.skinning) s.skinning->load(file);
  if (s.pose) s.pose->load(file);
}

bool run_pretraining(Pretraining& pretraining, const PretrainSettings& settings, const PretrainOptions& options, const std::function<bool(const PretrainEvent&)>& listen) {
  if (options.resume) pretraining.resume(read_safetensors(options.out));
  auto saved = std::chrono::steady_clock::now();
  const auto learn = [&](const char* network, uint64_t steps, const std::function<uint64_t()>& done, const std::function<double()>& step) {
    const uint64_t first = done();
    while (done() < steps) {
      PretrainEvent event{network, 0, steps, first, step(), false};
      event.step = done();
      if (std::chrono::duration<double>(std::chrono::steady_clock::now() - saved).count() >= options.save_seconds) {
        write_safetensors(options.out, pretraining.tensors());
        saved = std::chrono::steady_clock::now();
        event.saved = true;
      }
      if (listen && !listen(event)) return false;
    }
    return true;
  };
  const bool finished = learn("skinning weights", settings.skinning.steps, [&] { return pretraining.skinning_steps(); }, [&] { return pretraining.skinning_step(); }) &&
                        learn("SDF", settings.sdf.steps, [&] { return pretraining.sdf_steps(); }, [&] { return pretraining.sdf_step(); }) &&
                        learn("SDF by pose", settings.pose.steps, [&] { return pretraining.pose_steps(); }, [&] { return pretraining.pose_step(); });
  write_safetensors(options.out, pretraining.tensors());
  return finished || (pretraining.skinning_steps() >= settings.skinning.steps && pretraining.sdf_steps() >= settings.sdf.steps && pretraining.pose_steps() >= settings.pose.steps);
}

}  // namespace arah

#include "host/avatar/spec_choice.h"

#include <fmt/ranges.h>

#include <algorithm>

#include "host/body/json_fields.h"

namespace arah {
namespace {

// With fewer cameras the colour network explains the views that it saw by their direction: with four cameras the view
// input cost 0.5 dB in views that were held out.
constexpr std::size_t kFewestCamerasForView = 10;
constexpr const char* kTrainingSplit = "train";
constexpr const char* kTrainingRole = "train";

// What the capture itself says of its poses, "exact" or "estimated"; null where it says nothing.
nlohmann::json stated_poses(const Capture& capture) {
  for (const char* file : {"synthetic.json", "motion_train.json"}) {
    if (!std::filesystem::is_regular_file(capture.path / file)) continue;
    const nlohmann::json stated = read_json(capture.path / file);
    if (stated.is_object() && stated.contains("poses")) return stated["poses"];
  }
  return {};
}

std::string plural(std::size_t count, const char* noun) {
  return fmt::format("{} {}{}", count, noun, count == 1 ? "" : "s");
}

}  // namespace

std::vector<int> training_frames(const Capture& capture) {
  const Motion& motion = motion_of(capture, kTrainingSplit);
  std::vector<bool> pictured(motion.frames.size(), false);
  for (std::size_t c = 0; c < capture.cameras.size(); ++c) {
    if (capture.cameras[c].role != kTrainingRole) continue;
    for (std::size_t f = 0; f < pictured.size(); ++f) {
      if (!pictured[f]) {
        pictured[f] = std::filesystem::is_regular_file(image_path(capture, kTrainingSplit, c, motion.frames[f].number));
      }
    }
  }
  std::vector<int> frames;
  for (std::size_t f = 0; f < pictured.size(); ++f) {
    if (pictured[f]) frames.push_back(motion.frames[f].number);
  }
  if (frames.empty()) {
    throw InputError(capture.path.string(), "images/train", "a picture of a training frame from a training camera",
                     "none", "Cameras of the role 'train' in cameras.json need images/train/<camera>/<frame>.png.");
  }
  return frames;
}

CaptureFacts capture_facts(const Capture& capture) {
  const std::vector<int> frames = training_frames(capture);
  const Motion& motion = motion_of(capture, kTrainingSplit);
  CaptureFacts facts;
  facts.training_frames = frames.size();
  facts.joints = capture.body_template.skeleton.size();
  facts.shape_moves_joints = capture.body_template.shape.moves_joints();
  for (std::size_t c = 0; c < capture.cameras.size(); ++c) {
    if (capture.cameras[c].role == kTrainingRole && !frames_with_images(capture, kTrainingSplit, c).empty()) {
      ++facts.training_cameras;
    }
  }
  const Pose& first = find_frame(motion, frames.front())->pose;
  facts.single_pose = std::all_of(frames.begin(), frames.end(),
                                  [&](int number) { return find_frame(motion, number)->pose.theta == first.theta; });
  const nlohmann::json poses = stated_poses(capture);
  facts.exact_poses = poses == "exact";
  facts.estimated_poses = poses == "estimated";
  return facts;
}

SpecChoice choose_spec(const std::string& preset, const CaptureFacts& facts) {
  SpecChoice choice{preset_spec(preset), false, false, {}};
  AvatarSpec& spec = choice.spec;
  const auto say = [&](const std::string& part, const std::string& chosen, const std::string& reason) {
    choice.reasons.push_back(fmt::format("{}: {}, because {}", part, chosen, reason));
  };
  const std::string preset_has_it = fmt::format("the preset {} has it", preset);
  const std::string preset_has_none = fmt::format("the preset {} has none", preset);

  if (facts.single_pose) {
    spec.skinning = {Skinning::none, 0, 0};
    say("skinning", "none",
        fmt::format("all {} show one pose, so nothing moves", plural(facts.training_frames, "frame")));
  } else if (facts.joints <= 1) {
    spec.skinning = {Skinning::template_weights, 0, 0};
    say("skinning", "template weights", "with one joint every point follows it");
  } else {
    say("skinning", fmt::format("network, {} hidden layers of {}", spec.skinning.hidden_layers, spec.skinning.width),
        fmt::format("{} in several poses; {}", plural(facts.joints, "joint"), preset_has_it));
  }

  const bool several_frames = facts.training_frames > 1;
  if (spec.sdf.conditioning == SdfConditioning::latent && (!several_frames || facts.single_pose)) {
    spec.sdf.conditioning = SdfConditioning::none;
    spec.sdf.mapping_width = spec.sdf.mapping_hidden_layers = 0;
    say("SDF conditioning", "none", several_frames ? "one pose has one shape" : "there is one frame");
  } else if (spec.sdf.conditioning == SdfConditioning::latent) {
    say("SDF conditioning", "latent FiLM",
        fmt::format("{}; {}", plural(facts.training_frames, "frame"), preset_has_it));
  } else {
    say("SDF conditioning", "none", preset_has_none);
  }

  if (spec.sdf.pose != PoseConditioning::none && (!several_frames || facts.single_pose || facts.joints <= 1)) {
    spec.sdf.pose = PoseConditioning::none;
    spec.sdf.pose_width = spec.sdf.pose_hidden_layers = 0;
    say("SDF by pose", "none", facts.joints <= 1 ? "with one joint there is one pose" : several_frames ? "all frames show one pose" : "there is one frame");
  } else {
    say("SDF by pose", spec.sdf.pose == PoseConditioning::none ? "none" : fmt::format("{}, width {}", to_string(spec.sdf.pose), spec.sdf.pose_width),
        spec.sdf.pose == PoseConditioning::none ? preset_has_none : preset_has_it);
  }

  if (spec.color.latent && !several_frames) {
    spec.color.latent = false;
    say("colour latent", "off", "there is one frame");
  } else {
    say("colour latent", spec.color.latent ? fmt::format("{} numbers a frame", spec.latent_size) : "off",
        spec.color.latent ? fmt::format("light and cloth change over {}", plural(facts.training_frames, "frame"))
                          : preset_has_none);
  }
  if (!spec.color.latent && spec.sdf.conditioning == SdfConditioning::none) spec.latent_size = 0;

  if (spec.color.view && facts.training_cameras < kFewestCamerasForView) {
    spec.color.view = false;
    say("colour view direction", "off",
        fmt::format("{} (fewer than {}) let colour be learned by heart for each view",
                    plural(facts.training_cameras, "training camera"), kFewestCamerasForView));
  } else {
    say("colour view direction", spec.color.view ? "on" : "off",
        spec.color.view
            ? fmt::format("{} see the surface from many sides", plural(facts.training_cameras, "training camera"))
            : preset_has_none);
  }
  if (!spec.color.view && !spec.color.normal) spec.color.directions = DirectionSpace::observation;
  say("colour normal", spec.color.normal ? "on" : "off", spec.color.normal ? preset_has_it : preset_has_none);
  say("colour feature grid",
      spec.grid_cells.empty() ? "off" : fmt::format("cells of {} m", fmt::join(spec.grid_cells, " and ")),
      spec.grid_cells.empty() ? preset_has_none : preset_has_it);
  // Poses that are right would be moved by millimetres, and every step would take twice as long: only where it is asked for.
  choice.pose_refinement = facts.estimated_poses && spec.skinning.kind != Skinning::none;
  say("pose refinement", choice.pose_refinement ? "on" : "off",
      choice.pose_refinement                     ? "the capture states that its poses are estimates"
      : facts.exact_poses                        ? "the capture states that its poses are exact"
      : spec.skinning.kind == Skinning::none     ? "there is one pose, which is the canonical one"
                                                 : "the capture does not state whether its poses are estimates (--set pose_refinement=true if they are)");
  choice.shape_refinement = choice.pose_refinement && facts.shape_moves_joints;
  if (choice.pose_refinement)
    say("shape refinement", choice.shape_refinement ? "on" : "off", choice.shape_refinement ? "a shape is estimated with its poses" : "no morph target of the template moves its joints");
  validate_spec(spec, "chosen spec");
  return choice;
}

}  // namespace arah

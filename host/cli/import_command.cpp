#include <fmt/format.h>
#include <fmt/ranges.h>

#include <CLI/CLI.hpp>
#include <memory>
#include <optional>

#include "host/avatar/avatar_file.h"
#include "host/body/motion_file.h"
#include "host/body/smpl_file.h"
#include "host/capture/import_capture.h"
#include "host/cli/command.h"
#include "host/cli/interrupt.h"
#include "host/cli/progress.h"
#include "host/input_error.h"

namespace arah {
namespace {

constexpr const char* kBodyWord = "smpl";
constexpr const char* kMotionWord = "motion";

struct MotionEdits {
  double fps = 0, scale = 0;
  int loop = 1;
  std::vector<double> place;
  std::string animation;
};

void print_notes(const std::vector<std::string>& notes) {
  for (const std::string& note : notes) fmt::print("note: {}\n", note);
}

int import_body(const ImportSettings& settings, const std::vector<double>& betas) {
  const SmplBody smpl = read_smpl_body(settings.in, betas);
  write_body_template(settings.out, smpl.body);
  print_notes(smpl.notes);
  return 0;
}

// The rig that a motion is for: of a template, a body model or an avatar.
Skeleton rig_of(const std::filesystem::path& body, const std::vector<double>& betas) {
  if (body.empty()) throw InputError("arah import motion", "--body", "the rig that the motion is for", "none", "See: arah import --help");
  if (body.extension() == ".safetensors") return load_avatar(body).body.skeleton;
  if (is_smpl_file(body)) return read_smpl_body(body, betas).body.skeleton;
  return read_body_template(body).skeleton;
}

FrameRange motion_range(const std::string& text) {
  try {
    return parse_frame_range("motion=" + text);
  } catch (const InputError&) {
    throw InputError("--frames", "", "FIRST:END or FIRST:END:STEP for a motion, such as 0:300", "'" + text + "'");
  }
}

int import_motion(const ImportSettings& settings, const std::vector<double>& betas, const std::vector<std::string>& ranges, const MotionEdits& edits) {
  const std::string end = settings.in.extension().string();
  if (!edits.animation.empty() && end != ".glb" && end != ".gltf") throw InputError("--animation", "", "a .glb or .gltf to take it of", "'" + end + "'");
  if (edits.place.size() == 1 || edits.place.size() > 3) throw InputError("--place", "", "x,y or x,y,z", fmt::format("{} numbers", edits.place.size()));
  if (ranges.size() > 1) throw InputError("--frames", "", "one range for a motion", fmt::format("{}", ranges.size()));
  const std::string where = settings.in.string();
  MotionFile file = read_motion_file(settings.in, edits.animation, edits.fps);
  file.settings.scale = edits.scale;
  Motion source = file.motion;
  if (!ranges.empty()) {
    const FrameRange range = motion_range(ranges[0]);
    source = cut(source, static_cast<std::size_t>(range.first), static_cast<std::size_t>(range.end), static_cast<std::size_t>(range.step), where);
  }
  Retargeted result = retarget(source, rig_of(settings.body, betas), file.settings, where);
  Motion& motion = result.motion;
  if (edits.fps > 0) motion = resampled(motion, edits.fps, where);
  if (edits.loop > 1) motion = looped(motion, edits.loop, where);
  if (!edits.place.empty()) motion = placed(motion, edits.place);
  motion.split = settings.out.stem().string();
  motion.poses.clear();
  for (MotionFrame& frame : motion.frames) frame.source = settings.in.filename().string();
  write_motion(settings.out, motion);
  fmt::print("{} of {} frames and {} joints, for this rig:\n{}", file.format, file.motion.frames.size(), source.skeleton.size(), retarget_table(result, source.skeleton));
  fmt::print("  {}; root's way times {:.4g}\n", result.same_rest ? "both rest alike" : "limbs rest otherwise there: directions of bones are kept", result.scale);
  print_notes(file.notes);
  fmt::print("{}: {} frames{}\n", settings.out.string(), motion.frames.size(),
             motion.frames_per_second > 0 ? fmt::format(" at {:.4g} a second", motion.frames_per_second) : "");
  return 0;
}

}  // namespace

void add_import_command(CLI::App& program, Run& run) {
  struct Options {
    ImportSettings settings;
    std::vector<double> betas;
    std::vector<std::string> ranges;
    MotionEdits edits;
    bool list_presets = false;
  };
  const auto options = std::make_shared<Options>();
  CLI::App* command = program.add_subcommand("import", "Make a capture of a sequence of a public dataset, a rig of a body model, or a motion of motion capture");
  ImportSettings& settings = options->settings;
  command->add_option("LAYOUT", settings.layout, fmt::format("{}: how the sequence lies on disk; {}: a body model; {}: motion capture", fmt::join(import_layouts(), ", "), kBodyWord, kMotionWord));
  command->add_option("IN", settings.in, "the sequence's folder; for smpl the model's file, .npz or .pkl; for motion a .bvh, a .glb or .gltf with an animation, AMASS's .npz, AIST++'s .pkl or a motion_<split>.json");
  command->add_option("OUT", settings.out, "folder to write; an earlier import there is replaced. For smpl a .glb, for motion a .json");
  command->add_option("--body", settings.body,
                      "the body that the sequence's poses are for: a skinned .glb or .gltf with SMPL's joint names, taken as it is, or SMPL's .npz or .pkl, "
                      "which gets the sequence's shape. For motion the rig that it is for, or an avatar: its joints are found by their names");
  command->add_option("--betas", options->betas, "shape coefficients for smpl, or for a motion's --body of that kind, with commas between")->delimiter(',');
  command->add_option("--split", settings.preset, "a published split, see --list-presets (default: the one for the sequence, by the folder's name)");
  command->add_option("--frames", options->ranges,
                      "SPLIT=FIRST:END[:STEP], any number of times, instead of a published split; END is not in it. train is what is learnt from. For motion FIRST:END[:STEP], the file's frames to take");
  command->add_option("--train-cameras", settings.train_cameras, "names or numbers with commas between; all others are held out")->delimiter(',');
  command->add_option("--size", settings.size, "columns that pictures are reduced to (default: as they are)")->check(CLI::Range(16, 8192));
  command->add_option("--border", settings.border, "pixels on either side of the mask's edge that training leaves out (default: as the split was published, else 0)")
      ->check(CLI::Range(0, 64));
  command->add_flag("--exact-poses", settings.exact_poses, "the poses are exact: training does not refine them");
  MotionEdits& edits = options->edits;
  command->add_option("--fps", edits.fps, "motion: frames a second (default: the file's; of a .glb or .gltf the key frames', where they are evenly spaced, else 30)")->check(CLI::Range(0.1, 1000.0));
  command->add_option("--loop", edits.loop, "motion: how often it is to be repeated, from where it began")->check(CLI::Range(1, 1000000));
  command->add_option("--place", edits.place, "motion: x,y where the first frame's root is to stand, m, +Z up; x,y,z its height too")->delimiter(',');
  command->add_option("--scale", edits.scale, "motion: what the root's way is multiplied by (default: the ratio of the legs' lengths)")->check(CLI::Range(1e-6, 1e6));
  command->add_option("--animation", edits.animation, "motion: name of the animation to take of a .glb or .gltf (default: the first; arah inspect lists them)");
  command->add_flag("--list-presets", options->list_presets, "print the published splits and do nothing else");
  command->footer("Example: arah import zju-mocap CoreView_377 capture --body subject.glb --size 512\n         arah import people-snapshot female-3-casual capture --body SMPL_FEMALE.pkl --size 540 --border 2\n         arah import motion dance.bvh dance.json --body myrun/avatar.safetensors --fps 30");
  command->callback([options, &run] {
    run = [options] {
      if (options->list_presets) {
        fmt::print("{}", preset_table());
        return 0;
      }
      ImportSettings chosen = options->settings;
      if (chosen.layout.empty() || chosen.in.empty() || chosen.out.empty())
        throw InputError("arah import", "", "LAYOUT, IN and OUT", "fewer words", "See: arah import --help");
      if (chosen.layout == kMotionWord) return import_motion(chosen, options->betas, options->ranges, options->edits);
      if (chosen.layout == kBodyWord) return import_body(chosen, options->betas);
      for (const std::string& text : options->ranges) chosen.ranges.push_back(parse_frame_range(text));
      const Interrupt interrupt;
      std::optional<Progress> progress;
      const ImportReport report = import_capture(chosen, [&](std::size_t done, std::size_t total) {
        if (!progress) progress.emplace("import", static_cast<double>(total), "pictures");
        progress->update(static_cast<double>(done));
        return !interrupt.wanted();
      });
      if (progress) progress->finish(chosen.out.string());
      if (!report.preset.empty()) fmt::print("split {}\n", report.preset);
      print_notes(report.notes);
      return 0;
    };
  });
}

}  // namespace arah

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <limits>
#include <memory>
#include <nlohmann/json.hpp>

#include "host/avatar/avatar_file.h"
#include "host/avatar/spec_choice.h"
#include "host/body/json_fields.h"
#include "host/capture/synthetic_capture.h"
#include "host/cli/arguments.h"
#include "host/cli/command.h"
#include "host/cli/interrupt.h"
#include "host/cli/training_progress.h"
#include "host/evaluation/evaluate.h"
#include "host/evaluation/picture.h"
#include "host/file_writing.h"
#include "host/rendering/orbit_camera.h"

namespace arah {
namespace {

namespace fs = std::filesystem;

constexpr const char* kMarker = "demo.json";  // says that the folder is a demo's, and of what
constexpr int kTurntableViews = 8;
constexpr int kNovelStep = 3;  // every so-many-th frame of the held-out motion is evaluated

struct Options {
  fs::path out = "arah-demo";
  SyntheticSettings synthetic{.rig = {}, .frames = 30, .size = 256, .seed = 0};
  double minutes = 10;
  DeviceOptions device = DeviceOptions::from_environment();
};

std::string marker_text(const Options& options) {
  const nlohmann::ordered_json json{{"frames", options.synthetic.frames},
                                    {"size", options.synthetic.size},
                                    {"seed", options.synthetic.seed},
                                    {"version", kVersion}};
  return json.dump(1) + "\n";
}

// Makes the folder this demo's: as it is where an earlier call began the same one, empty otherwise.
void prepare(const Options& options) {
  make_folder(options.out);
  const fs::path marker = options.out / kMarker;
  const bool ours = fs::is_regular_file(marker);
  if (!ours && !fs::is_empty(options.out))
    throw InputError(options.out.string(), "", "a new folder, or one of an earlier demo", "one with other files in it",
                     "Choose another name.");
  if (ours && read_json(marker) == nlohmann::json::parse(marker_text(options))) return;
  if (ours)
    for (const char* part :
         {"capture", "run", "turntable.png", "metrics_views.json", "metrics_motion.json", "report.html"})
      fs::remove_all(options.out / part);
  write_file_safely(marker, marker_text(options));
}

void make_capture(const Options& options, const fs::path& folder) {
  if (fs::is_regular_file(folder / "synthetic.json")) return;
  Progress progress("synthetic capture", 1.0, "");
  write_synthetic_capture(folder, options.synthetic,
                          [&](double fraction, const std::string& what) { progress.update(fraction, what); });
  progress.finish(folder.string());
}

// Whether the run's settings are ones that this program knows.
bool can_resume(const fs::path& run) {
  try {
    RunFolder(run).read_config();
    return true;
  } catch (const InputError&) {
    return false;
  }
}

void train(Device& device, const Options& options, const Capture& capture, const fs::path& folder) {
  RunOptions run;
  run.folder = folder;
  run.resume = can_resume(folder);
  if (!run.resume) fs::remove_all(folder);
  TrainingSettings settings = preset_settings("tiny");
  settings.minutes = options.minutes;
  const SpecChoice choice = choose_spec(settings.preset, capture_facts(capture));
  settings.pose_refinement = choice.pose_refinement;
  settings.shape_refinement = choice.shape_refinement;
  search_for_refinement(settings);
  for (const std::string& reason : choice.reasons) fmt::print(stderr, "{}\n", reason);
  TrainingProgress progress(device, fmt::format("{:g} minutes", options.minutes));
  const Interrupt interrupt;
  const RunResult result =
      run_training(device, capture, make_run_config(capture, settings, choice.spec), run, [&](const RunEvent& event) {
        progress.show(event);
        return !interrupt.wanted();
      });
  progress.finish(result);
  if (result.stopped)
    throw std::runtime_error(fmt::format("stopped at step {}; the same command goes on", result.steps));
}

Evaluation evaluated(Device& device, const Avatar& avatar, const Capture& capture, const std::string& title,
                     const EvaluationSettings& settings) {
  Progress progress(title, 1.0, "");
  Evaluation result = evaluate(device, avatar, capture, settings, [&](double part) {
    progress.update(part);
    return true;
  });
  progress.finish(describe(result));
  return result;
}

// Pictures from all around in a pose of the held-out motion; the strip of them goes to `file`.
ReportRow turntable(Device& device, const Avatar& avatar, const Capture& capture, int size, const fs::path& file) {
  const Motion& motion = motion_of(capture, "novel");
  const MotionFrame& frame = motion.frames[motion.frames.size() / 2];
  const std::vector<glm::vec3> vertices = posed_vertices(avatar.body, frame.pose);
  Renderer renderer(device, avatar, render_preset(avatar, "paper"));
  Progress progress("turntable", kTurntableViews, "pictures");
  ReportRow row;
  row.split = "turntable, a held-out pose";
  row.camera = "orbit";
  row.frame = frame.number;
  row.psnr = std::numeric_limits<double>::quiet_NaN();  // nothing to compare with
  const auto side = static_cast<std::size_t>(size);
  std::vector<float> strip(3 * side * side * kTurntableViews);
  for (int view = 0; view < kTurntableViews; ++view) {
    const double degrees = 360.0 * view / kTurntableViews;
    const Picture picture = renderer.render(orbit_camera(vertices, UpAxis::z, degrees, size), frame.pose,
                                            avatar.spec.latent_size > 0 ? latent_row(avatar, frame.number) : 0);
    row.images.push_back({fmt::format("{:g}°", degrees), encode_png(picture.color, size, size, 3)});
    for (std::size_t y = 0; y < side; ++y)
      std::copy_n(&picture.color[3 * side * y], 3 * side,
                  &strip[3 * side * (y * kTurntableViews + static_cast<std::size_t>(view))]);
    progress.update(view + 1);
  }
  write_file_safely(file, encode_png(strip, size * kTurntableViews, size, 3));
  progress.finish(file.string());
  return row;
}

Plot training_curve(const RunFolder& folder) {
  Plot plot;
  plot.title = "Training";
  plot.x_label = "seconds";
  plot.y_label = "colour loss";
  PlotSeries series;
  series.label = "colour loss of a step's rays";
  for (const LoggedStep& step : logged_steps(folder))
    series.points.push_back({step.seconds, step.color, fmt::format("step {}", step.step)});
  plot.series.push_back(std::move(series));
  return plot;
}

int demo(const Options& options) {
  prepare(options);
  const fs::path run = options.out / "run";
  make_capture(options, options.out / "capture");
  const Capture capture = open_capture(options.out / "capture");
  Device device(options.device);
  fmt::print(stderr, "device: {} ({})\n", device.report().name, device.report().driver);
  train(device, options, capture, run);

  const std::string avatar_path = RunFolder(run).avatar_file().string();
  const Avatar avatar = load_avatar(avatar_path);
  EvaluationSettings views, motion;
  motion.split = "novel";
  motion.every = kNovelStep;
  std::vector<Evaluation> evaluations{evaluated(device, avatar, capture, "held-out views", views),
                                      evaluated(device, avatar, capture, "held-out motion", motion)};
  std::string figures;
  const char* const files[] = {"metrics_views.json", "metrics_motion.json"};
  for (std::size_t i = 0; i < evaluations.size(); ++i) {
    figures += describe(evaluations[i]) + "\n";
    write_file_safely(options.out / files[i], evaluation_json(evaluations[i], avatar, avatar_path, capture, device));
  }
  ReportRow row = turntable(device, avatar, capture, options.synthetic.size, options.out / "turntable.png");
  Report report = evaluation_report(std::move(evaluations), avatar, avatar_path, capture, device);
  report.title = "An avatar from a synthetic capture";
  report.rows.push_back(std::move(row));
  report.plots.push_back(training_curve(RunFolder(run)));
  write_file_safely(options.out / "report.html", to_html(report));
  fmt::print("{}{}\n", figures, (options.out / "report.html").string());
  return 0;
}

}  // namespace

void add_demo_command(CLI::App& program, Run& run) {
  const auto options = std::make_shared<Options>();
  CLI::App* command =
      program.add_subcommand("demo", "The whole story: synthetic capture, training, figures, pictures, report.html");
  command->add_option("OUT", options->out, "folder; the same demo there goes on, another one is replaced")
      ->capture_default_str();
  command->add_option("--minutes", options->minutes, "of training in all; the rest takes a few more")
      ->check(CLI::Range(0.0, 1e6))
      ->capture_default_str();
  command->add_option("--frames", options->synthetic.frames, "of the capture's training motion")
      ->check(CLI::Range(1, 10000))
      ->capture_default_str();
  command->add_option("--size", options->synthetic.size, "of all pictures, pixels")
      ->check(CLI::Range(16, 4096))
      ->capture_default_str();
  command->add_option("--seed", options->synthetic.seed, "of the person and the motion")->capture_default_str();
  add_device_option(*command, options->device);
  add_memory_option(*command, options->device);
  command->footer("Example: arah demo pictures --minutes 10");
  command->callback([options, &run] { run = [options] { return demo(*options); }; });
}

}  // namespace arah

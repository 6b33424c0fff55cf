#include "host/evaluation/learning_curve.h"

#include <fmt/format.h>

#include "host/avatar/avatar_file.h"
#include "host/evaluation/evaluate.h"
#include "host/evaluation/plot.h"
#include "host/evaluation/surface_error.h"
#include "host/input_error.h"
#include "host/training/run_folder.h"
#include "host/version.h"

namespace arah {
namespace {

// Of a camera that training does not see.
bool has_pictures(const Capture& capture, const std::string& split) {
  if (!capture.motions.contains(split)) return false;
  for (size_t camera = 0; camera < capture.cameras.size(); ++camera)
    if (capture.cameras[camera].role != "train" && !frames_with_images(capture, split, camera).empty()) return true;
  return false;
}

std::string number(const std::optional<double>& value, double unit = 1) { return value ? fmt::format("{:.4f}", *value / unit) : ""; }

std::string run_name(const std::filesystem::path& run) { return (run.has_filename() ? run : run.parent_path()).filename().string(); }

// A line for each run: of what `of` takes from its points, over minutes.
void add_lines(Plot& plot, const std::vector<LearningCurvePoint>& points, const std::string& what, const std::function<std::optional<double>(const LearningCurvePoint&)>& of) {
  std::vector<PlotSeries> lines;
  for (const LearningCurvePoint& point : points) {
    const std::optional<double> value = of(point);
    if (!value) continue;
    const std::string label = point.run + what;
    if (lines.empty() || lines.back().label != label) lines.push_back({label, {}});
    lines.back().points.push_back({point.minutes, *value, fmt::format("{}: {:.2f} after {:g} minutes, {} steps", label, *value, point.minutes, point.steps)});
  }
  plot.series.insert(plot.series.end(), lines.begin(), lines.end());
}

}  // namespace

std::vector<LearningCurvePoint> learning_curve(Device& device, const Capture& capture, const std::vector<std::filesystem::path>& runs, const LearningCurveSettings& settings,
                                               const std::function<bool(double)>& progress) {
  std::vector<std::pair<LearningCurvePoint, std::filesystem::path>> kept;
  for (const std::filesystem::path& run : runs) {
    const std::vector<KeptAvatar> avatars = RunFolder(run).kept_avatars();
    if (avatars.empty()) throw InputError(run.string(), "kept/", "avatars of a training's way", "none", "Train with --keep 1,2,5,10 to keep them after so many minutes.");
    for (const KeptAvatar& avatar : avatars) kept.push_back({{run_name(run), avatar.minutes, 0, {}, {}, {}}, avatar.file});
  }
  std::vector<LearningCurvePoint> points;
  for (size_t i = 0; i < kept.size(); ++i) {
    LearningCurvePoint point = kept[i].first;
    const Avatar avatar = load_avatar(kept[i].second);
    point.steps = avatar.steps;
    const auto psnr = [&](const std::string& split, double done) {
      EvaluationSettings evaluation;
      evaluation.split = split;
      evaluation.every = settings.every;
      evaluation.size = settings.size;
      evaluation.pictures = false;
      const Evaluation result = evaluate(device, avatar, capture, evaluation, [&](double part) { return !progress || progress((double(i) + done + 0.45 * part) / double(kept.size())); });
      return result.unmeasured ? std::nullopt : result.psnr;  // not a mean over other pictures than the other points'
    };
    if (has_pictures(capture, "train")) point.views = psnr("train", 0);
    if (has_pictures(capture, "novel")) point.motion = psnr("novel", 0.45);
    if (capture.motions.contains("novel") && has_surface(capture, "novel")) {
      const std::vector<SurfaceError> errors = surface_errors(device, avatar, capture, "novel");
      double sum = 0;
      for (const SurfaceError& error : errors) sum += error.mean;
      point.surface = sum / double(errors.size());
    }
    points.push_back(point);
  }
  return points;
}

std::string learning_curve_csv(const std::vector<LearningCurvePoint>& points) {
  std::string text = "run,minutes,steps,psnr_views,psnr_motion,surface_mm\n";
  for (const LearningCurvePoint& point : points)
    text += fmt::format("{},{:g},{},{},{},{}\n", point.run, point.minutes, point.steps, number(point.views), number(point.motion), number(point.surface, 1e-3));
  return text;
}

std::string learning_curve_page(const std::vector<LearningCurvePoint>& points, const Capture& capture, const Device& device) {
  Plot pictures, surface;
  pictures.title = "Pictures from held-out cameras";
  pictures.y_label = "PSNR, dB";
  add_lines(pictures, points, ", training's frames", [](const LearningCurvePoint& point) { return point.views; });
  add_lines(pictures, points, ", novel motion", [](const LearningCurvePoint& point) { return point.motion; });
  surface.title = "Surface";
  surface.y_label = "mean distance of the true surface, mm";
  add_lines(surface, points, "", [](const LearningCurvePoint& point) { return point.surface ? std::optional(*point.surface * 1e3) : std::nullopt; });
  pictures.x_label = surface.x_label = "minutes of training, the start included";
  std::string page = fmt::format(
      "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><title>arah: quality over time</title>\n"
      "<style>body{{font-family:sans-serif;max-width:60em;margin:2em auto;padding:0 1em}}td,th{{padding:.2em .8em;text-align:right}}</style></head><body>\n"
      "<h1>Quality over minutes of training</h1>\n<p>{} on {} ({}), arah {}.</p>\n",
      escape_html(capture.path.filename().string()), escape_html(device.report().name), escape_html(device.report().driver), kVersion);
  page += to_svg(pictures) + "\n";
  if (!surface.series.empty()) page += to_svg(surface) + "\n";
  page += "<table><tr><th>run</th><th>minutes</th><th>steps</th><th>views, dB</th><th>novel motion, dB</th><th>surface, mm</th></tr>\n";
  for (const LearningCurvePoint& point : points)
    page += fmt::format("<tr><td>{}</td><td>{:g}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td></tr>\n", escape_html(point.run), point.minutes, point.steps, number(point.views), number(point.motion),
                        number(point.surface, 1e-3));
  return page + "</table></body></html>\n";
}

}  // namespace arah

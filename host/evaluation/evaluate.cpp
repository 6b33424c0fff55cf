#include "host/evaluation/evaluate.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>
#include <numbers>
#include <nlohmann/json.hpp>
#include <stdexcept>

#include "host/evaluation/image_metrics.h"
#include "host/evaluation/lpips.h"
#include "host/evaluation/picture.h"
#include "host/evaluation/shared_work.h"
#include "host/input_error.h"

namespace arah {
namespace {

std::vector<std::size_t> chosen_cameras(const Capture& capture, const std::string& wanted) {
  std::vector<std::size_t> cameras;
  if (wanted == "training" || wanted == "held-out" || wanted == "all") {
    for (std::size_t c = 0; c < capture.cameras.size(); ++c) {
      const bool held_out = capture.cameras[c].role == "test";
      if (wanted == "all" || held_out == (wanted == "held-out")) cameras.push_back(c);
    }
    if (cameras.empty())
      throw InputError((capture.path / "cameras.json").string(), "role", wanted + " cameras", "none",
                       "--cameras training, all, or names with commas between.");
    return cameras;
  }
  for (std::size_t from = 0; from <= wanted.size();) {
    const std::size_t to = std::min(wanted.find(',', from), wanted.size());
    const std::size_t camera = camera_index(capture, wanted.substr(from, to - from));
    if (std::find(cameras.begin(), cameras.end(), camera) == cameras.end()) cameras.push_back(camera);
    from = to + 1;
  }
  return cameras;
}

std::vector<EvaluationPlace> places(const Capture& capture, const EvaluationSettings& settings) {
  if (settings.every < 1) throw InputError("--every", "", "at least 1", fmt::format("{}", settings.every));
  std::vector<EvaluationPlace> result;
  for (const std::size_t camera : chosen_cameras(capture, settings.cameras)) {
    const std::vector<int> frames = frames_with_images(capture, settings.split, camera);
    for (std::size_t f = 0; f < frames.size(); f += static_cast<std::size_t>(settings.every))
      result.push_back({camera, frames[f]});
  }
  if (result.empty())
    throw InputError((capture.path / "images" / settings.split).string(), "",
                     fmt::format("pictures of the cameras '{}'", settings.cameras), "none",
                     "arah inspect lists what a capture holds.");
  std::stable_sort(result.begin(), result.end(), [](const EvaluationPlace& a, const EvaluationPlace& b) { return a.frame < b.frame; });
  return result;
}

void check_skeleton(const Avatar& avatar, const Capture& capture) {
  const Skeleton& ours = avatar.body.skeleton;
  const Skeleton& theirs = capture.body_template.skeleton;
  if (ours.names != theirs.names || ours.parents != theirs.parents)
    throw InputError((capture.path / "template.glb").string(), "skeleton",
                     fmt::format("the avatar's {} joints", ours.size()),
                     ours.size() == theirs.size() ? "other names or parents" : fmt::format("{}", theirs.size()),
                     "Evaluate on a capture of the subject that the avatar was trained on.");
}

std::string row_split(const EvaluationSettings& settings, const Camera& camera) {
  const bool held_out = camera.role == "test";
  if (settings.split == "train") return held_out ? "held-out views of training poses" : "training views";
  return fmt::format("{} poses, {} views", settings.split, held_out ? "held-out" : "training");
}

// What the figures mean, that of LPIPS only where it is among them.
std::string protocol(const EvaluationSettings& settings) {
  return metrics_definition() + (settings.lpips.empty() ? "" : lpips_definition(settings.lpips));
}

nlohmann::ordered_json optional_number(const std::optional<double>& value) {
  return value && std::isfinite(*value) ? nlohmann::ordered_json(*value) : nlohmann::ordered_json();
}

// One picture's row and the searches that it took, as they travel between ranks.
struct MeasuredPicture {
  ReportRow row;
  RootFindingCounts counts;
  BadPixels bad;
  bool comparable = true;  // with the photograph: finite where it is compared
};

constexpr uint64_t RootFindingCounts::*all_counts[] = {&RootFindingCounts::points, &RootFindingCounts::steps, &RootFindingCounts::converged, &RootFindingCounts::diverged, &RootFindingCounts::exhausted, &RootFindingCounts::newton, &RootFindingCounts::restarted, &RootFindingCounts::rescue_evaluations};

std::optional<double> found_share(const RootFindingCounts& counts) { return counts.points ? std::optional(double(counts.converged) / double(counts.points)) : std::nullopt; }

nlohmann::json travelling(MeasuredPicture measured) {
  using nlohmann::json;
  ReportRow& row = measured.row;
  json optional = json::array(), images = json::array(), counts = json::array();
  for (const std::optional<double>& value : {row.ssim, row.ssim_of_the_paper, row.lpips}) optional.push_back(value ? json(*value) : json());
  for (ReportImage& image : row.images) images.push_back({image.label, json::binary(std::move(image.png))});
  for (const auto count : all_counts) counts.push_back(measured.counts.*count);
  const BadPixels& bad = measured.bad;
  return {{"bad", {bad.count, bad.pixels, bad.column, bad.row}}, {"comparable", measured.comparable}, {"split", row.split}, {"camera", row.camera}, {"frame", row.frame}, {"psnr", row.psnr}, {"measures", row.measures}, {"optional", optional}, {"images", std::move(images)}, {"counts", counts}};
}

MeasuredPicture arrived(nlohmann::json& json) {
  MeasuredPicture measured;
  ReportRow& row = measured.row;
  json.at("split").get_to(row.split);
  json.at("camera").get_to(row.camera);
  json.at("frame").get_to(row.frame);
  json.at("psnr").get_to(row.psnr);
  json.at("measures").get_to(row.measures);
  std::size_t at = 0;
  for (std::optional<double>* value : {&row.ssim, &row.ssim_of_the_paper, &row.lpips})
    if (const auto& number = json.at("optional").at(at++); !number.is_null()) *value = number.get<double>();
  for (auto& image : json.at("images")) row.images.push_back({image.at(0).get<std::string>(), std::move(image.at(1).get_binary())});
  at = 0;
  for (const auto count : all_counts) json.at("counts").at(at++).get_to(measured.counts.*count);
  const auto& bad = json.at("bad");
  measured.bad = {bad.at(0).get<std::size_t>(), bad.at(1).get<std::size_t>(), bad.at(2).get<int>(), bad.at(3).get<int>()};
  json.at("comparable").get_to(measured.comparable);
  return measured;
}

}  // namespace

std::vector<EvaluationPlace> evaluation_places(const Avatar& avatar, const Capture& capture, const EvaluationSettings& settings) {
  check_skeleton(avatar, capture);
  motion_of(capture, settings.split);  // throws where there is none
  return places(capture, settings);
}

const std::vector<std::string>& evaluation_protocols() {
  static const std::vector<std::string> names{"novel-view", "novel-pose", "training-pose", "out-of-distribution"};
  return names;
}

EvaluationSettings evaluation_protocol(const std::string& name) {
  EvaluationSettings settings;
  settings.protocol = name;
  settings.every = 30;
  if (name == "novel-view") return settings;
  if (name == "training-pose") settings.cameras = "training";
  else if (name == "novel-pose") settings.split = "novel";
  else if (name == "out-of-distribution") settings.split = "ood", settings.every = 1;
  else throw InputError("--protocol", "", fmt::format("one of {}", fmt::join(evaluation_protocols(), ", ")), "'" + name + "'");
  return settings;
}

std::vector<float> rgb_on_black(const Image& image) {
  std::vector<float> rgb;
  rgb.reserve(image.rgba.size() / 4 * 3);
  for (std::size_t i = 0; i < image.rgba.size(); i += 4) rgb.insert(rgb.end(), &image.rgba[i], &image.rgba[i] + 3);
  return rgb;
}

Evaluation evaluate(Device& device, const Avatar& avatar, const Capture& capture, const EvaluationSettings& settings,
                    const std::function<bool(double)>& progress, const Ranks& ranks) {
  const std::vector<EvaluationPlace> chosen = evaluation_places(avatar, capture, settings);
  const Motion& motion = motion_of(capture, settings.split);
  std::optional<Lpips> lpips;
  if (!settings.lpips.empty()) lpips.emplace(settings.lpips);
  RenderSettings render_settings = settings.render.value_or(render_preset(avatar, "paper"));
  render_settings.normals = settings.pictures;
  agree_on_work(ranks, avatar, fmt::format("{} pictures of {}, {}, every {}, {} columns, {}", chosen.size(), settings.split, settings.cameras, settings.every, settings.size, render_settings_json(render_settings)));
  Renderer renderer(device, avatar, render_settings);

  Evaluation result;
  result.settings = settings;
  const auto start = std::chrono::steady_clock::now();
  std::chrono::steady_clock::duration lpips_time{};
  std::vector<double> psnrs, ssims, ssims_of_the_paper, distances;
  std::vector<nlohmann::json> measured = shared_out(ranks, chosen.size(), [&](uint64_t i) {
    const EvaluationPlace& place = chosen[i];
    const Image photograph = load_image(capture, settings.split, place.camera, place.frame, settings.size);
    const Camera& stored = capture.cameras[place.camera];
    const Camera camera = settings.size > 0 ? stored.scaled(settings.size) : stored;
    // The region is the capture's, so that avatars are measured on the same pixels whether they refined its poses or not.
    const MotionFrame& frame = *find_frame(motion, place.frame);
    const Pose& pose = pose_to_render(avatar.refined, settings.split, frame);
    const PixelMask mask = projected_box_mask(camera, posed_vertices(avatar.body, frame.pose));
    if (std::find(mask.inside.begin(), mask.inside.end(), 1) == mask.inside.end())
      throw InputError(image_path(capture, settings.split, place.camera, place.frame).string(), "",
                       "the posed template in view", "nothing of it",
                       "Check cameras and poses with arah inspect, or leave the camera out with --cameras.");
    const RootFindingCounts before = renderer.root_finder().counts();
    const Picture picture = renderer.render(
        camera, pose, avatar.spec.latent_size > 0 ? latent_row(avatar, place.frame) : 0, [&](const PictureSoFar& so_far) {
          return !progress || progress((static_cast<double>(i) + so_far.part) / static_cast<double>(chosen.size()));
        });
    const std::vector<float> truth = rgb_on_black(photograph);
    const int w = camera.width, h = camera.height;
    const CropRectangle crop = mask_bounds(mask.inside, w, h);
    MeasuredPicture one;
    one.bad = bad_pixels(picture);
    one.comparable = finite_colors(picture, crop);
    const ImageMetrics metrics = one.comparable ? image_metrics({picture.color, w, h}, {truth, w, h}, mask.inside) : ImageMetrics{.psnr = std::numeric_limits<double>::quiet_NaN(), .crop = crop};
    ReportRow& row = one.row;
    row.split = row_split(settings, stored);
    row.camera = stored.name;
    row.frame = place.frame;
    row.psnr = metrics.psnr;
    row.ssim = metrics.ssim;
    row.ssim_of_the_paper = metrics.ssim_of_the_paper;
    one.counts = renderer.root_finder().counts();
    for (const auto count : all_counts) one.counts.*count -= before.*count;
    if (const std::optional<double> found = found_share(one.counts)) row.measures.emplace_back("found (%)", 100 * *found);
    if (one.bad.count > 0) row.measures.emplace_back("not finite (pixels)", double(one.bad.count));
    if (lpips && one.comparable) {
      const auto began = std::chrono::steady_clock::now();
      row.lpips = lpips->distance({picture.color, w, h}, {truth, w, h}, metrics.crop);
      lpips_time += std::chrono::steady_clock::now() - began;
    }
    if (settings.pictures)
      row.images = {{"photograph", encode_png(truth, w, h, 3)},
                    {"rendering", encode_png(picture.color, w, h, 3)},
                    {"error ×4", encode_png(error_map(picture.color, truth, w, h), w, h, 3)},
                    {"normals", encode_png(normals_to_rgb(picture.normal, w, h), w, h, 3)}};
    return travelling(std::move(one));
  });
  for (nlohmann::json& picture : measured) {
    MeasuredPicture one = arrived(picture);
    picture = {};
    psnrs.push_back(one.row.psnr);
    if (one.row.ssim) ssims.push_back(*one.row.ssim), ssims_of_the_paper.push_back(*one.row.ssim_of_the_paper);
    if (one.row.lpips) distances.push_back(*one.row.lpips);
    result.found.push_back(found_share(one.counts));
    result.bad.push_back(one.bad);
    result.unmeasured += !one.comparable;
    for (const auto count : all_counts) result.root_finding.*count += one.counts.*count;
    result.rows.push_back(std::move(one.row));
  }
  result.psnr = mean_of_finite(psnrs);
  result.ssim = mean_of_finite(ssims);
  result.ssim_of_the_paper = mean_of_finite(ssims_of_the_paper);
  result.psnr_spread = spread_of_finite(psnrs);
  result.ssim_spread = spread_of_finite(ssims);
  result.lpips = mean_of_finite(distances);
  result.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start - lpips_time).count();
  if (!avatar.refined.empty() && capture.motions.contains("train")) result.poses = pose_improvement(avatar.refined, avatar.body, capture.body_template.skeleton, motion_of(capture, "train"));
  return result;
}

std::string evaluation_json(const Evaluation& evaluation, const Avatar& avatar, const std::string& avatar_path,
                            const Capture& capture, const Device& device) {
  using nlohmann::ordered_json;
  ordered_json images = ordered_json::array();
  const auto percent = [](const std::optional<double>& share) { return optional_number(share ? std::optional(100 * *share) : share); };
  for (size_t i = 0; i < evaluation.rows.size(); ++i) {
    const ReportRow& row = evaluation.rows[i];
    images.push_back({{"frame", row.frame},
                      {"camera", row.camera},
                      {"psnr", optional_number(row.psnr)},
                      {"ssim", optional_number(row.ssim)},
                      {"ssim_data_range_2", optional_number(row.ssim_of_the_paper)},
                      {"found_percent", percent(evaluation.found[i])},
                      {"bad_pixels", evaluation.bad[i].count}});
    if (row.lpips) images.back()["lpips"] = *row.lpips;
  }
  std::size_t bad_count = 0;
  for (const BadPixels& bad : evaluation.bad) bad_count += bad.count;
  const RootFindingCounts& counts = evaluation.root_finding;
  ordered_json surface = ordered_json::array();
  const auto figures = [](const SurfaceError& error) {
    return ordered_json{{"mean_mm", 1000 * error.mean}, {"percentile_95_mm", 1000 * error.percentile_95}, {"chamfer_cm2", 1e4 * error.chamfer}, {"normal_consistency", error.normal_consistency},
                        {"normal_consistency_of_the_paper", error.normal_consistency_of_the_paper}, {"f_score_5mm", error.f_score}};
  };
  SurfaceError of_all;
  for (double SurfaceError::*figure : {&SurfaceError::mean, &SurfaceError::percentile_95, &SurfaceError::chamfer, &SurfaceError::normal_consistency, &SurfaceError::normal_consistency_of_the_paper, &SurfaceError::f_score})
    of_all.*figure = mean_of(evaluation.surface, figure);
  for (const SurfaceError& error : evaluation.surface) {
    surface.push_back({{"frame", error.frame}});
    surface.back().update(figures(error));
  }
  const SurfaceSettings& measured = evaluation.surface_settings;
  ordered_json surface_settings{{"cell_mm", 1000 * measured.cell}, {"largest_part", measured.largest_part}, {"ground", nullptr}};
  if (measured.ground) surface_settings["ground"] = {measured.ground->x, measured.ground->y, measured.ground->z, measured.ground->w};
  ordered_json mean{{"psnr", optional_number(evaluation.psnr)}, {"ssim", optional_number(evaluation.ssim)}, {"ssim_data_range_2", optional_number(evaluation.ssim_of_the_paper)}};
  if (evaluation.lpips) mean["lpips"] = *evaluation.lpips;
  ordered_json json{
      {"mean", mean},
      {"spread", {{"psnr", optional_number(evaluation.psnr_spread)}, {"ssim", optional_number(evaluation.ssim_spread)}}},
      {"images", images},
      {"bad_pixels", bad_count},
      {"unmeasured", evaluation.unmeasured},
      {"protocol_name", evaluation.settings.protocol},
      {"split", evaluation.settings.split},
      {"cameras", evaluation.settings.cameras},
      {"every", evaluation.settings.every},
      {"size", evaluation.settings.size},
      {"render", ordered_json::parse(render_settings_json(evaluation.settings.render.value_or(render_preset(avatar, "paper"))))},
      {"protocol", protocol(evaluation.settings)},
      {"avatar", avatar_path},
      {"capture", capture.path.string()},
      {"device", device.report().name},
      {"driver", device.report().driver},
      {"version", kVersion},
      {"avatar_version", avatar.version},
      {"seed", avatar.seed},
      {"steps", avatar.steps},
      {"root_finding",
       {{"points", counts.points},
        {"converged", counts.converged},
        {"diverged", counts.diverged},
        {"exhausted", counts.exhausted},
        {"steps", counts.steps},
        {"rescued_by_newton", counts.newton},
        {"rescued_from_bones", counts.restarted},
        {"rescue_evaluations", counts.rescue_evaluations},
        {"least_found_percent", percent(least_found(evaluation))}}},
      {"seconds", evaluation.seconds},
      {"surface", surface},
      {"surface_mean", evaluation.surface.empty() ? ordered_json() : figures(of_all)},
      {"surface_settings", evaluation.surface.empty() ? ordered_json() : surface_settings},
  };
  if (evaluation.poses) {
    const auto distance = [](const PoseDistance& d) { return ordered_json{{"joints_mm", 1000 * d.joints}, {"rotations_degrees", d.rotations * 180 / std::numbers::pi}}; };
    json["poses"] = {{"frames", evaluation.poses->after.frames}, {"before", distance(evaluation.poses->before)}, {"after", distance(evaluation.poses->after)}};
  }
  if (!evaluation.settings.lpips.empty()) json["lpips_network"] = evaluation.settings.lpips.string();
  return json.dump(1) + "\n";
}

Report evaluation_report(std::vector<Evaluation> evaluations, const Avatar& avatar, const std::string& avatar_path,
                         const Capture& capture, const Device& device) {
  Report report;
  report.title = "Evaluation of " + avatar_path;
  report.definition = evaluations.empty() ? metrics_definition() : protocol(evaluations.front().settings);
  report.facts = {{"avatar", fmt::format("{}, {} after {} steps, seed {}", avatar_path, avatar.spec.preset,
                                         avatar.steps, avatar.seed)},
                  {"capture", capture.path.string()},
                  {"device", fmt::format("{} ({})", device.report().name, device.report().driver)},
                  {"program", fmt::format("arah {}", kVersion)}};
  for (Evaluation& evaluation : evaluations) {
    const RootFindingCounts& counts = evaluation.root_finding;
    report.summary += (report.summary.empty() ? "" : ". ") + describe(evaluation);
    report.facts.emplace_back(
        "root finding, split " + evaluation.settings.split,
        fmt::format(
            "{} searches, {:.2f} % converged{}, {} diverged, {} out of steps", counts.points,
            100.0 * static_cast<double>(counts.converged) / static_cast<double>(std::max<uint64_t>(counts.points, 1)),
            least_found(evaluation) ? fmt::format(" ({:.2f} % in the worst picture)", 100 * *least_found(evaluation)) : "",
            counts.diverged, counts.exhausted) +
            (counts.rescue_evaluations ? fmt::format("; {} of them rescued by damped Newton, {} from other starts, in {} evaluations", counts.newton, counts.restarted, counts.rescue_evaluations) : ""));
    std::move(evaluation.rows.begin(), evaluation.rows.end(), std::back_inserter(report.rows));
  }
  return report;
}

std::optional<double> least_found(const Evaluation& evaluation) {
  std::optional<double> least;
  for (const std::optional<double>& share : evaluation.found)
    if (share && (!least || *share < *least)) least = share;
  return least;
}

std::string describe(const Evaluation& evaluation) {
  const auto figure = [](const std::optional<double>& mean, const std::optional<double>& spread, int digits, const char* unit, const char* absent) {
    return mean ? fmt::format("{:.{}f}{}{}", *mean, digits, spread ? fmt::format(" ± {:.{}f}", *spread, digits) : "", unit) : absent;
  };
  return fmt::format("split {}, cameras {}: PSNR {}, SSIM {}{} ({} pictures{})", evaluation.settings.split, evaluation.settings.cameras,
                     figure(evaluation.psnr, evaluation.psnr_spread, 2, " dB", "not finite"), figure(evaluation.ssim, evaluation.ssim_spread, 4, "", "not defined"),
                     evaluation.lpips ? fmt::format(", LPIPS {:.4f}", *evaluation.lpips) : "", evaluation.rows.size(), evaluation.unmeasured > 0 ? fmt::format(", {} of them left out: not finite", evaluation.unmeasured) : "") +
         (evaluation.surface.empty() ? "" : "; " + describe(evaluation.surface)) + (evaluation.poses ? "; " + describe(*evaluation.poses) : "");
}

std::vector<std::string> warnings_of(const Evaluation& evaluation, const std::string& avatar_path, std::size_t most) {
  std::vector<std::string> lines;
  std::size_t pictures = 0;
  for (std::size_t i = 0; i < evaluation.rows.size(); ++i)
    if (evaluation.bad[i].count > 0 && ++pictures <= most) lines.push_back(warning_of(evaluation.bad[i], fmt::format("camera {}, frame {}", evaluation.rows[i].camera, evaluation.rows[i].frame), avatar_path));
  if (pictures > most) lines.push_back(fmt::format("warning: {} more pictures have pixels that are not finite", pictures - most));
  return lines;
}

}  // namespace arah

#include "host/evaluation/tradeoff.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>
#include <map>
#include <nlohmann/json.hpp>
#include <span>
#include <tuple>

#include "host/evaluation/bad_pixels.h"
#include "host/evaluation/evaluate.h"
#include "host/evaluation/image_metrics.h"
#include "host/evaluation/lpips.h"
#include "host/evaluation/picture.h"
#include "host/evaluation/shared_work.h"
#include "host/evaluation/timed_launches.h"
#include "host/input_error.h"
#include "kernels/linear/cooperative.h"

namespace arah {
namespace {

using Knobs = std::vector<std::pair<std::string, std::string>>;

// Of the renderings that are compared and not timed.
constexpr uint64_t memory_of_errors = 100'000'000;

// A PSNR of equal pictures in a plot.
constexpr double same_picture = 100;

// Each knob alone, from less to more.
std::vector<Knobs> single_knobs(const SamplingSettings& exact, const AvatarSpec& spec, bool cooperative_matrices) {
  std::vector<Knobs> all;
  const auto knob = [&](const char* name, std::initializer_list<const char*> values) {
    for (const char* value : values) all.push_back({{name, value}});
  };
  if (exact.mode == SamplingMode::surface) {
    knob("shell_bound", {"false"});
    knob("trace_start", {"shell"});
    knob("trace_tolerance", {"1e-4", "1e-3"});
    knob("surface", {"mesh"});
    knob("around_surface", {"9", "5"});
    knob("half_width_b", {"10", "5"});
    knob("before_surface", {"4"});
    all.push_back({{"sampling_mode", "shell"}, {"samples", "32"}});
  } else {
    knob("samples", {"24", "16", "12", "8"});
  }
  if (exact.mode != SamplingMode::uniform) knob("sampling_mode", {"uniform"});
  knob("sampling_mode", {"surface_only"});
  all.push_back({{"sampling_mode", "surface_only"}, {"surface", "mesh"}});
  all.push_back({{"sampling_mode", "surface_only"}, {"surface", "mesh"}, {"outline", "1"}});
  knob("distances", {"baked"});
  all.push_back({{"distances", "baked"}, {"bake_cell", "0.012"}});
  if (spec.sdf.pose != PoseConditioning::none) knob("sdf_by_pose", {"shared"});
  knob("root_tolerance", {"1e-4", "1e-3"});
  knob("root_max_iterations", {"12", "6", "4"});
  knob("root_initialisations", {"2", "3"});
  knob("root_rescue_steps", {"20"});
  knob("root_correspondence", {"search_from_grid", "grid", "grid_alone"});
  knob("least_weight", {"0", "1e-4", "1e-3", "1e-2", "3e-2"});
  knob("color_groups", {"4", "2", "1"});
  knob("arithmetic", {"half_storage"});
  if (cooperative_matrices) knob("arithmetic", {"cooperative_matrix"});
  knob("pixel_step", {"2", "3"});
  return all;
}

struct View {
  Camera camera;
  Pose pose;
  std::size_t latent_row = 0;
  std::vector<float> photograph;  // rgb on black
  PixelMask mask;
  std::string name;
  int frame = 0;
};

// Mean over the pixels that both see of |depth − exact|, metres, and of the angle between the normals, degrees.
std::pair<double, double> geometry_errors(const Picture& picture, const Picture& exact) {
  double depth = 0, angle = 0;
  std::size_t seen = 0;
  for (std::size_t i = 0; i < exact.depth.size(); ++i) {
    if (exact.depth[i] <= 0 || picture.depth[i] <= 0) continue;
    ++seen;
    depth += std::abs(double(picture.depth[i]) - exact.depth[i]);
    double dot = 0, a = 0, b = 0;
    for (std::size_t c = 0; c < 3; ++c) {
      const double x = picture.normal[3 * i + c], y = exact.normal[3 * i + c];
      dot += x * y, a += x * x, b += y * y;
    }
    if (a > 0 && b > 0) angle += std::acos(std::clamp(dot / std::sqrt(a * b), -1.0, 1.0));
  }
  const auto count = static_cast<double>(std::max<std::size_t>(seen, 1));
  return {depth / count, angle / count * 57.29577951308232};
}

bool is_preset(const std::string& name) { return std::find(render_presets().begin(), render_presets().end(), name) != render_presets().end(); }

// What is to be measured in each view: of the exact rendering, what its knobs change; or a preset.
struct Setting {
  std::string name;
  Knobs knobs;
  RenderSettings render;
};

// One setting in one view, as it travels between ranks. Errors are lists, for they may be absent: of one or of none.
struct Measured {
  std::string refused;  // by the renderer, and why; nothing else is there then
  std::vector<double> times, times_same_pose;
  double baking_milliseconds = 0, gflop = 0;
  uint64_t memory_bytes = 0;
  std::map<std::string, double> stages;
  uint64_t rays = 0, samples = 0, shaded = 0, searched = 0, steps = 0, converged = 0;
  std::vector<double> psnr_exact, psnr_photograph, ssim_exact, ssim_photograph, lpips_exact, lpips_photograph;
  double depth_error = 0, normal_error = 0;
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Measured, refused, times, times_same_pose, baking_milliseconds, gflop, memory_bytes, stages, rays, samples, shaded, searched, steps, converged, psnr_exact, psnr_photograph, ssim_exact, ssim_photograph, lpips_exact, lpips_photograph, depth_error, normal_error)

class Study {
 public:
  Study(Device& device, const Avatar& avatar, const Capture& capture, const TradeoffSettings& settings, const std::function<void(double, const std::string&)>& progress, const Ranks& ranks)
      : device_(device), avatar_(avatar), settings_(settings), progress_(progress), ranks_(ranks), views_(evaluation_views(avatar, capture, settings)) {
    if (!settings.lpips.empty()) lpips_.emplace(settings.lpips);
    result_.lpips = settings.lpips;
    if (settings.repetitions < 1) throw InputError("--repetitions", "", "at least 1", fmt::format("{}", settings.repetitions));
  }

  Tradeoff run() {
    result_.device = device_.report().name;
    result_.driver = device_.report().driver;
    result_.width = views_.front().camera.width;
    result_.height = views_.front().camera.height;
    result_.pictures_measured = static_cast<int>(views_.size());
    result_.repetitions = settings_.repetitions;
    exact_.resize(views_.size());
    const std::vector<Setting> settings = chosen_settings();
    std::string names;
    for (const Setting& setting : settings) names += setting.name + "; ";
    agree_on_work(ranks_, avatar_, fmt::format("{} pictures of {}, {}, {} columns, {} repetitions of {}", views_.size(), settings_.split, settings_.cameras, settings_.size, settings_.repetitions, names));
    std::vector<nlohmann::json> measured = shared_out(ranks_, settings.size() * views_.size(), [&](uint64_t number) {
      const Setting& setting = settings[number / views_.size()];
      if (progress_) progress_(double(number) / double(settings.size() * views_.size()), setting.name);
      return measure_where_possible(setting, number % views_.size());
    });
    if (!ranks_.first()) return {};
    for (std::size_t s = 0; s < settings.size(); ++s) add_point(settings[s], std::span(measured).subspan(s * views_.size(), views_.size()));
    mark_front();
    pictures();
    return std::move(result_);
  }

 private:
  std::vector<Setting> chosen_settings() {
    const RenderSettings exact = render_preset(avatar_, "paper");
    const std::string& refusal = cooperative_refusal(device_);
    const bool cooperative = ranks_.broadcast(uint64_t{refusal.empty()}) != 0;  // as the first rank's device: another one may refuse it
    const std::vector<Knobs> knobs = settings_.presets_alone ? std::vector<Knobs>{} : single_knobs(*exact.sampling, avatar_.spec, cooperative);
    if (!settings_.presets_alone && !cooperative) result_.left_out.push_back(fmt::format("arithmetic cooperative_matrix: not on {} ({})", result_.device, refusal));
    std::vector<Setting> settings{{"paper", {}, exact}};
    for (const Knobs& some : knobs) {
      RenderSettings changed = exact;
      std::string name;
      for (const auto& [knob, value] : some) {
        set_render_knob(changed, knob, value);
        name += fmt::format("{}{} {}", name.empty() ? "" : ", ", knob, value);
      }
      settings.push_back({name, some, changed});
    }
    for (const std::string& preset : render_presets())
      if (preset != "paper") settings.push_back({preset, {}, render_preset(avatar_, preset)});
    return settings;
  }

  static std::vector<View> evaluation_views(const Avatar& avatar, const Capture& capture, const TradeoffSettings& settings) {
    EvaluationSettings evaluation;
    evaluation.split = settings.split;
    evaluation.cameras = settings.cameras;
    const std::vector<EvaluationPlace> all = evaluation_places(avatar, capture, evaluation);
    const std::size_t wanted = std::clamp<std::size_t>(static_cast<std::size_t>(std::max(settings.pictures, 1)), 1, all.size());
    const Motion& motion = motion_of(capture, settings.split);
    std::vector<View> views;
    for (std::size_t i = 0; i < wanted; ++i) {
      const EvaluationPlace& place = all[(2 * i + 1) * all.size() / (2 * wanted)];
      View view;
      const Camera& stored = capture.cameras[place.camera];
      view.camera = settings.size > 0 ? stored.scaled(settings.size) : stored;
      const MotionFrame& frame = *find_frame(motion, place.frame);
      view.pose = pose_to_render(avatar.refined, settings.split, frame);
      view.latent_row = avatar.spec.latent_size > 0 ? latent_row(avatar, place.frame) : 0;
      view.photograph = rgb_on_black(load_image(capture, settings.split, place.camera, place.frame, settings.size));
      view.mask = projected_box_mask(view.camera, posed_vertices(avatar.body, frame.pose));
      view.name = stored.name;
      view.frame = place.frame;
      views.push_back(std::move(view));
    }
    return views;
  }

  // What the renderer refuses of this avatar (a density has no surface to search), and what comes out with numbers that are not finite, is
  // named, and the study goes on; not without the exact one.
  nlohmann::json measure_where_possible(const Setting& setting, std::size_t view) {
    try {
      return measure(setting, view);
    } catch (const InputError& error) {
      if (setting.name == "paper") throw;
      Measured refused;
      refused.refused = error.what();
      return refused;
    }
  }

  nlohmann::json measure(const Setting& setting, std::size_t number) {
    const View& view = views_[number];
    const Picture& exact = exact_in(number);
    const Picture rendered = setting.name == "paper" ? exact : compared(setting, view);
    Measured m;
    {
      Renderer renderer(device_, avatar_, setting.render);  // as it would be used: colours and depths alone
      for (int repetition = -1; repetition < settings_.repetitions; ++repetition) {
        const auto timed = [&] {
          const auto start = std::chrono::steady_clock::now();
          renderer.render(view.camera, view.pose, view.latent_row);
          return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count();
        };
        renderer.forget_pose();
        const double new_pose = timed();
        if (repetition < 0) {
          m.baking_milliseconds = 1000 * renderer.work().baking_seconds;
          continue;
        }
        m.times.push_back(new_pose);
        m.times_same_pose.push_back(timed());
      }
      m.memory_bytes = device_.allocated_bytes();
      const bool profiled = device_.profiler().enabled;
      device_.profiler().reset();
      device_.profiler().enabled = true;
      renderer.reset_work();
      renderer.forget_pose();
      renderer.render(view.camera, view.pose, view.latent_row);
      for (const auto& [stage, statistics] : device_.profiler().stages()) {
        if (device_.report().timestamp_period_ns > 0) m.stages[stage.empty() ? "other" : stage] = statistics.milliseconds;
        m.gflop += statistics.cost.flops * 1e-9;
      }
      device_.profiler().reset();
      device_.profiler().enabled = profiled;
      const Renderer::Work& work = renderer.work();
      const RootFindingCounts roots = renderer.root_finder().counts();
      m.rays = work.rays, m.samples = work.samples, m.shaded = work.shaded;
      m.searched = roots.points, m.steps = roots.steps, m.converged = roots.converged;
    }
    const int w = view.camera.width, h = view.camera.height;
    const ImageMetrics to_exact = image_metrics({rendered.color, w, h}, {exact.color, w, h}, view.mask.inside);
    const ImageMetrics to_photograph = image_metrics({rendered.color, w, h}, {view.photograph, w, h}, view.mask.inside);
    m.psnr_exact = {to_exact.psnr};
    m.psnr_photograph = {to_photograph.psnr};
    if (to_exact.ssim) m.ssim_exact = {*to_exact.ssim};
    if (to_photograph.ssim) m.ssim_photograph = {*to_photograph.ssim};
    if (lpips_) {
      m.lpips_exact = {lpips_->distance({rendered.color, w, h}, {exact.color, w, h}, to_exact.crop)};
      m.lpips_photograph = {lpips_->distance({rendered.color, w, h}, {view.photograph, w, h}, to_photograph.crop)};
    }
    std::tie(m.depth_error, m.normal_error) = geometry_errors(rendered, exact);
    nlohmann::json json = m;
    if (is_preset(setting.name)) json["picture"] = nlohmann::json::binary(rows_of(rendered, 0, h));
    return json;
  }

  // Not timed: with normals. Throws InputError where a pixel is not finite: a figure of it would say nothing.
  Picture compared(const Setting& setting, const View& view) {
    RenderSettings settings = setting.render;
    settings.normals = true;
    settings.memory_bytes = memory_of_errors;
    Picture picture = Renderer(device_, avatar_, settings).render(view.camera, view.pose, view.latent_row);
    if (const BadPixels bad = bad_pixels(picture); bad.count > 0)
      throw InputError(fmt::format("rendering '{}' of camera {}, frame {}", setting.name, view.name, view.frame), "", "finite numbers", counted(bad), "'arah inspect' of the avatar names its largest learned number.");
    return picture;
  }

  // Made by each rank that measures in this view.
  const Picture& exact_in(std::size_t view) {
    if (!exact_[view]) exact_[view] = compared({"paper", {}, render_preset(avatar_, "paper")}, views_[view]);
    return *exact_[view];
  }

  Picture arrived(const nlohmann::json& bytes, const View& view) {
    Picture picture;
    picture.width = view.camera.width;
    picture.height = view.camera.height;
    const std::size_t pixels = view.mask.inside.size();
    picture.color.resize(3 * pixels);
    picture.alpha.resize(pixels);
    picture.depth.resize(pixels);
    picture.normal.resize(3 * pixels);
    put_rows(picture, 0, picture.height, bytes.get_binary());
    return picture;
  }

  // measured: by view.
  void add_point(const Setting& setting, std::span<nlohmann::json> measured) {
    TradeoffPoint point;
    point.name = setting.name;
    point.knobs = setting.knobs;
    point.settings = render_settings_json(setting.render);
    const auto pictures = static_cast<double>(measured.size());
    Measured all;
    const auto append = [](std::vector<double>& to, const std::vector<double>& from) { to.insert(to.end(), from.begin(), from.end()); };
    for (const nlohmann::json& json : measured) {
      const auto one = json.get<Measured>();
      if (!one.refused.empty()) {
        result_.left_out.push_back(setting.name + ": " + one.refused);
        return;
      }
      for (const auto list : {&Measured::times, &Measured::times_same_pose, &Measured::psnr_exact, &Measured::psnr_photograph, &Measured::ssim_exact, &Measured::ssim_photograph, &Measured::lpips_exact, &Measured::lpips_photograph}) append(all.*list, one.*list);
      for (const auto sum : {&Measured::rays, &Measured::samples, &Measured::shaded, &Measured::searched, &Measured::steps, &Measured::converged}) all.*sum += one.*sum;
      for (const auto& [stage, milliseconds] : one.stages) all.stages[stage] += milliseconds / pictures;
      point.baking_milliseconds += one.baking_milliseconds / pictures;
      point.gflop += one.gflop / pictures;
      point.memory_bytes = std::max(point.memory_bytes, one.memory_bytes);
      point.depth_error += one.depth_error / pictures;
      point.normal_error += one.normal_error / pictures;
    }
    if (is_preset(setting.name)) {
      presets_.emplace_back(setting.name, std::vector<Picture>{});
      for (std::size_t v = 0; v < measured.size(); ++v) {
        presets_.back().second.push_back(arrived(measured[v].at("picture"), views_[v]));
        measured[v] = {};
      }
    }
    const auto rays = static_cast<double>(std::max<uint64_t>(all.rays, 1)), samples = static_cast<double>(std::max<uint64_t>(all.searched, 1));
    point.stages.assign(all.stages.begin(), all.stages.end());
    point.rays = static_cast<double>(all.rays) / pictures;
    point.samples_a_ray = static_cast<double>(all.samples) / rays;
    point.shaded_a_ray = static_cast<double>(all.shaded) / rays;
    point.search_steps_a_sample = static_cast<double>(all.steps) / samples;
    point.found = static_cast<double>(all.converged) / samples;
    point.psnr_exact = mean_of_finite(all.psnr_exact).value_or(std::numeric_limits<double>::infinity());
    point.psnr = mean_of_finite(all.psnr_photograph).value_or(std::numeric_limits<double>::infinity());
    point.ssim_exact = mean_of_finite(all.ssim_exact);
    point.ssim = mean_of_finite(all.ssim_photograph);
    point.lpips_exact = mean_of_finite(all.lpips_exact);
    point.lpips = mean_of_finite(all.lpips_photograph);
    point.milliseconds = median(all.times);
    point.milliseconds_same_pose = median(all.times_same_pose);
    point.fastest = *std::min_element(all.times.begin(), all.times.end());
    point.slowest = *std::max_element(all.times.begin(), all.times.end());
    result_.points.push_back(std::move(point));
  }

  void mark_front() {
    for (TradeoffPoint& point : result_.points)
      point.pareto = std::none_of(result_.points.begin(), result_.points.end(), [&](const TradeoffPoint& other) {
        return other.milliseconds <= point.milliseconds && other.psnr_exact >= point.psnr_exact && (other.milliseconds < point.milliseconds || other.psnr_exact > point.psnr_exact);
      });
  }

  void pictures() {
    for (std::size_t i = 0; i < views_.size(); ++i) {
      const View& view = views_[i];
      const int w = view.camera.width, h = view.camera.height;
      for (const auto& [name, rendered] : presets_) {
        const ImageMetrics metrics = image_metrics({rendered[i].color, w, h}, {view.photograph, w, h}, view.mask.inside);
        ReportRow row;
        row.split = "preset " + name;
        row.camera = view.name;
        row.frame = view.frame;
        row.psnr = metrics.psnr;
        row.ssim = metrics.ssim;
        if (lpips_) row.lpips = lpips_->distance({rendered[i].color, w, h}, {view.photograph, w, h}, metrics.crop);
        row.images = {{"photograph", encode_png(view.photograph, w, h, 3)},
                      {"preset " + name, encode_png(rendered[i].color, w, h, 3)},
                      {"against the exact one ×4", encode_png(error_map(rendered[i].color, presets_.front().second[i].color, w, h), w, h, 3)},
                      {"normals", encode_png(normals_to_rgb(rendered[i].normal, w, h), w, h, 3)}};
        result_.pictures.push_back(std::move(row));
      }
    }
  }

  Device& device_;
  const Avatar& avatar_;
  const TradeoffSettings& settings_;
  const std::function<void(double, const std::string&)>& progress_;
  const Ranks& ranks_;
  std::vector<View> views_;
  std::optional<Lpips> lpips_;
  std::vector<std::optional<Picture>> exact_;  // by view
  std::vector<std::pair<std::string, std::vector<Picture>>> presets_;  // by view; the exact one first
  Tradeoff result_;
};

std::string lpips_text(const std::optional<double>& value) { return value ? fmt::format(", LPIPS {:.4f}", *value) : ""; }

std::string optional_text(const std::optional<double>& value, const char* format) { return value ? fmt::format(fmt::runtime(format), *value) : ""; }

}  // namespace

Tradeoff measure_tradeoff(Device& device, const Avatar& avatar, const Capture& capture, const TradeoffSettings& settings, const std::function<void(double, const std::string&)>& progress, const Ranks& ranks) {
  return Study(device, avatar, capture, settings, progress, ranks).run();
}

const TradeoffPoint* fastest_within_error(const Tradeoff& tradeoff, double decibels) {
  const TradeoffPoint* best = nullptr;
  for (const TradeoffPoint& point : tradeoff.points)
    if (point.psnr >= tradeoff.points.front().psnr - decibels && (!best || point.milliseconds < best->milliseconds)) best = &point;
  return best;
}

const TradeoffPoint* nearest_within_time(const Tradeoff& tradeoff, double milliseconds) {
  const TradeoffPoint* best = nullptr;
  for (const TradeoffPoint& point : tradeoff.points)
    if (point.milliseconds <= milliseconds && (!best || point.psnr_exact > best->psnr_exact)) best = &point;
  return best;
}

std::string tradeoff_csv(const Tradeoff& tradeoff) {
  std::vector<std::string> stages;
  for (const TradeoffPoint& point : tradeoff.points)
    for (const auto& [stage, milliseconds] : point.stages)
      if (std::find(stages.begin(), stages.end(), stage) == stages.end()) stages.push_back(stage);
  std::string text =
      "setting,milliseconds,fastest,slowest,milliseconds_same_pose,baking_milliseconds,gflop,rays,samples_a_ray,shaded_a_ray,search_steps_a_sample,found,memory_mb,psnr_exact,ssim_exact,psnr_photograph,ssim_photograph,depth_error_mm,normal_error_degrees,pareto";
  if (!tradeoff.lpips.empty()) text += ",lpips_exact,lpips_photograph";
  for (const std::string& stage : stages) text += "," + stage + " ms";
  text += "\n";
  for (const TradeoffPoint& p : tradeoff.points) {
    text += fmt::format("\"{}\",{:.2f},{:.2f},{:.2f},{:.2f},{:.2f},{:.3f},{:.0f},{:.2f},{:.2f},{:.3f},{:.5f},{:.1f},{:.3f},{},{:.3f},{},{:.4f},{:.3f},{}", p.name, p.milliseconds, p.fastest, p.slowest, p.milliseconds_same_pose, p.baking_milliseconds, p.gflop, p.rays, p.samples_a_ray,
                        p.shaded_a_ray, p.search_steps_a_sample, p.found, double(p.memory_bytes) * 1e-6, p.psnr_exact, optional_text(p.ssim_exact, "{:.5f}"), p.psnr, optional_text(p.ssim, "{:.5f}"), 1000 * p.depth_error,
                        p.normal_error, p.pareto ? 1 : 0);
    if (!tradeoff.lpips.empty()) text += fmt::format(",{},{}", optional_text(p.lpips_exact, "{:.5f}"), optional_text(p.lpips, "{:.5f}"));
    for (const std::string& stage : stages) {
      const auto found = std::find_if(p.stages.begin(), p.stages.end(), [&](const auto& entry) { return entry.first == stage; });
      text += found == p.stages.end() ? "," : fmt::format(",{:.2f}", found->second);
    }
    text += "\n";
  }
  return text;
}

Plot tradeoff_plot(const Tradeoff& tradeoff) {
  const auto dot = [](const TradeoffPoint& point) { return PlotPoint{std::log10(std::max(point.milliseconds, 1e-3)), std::min(point.psnr_exact, same_picture), point.name}; };
  PlotSeries knobs{"one knob", {}}, presets{"presets", {}}, front{"front", {}};
  for (const TradeoffPoint& point : tradeoff.points) (point.knobs.empty() ? presets : knobs).points.push_back(dot(point));
  for (const TradeoffPoint& point : tradeoff.points)
    if (point.pareto) front.points.push_back(dot(point));
  std::sort(front.points.begin(), front.points.end(), [](const PlotPoint& a, const PlotPoint& b) { return a.x < b.x; });
  // A series of single dots, each broken off from the next by a point that is not finite.
  for (PlotSeries* series : {&knobs, &presets}) {
    std::vector<PlotPoint> apart;
    for (PlotPoint& point : series->points) {
      apart.push_back(std::move(point));
      apart.push_back({std::numeric_limits<double>::quiet_NaN(), 0, ""});
    }
    series->points = std::move(apart);
  }
  return {fmt::format("{} × {} pixels on {}; {:.0f} dB stand for the same picture", tradeoff.width, tradeoff.height, tradeoff.device, same_picture), "log10 of milliseconds a picture", "PSNR against the exact rendering, dB", {front, knobs, presets}, true};
}

std::string tradeoff_table(const Tradeoff& tradeoff) {
  const bool lpips = !tradeoff.lpips.empty();
  std::string text = fmt::format("{:<54}{:>9}{:>15}{:>9}{:>9}{:>9}{:>9}{:>9}{:>8}{:>9}{:>8}", "setting", "ms", "(spread)", "posed ms", "bake ms", "exact dB", "photo dB", "depth mm", "norm °", "shaded", "steps");
  if (lpips) text += fmt::format("{:>12}{:>12}", "exact LPIPS", "photo LPIPS");
  text += "\n";
  for (const TradeoffPoint& p : tradeoff.points) {
    text += fmt::format("{:<54}{:>9.1f}{:>15}{:>9.1f}{:>9.0f}{:>9}{:>9.2f}{:>9.2f}{:>8.2f}{:>9.2f}{:>8.2f}", p.name, p.milliseconds, fmt::format("({:.0f}-{:.0f})", p.fastest, p.slowest), p.milliseconds_same_pose, p.baking_milliseconds,
                        std::isfinite(p.psnr_exact) ? fmt::format("{:.2f}", p.psnr_exact) : "same", p.psnr, 1000 * p.depth_error, p.normal_error, p.shaded_a_ray, p.search_steps_a_sample);
    if (lpips) text += fmt::format("{:>12}{:>12}", optional_text(p.lpips_exact, "{:.4f}"), optional_text(p.lpips, "{:.4f}"));
    text += p.pareto ? "  *\n" : "\n";
  }
  for (const std::string& setting : tradeoff.left_out) text += fmt::format("not measured: {}\n", setting);
  return text +
         "ms: a picture of a new pose. posed ms: another picture of that pose. bake ms: once for each code, before its first picture\n"
         "* nothing measured is both faster and nearer to the exact rendering\n";
}

Report tradeoff_report(Tradeoff tradeoff, const Avatar& avatar, const std::string& avatar_path, const Capture& capture) {
  Report report;
  report.title = "Speed against accuracy: " + avatar_path;
  report.summary = fmt::format("{} settings, {} pictures of {} × {}, {} repetitions each; times are medians of whole pictures of a new pose.", tradeoff.points.size(), tradeoff.pictures_measured, tradeoff.width, tradeoff.height, tradeoff.repetitions);
  report.definition = metrics_definition() + (tradeoff.lpips.empty() ? "" : lpips_definition(tradeoff.lpips));
  report.facts = {{"avatar", fmt::format("{}, {} after {} steps, seed {}", avatar_path, avatar.spec.preset, avatar.steps, avatar.seed)}, {"capture", capture.path.string()}, {"device", fmt::format("{} ({})", tradeoff.device, tradeoff.driver)}};
  for (const std::string& setting : tradeoff.left_out) report.facts.emplace_back("not measured", setting);
  for (const TradeoffPoint& p : tradeoff.points)
    report.facts.emplace_back(p.name + (p.pareto ? " *" : ""), fmt::format("{:.0f} ms ({:.0f} to {:.0f}), {:.0f} ms for another picture of the same pose, {:.0f} ms of baking before the first; {:.2f} GFLOP; against the exact rendering {}{}, depth {:.2f} mm, normals {:.2f}°; against photographs {:.2f} dB{}; {:.1f} samples a ray, {:.1f} shaded", p.milliseconds, p.fastest, p.slowest, p.milliseconds_same_pose, p.baking_milliseconds, p.gflop,
                                                                           std::isfinite(p.psnr_exact) ? fmt::format("{:.2f} dB", p.psnr_exact) : "the same picture", lpips_text(p.lpips_exact), 1000 * p.depth_error, p.normal_error, p.psnr, lpips_text(p.lpips), p.samples_a_ray, p.shaded_a_ray));
  report.plots = {tradeoff_plot(tradeoff)};
  report.rows = std::move(tradeoff.pictures);
  return report;
}

}  // namespace arah

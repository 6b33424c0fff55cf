#include "host/evaluation/bench.h"

#include <cblas.h>
#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <limits>
#include <map>
#include <nlohmann/json.hpp>
#include <random>
#include <thread>

#include "host/body/json_fields.h"
#include "host/evaluation/timed_launches.h"
#include "host/input_error.h"
#include "kernels/linear/cooperative.h"
#include "kernels/linear/linear.h"
#include "kernels/losses/normal.h"
#include "kernels/reduction/sum.h"
#include "kernels/skinning/bone_gradient.h"

namespace arah {
namespace {

// OpenBLAS's threads wait actively for more work for a while; a kernel that runs meanwhile would share its cores with
// them.
constexpr std::chrono::milliseconds idle_after_sgemm{50};

class Bench {
 public:
  Bench(Device& device, const BenchSettings& settings, const std::function<void(const std::string&)>& progress)
      : device_(device), settings_(settings), progress_(progress), commands_(device), profile_(device) {
    result_.device = device.report().name;
    result_.driver = device.report().driver;
    result_.linear_family = linear_family(device) == LinearFamily::straight ? "straight" : "tiled";
    result_.sgemm_threads = openblas_get_num_threads();
    const uint32_t widest = *std::max_element(settings.widths.begin(), settings.widths.end());
    std::uniform_real_distribution<float> uniform(-1, 1);
    std::mt19937 generator(1);
    numbers_.resize(size_t(settings.points) * widest);
    for (float& number : numbers_) number = uniform(generator);
    host_result_.resize(numbers_.size());
  }

  BenchResult run() {
    peak();
    for (const uint32_t width : settings_.widths) linear(width);
    if (settings_.with_works) {
      result_.works = run_work_bench(device_, settings_.works, [&](const std::string& name) {
        peak();
        start(name);
      });
      for (const WorkBench& work : result_.works) add_shaders(work.shaders);
      kernels_without_work();
    }
    peak();
    add_shaders({{"peak/arithmetic", "", 1, result_.peak.gflops_milliseconds, result_.peak.gflops, 0, 0},
                 {"peak/bandwidth", "", 1, result_.peak.gigabytes_milliseconds, 0, result_.peak.gigabytes, 0}});
    return std::move(result_);
  }

 private:
  void start(const std::string& what) {
    if (progress_) progress_(what);
  }

  void peak() {
    result_.peak = best_peak(result_.peak, measure_device_peak(device_, settings_.repetitions));
  }

  // Keeps the order of names, and of two lines for a shader the earlier.
  void add_shaders(const std::vector<BenchLine>& lines) {
    std::vector<BenchLine>& all = result_.shaders;
    for (const BenchLine& line : lines) {
      const auto place = std::lower_bound(all.begin(), all.end(), line, [](const BenchLine& a, const BenchLine& b) { return a.name < b.name; });
      if (place == all.end() || place->name != line.name) all.insert(place, line);
    }
  }

  // A buffer of `floats` numbers in [−1, 1), whatever they mean.
  Buffer filled(const char* name, uint64_t floats) {
    Buffer buffer(device_, std::string("bench ") + name, floats * 4, BufferPlace::device);
    for (uint64_t at = 0; at < floats; at += numbers_.size()) {
      const uint64_t count = std::min<uint64_t>(floats - at, numbers_.size());
      device_.upload(buffer.slice().elements(at, count), numbers_.data(), count * 4);
    }
    return buffer;
  }

  // The best of the repetitions, each after one of `sgemm`; flops: of the product.
  void measure_beside_sgemm(const std::string& name, const std::string& shape, const std::function<void()>& record, const std::function<void()>& sgemm, double flops) {
    start(fmt::format("{} {}", name, shape));
    run_timed(commands_, record);  // makes the pipelines
    sgemm();                       // and wakes its threads
    TimedLaunches best;
    best.milliseconds = std::numeric_limits<double>::infinity();
    double best_sgemm = std::numeric_limits<double>::infinity();
    for (uint32_t i = 0; i < settings_.repetitions; ++i) {
      const auto before = std::chrono::steady_clock::now();
      sgemm();
      best_sgemm = std::min(best_sgemm, milliseconds_since(before));
      std::this_thread::sleep_for(idle_after_sgemm);
      const TimedLaunches timed = run_timed(commands_, record);
      if (timed.milliseconds < best.milliseconds) best = timed;
    }
    BenchLine line = bench_line(name, shape, {1, best.milliseconds, {flops, best.cost.bytes}});
    line.sgemm_gflops = flops / std::max(best_sgemm, 1e-6) * 1e-6;
    result_.lines.push_back(line);
  }

  void linear(uint32_t width) {
    const uint32_t points = settings_.points;
    const int n = static_cast<int>(points), w = static_cast<int>(width);
    Layer layer(*this, points, width);
    const std::string shape = layer.shape();
    const double flops = 2.0 * points * width * width;
    const float* a = numbers_.data();
    float* c = host_result_.data();
    measure_beside_sgemm(
        "linear forward", shape, [&] { layer.record_forward(commands_, {}); },
        [&] { cblas_sgemm(CblasRowMajor, CblasNoTrans, CblasNoTrans, n, w, w, 1, a, w, a, w, 0, c, w); }, flops);
    measure_beside_sgemm(
        "linear input gradient", shape, [&] { layer.record_input_gradient(commands_); },
        [&] { cblas_sgemm(CblasRowMajor, CblasNoTrans, CblasTrans, n, w, w, 1, a, w, a, w, 0, c, w); }, flops);
    measure_beside_sgemm(
        "linear weight gradient", shape, [&] { layer.record_weight_gradient(commands_, {}); },
        [&] { cblas_sgemm(CblasRowMajor, CblasTrans, CblasNoTrans, w, w, n, 1, a, w, a, w, 0, c, w); }, flops);
  }

  // A layer of width × width and a batch for it.
  struct Layer {
    Layer(Bench& bench, uint32_t batch, uint32_t layer_width)
        : points(batch), width(layer_width), x(bench.filled("x", uint64_t(batch) * layer_width)), y(bench.filled("y", uint64_t(batch) * layer_width)),
          weights(bench.filled("weights", packed_floats(layer_width, layer_width))), total(bench.filled("gradient", uint64_t(layer_width + 1) * layer_width)),
          scratch(bench.filled("partial sums", weight_gradient_scratch_floats(layer_width, layer_width, batch))) {}

    std::string shape() const { return fmt::format("{} x {} x {}", points, width, width); }
    PackedWeights packed() { return {width, width, weights.slice(), weights.slice()}; }
    void record_forward(Commands& commands, std::optional<LinearFamily> family) {
      LinearForwardArgs args;
      args.x = {x.slice(), width, 0};
      args.weights = packed();
      args.y = {y.slice(), width, 0};
      args.activation = Activation::relu;
      args.range.points = points;
      args.family = family;
      record_linear_forward(commands, args);
    }
    void record_input_gradient(Commands& commands) {
      LinearInputGradientArgs args;
      args.dy = {x.slice(), width, 0};
      args.weights = packed();
      args.result = {y.slice(), width, 0};
      args.range.points = points;
      record_linear_input_gradient(commands, args);
    }
    void record_weight_gradient(Commands& commands, std::optional<LinearFamily> family) {
      LinearWeightGradientArgs args;
      args.x = {x.slice(), width, 0};
      args.dy = {y.slice(), width, 0};
      args.inputs = args.outputs = width;
      args.points = points;
      args.scratch = scratch.slice();
      args.total = total.slice();
      args.family = family;
      record_linear_weight_gradient(commands, args);
    }

    uint32_t points, width;
    Buffer x, y, weights, total, scratch;
  };

  // The shaders of the launches, by the median of the repetitions.
  void measure_alone(const std::string& shape, const std::function<void()>& record) {
    run_timed(commands_, record);  // makes the pipelines
    std::vector<Profiler> profiles;
    for (uint32_t i = 0; i < settings_.repetitions; ++i) profiles.push_back(run_timed(commands_, record).profile);
    add_shaders(median_lines(profiles, &Profiler::shaders, shape));
  }

  // The other family of the linear layer, the straight one's kernel for wide layers, what cooperative matrices need and, where
  // the device has them, their kernel, and the gradient of the bones.
  void kernels_without_work() {
    start("kernels of no work");
    const uint32_t points = std::min(settings_.points, 16384u);
    for (const auto& [width, family] : {std::pair{64u, LinearFamily::straight}, {64u, LinearFamily::tiled}, {256u, LinearFamily::straight}}) {
      Layer layer(*this, points, width);
      measure_alone(layer.shape(), [&, family = family] {
        layer.record_forward(commands_, family);
        layer.record_weight_gradient(commands_, family);
      });
    }

    {
      Layer layer(*this, points, 256);
      Buffer halves(device_, "bench weights as halves", half_weights_bytes(256, 256), BufferPlace::device);
      measure_alone(layer.shape(), [&] {
        record_half_weights(commands_, {256, 256, layer.weights.slice(), {}, halves.slice()}, "weights as halves");
        if (!cooperative_refusal(device_).empty()) return;
        LinearForwardArgs args;
        args.x = {layer.x.slice(), 256, 0, Element::half};
        args.weights = {256, 256, layer.weights.slice(), {}, halves.slice()};
        args.y = {layer.y.slice(), 256, 0, Element::half};
        args.activation = Activation::relu;
        args.range.points = points;
        record_linear_forward(commands_, args);
      });
    }

    const uint64_t rows = padded_points(points);
    constexpr uint32_t joints = 24;
    Buffer vectors = filled("vectors", rows * 4), cotangents = filled("cotangents", rows * 4), weights = filled("skinning weights", rows * joints),
           partials(device_, "bench partial sums", bone_gradient_partials(points, joints), BufferPlace::device), bones = filled("bones", 12 * joints);
    measure_alone(fmt::format("{} points, {} joints", points, joints), [&] {
      BoneGradientArgs args;
      args.rows = {{points, {}}, {}};
      args.joints = joints;
      args.cotangents = cotangents.slice();
      args.canonical = vectors.slice();
      args.weights = {weights.slice(), joints, 0};
      args.partials = partials.slice();
      args.gradients = bones.slice();
      record_bone_gradient(commands_, args);
    });

    // Of pre-training alone.
    Buffer gradients = filled("gradients", rows * channel_padding), sdf_cotangents = filled("sdf cotangents", rows * channel_padding);
    Buffer normal_partials = filled("partial sums of normals", partial_bytes(points) / 4), normal_losses = filled("losses of normals", 64);
    measure_alone(fmt::format("{} points", points), [&] {
      NormalLossArgs args;
      args.points = points;
      args.normaliser = static_cast<float>(points);
      args.weight = 1;
      args.gradients = {gradients.slice(), channel_padding, 0};
      args.normals = vectors.slice();
      args.d_gradients = {sdf_cotangents.slice(), channel_padding, 0};
      args.losses = normal_losses.slice();
      args.partials = normal_partials.slice();
      record_normal_loss(commands_, args);
    });
  }

  Device& device_;
  const BenchSettings& settings_;
  const std::function<void(const std::string&)>& progress_;
  Commands commands_;
  ProfileScope profile_;
  std::vector<float> numbers_, host_result_;
  BenchResult result_;
};

void check(const BenchSettings& settings) {
  const auto refuse = [](const std::string& text) { return InputError("bench: " + text); };
  if (settings.points == 0 || settings.points % point_padding != 0 || settings.points > 65536)
    throw refuse(
        fmt::format("points: expected a multiple of {} up to 65536, found {}", point_padding, settings.points));
  if (settings.widths.empty()) throw refuse("widths: expected at least one, found none");
  for (const uint32_t width : settings.widths)
    if (width == 0 || width % channel_padding != 0 || width > 512)
      throw refuse(fmt::format("widths: expected multiples of {} up to 512, found {}", channel_padding, width));
  if (settings.repetitions == 0) throw refuse("repetitions: expected at least 1, found 0");
}

}  // namespace

BenchSettings quick_bench_settings() {
  BenchSettings settings;
  settings.points = 1024;
  settings.widths = {64};
  settings.repetitions = 1;
  settings.works = {.warm_up = 1, .steps = 1, .profiled_steps = 8, .repetitions = 1, .picture_size = 32, .fit_steps = 20, .fit_skinning_steps = 40};
  return settings;
}

BenchResult run_bench(Device& device, const BenchSettings& settings, const std::function<void(const std::string&)>& progress) {
  check(settings);
  return Bench(device, settings, progress).run();
}

namespace {

std::string percent_text(double share) { return share > 0 ? fmt::format("{:.1f} %", 100 * share) : ""; }

std::string rate_text(double value) { return value > 0 ? fmt::format("{:.2f}", value) : ""; }

std::string table_head(const std::string& name, const std::string& shape) {
  return fmt::format("{:<34}{:<27}{:>7}{:>11}{:>10}{:>9}{:>9}{:>9}  {:<10}{:>9}\n", name, shape, "calls", "ms", "GFLOP/s", "of peak", "GB/s", "of peak", "bound by", "of sgemm");
}

std::string table_line(const std::string& name, const BenchLine& line, const std::string& shape, const DevicePeak& peak) {
  const double arithmetic = line.share_of_arithmetic(peak), bandwidth = line.share_of_bandwidth(peak);
  const char* bound = arithmetic == 0 && bandwidth == 0 ? "" : arithmetic > bandwidth ? "arithmetic" : "memory";
  std::string text = fmt::format("{:<34}{:<27}{:>7}{:>11.3f}{:>10}{:>9}{:>9}{:>9}  {:<10}{:>9}", name, shape, line.calls, line.milliseconds, rate_text(line.gflops), percent_text(arithmetic),
                                 rate_text(line.gigabytes), percent_text(bandwidth), bound, percent_text(line.share_of_sgemm()));
  text.erase(text.find_last_not_of(' ') + 1);
  return text + "\n";
}

}  // namespace

std::string bench_table(const BenchResult& result) {
  std::string text = fmt::format("{} ({})\nPeak, measured: {:.1f} GFLOP/s in float32, {:.1f} GB/s of memory. Shares are of these; the larger one is the closer bound.\n", result.device, result.driver,
                                 result.peak.gflops, result.peak.gigabytes);
  text += fmt::format("\nLinear layer: {} kernels; sgemm: OpenBLAS, {} threads; the best of each\n", result.linear_family, result.sgemm_threads);
  text += table_head("product", "shape");
  for (const BenchLine& line : result.lines) text += table_line(line.name, line, line.shape, result.peak);

  text += "\nEvery kernel: one picture, one training step, or alone; medians\n" + table_head("kernel", "measured in");
  std::string room;
  for (const BenchLine& line : result.shaders) {
    const size_t slash = line.name.find('/');
    if (line.name.substr(0, slash) != room) text += (room = line.name.substr(0, slash)) + "\n";
    text += table_line("  " + line.name.substr(slash + 1), line, line.shape, result.peak);
  }

  text += "\nEvery stage: time on the device; medians\n" + table_head("stage", "");
  for (const WorkBench& work : result.works) {
    text += fmt::format("{}: {}: median {:.1f} ms, mean {:.1f} ms by the clock\n", work.name, work.description, work.median_milliseconds, work.mean_milliseconds);
    if (work.profiled == 0) text += "  the device has no timestamps: no times by stage\n";
    for (const BenchLine& line : work.stages) text += table_line("  " + line.name, line, "", result.peak);
  }
  return text;
}

namespace {

nlohmann::ordered_json json_lines(const std::vector<BenchLine>& lines, const DevicePeak& peak) {
  nlohmann::ordered_json all = nlohmann::json::array();
  for (const BenchLine& line : lines) {
    nlohmann::ordered_json entry{{"name", line.name}};
    if (!line.shape.empty()) entry["shape"] = line.shape;
    entry["calls"] = line.calls;
    entry["milliseconds"] = line.milliseconds;
    if (line.gflops > 0) {
      entry["gflops"] = line.gflops;
      entry["share_of_peak_arithmetic"] = line.share_of_arithmetic(peak);
    }
    if (line.gigabytes > 0) {
      entry["gigabytes_per_second"] = line.gigabytes;
      entry["share_of_peak_bandwidth"] = line.share_of_bandwidth(peak);
    }
    if (line.sgemm_gflops > 0) {
      entry["sgemm_gflops"] = line.sgemm_gflops;
      entry["share_of_sgemm"] = line.share_of_sgemm();
    }
    all.push_back(std::move(entry));
  }
  return all;
}

}  // namespace

std::string bench_json(const BenchResult& result) {
  nlohmann::ordered_json works = nlohmann::json::array();
  for (const WorkBench& work : result.works)
    works.push_back({{"name", work.name},
                     {"description", work.description},
                     {"median_milliseconds", work.median_milliseconds},
                     {"mean_milliseconds", work.mean_milliseconds},
                     {"profiled", work.profiled},
                     {"stages", json_lines(work.stages, result.peak)},
                     {"launches", json_lines(work.launches, result.peak)}});
  const nlohmann::ordered_json kernels{{"device", result.device},
                                       {"driver", result.driver},
                                       {"linear_family", result.linear_family},
                                       {"sgemm_threads", result.sgemm_threads},
                                       {"peak", {{"gflops", result.peak.gflops}, {"gigabytes_per_second", result.peak.gigabytes}}},
                                       {"lines", json_lines(result.lines, result.peak)},
                                       {"shaders", json_lines(result.shaders, result.peak)}};
  return nlohmann::ordered_json{{"kernels", kernels}, {"works", works}}.dump(1) + "\n";
}

namespace {

// name and shape → milliseconds, in the file's order: of one call of a kernel or a launch, of all of a stage.
std::vector<std::pair<std::string, double>> timed_lines(const nlohmann::ordered_json& file) {
  std::vector<std::pair<std::string, double>> lines;
  const auto add = [&](const std::string& prefix, const nlohmann::ordered_json& all, bool a_call) {
    for (const auto& line : all) {
      const double calls = a_call ? std::max(line.at("calls").get<double>(), 1.0) : 1;
      const std::string shape = a_call && line.contains("shape") ? ", " + line["shape"].get<std::string>() : "";
      lines.emplace_back(prefix + line.at("name").get<std::string>() + shape, line.at("milliseconds").get<double>() / calls);
    }
  };
  add("", file.at("kernels").at("lines"), true);
  if (!file.contains("works")) {
    const auto& step = file.at("training_step");
    lines.emplace_back("training step", step.at("median_milliseconds").get<double>());
    add("step: ", step.at("stages"), true);
    return lines;
  }
  add("", file.at("kernels").at("shaders"), true);
  for (const auto& work : file.at("works")) {
    const std::string name = work.at("name").get<std::string>();
    lines.emplace_back(name, work.at("median_milliseconds").get<double>());
    add(name + ": ", work.at("stages"), false);
    if (name == "training step") add("step: ", work.at("launches"), true);  // as in files of version 0.1
  }
  return lines;
}

}  // namespace

std::string bench_comparison(const std::string& old_json, const std::string& old_name, const std::string& new_json) {
  std::vector<std::pair<std::string, double>> before;
  try {
    before = timed_lines(parse_json<nlohmann::ordered_json>(old_json, old_name));
  } catch (const nlohmann::json::exception&) {
    throw InputError(old_name, "", "a file that arah bench --json wrote", "something else");
  }
  const auto after = timed_lines(nlohmann::ordered_json::parse(new_json));
  const auto find = [](const auto& lines, const std::string& name) { return std::find_if(lines.begin(), lines.end(), [&](const auto& line) { return line.first == name; }); };
  std::string text = fmt::format("{:<64}{:>12}{:>12}{:>9}\n", "milliseconds: a call, or all of a stage", "before", "after", "ratio"), gone;
  for (const auto& [name, milliseconds] : after) {
    const auto old = find(before, name);
    if (old == before.end()) text += fmt::format("{:<64}{:>12}{:>12.3f}{:>9}\n", name, "-", milliseconds, "new");
    else text += fmt::format("{:<64}{:>12.3f}{:>12.3f}{:>9.2f}\n", name, old->second, milliseconds, milliseconds / std::max(old->second, 1e-9));
  }
  for (const auto& [name, milliseconds] : before)
    if (find(after, name) == after.end()) gone += fmt::format("{:<64}{:>12.3f}{:>12}{:>9}\n", name, milliseconds, "-", "gone");
  return text + gone;
}

}  // namespace arah

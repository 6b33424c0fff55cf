#include "host/evaluation/bench.h"

#include <cblas.h>
#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <limits>
#include <nlohmann/json.hpp>
#include <random>
#include <thread>

#include "host/input_error.h"
#include "kernels/color/assemble_inputs.h"
#include "kernels/color/feature_grid.h"
#include "kernels/linear/linear.h"
#include "shaders/shared/frame.h"
#include "shaders/shared/ray.h"

namespace arah {
namespace {

using Clock = std::chrono::steady_clock;

double milliseconds_since(Clock::time_point start) {
  return std::chrono::duration<double, std::milli>(Clock::now() - start).count();
}

// OpenBLAS's threads wait actively for more work for a while; a kernel that runs meanwhile would share its cores with
// them.
constexpr std::chrono::milliseconds idle_after_sgemm{50};

// Turns the profile on while it lives, and puts the caller's own back.
class ProfileScope {
 public:
  explicit ProfileScope(Device& device) : device_(device), before_(device.profiler()) {
    device.profiler().enabled = true;
  }
  ~ProfileScope() { device_.profiler() = before_; }
  ProfileScope(const ProfileScope&) = delete;
  ProfileScope& operator=(const ProfileScope&) = delete;

 private:
  Device& device_;
  Profiler before_;
};

struct Measured {
  double milliseconds = std::numeric_limits<double>::infinity();
  Cost cost;
};

class Bench {
 public:
  Bench(Device& device, const BenchSettings& settings, const std::function<void(const BenchLine&)>& progress)
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
    for (const uint32_t width : settings_.widths) linear(width);
    color_inputs();
    feature_grid();
    return std::move(result_);
  }

 private:
  // A buffer of `floats` numbers in [−1, 1), whatever they mean.
  Buffer filled(const char* name, uint64_t floats) {
    Buffer buffer(device_, std::string("bench ") + name, floats * 4, BufferPlace::device);
    for (uint64_t at = 0; at < floats; at += numbers_.size()) {
      const uint64_t count = std::min<uint64_t>(floats - at, numbers_.size());
      device_.upload(buffer.slice().elements(at, count), numbers_.data(), count * 4);
    }
    return buffer;
  }

  // One run of what `record` records. The device's own timestamps do not count submission; without them the clock must
  // do.
  Measured once(const std::function<void()>& record) {
    device_.profiler().reset();
    record();
    const Clock::time_point start = Clock::now();
    commands_.submit_and_wait();
    Measured measured{milliseconds_since(start), {}};
    for (const auto& [name, launch] : device_.profiler().launches()) {
      measured.cost.flops += launch.cost.flops;
      measured.cost.bytes += launch.cost.bytes;
    }
    if (device_.report().timestamp_period_ns > 0) measured.milliseconds = device_.profiler().total_milliseconds();
    return measured;
  }

  // The best of the repetitions, each after one of `sgemm` where that is given; flops: of the product.
  void measure(const std::string& name, const std::string& shape, const std::function<void()>& record,
               const std::function<void()>& sgemm = {}, double flops = 0) {
    record();  // makes the pipelines
    commands_.submit_and_wait();
    Measured best;
    double best_sgemm = std::numeric_limits<double>::infinity();
    for (uint32_t i = 0; i < settings_.repetitions; ++i) {
      if (sgemm) {
        const Clock::time_point start = Clock::now();
        sgemm();
        best_sgemm = std::min(best_sgemm, milliseconds_since(start));
        std::this_thread::sleep_for(idle_after_sgemm);
      }
      const Measured measured = once(record);
      if (measured.milliseconds < best.milliseconds) best = measured;
    }
    const double seconds = std::max(best.milliseconds, 1e-6) * 1e-3;
    BenchLine line{name,
                   shape,
                   1,
                   best.milliseconds,
                   (sgemm ? flops : best.cost.flops) / seconds * 1e-9,
                   best.cost.bytes / seconds * 1e-9,
                   0};
    if (sgemm) line.sgemm_gflops = flops / std::max(best_sgemm, 1e-6) * 1e-6;
    result_.lines.push_back(line);
    if (progress_) progress_(line);
  }

  void linear(uint32_t width) {
    const uint32_t points = settings_.points;
    const int n = static_cast<int>(points), w = static_cast<int>(width);
    Buffer x = filled("x", uint64_t(points) * width), y = filled("y", uint64_t(points) * width),
           weights = filled("weights", packed_floats(width, width));
    Buffer total = filled("gradient", uint64_t(width + 1) * width),
           scratch = filled("partial sums", weight_gradient_scratch_floats(width, width, points));
    const Matrix x_matrix{x.slice(), width, 0}, y_matrix{y.slice(), width, 0};
    const PackedWeights packed{width, width, weights.slice(), weights.slice()};
    const std::string shape = fmt::format("{} x {} x {}", points, width, width);
    const double flops = 2.0 * points * width * width;
    const float* a = numbers_.data();
    float* c = host_result_.data();

    measure(
        "linear forward", shape,
        [&] {
          LinearForwardArgs args;
          args.x = x_matrix;
          args.weights = packed;
          args.y = y_matrix;
          args.activation = Activation::relu;
          args.range.points = points;
          record_linear_forward(commands_, args);
        },
        [&] { cblas_sgemm(CblasRowMajor, CblasNoTrans, CblasNoTrans, n, w, w, 1, a, w, a, w, 0, c, w); }, flops);
    measure(
        "linear input gradient", shape,
        [&] {
          LinearInputGradientArgs args;
          args.dy = x_matrix;
          args.weights = packed;
          args.result = y_matrix;
          args.range.points = points;
          record_linear_input_gradient(commands_, args);
        },
        [&] { cblas_sgemm(CblasRowMajor, CblasNoTrans, CblasTrans, n, w, w, 1, a, w, a, w, 0, c, w); }, flops);
    measure(
        "linear weight gradient", shape,
        [&] {
          LinearWeightGradientArgs args;
          args.x = x_matrix;
          args.dy = y_matrix;
          args.inputs = args.outputs = width;
          args.points = points;
          args.scratch = scratch.slice();
          args.total = total.slice();
          record_linear_weight_gradient(commands_, args);
        },
        [&] { cblas_sgemm(CblasRowMajor, CblasTrans, CblasNoTrans, w, w, n, 1, a, w, a, w, 0, c, w); }, flops);
  }

  void color_inputs() {
    const uint32_t points = settings_.points, samples = 32;
    const ColorRow row{true, true, 256};
    const uint32_t stride = padded_channels(row.grid_column());
    Buffer frame = filled("frame", sizeof(FrameConstants) / 4), vectors = filled("points", uint64_t(points) * 4);
    Buffer rays = filled("rays", uint64_t(padded_points(points / samples)) * sizeof(Ray) / 4);
    Buffer feature = filled("feature", uint64_t(points) * 256), rows = filled("rows", uint64_t(points) * stride),
           normals = filled("normals", uint64_t(points) * 4);
    measure("colour inputs", fmt::format("{} x {}", points, row.grid_column()), [&] {
      record_assemble_inputs(commands_, {row,
                                         points,
                                         samples,
                                         frame.slice(),
                                         vectors.slice(),
                                         rays.slice(),
                                         normals.slice(),
                                         {feature.slice(), 256, 0},
                                         {rows.slice(), stride, 0},
                                         row.grid_column()});
    });
    measure("colour inputs backward", fmt::format("{} x {}", points, row.grid_column()), [&] {
      record_assemble_inputs_backward(
          commands_,
          {row, points, {rows.slice(), stride, 0}, vectors.slice(), normals.slice(), {feature.slice(), 256, 0}});
    });
  }

  void feature_grid() {
    const uint32_t points = settings_.points;
    const FeatureGridShape shape{{-1, -1, -1}, {1, 1, 1}, 2, {{{64, 64, 64}, {32, 32, 32}}}};
    Buffer positions = filled("points", uint64_t(points) * 4), features = filled("features", shape.feature_count()),
           rows = filled("rows", uint64_t(points) * 8);
    Buffer sums = filled("sums", shape.feature_count()), clamped = filled("clamped", 1),
           d_position = filled("d position", uint64_t(points) * 4);
    const Matrix row_matrix{rows.slice(), 8, 0};
    const std::string text = fmt::format("{} x 2 grids", points);
    measure("feature grid", text, [&] {
      record_feature_grid_forward(commands_, {shape, points, positions.slice(), features.slice(), row_matrix, 0});
    });
    measure("feature grid backward", text, [&] {
      record_feature_grid_backward(
          commands_, {shape, points, points, 1024, positions.slice(), features.slice(), row_matrix, 0, sums.slice(),
                      clamped.slice(), PositionGradient::assign, d_position.slice(), 1});
    });
  }

  Device& device_;
  const BenchSettings& settings_;
  const std::function<void(const BenchLine&)>& progress_;
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

BenchResult run_bench(Device& device, const BenchSettings& settings,
                      const std::function<void(const BenchLine&)>& progress) {
  check(settings);
  return Bench(device, settings, progress).run();
}

std::vector<BenchLine> profile_lines(const Profiler& profiler) {
  std::vector<BenchLine> lines;
  for (const auto& [name, launch] : profiler.launches()) {
    const double seconds = std::max(launch.milliseconds, 1e-6) * 1e-3;
    lines.push_back({name, "", launch.calls, launch.milliseconds, launch.cost.flops / seconds * 1e-9,
                     launch.cost.bytes / seconds * 1e-9, 0});
  }
  std::stable_sort(lines.begin(), lines.end(),
                   [](const BenchLine& a, const BenchLine& b) { return a.milliseconds > b.milliseconds; });
  return lines;
}

std::string bench_table(const BenchResult& result) {
  std::string text = fmt::format("{} ({}); linear layer: {}; sgemm: OpenBLAS, {} threads\n", result.device,
                                 result.driver, result.linear_family, result.sgemm_threads);
  text += fmt::format("{:<40}{:<20}{:>8}{:>12}{:>10}{:>9}{:>10}\n", "kernel", "shape", "calls", "ms", "GFLOP/s", "GB/s",
                      "of sgemm");
  for (const BenchLine& line : result.lines) {
    const std::string share = line.sgemm_gflops > 0 ? fmt::format("{:.0f} %", 100 * line.share_of_sgemm()) : "";
    text += fmt::format("{:<40}{:<20}{:>8}{:>12.3f}{:>10.2f}{:>9.2f}{:>10}\n", line.name, line.shape, line.calls,
                        line.milliseconds, line.gflops, line.gigabytes, share);
  }
  return text;
}

std::string bench_json(const BenchResult& result) {
  nlohmann::ordered_json lines = nlohmann::json::array();
  for (const BenchLine& line : result.lines) {
    nlohmann::ordered_json entry{{"name", line.name}};
    if (!line.shape.empty()) entry["shape"] = line.shape;
    entry["calls"] = line.calls;
    entry["milliseconds"] = line.milliseconds;
    if (line.gflops > 0) entry["gflops"] = line.gflops;
    if (line.gigabytes > 0) entry["gigabytes_per_second"] = line.gigabytes;
    if (line.sgemm_gflops > 0) {
      entry["sgemm_gflops"] = line.sgemm_gflops;
      entry["share_of_sgemm"] = line.share_of_sgemm();
    }
    lines.push_back(std::move(entry));
  }
  return nlohmann::ordered_json{{"device", result.device},
                                {"driver", result.driver},
                                {"linear_family", result.linear_family},
                                {"sgemm_threads", result.sgemm_threads},
                                {"lines", lines}}
             .dump(1) +
         "\n";
}

namespace {

// name and shape → milliseconds of one call, in the file's order.
std::vector<std::pair<std::string, double>> timed_lines(const nlohmann::ordered_json& file) {
  std::vector<std::pair<std::string, double>> lines;
  const auto add = [&](const std::string& prefix, const nlohmann::ordered_json& all) {
    for (const auto& line : all) {
      const double calls = line.at("calls").get<double>();
      lines.emplace_back(fmt::format("{}{}{}", prefix, line.at("name").get<std::string>(), line.contains("shape") ? ", " + line["shape"].get<std::string>() : ""),
                         line.at("milliseconds").get<double>() / std::max(calls, 1.0));
    }
  };
  add("", file.at("kernels").at("lines"));
  const auto& step = file.at("training_step");
  lines.emplace_back("training step", step.at("median_milliseconds").get<double>());
  add("step: ", step.at("stages"));
  return lines;
}

}  // namespace

std::string bench_comparison(const std::string& old_json, const std::string& old_name, const std::string& new_json) {
  std::vector<std::pair<std::string, double>> before;
  try {
    before = timed_lines(nlohmann::ordered_json::parse(old_json));
  } catch (const nlohmann::json::exception&) {
    throw InputError(old_name, "", "a file that arah bench --json wrote", "something else");
  }
  const auto after = timed_lines(nlohmann::ordered_json::parse(new_json));
  const auto find = [](const auto& lines, const std::string& name) { return std::find_if(lines.begin(), lines.end(), [&](const auto& line) { return line.first == name; }); };
  std::string text = fmt::format("{:<64}{:>12}{:>12}{:>9}\n", "milliseconds a call", "before", "after", "ratio"), gone;
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

#include "host/evaluation/rank_bench.h"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <span>

#include "host/evaluation/bench_subject.h"
#include "host/evaluation/timed_launches.h"
#include "host/training/trainer.h"

namespace arah {
namespace {

using Clock = std::chrono::steady_clock;

constexpr uint32_t part_of_rays = 4;
// Each an exchange of parts and one of sums (ranks.cpp): a frame's first and second, the grid's, the step's.
constexpr double collectives = 4;

class RankWorks {
 public:
  RankWorks(Device& device, const Ranks& ranks, const RankBenchSettings& settings, const std::function<void(const std::string&)>& progress) : device_(device), ranks_(ranks), settings_(settings), progress_(progress) {
    for (uint32_t n = 1; n <= ranks.count(); ++n) groups_.push_back(ranks.first_ranks(n));
  }

  RankBench run() {
    bench_.device = fmt::format("{} ({})", device_.report().name, device_.report().driver);
    measure_links();
    TrainingSettings tiny = bench_step_settings("tiny", 60, 200);
    tiny.rays *= 4;  // much of its own step is no ray's
    work("tiny", fmt::format("preset tiny, {} rays x {} samples", tiny.rays, tiny.sampling.samples), preset_spec("tiny"), tiny);
    if (settings_.with_paper) {
      TrainingSettings papers = bench_step_settings("paper", 2, 2);
      papers.rays = settings_.papers_rays;
      papers.eikonal_points = papers.off_surface_points = papers.inside_points = papers.skinning_points = settings_.papers_rays;
      papers.view_augmentation = 1;  // in every step, so that each takes the same
      work("paper", fmt::format("preset paper with its hypernetwork, {} rays x {} samples", papers.rays, papers.sampling.samples), preset_spec("paper"), papers);
    }
    return std::move(bench_);
  }

 private:
  void start(const std::string& name) {
    if (ranks_.first() && progress_) progress_(name);
  }

  void measure_links() {
    if (ranks_.count() == 1) return;
    start("links");
    std::vector<float> many(std::size_t{1} << 24, 1.0f), one(1, 1.0f);
    std::vector<double> seconds, latency;
    for (int i = 0; i < 5; ++i) {
      std::fill(many.begin(), many.end(), 1.0f);
      ranks_.wait_for_all();
      const Clock::time_point began = Clock::now();
      ranks_.sum(std::span(many));
      seconds.push_back(1e-3 * milliseconds_since(began));
    }
    for (int i = 0; i < 101; ++i) {
      const Clock::time_point began = Clock::now();
      ranks_.sum(std::span(one));
      latency.push_back(1e3 * milliseconds_since(began));
    }
    const double n = ranks_.count();
    bench_.gigabytes = 2 * (n - 1) / n * double(many.size()) * 4e-9 / median(seconds);
    bench_.microseconds = median(latency);
  }

  // Steps of these ranks, of each kind in turns, so that a busy machine slows both alike.
  RankBenchPoint point(const Avatar& avatar, const TrainingSettings& training, const Ranks& group, uint64_t* bytes = nullptr) {
    const uint32_t part = avatar.spec.preset == "paper" ? 2 : 1, warm_up = settings_.warm_up / part, steps = settings_.steps / part;
    Trainer trainer(device_, subject_.capture(), avatar, training, group);
    uint64_t left = 2 * (warm_up + steps);
    std::vector<double> step, in_turns, exchange, beside;
    for (uint32_t i = 0; i < warm_up + steps; ++i)
      for (const bool begin_beside : {true, false}) {
        trainer.set_exchange_beside(begin_beside);
        const Trainer::ExchangeTimes before = trainer.exchange_times();
        const Clock::time_point began = Clock::now();
        trainer.step(left--);
        const double milliseconds = milliseconds_since(began);
        const Trainer::ExchangeTimes& after = trainer.exchange_times();
        if (bytes) *bytes = after.bytes - before.bytes;
        if (i < warm_up) continue;
        (begin_beside ? step : in_turns).push_back(milliseconds);
        if (begin_beside) exchange.push_back(1e3 * (after.seconds - before.seconds)), beside.push_back(1e3 * (after.beside - before.beside));
      }
    return {group.count(), median(step), median(in_turns), median(exchange), median(beside)};
  }

  void work(const std::string& name, const std::string& description, const AvatarSpec& spec, TrainingSettings training) {
    training.skinning_every = 1;  // the same numbers in every step
    start(name);
    Avatar avatar = bench_avatar(device_, subject_.capture(), spec, training);
    ranks_.broadcast(std::span(avatar.parameters));
    RankBenchWork work{name, description, training.rays, preset_settings(name).rays, 0, 4 * avatar.layout.parameter_count(), 0, {}};
    for (const Ranks& group : groups_) {
      ranks_.wait_for_all();
      if (ranks_.rank() >= group_size(group)) continue;
      start(fmt::format("{} on {} {}", name, group.count(), group.count() == 1 ? "rank" : "ranks"));
      work.points.push_back(point(avatar, training, group, &work.bytes));
      if (group.count() > 1) continue;
      TrainingSettings part = training;
      for (uint32_t* count : {&part.rays, &part.eikonal_points, &part.off_surface_points, &part.inside_points, &part.skinning_points}) *count /= part_of_rays;
      work.part_step = point(avatar, part, group).step;
    }
    ranks_.wait_for_all();
    bench_.works.push_back(work);
  }

  // Of a group that this rank may not be in.
  uint32_t group_size(const Ranks& group) const { return static_cast<uint32_t>(&group - groups_.data()) + 1; }

  Device& device_;
  const Ranks& ranks_;
  const RankBenchSettings& settings_;
  const std::function<void(const std::string&)>& progress_;
  BenchCapture subject_;
  std::vector<Ranks> groups_;  // the first 1, 2, ... ranks
  RankBench bench_;
};

}  // namespace

RankBench run_rank_bench(Device& device, const Ranks& ranks, const RankBenchSettings& settings, const std::function<void(const std::string&)>& progress) {
  return RankWorks(device, ranks, settings, progress).run();
}

double modelled_step(const RankBenchWork& work, uint32_t rays, uint64_t bytes, uint32_t ranks, const Link& link, double compute) {
  const double whole = work.points.at(0).step, of_rays = std::clamp((whole - work.part_step) * part_of_rays / (part_of_rays - 1.0), 0.0, whole);
  const double n = ranks;
  return compute * (whole - of_rays + of_rays * rays / work.rays / n) + 2 * (n - 1) / n * double(bytes) * 8 / (link.gigabits * 1e9) * 1e3 + 2 * collectives * (n - 1) * link.microseconds * 1e-3;
}

std::string rank_bench_table(const RankBench& bench) {
  std::string text = bench.device + "\n";
  if (bench.gigabytes > 0) text += fmt::format("links: {:.2f} GB/s in and out of a rank, {:.0f} us for one number\n", bench.gigabytes, bench.microseconds);
  for (const RankBenchWork& work : bench.works) {
    text += fmt::format("\n{}: {}\n", work.name, work.description);
    if (work.bytes > 0) text += fmt::format("added up in a step: {:.2f} MB, of {:.2f} MB of gradients\n", 1e-6 * double(work.bytes), 1e-6 * double(work.bytes_of_gradients));
    text += fmt::format("one rank with a quarter of the rays: {:.1f} ms\n", work.part_step);
    text += "  ranks   step, ms   of it compute   exchange   of it beside   exchange after   times one rank\n";
    for (const RankBenchPoint& point : work.points)
      text += fmt::format("  {:5}   {:8.1f}   {:13.1f}   {:8.1f}   {:12.1f}   {:14.1f}   {:14.2f}\n", point.ranks, point.step, point.step - (point.exchange - point.beside), point.exchange, point.beside,
                          point.step_in_turns, work.points[0].step / point.step);
  }
  return text;
}

std::string rank_bench_json(const RankBench& bench) {
  nlohmann::ordered_json works = nlohmann::ordered_json::array();
  for (const RankBenchWork& work : bench.works) {
    nlohmann::ordered_json points = nlohmann::ordered_json::array();
    for (const RankBenchPoint& point : work.points)
      points.push_back({{"ranks", point.ranks}, {"step_milliseconds", point.step}, {"exchange_milliseconds", point.exchange}, {"beside_milliseconds", point.beside}, {"step_with_exchange_after_milliseconds", point.step_in_turns}});
    works.push_back({{"name", work.name}, {"description", work.description}, {"rays", work.rays}, {"rays_of_preset", work.rays_of_preset}, {"bytes", work.bytes}, {"bytes_of_gradients", work.bytes_of_gradients},
                     {"part_step_milliseconds", work.part_step}, {"points", points}});
  }
  return nlohmann::ordered_json{{"device", bench.device}, {"gigabytes_per_second", bench.gigabytes}, {"latency_microseconds", bench.microseconds}, {"works", works}}.dump(2) + "\n";
}

Plot scaling_plot(const RankBench& bench, const RankBenchWork& work) {
  // Latencies as TCP over Ethernet and as InfiniBand or RoCE are said to have them.
  const Link ethernet{"10 Gb/s", 10, 20}, infiniband{"100 Gb/s", 100, 2};
  constexpr double fast = 0.01;
  Plot plot{fmt::format("Ranks in a step of {} rays: {}", work.rays, work.description), "ranks", "times as fast as one", {}, true};
  const auto series = [&](const std::string& label, const auto& speed) {
    PlotSeries line{label, {}};
    for (const uint32_t n : {1u, 2u, 3u, 4u, 6u, 8u, 12u, 16u, 24u, 32u, 48u, 64u}) line.points.push_back({double(n), speed(n), fmt::format("{}, {} ranks: {:.2f}", label, n, speed(n))});
    plot.series.push_back(line);
  };
  const auto modelled = [&](uint32_t rays, uint64_t bytes, const Link& link, double compute) {
    return [&work, rays, bytes, link, compute](uint32_t n) { return modelled_step(work, rays, bytes, 1, link, compute) / modelled_step(work, rays, bytes, n, link, compute); };
  };
  PlotSeries measured{fmt::format("measured: {}", bench.device), {}};
  for (const RankBenchPoint& point : work.points) measured.points.push_back({double(point.ranks), work.points[0].step / point.step, fmt::format("measured, {} ranks: {:.2f}", point.ranks, work.points[0].step / point.step)});
  plot.series.push_back(measured);
  for (const Link& link : {ethernet, infiniband}) series(fmt::format("modelled, {}", link.name), modelled(work.rays, work.bytes, link, 1));
  const uint32_t rays = work.rays_of_preset;
  if (rays != work.rays) series(fmt::format("modelled: the preset's {} rays, {}", rays, ethernet.name), modelled(rays, work.bytes, ethernet, 1));
  for (const Link& link : {ethernet, infiniband}) series(fmt::format("modelled: {} rays, devices x 100, {}", rays, link.name), modelled(rays, work.bytes, link, fast));
  if (work.bytes_of_gradients > 2 * work.bytes) series("the last one without factors", modelled(rays, work.bytes_of_gradients, infiniband, fast));
  return plot;
}

}  // namespace arah

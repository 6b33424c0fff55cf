#include "host/evaluation/search_bench.h"

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <random>
#include <stdexcept>

#include "host/body/pose.h"
#include "host/evaluation/timed_launches.h"
#include "host/input_error.h"
#include "host/rendering/orbit_camera.h"
#include "host/rendering/ray_samples.h"

namespace arah {
namespace {

constexpr double bend = 0.15;          // radians about each axis of each joint but the root, standard deviation
constexpr double from_surface = 0.01;  // metres, standard deviation

Pose bent_pose(const Skeleton& skeleton, std::mt19937_64& generator) {
  std::normal_distribution<double> angle(0, bend);
  Pose pose = rest_pose(skeleton);
  for (size_t joint = 1; joint < pose.theta.size(); ++joint)
    for (int axis = 0; axis < 3; ++axis) pose.theta[joint][axis] += angle(generator);
  return pose;
}

// Whose rays hit the surface, evenly spread over it; fewer where there are fewer.
std::vector<uint32_t> pixels_of_hits(Commands& commands, FrameOnDevice& frame, RaySamples& samples, SurfaceFinder& finder, const Camera& camera, uint32_t wanted) {
  std::vector<uint32_t> inside, hit, some;
  for (int row = 0; row < camera.height; row += 32) {
    std::vector<uint32_t> pixels;
    for (int v = row; v < std::min(row + 32, camera.height); ++v)
      for (int u = 0; u < camera.width; ++u) pixels.push_back(static_cast<uint32_t>(u) | static_cast<uint32_t>(v) << 16);
    samples.set_pixels(commands, frame, camera, pixels);
    const std::vector<uint32_t> kept = samples.kept_counts(static_cast<uint32_t>(pixels.size()));
    for (size_t i = 0; i < pixels.size(); ++i)
      if (kept[i]) inside.push_back(pixels[i]);
  }
  const SurfaceHits hits = samples.search_surface(commands, frame, camera, inside, finder, SurfaceFinder::Candidates::not_diverged);
  for (size_t i = 0; i < inside.size(); ++i)
    if (hits.points[i][3] > 0) hit.push_back(inside[i]);
  const size_t count = std::min<size_t>(wanted, hit.size());
  for (size_t i = 0; i < count; ++i) some.push_back(hit[i * hit.size() / count]);
  return some;
}

// Points about the template's surface, vec4 by point with w = 1: wanted.
std::vector<std::array<float, 4>> points_at_surface(const BodyTemplate& body, const Pose& pose, uint32_t count, std::mt19937_64& generator) {
  const std::vector<glm::vec3> vertices = posed_vertices(body, pose);
  std::uniform_int_distribution<size_t> vertex(0, vertices.size() - 1);
  std::normal_distribution<float> distance(0, float(from_surface));
  std::vector<std::array<float, 4>> points;
  for (uint32_t i = 0; i < count; ++i) {
    const glm::vec3& at = vertices[vertex(generator)];
    points.push_back({at.x + distance(generator), at.y + distance(generator), at.z + distance(generator), 1});
  }
  points.resize(padded_points(count), {0, 0, 0, 0});
  return points;
}

}  // namespace

std::vector<SearchBench> run_search_bench(Device& device, const Avatar& avatar, const SearchBenchSettings& settings, const std::function<void(double)>& progress) {
  if (avatar.spec.skinning.kind != Skinning::network) throw InputError("avatar", "skinning", "a skinning network, whose inverse has to be searched", "none");
  if (settings.rays < 1 || settings.rays > 16384 || settings.points < 1 || settings.points > 65536 || settings.repetitions < 1)
    throw std::invalid_argument("search bench: 1 to 16,384 rays, 1 to 65,536 points, at least one repetition");
  std::mt19937_64 generator(1);
  const Pose pose = bent_pose(avatar.body.skeleton, generator);
  const std::vector<glm::vec3> vertices = posed_vertices(avatar.body, pose);
  const Camera camera = orbit_camera(vertices, UpAxis::y, 0, 512);

  Commands commands(device);
  AvatarNetworks networks(device, avatar, false);
  networks.record_pack(commands, 0, pose_input(avatar, pose));
  commands.submit_and_wait();
  TemplateOnDevice body(device, avatar.body);
  FrameOnDevice frame(device, avatar, body, pose, {});
  SamplingSettings sampling;
  sampling.mode = SamplingMode::surface;
  sampling.samples = 1;  // none is placed
  RaySamples samples(device, networks, 64, sampling);
  SurfaceFinder surface_finder(device, networks, settings.rays);
  const std::vector<uint32_t> pixels = pixels_of_hits(commands, frame, samples, surface_finder, camera, settings.rays);
  const auto rays = static_cast<uint32_t>(pixels.size());
  if (rays == 0) throw InputError("avatar", "", "a surface that rays hit", "none");

  const ProfileScope profile(device);
  std::map<std::string, std::vector<double>> times;
  std::map<std::string, Cost> costs;
  const auto take_stage = [&](const std::string& stage) {
    const auto& stages = device.profiler().stages();
    const auto found = stages.find(stage);
    if (found == stages.end()) return;
    times[stage].push_back(found->second.milliseconds);
    costs[stage] = found->second.cost;
  };

  samples.set_pixels(commands, frame, camera, pixels);
  for (uint32_t i = 0; i <= settings.repetitions; ++i) {  // the first makes the pipelines
    if (progress) progress(0.5 * i / (settings.repetitions + 1));
    device.profiler().reset();
    surface_finder.reset_counts();
    surface_finder.find(commands, frame, rays, samples.rays(), samples.kept(), SurfaceFinder::Candidates::not_diverged, {});
    commands.submit_and_wait();
    if (i == 0) continue;
    take_stage("sphere tracing");
    take_stage("joint search");
  }
  const SurfaceFindingCounts joint = surface_finder.counts();

  PointRootFinder finder(device, networks, settings.points);
  Buffer targets(device, "search bench: points", padded_points(settings.points) * 16ull, BufferPlace::device), canonical(device, "search bench: correspondences", padded_points(settings.points) * 16ull, BufferPlace::device);
  device.upload(targets.slice(), points_at_surface(avatar.body, pose, settings.points, generator));
  std::vector<double> by_clock;
  for (uint32_t i = 0; i <= settings.repetitions; ++i) {
    if (progress) progress(0.5 + 0.5 * i / (settings.repetitions + 1));
    device.profiler().reset();
    finder.reset_counts();
    const auto start = std::chrono::steady_clock::now();
    finder.solve(commands, frame, settings.points, targets.slice(), canonical.slice(), {});
    if (i > 0) by_clock.push_back(milliseconds_since(start));
    if (i > 0) take_stage("correspondence search");
  }
  const RootFindingCounts point = finder.counts();

  const auto bench = [&](const std::string& name, uint64_t searches, uint64_t steps, uint64_t converged) {
    SearchBench result{name, searches, searches ? double(steps) / double(searches) : 0, searches ? double(converged) / double(searches) : 0, 0, 0};
    const auto found = times.find(name);
    if (found == times.end()) return result;
    result.milliseconds = median(found->second);
    result.gflops = costs[name].flops / (result.milliseconds * 1e6);
    return result;
  };
  std::vector<SearchBench> all{bench("sphere tracing", rays, 0, 0), bench("joint search", joint.rays, joint.steps, joint.hits), bench("correspondence search", point.points, point.steps, point.converged)};
  all.back().milliseconds = median(by_clock);
  return all;
}

std::string search_bench_table(const std::vector<SearchBench>& searches) {
  std::string text = fmt::format("{:<24}{:>10}{:>12}{:>12}{:>12}{:>10}\n", "search", "searches", "steps each", "converged", "ms", "GFLOP/s");
  for (const SearchBench& search : searches)
    text += fmt::format("{:<24}{:>10}{:>12}{:>12}{:>12.1f}{:>10.1f}\n", search.name, search.searches, search.steps > 0 ? fmt::format("{:.2f}", search.steps) : "",
                        search.converged > 0 ? fmt::format("{:.2f} %", 100 * search.converged) : "", search.milliseconds, search.gflops);
  return text;
}

}  // namespace arah

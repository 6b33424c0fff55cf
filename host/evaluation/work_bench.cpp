#include "host/evaluation/work_bench.h"

#include <fmt/format.h>

#include <algorithm>
#include <numeric>
#include <stdexcept>

#include "host/evaluation/bench_subject.h"
#include "host/evaluation/mesh_extraction.h"
#include "host/evaluation/timed_launches.h"
#include "host/rendering/renderer.h"
#include "host/training/trainer.h"

namespace arah {
namespace {

// The stages as they follow each other; a step and a picture have those that they launch.
const std::vector<std::string>& stage_order() {
  static const std::vector<std::string> order{"weights", "rays", "sphere tracing", "joint search", "correspondence search", "distances", "shading", "compositing",
                                              "losses", "compositing backward", "shading backward", "skinning backward", "mask loss", "regularisers", "watch", "optimiser", "meshing"};
  return order;
}

// Times of `run`, after `warm_up` runs that do not count.
WorkBench measure_work(Device& device, const std::string& name, const std::string& description, uint32_t warm_up, uint32_t timed, uint32_t profiled, const std::function<void()>& run) {
  WorkBench bench{name, description, 0, 0, 0, {}, {}, {}};
  const ProfileScope scope(device);
  const bool timestamps = device.profiler().enabled;
  device.profiler().enabled = false;
  for (uint32_t i = 0; i < warm_up; ++i) run();
  std::vector<double> milliseconds;
  for (uint32_t i = 0; i < timed; ++i) {
    const auto start = std::chrono::steady_clock::now();
    run();
    milliseconds.push_back(milliseconds_since(start));
  }
  bench.mean_milliseconds = std::accumulate(milliseconds.begin(), milliseconds.end(), 0.0) / timed;
  bench.median_milliseconds = median(milliseconds);
  if (!timestamps) return bench;

  device.profiler().enabled = true;
  std::vector<Profiler> profiles;
  for (uint32_t i = 0; i < profiled; ++i) {
    device.profiler().reset();
    run();
    profiles.push_back(device.profiler());
  }
  bench.profiled = profiled;
  bench.stages = median_lines(profiles, &Profiler::stages, name);
  const auto place = [](const BenchLine& line) { return std::find(stage_order().begin(), stage_order().end(), line.name); };
  std::stable_sort(bench.stages.begin(), bench.stages.end(), [&](const BenchLine& a, const BenchLine& b) { return place(a) < place(b); });
  bench.launches = median_lines(profiles, &Profiler::launches, "");
  std::stable_sort(bench.launches.begin(), bench.launches.end(), [](const BenchLine& a, const BenchLine& b) { return a.milliseconds > b.milliseconds; });
  bench.shaders = median_lines(profiles, &Profiler::shaders, name);
  return bench;
}

class Works {
 public:
  Works(Device& device, const WorkBenchSettings& settings, const std::function<void(const std::string&)>& progress) : device_(device), settings_(settings), progress_(progress) {}

  std::vector<WorkBench> run() {
    const TrainingSettings tiny = step_settings("tiny");
    const Avatar plain = fitted(preset_spec("tiny"), tiny);
    train("training step", fmt::format("preset tiny, {} rays x {} samples", tiny.rays, tiny.sampling.samples), plain, tiny, settings_.warm_up, settings_.steps, settings_.profiled_steps);

    AvatarSpec by_pose = preset_spec("tiny");
    by_pose.sdf.pose = PoseConditioning::low_rank;
    by_pose.sdf.pose_width = 16;
    by_pose.sdf.pose_hidden_layers = 1;
    train("step by pose, low rank", "preset tiny, the SDF following the pose by changes of rank 16", fitted(by_pose, tiny), tiny, settings_.warm_up, settings_.steps, settings_.profiled_steps);

    // The parts of the preset paper in the sizes of tiny: 64 samples around surfaces, code and pose for the SDF, view and normal
    // for the colour.
    TrainingSettings papers = step_settings("paper");
    papers.rays = 128;
    papers.view_augmentation = 1;  // in every step, so that each takes the same
    papers.eikonal_points = papers.off_surface_points = papers.inside_points = papers.skinning_points = 256;
    AvatarSpec spec = preset_spec("tiny");
    spec.sdf.conditioning = SdfConditioning::latent;
    spec.sdf.mapping_width = 64;
    spec.sdf.mapping_hidden_layers = 2;
    spec.sdf.pose = PoseConditioning::hypernetwork;
    spec.sdf.pose_width = 64;
    spec.sdf.pose_hidden_layers = 2;
    spec.color.skip = 2;
    spec.color.narrow = 32;
    spec.color.view = spec.color.normal = true;
    const Avatar rich = fitted(spec, papers);
    train("paper's step", fmt::format("sampled as preset paper, {} rays x {} samples, views rotated", papers.rays, papers.sampling.samples), rich, papers, 1, settings_.repetitions, settings_.repetitions);

    AvatarSpec radiance = preset_spec("tiny");
    radiance.sdf.kind = FieldKind::density;
    train("step of a density", fmt::format("preset tiny with sdf.kind density, {} rays x {} samples", tiny.rays, tiny.sampling.samples), fitted(radiance, tiny), tiny, 1, settings_.repetitions, settings_.repetitions);

    AvatarSpec backward = preset_spec("tiny");
    backward.skinning.kind = Skinning::backward;
    train("step, backward skinning", fmt::format("preset tiny with skinning.kind backward, {} rays x {} samples", tiny.rays, tiny.sampling.samples), fitted(backward, tiny), tiny, 1, settings_.repetitions, settings_.repetitions);

    TrainingSettings of_surface = papers;
    of_surface.rendering = Rendering::surface;
    train("surface step", fmt::format("surface rendering, {} rays, mask loss of {} samples a ray", of_surface.rays, of_surface.mask_samples), rich, of_surface, 1, settings_.repetitions, settings_.repetitions);

    picture("picture, paper", "64 samples around surfaces, with normals", rich, "paper");
    picture("picture, balanced", "32 samples in the shell, correspondences and distances from grids", plain, "balanced");
    picture("picture, fast", "20 samples in the shell, correspondences and distances from grids, one colour a ray", plain, "fast");
    picture("picture, three starts", "as the first, each correspondence searched from three starts", rich, "paper", [](RootFindingSettings& root) { root.initialisations = 3; });
    picture("picture, rescued roots", "as the first, each correspondence searched by two steps of Broyden's method and, where that does not do, by damped Newton", rich, "paper", [](RootFindingSettings& root) {
      root.max_iterations = 2;
      root.rescue_steps = 10;
    });
    AvatarSpec simple = preset_spec("tiny");
    simple.skinning = {Skinning::template_weights, 0, 0};
    picture("picture, template weights", "64 samples around surfaces, no skinning network", fitted(simple, papers), "paper");
    mesh("surface mesh", plain, 0.004);
    return std::move(benches_);
  }

 private:
  TrainingSettings step_settings(const std::string& preset) const { return bench_step_settings(preset, settings_.fit_steps, settings_.fit_skinning_steps); }
  Avatar fitted(const AvatarSpec& spec, const TrainingSettings& training) { return bench_avatar(device_, capture_, spec, training); }

  void start(const std::string& name) {
    if (progress_) progress_(name);
  }

  void train(const std::string& name, const std::string& description, const Avatar& avatar, const TrainingSettings& training, uint32_t warm_up, uint32_t timed, uint32_t profiled) {
    start(name);
    Trainer trainer(device_, capture_, avatar, training);
    uint64_t left = uint64_t(warm_up) + timed + profiled;
    benches_.push_back(measure_work(device_, name, description, warm_up, timed, profiled, [&] { trainer.step(left--); }));
  }

  void picture(const std::string& name, const std::string& description, const Avatar& avatar, const std::string& preset, const std::function<void(RootFindingSettings&)>& change = {}) {
    start(name);
    RenderSettings render = render_preset(avatar, preset);
    if (change) change(render.sampling->root);
    render.normals = preset == "paper";
    Renderer renderer(device_, avatar, render);
    const Camera camera = capture_.cameras[0].scaled(settings_.picture_size);
    const MotionFrame& frame = motion_of(capture_, "train").frames.front();
    benches_.push_back(measure_work(device_, name, fmt::format("{0} x {0} pixels, {1}", settings_.picture_size, description), 1, settings_.repetitions, settings_.repetitions,
                                    [&] { renderer.render(camera, frame.pose, latent_row(avatar, frame.number)); }));
  }

  // From the network to the mesh with its skinning weights.
  void mesh(const std::string& name, const Avatar& avatar, double cell) {
    start(name);
    const MotionFrame& frame = motion_of(capture_, "train").frames.front();
    MeshSettings meshing;
    meshing.cell = cell;
    benches_.push_back(measure_work(device_, name, fmt::format("marching cubes of {:g} mm, asked for from coarse to fine, and skinning weights", 1000 * cell), 1, settings_.repetitions, settings_.repetitions,
                                    [&] { MeshExtraction(device_, avatar, meshing).mesh(frame.pose, latent_row(avatar, frame.number)); }));
  }

  Device& device_;
  const WorkBenchSettings& settings_;
  const std::function<void(const std::string&)>& progress_;
  BenchCapture subject_;
  const Capture& capture_ = subject_.capture();
  std::vector<WorkBench> benches_;
};

}  // namespace

std::vector<WorkBench> run_work_bench(Device& device, const WorkBenchSettings& settings, const std::function<void(const std::string&)>& progress) {
  if (settings.steps == 0 || settings.repetitions == 0) throw std::invalid_argument("work bench: nothing to time");
  return Works(device, settings, progress).run();
}

}  // namespace arah

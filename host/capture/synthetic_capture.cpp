#include "host/capture/synthetic_capture.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <fstream>
#include <mutex>
#include <nlohmann/json.hpp>
#include <numbers>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <random>
#include <vector>

#include "host/body/motion.h"
#include "host/capture/camera.h"
#include "host/capture/figure_texture.h"
#include "host/capture/parallel_jobs.h"
#include "host/capture/software_renderer.h"
#include "host/capture/synthetic_figure.h"
#include "host/capture/synthetic_motion.h"
#include "host/capture/whole_folder.h"
#include "host/input_error.h"

namespace arah {

namespace {

namespace fs = std::filesystem;

constexpr int kTrainingCameras = 4;
constexpr int kHeldOutImageStep = 6;  // held-out cameras see every 6th training frame
constexpr int kTrainMeshStep = 12, kNovelMeshStep = 6;
constexpr double kLagInterval = 1.0 / 30.0;  // s, over which the velocity that clothes lag behind is taken
constexpr const char* kMarker = "synthetic.json";

void check(const SyntheticSettings& settings) {
  const auto in_range = [](const char* name, int value, int low, int high) {
    if (value < low || value > high)
      throw InputError("synthetic capture", name, fmt::format("{} to {}", low, high), fmt::format("{}", value));
  };
  in_range("frames", settings.frames, 1, 10000);
  in_range("size", settings.size, 16, 4096);
  if (settings.body_seed && !settings.rig.empty())
    throw InputError("synthetic capture", "body_seed", "0 with a rig: it varies the built-in figure", fmt::format("{}", settings.body_seed));
}

// Looks from `eye` at `target`, +Z up.
Camera look_at(const std::string& name, bool training, const glm::dvec3& eye, const glm::dvec3& target, double focal,
               int size) {
  const glm::dvec3 forward = glm::normalize(target - eye);
  const glm::dvec3 right = glm::normalize(glm::cross(forward, glm::dvec3(0, 0, 1)));
  const glm::dvec3 down = glm::cross(forward, right);
  Camera camera;
  camera.name = name;
  camera.role = training ? "train" : "test";
  camera.width = camera.height = size;
  camera.R = glm::transpose(glm::dmat3(right, down, forward));
  camera.T = -(camera.R * eye);
  camera.K = glm::dmat3(1.0);
  camera.K[0][0] = camera.K[1][1] = focal;
  camera.K[2] = {0.5 * (size - 1), 0.5 * (size - 1), 1.0};
  return camera;
}

// Four cameras around at chest height, four between them higher and lower. Distance, aim and intrinsics differ a little
// from camera to camera, as in a real room; the figure (with arms overhead) fills most of the picture.
std::vector<Camera> make_cameras(const ClothedFigure& figure, int size, std::uint64_t seed) {
  std::mt19937_64 random(seed + 77);
  const auto vary = [&](double range) { return range * (2.0 * static_cast<double>(random() >> 11) * 0x1p-53 - 1.0); };
  const double held_out_height[4] = {0.32, -0.11, 0.22, -0.01};  // above the middle, in distances
  std::vector<Camera> cameras;
  for (int c = 0; c < 2 * kTrainingCameras; ++c) {
    const bool training = c < kTrainingCameras;
    const int place = c % kTrainingCameras;
    const double turn = 2 * std::numbers::pi * (place + (training ? 0.0 : 0.5)) / kTrainingCameras + vary(0.08);
    const double distance = figure.camera_distance * (1.0 + vary(0.04));
    const double height = figure.camera_distance * (training ? 0.07 + vary(0.05) : held_out_height[place]);
    const glm::dvec3 target(distance * vary(0.01), distance * vary(0.01),
                            figure.middle_height + distance * vary(0.007));
    const glm::dvec3 eye =
        glm::dvec3(distance * std::sin(turn), -distance * std::cos(turn), figure.middle_height + height);
    Camera camera = look_at(fmt::format("cam_{:02d}", c), training, eye, target, size * (1.28 + vary(0.02)), size);
    camera.K[1][1] *= 1.0 + vary(0.002);
    camera.K[2][0] += size * vary(0.015);
    camera.K[2][1] += size * vary(0.015);
    cameras.push_back(camera);
  }
  return cameras;
}

void write_bytes(const fs::path& path, const void* data, std::size_t size) {
  std::ofstream file(path, std::ios::binary);
  file.write(static_cast<const char*>(data), static_cast<std::streamsize>(size));
  file.close();
  if (!file) throw std::runtime_error(fmt::format("{}: cannot be written", path.string()));
}

void write_png(const fs::path& path, RgbaPicture picture) {
  cv::Mat image(picture.height, picture.width, CV_8UC4, picture.rgba.data());
  cv::cvtColor(image, image, cv::COLOR_RGBA2BGRA);
  std::vector<unsigned char> bytes;
  cv::imencode(".png", image, bytes);
  write_bytes(path, bytes.data(), bytes.size());
}

template <typename T>
void append_bytes(std::string& bytes, const T& value) {
  char raw[sizeof(T)];
  std::memcpy(raw, &value, sizeof(T));
  bytes.append(raw, sizeof(T));
}

void write_ply(const fs::path& path, const ClothedFigure& figure, const PosedSurface& surface) {
  std::string bytes = fmt::format(
      "ply\nformat binary_little_endian 1.0\n"
      "comment clothed ground truth, metres, world Z-up; part: 0 skin 1 garment 2 shoes 3 hair\n"
      "element vertex {}\nproperty float x\nproperty float y\nproperty float z\n"
      "element face {}\nproperty list uchar int vertex_indices\nproperty uchar part\nend_header\n",
      surface.positions.size(), figure.triangles.size());
  for (const glm::vec3& p : surface.positions)
    for (int k = 0; k < 3; ++k) append_bytes(bytes, p[k]);
  for (const glm::uvec3& t : figure.triangles) {
    append_bytes(bytes, std::uint8_t{3});
    for (int k = 0; k < 3; ++k) append_bytes(bytes, static_cast<std::int32_t>(t[k]));
    append_bytes(bytes, static_cast<std::uint8_t>(ground_truth_part(figure.layers[t.x])));
  }
  write_bytes(path, bytes.data(), bytes.size());
}

RgbaPicture draw(const ClothedFigure& figure, const PosedSurface& surface, const Palette& palette,
                 const Camera& camera) {
  const auto shade = [&](const SurfaceSample& sample) {
    const glm::uvec3& t = figure.triangles[sample.triangle];
    const glm::vec3& w = sample.barycentric;
    const glm::vec3 rest = w.x * figure.rest[t.x] + w.y * figure.rest[t.y] + w.z * figure.rest[t.z];
    const glm::vec3 tint = w.x * figure.tint[t.x] + w.y * figure.tint[t.y] + w.z * figure.tint[t.z];
    glm::vec3 normal = w.x * surface.normals[t.x] + w.y * surface.normals[t.y] + w.z * surface.normals[t.z];
    const float length = glm::length(normal);
    normal = length > 0 ? normal / length : -sample.view_direction;
    const glm::vec3 face =
        glm::cross(surface.positions[t.y] - surface.positions[t.x], surface.positions[t.z] - surface.positions[t.x]);
    const bool inner_side = glm::dot(face, sample.view_direction) > 0;
    const glm::vec3 color =
        lit(surface_color(palette, figure.layers[t.x], figure.average_place(rest), tint), inner_side ? -normal : normal);
    return inner_side ? 0.55f * color : color;  // the inside of a sleeve or a leg gets little light
  };
  return rasterise(camera, surface.positions, figure.triangles, shade);
}

struct Job {
  SyntheticSplit split;
  std::size_t index;  // into the motion's frames
  double seconds;
};

// Everything but the pictures and meshes of the frames.
struct Scene {
  ClothedFigure figure;
  Palette palette;
  std::vector<Camera> cameras;
  Motion train, novel;
  std::vector<Job> jobs;
};

Scene make_scene(const SyntheticSettings& settings) {
  Scene scene;
  scene.figure =
      settings.rig.empty() ? make_clothed_figure(settings.seed, varied_figure(settings.body_seed)) : dress_rig(read_body_template(settings.rig));
  scene.palette = make_palette(settings.seed);
  scene.cameras = make_cameras(scene.figure, settings.size, settings.seed);
  int number = 0;
  const auto fill = [&](Motion& motion, const char* name, SyntheticSplit split, int frames) {
    motion.split = name;
    motion.skeleton = scene.figure.body.skeleton;
    for (int i = 0; i < frames; ++i) {
      const double seconds = kSyntheticMotionSeconds * i / frames;
      motion.frames.push_back({number++, synthetic_pose(scene.figure, split, seconds, settings.seed),
                               fmt::format("synthetic {} at {:.3f} s", name, seconds)});
      scene.jobs.push_back({split, static_cast<std::size_t>(i), seconds});
    }
  };
  fill(scene.train, "train", SyntheticSplit::kTrain, settings.frames);
  fill(scene.novel, "novel", SyntheticSplit::kNovel, std::max(1, settings.frames / 3));
  return scene;
}

void write_frame(const fs::path& folder, const Scene& scene, const Job& job, std::uint64_t seed) {
  const bool train = job.split == SyntheticSplit::kTrain;
  const Motion& motion = train ? scene.train : scene.novel;
  const MotionFrame& frame = motion.frames[job.index];
  const Pose before = synthetic_pose(scene.figure, job.split, job.seconds - kLagInterval, seed);
  const PosedSurface surface = pose_surface(scene.figure, frame.pose, before, kLagInterval);
  for (const Camera& camera : scene.cameras) {
    if (train && camera.role != "train" && job.index % kHeldOutImageStep != 0) continue;
    write_png(folder / "images" / motion.split / camera.name / fmt::format("{:06d}.png", frame.number),
              draw(scene.figure, surface, scene.palette, camera));
  }
  if (job.index % static_cast<std::size_t>(train ? kTrainMeshStep : kNovelMeshStep) == 0)
    write_ply(folder / "meshes" / fmt::format("{}_{:06d}.ply", motion.split, frame.number), scene.figure, surface);
}

std::string marker_text(const SyntheticSettings& settings) {
  nlohmann::json marker = {{"generator", "arah synth"},
                                 {"frames", settings.frames},
                                 {"size", settings.size},
                                 {"seed", settings.seed},
                                 {"rig", settings.rig.filename().string()},
                                 {"poses", "exact"}};
  if (settings.body_seed) marker["body_seed"] = settings.body_seed;
  return marker.dump(1) + "\n";
}

void write_contents(const fs::path& folder, const Scene& scene, const SyntheticSettings& settings,
                    const SyntheticProgress& report) {
  for (const char* split : {"train", "novel"})
    for (const Camera& camera : scene.cameras) fs::create_directories(folder / "images" / split / camera.name);
  fs::create_directories(folder / "meshes");
  write_body_template(folder / "template.glb", settings.rig.empty() ? body_with_shape(scene.figure, varied_figure(settings.body_seed).build) : scene.figure.body);
  write_cameras(folder / "cameras.json", scene.cameras);
  write_motion(folder / "motion_train.json", scene.train);
  write_motion(folder / "motion_novel.json", scene.novel);
  std::size_t done = 0;
  std::mutex done_mutex;
  run_jobs(scene.jobs.size(), [&](std::size_t i) {
    write_frame(folder, scene, scene.jobs[i], settings.seed);
    const std::lock_guard lock(done_mutex);
    ++done;
    if (report)
      report(static_cast<double>(done) / static_cast<double>(scene.jobs.size()),
             fmt::format("frame {} of {}", done, scene.jobs.size()));
  });
}

}  // namespace

void write_synthetic_capture(const fs::path& out, const SyntheticSettings& settings,
                             const SyntheticProgress& progress) {
  check(settings);
  WholeFolder folder(out, kMarker, "synthetic capture");
  if (progress) progress(0.0, "building the figure");
  const Scene scene = make_scene(settings);
  folder.start(marker_text(settings));
  write_contents(folder.partial(), scene, settings, progress);
  folder.finish();
}

}  // namespace arah

#include "host/capture/import_capture.h"

#include <fmt/ranges.h>

#include <algorithm>
#include <limits>
#include <map>
#include <mutex>
#include <nlohmann/json.hpp>
#include <opencv2/imgcodecs.hpp>
#include <set>

#include "host/body/body_template.h"
#include "host/body/motion.h"
#include "host/body/smpl_file.h"
#include "host/body/smpl_joints.h"
#include "host/capture/dataset.h"
#include "host/capture/frame_reader.h"
#include "host/capture/imported_picture.h"
#include "host/capture/parallel_jobs.h"
#include "host/capture/whole_folder.h"
#include "host/file_writing.h"

namespace arah {
namespace {

namespace fs = std::filesystem;

constexpr const char* kMarkerName = "import.json";
constexpr std::size_t kFramesTogether = 16;  // 75 MB of 1080x1080

struct Layout {
  const char* name;
  Dataset (*read)(const fs::path& folder);
};
constexpr Layout kLayouts[] = {{"zju-mocap", read_zju_mocap}, {"h36m", read_h36m}, {"easymocap", read_easymocap}, {"people-snapshot", read_people_snapshot}};

// One picture to write.
struct PictureJob {
  const DatasetPicture* picture = nullptr;
  std::string split;
  int frame = 0;
  PictureTreatment treatment;
};

// What will be written, all of it known before the first picture is.
struct ImportPlan {
  Dataset dataset;
  SplitPlan splits;
  std::vector<std::size_t> cameras;  // of the dataset that the capture has
  std::map<std::string, Motion> motions;
  std::vector<PictureJob> jobs;
  BodyTemplate body;
  ImportReport report;
};

Dataset read_dataset(const ImportSettings& settings) {
  if (!fs::is_directory(settings.in)) throw InputError(settings.in.string(), "", "the folder of a sequence", "no folder");
  for (const Layout& layout : kLayouts) {
    if (settings.layout == layout.name) return layout.read(settings.in);
  }
  throw InputError("arah import", "layout", fmt::format("one of {}", fmt::join(import_layouts(), ", ")), "'" + settings.layout + "'");
}

SplitPlan choose_splits(const ImportSettings& settings, const Dataset& dataset, ImportReport& report) {
  SplitPlan plan;
  const DatasetPreset* preset = nullptr;
  if (!settings.preset.empty()) {
    preset = &dataset_preset(settings.preset);
    if (preset->layout != settings.layout) {
      throw InputError("--split", "", "a preset of " + settings.layout, fmt::format("'{}', one of {}", preset->name, preset->layout));
    }
  } else if (settings.ranges.empty()) {
    for (const DatasetPreset& candidate : dataset_presets()) {
      if (candidate.layout == settings.layout && candidate.sequence == dataset.sequence) preset = &candidate;
    }
  }
  if (preset) {
    plan = preset->plan;
    report.preset = preset->name;
  }
  if (!settings.ranges.empty()) plan.ranges = settings.ranges;
  if (!settings.train_cameras.empty()) {
    plan.train_cameras = settings.train_cameras;
    plan.test_cameras.clear();
  }
  if (settings.border >= 0) plan.training_band = settings.border;
  if (plan.ranges.empty()) {
    plan.ranges = {{"train", 0, std::numeric_limits<int>::max(), 1}};
    report.notes.push_back("No published split is known for this sequence: all frames are for training. --frames and --train-cameras choose.");
  }
  return plan;
}

bool named_in(const std::vector<std::string>& words, const std::string& camera) {
  return std::any_of(words.begin(), words.end(), [&](const std::string& word) { return camera_is(camera, word); });
}

// Roles of the dataset's cameras, and which of them the capture has.
void choose_cameras(ImportPlan& plan) {
  const SplitPlan& splits = plan.splits;
  std::vector<std::string> names;
  for (std::size_t c = 0; c < plan.dataset.cameras.size(); ++c) {
    Camera& camera = plan.dataset.cameras[c];
    names.push_back(camera.name);
    const bool trains = splits.train_cameras.empty() || named_in(splits.train_cameras, camera.name);
    camera.role = trains ? "train" : "test";
    if (trains || splits.test_cameras.empty() || named_in(splits.test_cameras, camera.name)) plan.cameras.push_back(c);
  }
  const auto absent = [&](const std::string& word) {
    return std::none_of(names.begin(), names.end(), [&](const std::string& name) { return camera_is(name, word); });
  };
  for (const std::string& word : splits.train_cameras) {
    if (!absent(word)) continue;
    // A published split may be of more cameras than were downloaded.
    if (plan.report.preset.empty()) throw InputError("cameras", word, fmt::format("one of {}", fmt::join(names, ", ")), "no camera of that name");
    plan.report.notes.push_back(fmt::format("Camera {} of the split, for training, is not in the sequence.", word));
  }
  for (const std::string& word : splits.test_cameras) {
    if (absent(word)) plan.report.notes.push_back(fmt::format("Camera {} of the split is not in the sequence.", word));
  }
}

// The body: a rig as it is, or a model of the SMPL family in the shape that the sequence's first fit states, for the poses that are
// learnt from.
void read_body(ImportPlan& plan, const ImportSettings& settings) {
  if (!is_smpl_file(settings.body)) {
    plan.body = read_body_template(settings.body);
    return;
  }
  std::optional<std::vector<double>> betas;
  std::vector<std::vector<glm::dvec3>> poses;
  for (const DatasetFrame& frame : plan.dataset.frames) {
    const bool learnt = std::any_of(plan.splits.ranges.begin(), plan.splits.ranges.end(), [&](const FrameRange& range) { return range.split == "train" && range.has(frame.number); });
    if ((betas && !learnt) || !has_fit(frame)) continue;
    BodyFit fit = fit_of(frame);
    if (!betas) betas = fit.shapes;
    if (learnt) poses.push_back(std::move(fit.poses));
  }
  SmplBody smpl = read_smpl_body(settings.body, betas.value_or(std::vector<double>{}), poses);
  plan.body = std::move(smpl.body);
  plan.report.notes.insert(plan.report.notes.end(), smpl.notes.begin(), smpl.notes.end());
}

// A dataset's pose in the order and with the names of SMPL's joints, as poses of the body's rig.
Motion empty_motion(const std::string& split, const BodyTemplate& body, std::size_t joints, const std::string& where) {
  Motion motion;
  motion.split = split;
  motion.skeleton.names = smpl_joint_names(joints, where);
  motion.skeleton.parents = smpl_joint_parents(joints, where);
  motion.skeleton.rest_joints.assign(joints, glm::dvec3(0.0));
  motion.skeleton.rest_joints[0] = body.skeleton.rest_joints[0];
  return motion;
}

PictureTreatment treatment_of(const ImportPlan& plan, const ImportSettings& settings, const Camera& camera, bool training) {
  PictureTreatment treatment;
  treatment.resize = plan.dataset.resize_pictures;
  treatment.width = settings.size;
  if (training && camera.role == "train") treatment.band = plan.splits.training_band;
  if (camera.role == "test") treatment.grow = plan.splits.evaluation_band;
  return treatment;
}

// Poses and pictures of every split.
void choose_frames(ImportPlan& plan, const ImportSettings& settings) {
  std::vector<int> without_body;
  std::size_t missing = 0;
  double varies = 0;
  std::vector<double> shapes;
  std::map<std::string, Motion> motions;
  for (const FrameRange& range : plan.splits.ranges) {
    const bool training = range.split == "train";
    for (const DatasetFrame& frame : plan.dataset.frames) {
      if (!range.has(frame.number)) continue;
      if (!has_fit(frame)) {
        without_body.push_back(frame.number);
        continue;
      }
      const BodyFit fit = fit_of(frame);
      if (shapes.empty()) shapes = fit.shapes;
      for (std::size_t i = 0; i < std::min(shapes.size(), fit.shapes.size()); ++i) varies = std::max(varies, std::abs(shapes[i] - fit.shapes[i]));
      Motion& motion = motions.try_emplace(range.split, empty_motion(range.split, plan.body, fit.poses.size(), frame.fit.string())).first->second;
      if (find_frame(motion, frame.number)) throw InputError("--frames", range.split, "each frame once", fmt::format("frame {} twice", frame.number));
      if (motion.skeleton.size() != fit.poses.size()) throw InputError(frame.fit.string(), "poses", "as many joints as in other frames", fmt::format("{}", fit.poses.size()));
      motion.frames.push_back({frame.number, pose_of_fit(fit, plan.body.skeleton.rest_joints[0]), plan.dataset.sequence});
      const bool held_out_see = !training || (frame.number - range.first) % (range.step * plan.splits.held_out_step) == 0;
      for (const DatasetPicture& picture : frame.pictures) {
        const Camera& camera = plan.dataset.cameras[picture.camera];
        const bool has = std::find(plan.cameras.begin(), plan.cameras.end(), picture.camera) != plan.cameras.end();
        const bool wanted = camera.role == "test" ? held_out_see : training || !plan.splits.only_held_out;
        if (!has || !wanted) continue;
        if (!fs::is_regular_file(picture.image) || !fs::is_regular_file(picture.mask)) {
          ++missing;
          continue;
        }
        plan.jobs.push_back({&picture, range.split, frame.number, treatment_of(plan, settings, camera, training)});
      }
    }
  }
  // A video is decoded from its first frame to its last.
  std::stable_sort(plan.jobs.begin(), plan.jobs.end(), [](const PictureJob& a, const PictureJob& b) { return a.picture->image_frame < b.picture->image_frame; });
  for (auto& [split, motion] : motions) {
    motion.poses = settings.exact_poses ? "exact" : "estimated";
    plan.motions.emplace(split, adapt_motion(motion, plan.body.skeleton, settings.body.string()));
  }
  if (plan.jobs.empty()) {
    throw InputError(settings.in.string(), "", "frames of the split with a body, pictures and masks",
                     fmt::format("{} frames, none of them with all three", plan.dataset.frames.size()));
  }
  std::vector<std::string>& notes = plan.report.notes;
  if (!without_body.empty()) notes.push_back(fmt::format("{} frames have no fitted body and are left out, the first of them frame {}.", without_body.size(), without_body[0]));
  if (missing > 0) notes.push_back(fmt::format("{} pictures have no file or no mask and are left out.", missing));
  if (!is_smpl_file(settings.body) && std::any_of(shapes.begin(), shapes.end(), [](double beta) { return beta != 0; })) {
    notes.push_back(fmt::format("The sequence gives shape coefficients; {} is taken as it is, so it must have the subject's shape.", settings.body.filename().string()));
  }
  if (varies > 1e-3) notes.push_back(fmt::format("The sequence's shape coefficients differ by up to {:.3g} between frames.", varies));
}

ImportPlan make_plan(const ImportSettings& settings) {
  if (settings.body.empty()) {
    throw InputError("--body", "", "the body that the sequence's poses are for", "none", "The layout has poses but no body: give a skinned .glb, or SMPL's own file.");
  }
  ImportPlan plan;
  plan.dataset = read_dataset(settings);
  plan.report.notes = plan.dataset.notes;
  plan.splits = choose_splits(settings, plan.dataset, plan.report);
  read_body(plan, settings);
  choose_cameras(plan);
  for (const std::size_t c : plan.cameras) {
    const Camera& camera = plan.dataset.cameras[c];
    if (camera.width == 0) throw InputError(settings.in.string(), fmt::format("camera '{}'", camera.name), "at least one picture", "none");
    check_camera(camera, settings.in.string());
    if (settings.size > camera.width) {
      throw InputError("--size", "", fmt::format("at most {} columns, as camera '{}' has", camera.width, camera.name), fmt::format("{}", settings.size));
    }
  }
  choose_frames(plan, settings);
  plan.report.pictures = plan.jobs.size();
  return plan;
}

std::string import_marker(const ImportPlan& plan, const ImportSettings& settings) {
  nlohmann::ordered_json marker = {{"generator", "arah import"}, {"layout", settings.layout}, {"sequence", plan.dataset.sequence}, {"split", plan.report.preset}};
  for (const FrameRange& range : plan.splits.ranges) marker["frames"].push_back(fmt::format("{}={}:{}:{}", range.split, range.first, range.end, range.step));
  marker["size"] = settings.size;
  marker["training_band"] = plan.splits.training_band;
  marker["evaluation_band"] = plan.splits.evaluation_band;
  marker["body"] = settings.body.filename().string();
  marker["notes"] = plan.report.notes;
  return marker.dump(1, ' ', false, nlohmann::json::error_handler_t::replace) + "\n";
}

void write_png_file(const fs::path& path, const cv::Mat& picture) {
  std::vector<std::uint8_t> bytes;
  cv::imencode(".png", picture, bytes);
  write_file_safely(path, bytes);
}

void write_pictures(const ImportPlan& plan, const fs::path& folder, const std::function<bool(std::size_t, std::size_t)>& progress) {
  const auto folder_of = [&](const char* kind, const PictureJob& job) {
    return folder / kind / job.split / plan.dataset.cameras[job.picture->camera].name;
  };
  std::set<fs::path> folders;
  for (const PictureJob& job : plan.jobs) {
    folders.insert(folder_of("images", job));
    if (job.treatment.band > 0) folders.insert(folder_of("borders", job));
  }
  for (const fs::path& made : folders) fs::create_directories(made);
  std::mutex mutex;
  std::size_t done = 0;
  // What lies in one file for all frames is read in their order, some at a time; the rest is work for all cores.
  const bool in_order = std::any_of(plan.jobs.begin(), plan.jobs.end(), [](const PictureJob& job) { return job.picture->image_frame >= 0 || job.picture->mask_frame >= 0; });
  const std::size_t together = in_order ? kFramesTogether : plan.jobs.size();
  FrameReader frames;
  for (std::size_t first = 0; first < plan.jobs.size(); first += together) {
    std::vector<SourcePicture> sources(std::min(together, plan.jobs.size() - first));
    for (std::size_t i = 0; i < sources.size(); ++i) sources[i] = frames.read(*plan.jobs[first + i].picture);
    run_jobs(sources.size(), [&](std::size_t i) {
      const PictureJob& job = plan.jobs[first + i];
      const ImportedPicture picture = import_picture(std::exchange(sources[i], {}), plan.dataset.cameras[job.picture->camera], job.treatment);
      const std::string name = fmt::format("{:06}.png", job.frame);
      write_png_file(folder_of("images", job) / name, picture.bgra);
      if (!picture.border.empty()) write_png_file(folder_of("borders", job) / name, picture.border);
      const std::lock_guard lock(mutex);
      if (progress && !progress(++done, plan.jobs.size())) throw std::runtime_error("stopped; nothing was written");
    });
  }
}

}  // namespace

std::vector<std::string> import_layouts() {
  std::vector<std::string> names;
  for (const Layout& layout : kLayouts) names.emplace_back(layout.name);
  return names;
}

ImportReport import_capture(const ImportSettings& settings, const std::function<bool(std::size_t, std::size_t)>& progress) {
  WholeFolder folder(settings.out, kMarkerName, "imported capture");
  const ImportPlan plan = make_plan(settings);
  folder.start(import_marker(plan, settings));
  std::vector<Camera> cameras;
  for (const std::size_t c : plan.cameras) {
    Camera camera = plan.dataset.cameras[c];
    camera.distortion = {};
    cameras.push_back(settings.size > 0 ? camera.scaled(settings.size) : camera);
  }
  write_cameras(folder.partial() / "cameras.json", cameras);
  for (const auto& [split, motion] : plan.motions) write_motion(folder.partial() / fmt::format("motion_{}.json", split), motion);
  if (plan.body.glb.empty()) {
    write_body_template(folder.partial() / "template.glb", plan.body);
  } else {
    write_file_safely(folder.partial() / "template.glb", std::span(reinterpret_cast<const std::uint8_t*>(plan.body.glb.data()), plan.body.glb.size()));
  }
  write_pictures(plan, folder.partial(), progress);
  folder.finish();
  return plan.report;
}

}  // namespace arah

// The layout of People Snapshot, as published and as loaders prepare it.
#include <algorithm>
#include <array>

#include "host/body/npz.h"
#include "host/body/pickle.h"
#include "host/capture/dataset.h"
#include "host/capture/files_by_frame.h"
#include "host/capture/hdf5_file.h"
#include "host/capture/picture_file.h"
#include "host/capture/video_frames.h"
#include "host/input_error.h"

namespace arah {
namespace {

namespace fs = std::filesystem;

constexpr long kSnapshotJoints = 24;
// From the camera's axes, y down, to a world with +Z up: a quarter turn about x.
const glm::dmat3 kUpright{1.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 1.0, 0.0};
const glm::dvec3 kUprightTurn{-1.5707963267948966, 0.0, 0.0};  // the same as an axis-angle

Camera read_snapshot_camera(const fs::path& path) {
  const std::string where = path.string();
  if (!fs::is_regular_file(path)) throw InputError(where, "", "the camera of a sequence", "no such file", "Is this the sequence's own folder?");
  const PythonData file = read_pickle(path);
  const auto numbers = [&](const char* name, long count) { return python_numbers(python_member(*file.root, name, where, ""), count, where, name); };
  const auto size = [&](const char* name) {
    const std::int64_t pixels = python_integer(python_member(*file.root, name, where, ""), where, name);
    if (pixels < 1 || pixels > kLargestPicture) throw InputError(where, name, fmt::format("1 to {} pixels", kLargestPicture), fmt::format("{}", pixels));
    return static_cast<int>(pixels);
  };
  Camera camera;
  camera.name = "camera";
  camera.width = size("width");
  camera.height = size("height");
  const std::vector<double> f = numbers("camera_f", 2), c = numbers("camera_c", 2), k = numbers("camera_k", 5);
  camera.K = {f[0], 0.0, 0.0, 0.0, f[1], 0.0, c[0], c[1], 1.0};
  std::copy(k.begin(), k.end(), camera.distortion.begin());
  camera.R = glm::transpose(kUpright);
  // The published ones are 0, and loaders' files may lack them.
  if (python_find(*file.root, "camera_rt")) {
    const std::vector<double> turn = numbers("camera_rt", 3);
    camera.R = rotation_from_axis_angle({turn[0], turn[1], turn[2]}) * camera.R;
  }
  if (python_find(*file.root, "camera_t")) {
    const std::vector<double> shift = numbers("camera_t", 3);
    camera.T = {shift[0], shift[1], shift[2]};
  }
  return camera;
}

// 72 numbers of a pose and three of a place, in the camera's axes; nothing where the frame was not fitted.
std::optional<BodyFit> upright_fit(std::span<const double> pose, std::span<const double> trans, const std::vector<double>& betas) {
  const auto zero = [](double number) { return number == 0.0; };
  if (std::all_of(pose.begin(), pose.end(), zero) && std::all_of(trans.begin(), trans.end(), zero)) return std::nullopt;
  BodyFit fit;
  for (std::size_t j = 0; j < pose.size(); j += 3) fit.poses.emplace_back(pose[j], pose[j + 1], pose[j + 2]);
  fit.Rh = kUprightTurn;
  fit.Th = kUpright * glm::dvec3(trans[0], trans[1], trans[2]);
  fit.shapes = betas;
  return fit;
}

std::vector<std::optional<BodyFit>> reconstructed_poses(const fs::path& path) {
  const Hdf5File file(path);
  const std::vector<double> poses = file.numbers("pose", {-1, 3 * kSnapshotJoints}), betas = file.numbers("betas", {-1});
  const std::size_t count = poses.size() / (3 * kSnapshotJoints);
  const std::vector<double> trans = file.numbers("trans", {static_cast<long>(count), 3});
  std::vector<std::optional<BodyFit>> fits;
  for (std::size_t f = 0; f < count; ++f) {
    fits.push_back(upright_fit(std::span(poses).subspan(3 * kSnapshotJoints * f, 3 * kSnapshotJoints), std::span(trans).subspan(3 * f, 3), betas));
  }
  return fits;
}

std::optional<BodyFit> prepared_fit(const fs::path& path) {
  const std::string where = path.string();
  const NpzFile file(path);
  const auto numbers = [&](const char* name, long count) { return python_numbers(*file.read(name).root, count, where, name); };
  std::vector<double> pose;
  for (const auto& [name, count] : {std::pair("root_orient", 3L), std::pair("pose_body", 63L), std::pair("pose_hand", 6L)}) {
    const std::vector<double> part = numbers(name, count);
    pose.insert(pose.end(), part.begin(), part.end());
  }
  return upright_fit(pose, numbers("trans", 3), file.has("betas") ? numbers("betas", -1) : std::vector<double>{});
}

// One file a frame; their numbers must follow one another, so that those of two folders belong together.
std::vector<fs::path> numbered_files(const fs::path& folder, std::initializer_list<const char*> extensions) {
  std::vector<fs::path> files;
  int next = -1;
  for (const auto& [number, path] : files_by_frame(folder, extensions)) {
    if (next >= 0 && number != next) throw InputError(folder.string(), "", "a file for each frame, called by consecutive numbers", fmt::format("none for {}", next));
    files.push_back(path);
    next = number + 1;
  }
  return files;
}

// <name>.mp4 in the folder of that name, else the only one.
fs::path snapshot_video(const fs::path& folder, const std::string& sequence) {
  if (fs::is_regular_file(folder / (sequence + ".mp4"))) return folder / (sequence + ".mp4");
  std::vector<fs::path> videos;
  for (const auto& entry : fs::directory_iterator(folder)) {
    if (entry.path().extension() == ".mp4") videos.push_back(entry.path());
  }
  if (videos.size() == 1) return videos[0];
  throw InputError(folder.string(), sequence + ".mp4", "the sequence's video, or its frames in image/", videos.empty() ? "neither" : fmt::format("{} other videos", videos.size()));
}

}  // namespace

Dataset read_people_snapshot(const fs::path& folder) {
  Dataset dataset;
  dataset.sequence = fs::absolute(folder / ".").lexically_normal().parent_path().filename().string();
  dataset.cameras = {read_snapshot_camera(folder / "camera.pkl")};

  const fs::path poses = folder / "reconstructed_poses.hdf5";
  std::vector<std::optional<BodyFit>> fits;
  std::vector<fs::path> models;
  if (fs::is_regular_file(poses)) {
    fits = reconstructed_poses(poses);
  } else {
    models = numbered_files(folder / "models", {".npz"});
    for (const fs::path& model : models) fits.push_back(prepared_fit(model));
    if (fits.empty()) throw InputError(folder.string(), "reconstructed_poses.hdf5", "the bodies of the frames, or models/", "neither");
  }

  const std::vector<fs::path> images = numbered_files(folder / "image", {".jpg", ".jpeg", ".png"}), masks = numbered_files(folder / "mask", {".png"});
  const fs::path video = images.empty() ? snapshot_video(folder, dataset.sequence) : fs::path(), mask_file = folder / "masks.hdf5";
  std::size_t image_count = images.size(), mask_count = masks.size();
  if (images.empty()) image_count = VideoFrames(video).count(fits.size());
  if (masks.empty()) {
    if (!fs::is_regular_file(mask_file)) throw InputError(folder.string(), "masks.hdf5", "the masks of the frames, or mask/", "neither");
    mask_count = Hdf5File(mask_file).open_frames("masks", kLargestPicture).count;
  }
  const auto [fewest, most] = std::minmax({fits.size(), image_count, mask_count});
  const std::string counts = fmt::format("{} poses, {} pictures and {} masks", fits.size(), image_count, mask_count);
  if (most - fewest > 1) throw InputError(folder.string(), "frames", "as many poses as pictures and masks, or one more", counts);
  if (most != fewest) dataset.notes.push_back(fmt::format("The sequence has {}: the first {} of each are taken.", counts, fewest));

  for (std::size_t f = 0; f < fewest; ++f) {
    DatasetFrame frame;
    frame.number = static_cast<int>(f);
    frame.fit = models.empty() ? fs::path() : models[f];
    frame.fitted = std::move(fits[f]);
    DatasetPicture picture;
    picture.image = images.empty() ? video : images[f];
    picture.mask = masks.empty() ? mask_file : masks[f];
    if (images.empty()) picture.image_frame = frame.number;
    if (masks.empty()) picture.mask_frame = frame.number;
    frame.pictures.push_back(std::move(picture));
    dataset.frames.push_back(std::move(frame));
  }
  const bool female = dataset.sequence.starts_with("female"), male = dataset.sequence.starts_with("male");
  if (female || male) dataset.notes.push_back(fmt::format("By the folder's name the poses are of SMPL's {} model: --body should be that one.", female ? "female" : "male"));
  return dataset;
}

}  // namespace arah

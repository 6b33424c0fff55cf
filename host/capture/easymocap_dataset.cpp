// The layout of EasyMocap.
#include <fmt/ranges.h>

#include <algorithm>
#include <map>

#include "host/capture/dataset.h"
#include "host/capture/files_by_frame.h"
#include "host/capture/opencv_yaml.h"
#include "host/capture/picture_file.h"
#include "host/input_error.h"

namespace arah {
namespace {

namespace fs = std::filesystem;

fs::path one_of_folders(const fs::path& folder, std::initializer_list<const char*> names) {
  for (const char* name : names) {
    if (fs::is_directory(folder / name)) return folder / name;
  }
  throw InputError(folder.string(), "", fmt::format("a folder called {}", fmt::join(names, ", ")), "none");
}

Camera read_easymocap_camera(const OpenCvYaml& intrinsics, const OpenCvYaml& extrinsics, const std::string& name) {
  Camera camera;
  camera.name = name;
  const std::vector<double>& K = intrinsics.matrix("K_" + name, 9);
  for (int i = 0; i < 9; ++i) camera.K[i % 3][i / 3] = K[static_cast<std::size_t>(i)];
  for (const std::string& key : {"dist_" + name, "D_" + name}) {
    if (!intrinsics.has(key)) continue;
    const std::vector<double>& D = intrinsics.matrix(key, -1);
    if (D.size() != 4 && D.size() != 5) throw InputError("intri.yml", key, "4 or 5 numbers", fmt::format("{}", D.size()));
    std::copy(D.begin(), D.end(), camera.distortion.begin());
    break;
  }
  // The rotation vector is a rotation whatever its digits; the matrix Rot_ is rounded in each number.
  if (extrinsics.has("R_" + name)) {
    const std::vector<double>& R = extrinsics.matrix("R_" + name, 3);
    camera.R = rotation_from_axis_angle({R[0], R[1], R[2]});
  } else {
    const std::vector<double>& R = extrinsics.matrix("Rot_" + name, 9);
    for (int i = 0; i < 9; ++i) camera.R[i % 3][i / 3] = R[static_cast<std::size_t>(i)];
  }
  const std::vector<double>& T = extrinsics.matrix("T_" + name, 3);
  camera.T = {T[0], T[1], T[2]};
  return camera;
}

}  // namespace

Dataset read_easymocap(const fs::path& folder) {
  const OpenCvYaml intrinsics(folder / "intri.yml"), extrinsics(folder / "extri.yml");
  const fs::path masks = one_of_folders(folder, {"mask", "masks", "mask-schp", "mask_cihp"});
  const fs::path fits = one_of_folders(folder, {"output-smpl-3d/smpl", "output/smpl/smpl", "output/smpl", "smpl"});
  Dataset dataset;
  dataset.sequence = fs::absolute(folder / ".").lexically_normal().parent_path().filename().string();
  std::vector<std::map<int, fs::path>> images;
  for (const std::string& name : intrinsics.texts("names")) {
    Camera camera = read_easymocap_camera(intrinsics, extrinsics, name);
    // The camera's name becomes a path below.
    if (name.empty() || name.find('/') != name.npos || name[0] == '.') throw InputError((folder / "intri.yml").string(), "names", "names of folders", "'" + name + "'");
    images.push_back(files_by_frame(folder / "images" / name, {".jpg", ".jpeg", ".png"}));
    if (!images.back().empty()) {
      const cv::Size size = picture_file_size(images.back().begin()->second);
      camera.width = size.width;
      camera.height = size.height;
    }
    for (const Camera& other : dataset.cameras) {
      if (other.name == name) throw InputError((folder / "intri.yml").string(), "names", "each camera once", "'" + name + "' twice");
    }
    dataset.cameras.push_back(camera);
  }
  if (dataset.cameras.empty()) throw InputError((folder / "intri.yml").string(), "names", "at least one camera", "none");
  for (const auto& [number, fit] : files_by_frame(fits, {".json"})) {
    DatasetFrame frame;
    frame.number = number;
    frame.fit = fit;
    for (std::size_t c = 0; c < images.size(); ++c) {
      const auto image = images[c].find(number);
      if (image == images[c].end()) continue;
      const fs::path mask = masks / dataset.cameras[c].name / image->second.filename();
      frame.pictures.push_back({c, image->second, fs::path(mask).replace_extension(".png")});
    }
    dataset.frames.push_back(std::move(frame));
  }
  return dataset;
}

}  // namespace arah

// The layout of Neural Body and Animatable NeRF: ZJU-MoCap and Human3.6M.
#include <algorithm>
#include <charconv>
#include <map>
#include <optional>

#include "host/body/npy.h"
#include "host/capture/dataset.h"
#include "host/capture/picture_file.h"
#include "host/input_error.h"

namespace arah {
namespace {

namespace fs = std::filesystem;

constexpr double kMillimetres = 1e-3;
constexpr std::size_t kMostPictures = 300'000;
constexpr int kH36mWidth = 1000, kH36mHeight = 1002;  // of the pictures that the intrinsics are for

std::optional<int> whole_number(std::string_view text) {
  int number = 0;
  const auto [stop, error] = std::from_chars(text.data(), text.data() + text.size(), number);
  if (text.empty() || error != std::errc() || stop != text.data() + text.size() || number < 0) return std::nullopt;
  return number;
}

// What the picture's name says: "000012" is frame 12 and the body's file is 12; "CoreView_313_Camera_(1)_0013_…" is frame
// 12 too, and its body's file is 13.
struct NameOfFrame {
  int frame = 0, fit = 0;
};
NameOfFrame frame_of(const fs::path& image, const std::string& where) {
  const std::string stem = image.stem().string();
  if (const auto number = whole_number(stem)) return {*number, *number};
  std::size_t from = 0;
  for (int field = 0; field < 4 && from != stem.npos; ++field) {
    from = stem.find('_', from);
    if (from != stem.npos) ++from;
  }
  if (from != stem.npos) {
    const auto number = whole_number(std::string_view(stem).substr(from, stem.find('_', from) - from));
    if (number && *number > 0) return {*number - 1, *number};
  }
  throw InputError(where, "ims", "pictures called by their frame, 000012.jpg or CoreView_313_Camera_(1)_0013_….jpg", "'" + stem + "'");
}

// "Camera (7)/…" → "Camera_7": names without what shells take amiss.
std::string camera_name(const fs::path& image) {
  std::string name;
  for (const char letter : image.parent_path().filename().string()) {
    if (letter == ' ') name += '_';
    else if (letter != '(' && letter != ')') name += letter;
  }
  return name;
}

// `count` numbers of the camera with this index, from a list of arrays or one array whose first axis counts cameras.
std::vector<double> of_camera(const PythonValue& cams, const char* name, std::size_t camera, std::size_t cameras, long count,
                              const std::string& where) {
  const std::string field = fmt::format("cams {}", name);
  const PythonValue& all = python_member(cams, name, where, "cams");
  if (std::holds_alternative<PythonList>(all.content)) {
    return python_numbers(*python_items(all, static_cast<long>(cameras), where, field)[camera], count, where, field);
  }
  const std::vector<double> numbers = python_numbers(all, static_cast<long>(cameras) * count, where, field);
  const auto start = numbers.begin() + static_cast<std::ptrdiff_t>(camera) * count;
  return {start, start + count};
}

glm::dmat3 from_rows(const std::vector<double>& rows) {
  glm::dmat3 matrix;
  for (int i = 0; i < 9; ++i) matrix[i % 3][i / 3] = rows[static_cast<std::size_t>(i)];
  return matrix;
}

// A path that annots.npy gives, within the folder.
fs::path checked_relative(const std::string& text, const std::string& where) {
  fs::path path(text);
  const bool inside = !text.empty() && path.is_relative() && std::find(path.begin(), path.end(), "..") == path.end() &&
                      path.has_parent_path() && text.find('\0') == text.npos;
  if (!inside) throw InputError(where, "ims", "pictures in folders of the sequence", "'" + text.substr(0, 60) + "'");
  return path;
}

fs::path first_folder(const fs::path& folder, std::initializer_list<const char*> names) {
  for (const char* name : names) {
    if (fs::is_directory(folder / name)) return folder / name;
  }
  throw InputError(folder.string(), *names.begin(), "this folder", "none");
}

Dataset read_annotated(const fs::path& folder) {
  const fs::path annotations = folder / "annots.npy";
  const std::string where = annotations.string();
  if (!fs::is_regular_file(annotations)) {
    throw InputError(folder.string(), "annots.npy", "the cameras and pictures of a sequence", "no such file", "Is this the sequence's own folder?");
  }
  const PythonData data = read_npy(annotations);
  const PythonValue& cams = python_member(*data.root, "cams", where, "");
  const auto& frames = python_items(python_member(*data.root, "ims", where, ""), -1, where, "ims");
  if (frames.empty()) throw InputError(where, "ims", "at least one frame", "none");
  const fs::path masks = first_folder(folder, {"mask_cihp", "mask"}), fits = first_folder(folder, {"new_params", "params"});

  Dataset dataset;
  std::map<std::string, std::size_t> cameras;
  std::size_t pictures = 0;
  for (const PythonValue* entry : frames) {
    const std::vector<std::string> images = python_texts(python_member(*entry, "ims", where, "ims"), where, "ims ims");
    if (images.empty()) throw InputError(where, "ims", "a picture for each camera", "none");
    // Frames may share one list.
    pictures += images.size();
    if (pictures > kMostPictures) throw InputError(where, "ims", fmt::format("at most {} pictures", kMostPictures), "more");
    if (cameras.empty()) {
      for (const std::string& image : images) {
        Camera camera;
        const std::size_t index = dataset.cameras.size();
        camera.name = camera_name(checked_relative(image, where));
        if (!cameras.emplace(camera.name, index).second) throw InputError(where, "ims", "each camera once a frame", "'" + camera.name + "' twice");
        camera.K = from_rows(of_camera(cams, "K", index, images.size(), 9, where));
        camera.R = from_rows(of_camera(cams, "R", index, images.size(), 9, where));
        const std::vector<double> T = of_camera(cams, "T", index, images.size(), 3, where);
        camera.T = kMillimetres * glm::dvec3(T[0], T[1], T[2]);
        const std::vector<double> D = of_camera(cams, "D", index, images.size(), 5, where);
        std::copy(D.begin(), D.end(), camera.distortion.begin());
        dataset.cameras.push_back(camera);
      }
    }
    DatasetFrame frame;
    for (std::size_t i = 0; i < images.size(); ++i) {
      const fs::path image = checked_relative(images[i], where);
      const NameOfFrame name = frame_of(image, where);
      const auto camera = cameras.find(camera_name(image));
      if (camera == cameras.end() || (i > 0 && name.frame != frame.number)) {
        throw InputError(where, fmt::format("ims frame {}", frame.number), "one frame of the first frame's cameras", "'" + image.string() + "'");
      }
      frame.number = name.frame;
      frame.fit = fits / fmt::format("{}.npy", name.fit);
      frame.pictures.push_back({camera->second, folder / image, (masks / image).replace_extension(".png")});
    }
    dataset.frames.push_back(std::move(frame));
  }
  return dataset;
}

}  // namespace

Dataset read_zju_mocap(const fs::path& folder) {
  Dataset dataset = read_annotated(folder);
  dataset.sequence = fs::absolute(folder / ".").lexically_normal().parent_path().filename().string();
  std::vector<bool> sized(dataset.cameras.size(), false);
  for (const DatasetFrame& frame : dataset.frames) {
    for (const DatasetPicture& picture : frame.pictures) {
      if (sized[picture.camera] || !fs::is_regular_file(picture.image)) continue;
      const cv::Size size = picture_file_size(picture.image);
      dataset.cameras[picture.camera].width = size.width;
      dataset.cameras[picture.camera].height = size.height;
      sized[picture.camera] = true;
    }
    if (std::find(sized.begin(), sized.end(), false) == sized.end()) break;
  }
  return dataset;
}

Dataset read_h36m(const fs::path& folder) {
  const bool inner = !fs::exists(folder / "annots.npy") && fs::is_directory(folder / "Posing");
  const fs::path posing = inner ? folder / "Posing" : folder;
  Dataset dataset = read_annotated(posing);
  const fs::path whole = fs::absolute(posing / ".").lexically_normal().parent_path();
  dataset.sequence = (whole.filename() == "Posing" ? whole.parent_path() : whole).filename().string();
  dataset.resize_pictures = true;
  for (Camera& camera : dataset.cameras) {
    camera.width = kH36mWidth;
    camera.height = kH36mHeight;
  }
  return dataset;
}

}  // namespace arah

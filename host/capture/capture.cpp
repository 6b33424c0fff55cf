#include "host/capture/capture.h"

#include <algorithm>

#include "host/input_error.h"

namespace arah {
namespace {

constexpr std::string_view kMotionPrefix = "motion_";

std::string joined(const std::vector<std::string>& names) {
  return names.empty() ? "none" : fmt::format("{}", fmt::join(names, ", "));
}

}  // namespace

Capture open_capture(const std::filesystem::path& path) {
  if (!std::filesystem::is_directory(path)) {
    throw InputError(path.string(), "", "a capture's folder", "no folder",
                     "'arah synth' makes a capture to look at.");
  }
  Capture capture;
  capture.path = path;
  capture.cameras = read_cameras(path / "cameras.json");
  capture.body_template = read_body_template(path / "template.glb");
  for (const auto& entry : std::filesystem::directory_iterator(path)) {
    const std::string stem = entry.path().stem().string();
    if (entry.path().extension() != ".json" || !stem.starts_with(kMotionPrefix)) continue;
    const std::string split = stem.substr(kMotionPrefix.size());
    Motion motion = adapt_motion(read_motion(entry.path()), capture.body_template.skeleton, entry.path().string());
    if (motion.split.empty()) motion.split = split;
    if (motion.split != split) {
      throw InputError(entry.path().string(), "split", "'" + split + "', as in the file's name",
                       "'" + motion.split + "'");
    }
    capture.motions.emplace(split, std::move(motion));
  }
  if (capture.motions.empty()) {
    throw InputError(path.string(), "", "motion_<split>.json with the poses", "none");
  }
  return capture;
}

const Motion& motion_of(const Capture& capture, const std::string& split) {
  const auto found = capture.motions.find(split);
  if (found != capture.motions.end()) return found->second;
  std::vector<std::string> names;
  for (const auto& [name, motion] : capture.motions) names.push_back(name);
  throw InputError(capture.path.string(), "split", "one of " + joined(names), "'" + split + "'");
}

std::size_t camera_index(const Capture& capture, const std::string& name) {
  std::vector<std::string> names;
  for (std::size_t c = 0; c < capture.cameras.size(); ++c) {
    if (capture.cameras[c].name == name) return c;
    names.push_back(capture.cameras[c].name);
  }
  throw InputError(capture.path.string(), "camera", "one of " + joined(names), "'" + name + "'");
}

std::filesystem::path image_path(const Capture& capture, const std::string& split, std::size_t camera, int frame) {
  return capture.path / "images" / split / capture.cameras.at(camera).name / fmt::format("{:06}.png", frame);
}

std::vector<int> frames_with_images(const Capture& capture, const std::string& split, std::size_t camera) {
  std::vector<int> frames;
  for (const MotionFrame& frame : motion_of(capture, split).frames) {
    if (std::filesystem::is_regular_file(image_path(capture, split, camera, frame.number))) {
      frames.push_back(frame.number);
    }
  }
  return frames;
}

}  // namespace arah

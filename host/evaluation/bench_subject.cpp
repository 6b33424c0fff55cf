#include "host/evaluation/bench_subject.h"

#include <fmt/format.h>
#include <stdlib.h>

#include <cerrno>
#include <cstring>
#include <stdexcept>

#include "host/capture/synthetic_capture.h"
#include "host/training/template_fit.h"

namespace arah {

namespace fs = std::filesystem;

BenchCapture::BenchCapture() {
  std::string name = (fs::temp_directory_path() / "arah-bench-XXXXXX").string();
  if (::mkdtemp(name.data()) == nullptr) throw std::runtime_error(fmt::format("{}: could not be made: {}", name, std::strerror(errno)));
  folder_ = name;
  SyntheticSettings synthetic;
  synthetic.frames = 2;
  synthetic.size = 128;
  write_synthetic_capture(folder_ / "capture", synthetic);
  capture_ = open_capture(folder_ / "capture");
}

BenchCapture::~BenchCapture() {
  std::error_code ignored;
  fs::remove_all(folder_, ignored);
}

TrainingSettings bench_step_settings(const std::string& preset, uint32_t fit_steps, uint32_t fit_skinning_steps) {
  TrainingSettings training = preset_settings(preset);
  for (GroupSettings* group : {&training.sdf, &training.skinning, &training.deviation, &training.pose_code, &training.hyper, &training.low_rank, &training.hyper_last}) group->freeze = group->warm_up = 0;
  training.fit_steps = fit_steps;
  training.fit_skinning_steps = fit_skinning_steps;
  training.fit_rate = preset_settings("tiny").fit_rate;
  return training;
}

Avatar bench_avatar(Device& device, const Capture& capture, const AvatarSpec& spec, const TrainingSettings& settings) {
  Avatar avatar = make_avatar(spec, capture, 0);
  fit_template(device, avatar, settings);
  avatar.settings = settings_to_json(settings);
  return avatar;
}

}  // namespace arah

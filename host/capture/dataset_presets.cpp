#include "host/capture/dataset_presets.h"

#include <fmt/ranges.h>

#include <array>
#include <charconv>

#include "host/input_error.h"

namespace arah {
namespace {

struct Sequence {
  const char* name;
  int train_first, train_end, test_first, test_end;  // published frame numbers, ends excluded
};

constexpr std::array<Sequence, 9> kZju{{{"313", 0, 60, 60, 1061},
                                        {"315", 0, 400, 400, 1401},
                                        {"377", 0, 300, 300, 618},
                                        {"386", 0, 300, 300, 647},
                                        {"387", 0, 300, 300, 655},
                                        {"390", 700, 1000, 0, 700},
                                        {"392", 0, 300, 300, 557},
                                        {"393", 0, 300, 300, 659},
                                        {"394", 0, 300, 300, 860}}};
constexpr std::array<Sequence, 7> kH36m{{{"S1", 0, 150, 150, 199},
                                         {"S5", 0, 250, 250, 327},
                                         {"S6", 0, 150, 150, 233},
                                         {"S7", 0, 300, 300, 500},
                                         {"S8", 0, 250, 250, 337},
                                         {"S9", 0, 260, 260, 393},
                                         {"S11", 0, 200, 200, 282}}};
constexpr int kZjuCameras = 23;
constexpr int kZjuEvaluationStep = 30, kH36mEvaluationStep = 6;  // published frames
constexpr int kH36mFrameStep = 5;                                // raw frames to a published one
constexpr int kBand = 2;                                         // pixels: a square of 5x5

DatasetPreset zju_preset(const Sequence& sequence) {
  const std::string name = sequence.name;
  DatasetPreset preset;
  preset.name = "zju-" + name;
  preset.layout = "zju-mocap";
  preset.sequence = "CoreView_" + name;
  preset.plan.train_cameras = {"1", "7", "13", "19"};
  for (int camera = 1; camera <= kZjuCameras; ++camera) {
    const bool absent = (name == "313" || name == "315") && (camera == 20 || camera == 21);
    if (camera % 6 != 1 && !absent) preset.plan.test_cameras.push_back(fmt::format("{}", camera));
  }
  preset.plan.ranges = {{"train", sequence.train_first, sequence.train_end, 1},
                        {"novel", sequence.test_first, sequence.test_end, kZjuEvaluationStep}};
  preset.plan.held_out_step = kZjuEvaluationStep;
  preset.plan.only_held_out = true;
  preset.plan.evaluation_band = kBand;
  return preset;
}

DatasetPreset h36m_preset(const Sequence& sequence) {
  DatasetPreset preset;
  preset.name = fmt::format("h36m-{}", sequence.name);
  preset.layout = "h36m";
  preset.sequence = sequence.name;
  preset.frame_step = kH36mFrameStep;
  preset.plan.train_cameras = {"54138969", "55011271", "58860488"};
  preset.plan.test_cameras = {"60457274"};
  const auto raw = [](int frame) { return kH36mFrameStep * frame; };
  preset.plan.ranges = {{"train", raw(sequence.train_first), raw(sequence.train_end), kH36mFrameStep},
                        {"novel", raw(sequence.test_first), raw(sequence.test_end), raw(kH36mEvaluationStep)}};
  preset.plan.held_out_step = kH36mEvaluationStep;
  preset.plan.only_held_out = true;
  preset.plan.training_band = kBand;
  return preset;
}

std::string range_text(const FrameRange& range, int frame_step) {
  const int step = range.step / frame_step;
  const std::string ends = fmt::format("{}:{}", range.first / frame_step, range.end / frame_step);
  return step == 1 ? ends : fmt::format("{}:{}", ends, step);
}

}  // namespace

const std::vector<DatasetPreset>& dataset_presets() {
  static const std::vector<DatasetPreset> presets = [] {
    std::vector<DatasetPreset> made;
    for (const Sequence& sequence : kZju) made.push_back(zju_preset(sequence));
    for (const Sequence& sequence : kH36m) made.push_back(h36m_preset(sequence));
    return made;
  }();
  return presets;
}

const DatasetPreset& dataset_preset(const std::string& name) {
  std::vector<std::string> names;
  for (const DatasetPreset& preset : dataset_presets()) {
    if (preset.name == name) return preset;
    names.push_back(preset.name);
  }
  throw InputError("--split", "", fmt::format("one of {}", fmt::join(names, ", ")), "'" + name + "'");
}

std::string preset_table() {
  std::string table = fmt::format("{:10} {:12} {:9} {:13} {:28} {}\n", "preset", "sequence", "train", "novel", "train cameras", "test cameras");
  for (const DatasetPreset& preset : dataset_presets()) {
    const SplitPlan& plan = preset.plan;
    table += fmt::format("{:10} {:12} {:9} {:13} {:28} {}\n", preset.name, preset.sequence, range_text(plan.ranges[0], preset.frame_step),
                         range_text(plan.ranges[1], preset.frame_step), fmt::format("{}", fmt::join(plan.train_cameras, ",")), fmt::join(plan.test_cameras, ","));
  }
  return table +
         "\nFrames as first:end:step, the end excluded. Cameras for training see all training frames; test cameras see every\n"
         "30th of them (H36M: every 6th) and the novel frames. One frame of H36M is five of the recording.\n";
}

FrameRange parse_frame_range(const std::string& text) {
  FrameRange range;
  const std::size_t equals = text.find('=');
  std::vector<int> numbers;
  bool sound = equals != text.npos && equals > 0;
  for (std::size_t from = equals + 1; sound && from <= text.size();) {
    const std::size_t to = std::min(text.find(':', from), text.size());
    int number = 0;
    const auto [stop, error] = std::from_chars(text.data() + from, text.data() + to, number);
    sound = error == std::errc() && stop == text.data() + to && number >= 0 && numbers.size() < 3;
    numbers.push_back(number);
    from = to + 1;
  }
  sound = sound && numbers.size() >= 2 && numbers[0] < numbers[1] && (numbers.size() < 3 || numbers[2] > 0);
  range.split = text.substr(0, equals);
  sound = sound && range.split.find('/') == range.split.npos && range.split[0] != '.';
  if (!sound) throw InputError("--frames", "", "SPLIT=FIRST:END or SPLIT=FIRST:END:STEP, such as train=0:300", "'" + text + "'");
  range.first = numbers[0];
  range.end = numbers[1];
  if (numbers.size() == 3) range.step = numbers[2];
  return range;
}

bool camera_is(const std::string& name, const std::string& word) {
  if (name == word) return true;
  const std::size_t digits = name.find_last_not_of("0123456789");
  return digits != name.npos && digits + 1 < name.size() && name.substr(digits + 1) == word;
}

}  // namespace arah

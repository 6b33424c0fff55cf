// The paper's ablations on one capture: the same training with one part exchanged or left out at a time, and how near each comes to
// pictures and surface.
#pragma once

#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "host/avatar/spec_choice.h"
#include "host/evaluation/report.h"
#include "host/rendering/root_finder.h"
#include "host/training/run_folder.h"

namespace arah {

struct AblationVariant {
  std::string name;
  std::string shows;  // in a few words
  RunConfig config;
};

struct Ablation {
  std::vector<AblationVariant> variants;
  std::vector<std::pair<std::string, std::string>> left_out;  // name and reason
};

std::vector<std::string> ablation_names();

// The variants of a training `full`: all, or those of the names in `only`. prior: its file, or empty. What such a capture cannot show, and
// what would be the same training as one before it, is left out with the reason. Throws InputError naming --only for an unknown name,
// and for settings that a variant cannot have (validate_spec, check_settings).
Ablation ablation(const RunConfig& full, const CaptureFacts& facts, const std::string& prior = "", const std::vector<std::string>& only = {});

struct AblationSettings {
  int every = 1;  // takes every so-many-th frame that has a picture, camera by camera
  int size = 0;   // columns that photographs are reduced to; 0: as they are
};

struct SplitFigures {
  std::string split;  // "views": the training's frames
  std::optional<double> psnr, ssim;
};

struct AblationRow {
  std::string name, shows;
  uint64_t steps = 0;
  double seconds_per_step = 0;   // 0: not known
  uint64_t learned_numbers = 0;
  uint64_t device_bytes = 0;     // most that training held on the device
  std::vector<SplitFigures> splits;
  std::optional<double> surface;  // mean distance of the true surface, metres; absent without either surface
  std::optional<double> found;    // share of the correspondences that were searched, 0..1; absent where none is
  std::optional<double> least_found;  // of the picture with the least
  std::vector<uint8_t> rendering;  // PNG of the picture that all variants are shown by
};

struct AblationTable {
  std::vector<AblationRow> rows;
  std::vector<std::pair<std::string, std::string>> left_out;
  std::vector<uint8_t> photograph;  // PNG
  std::string picture;              // which: "ood, cam_05, frame 12"
};

// Of a finished run: its held-out cameras' pictures of the training frames, and of every other split that has pictures (of all
// cameras where held-out ones have none); every true mesh; the one picture. What was measured before with these settings is read
// from `measured.json` and `measured.png` in the run's folder. progress: the part done; false stops (std::runtime_error).
AblationRow measure_variant(Device& device, const Capture& capture, const AblationVariant& variant, const RunFolder& folder, const AblationSettings& settings,
                            const std::function<bool(double)>& progress = {});
// Fills photograph and picture: the middle one of the hardest split that has pictures, `ood` before `novel` before others.
void add_photograph(AblationTable& table, const Capture& capture, const AblationSettings& settings);

std::string ablation_csv(const AblationTable& table);       // what was not measured is empty
std::string ablation_markdown(const AblationTable& table);  // the best of each column in bold
std::string ablation_text(const AblationTable& table);
std::string ablation_page(const AblationTable& table, const Capture& capture, const Device& device);

}  // namespace arah

// What each approximation of rendering costs and buys: every knob alone from its exact value, then the presets; times by
// stage, work, and errors against the exact rendering and against photographs.
#pragma once

#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "host/avatar/avatar.h"
#include "host/evaluation/report.h"
#include "host/rendering/renderer.h"
#include "host/training/ranks.h"

namespace arah {

struct TradeoffSettings {
  std::string split = "train";
  std::string cameras = "held-out";  // as EvaluationSettings
  int pictures = 2;                  // evenly chosen among those that the split and the cameras have
  int size = 0;                      // columns; 0: as they are
  int repetitions = 3;               // of each picture, after one that is not counted
  bool presets_alone = false;        // not each knob
  std::filesystem::path lpips;       // as EvaluationSettings
};

// One setting: its cost, the median over pictures and repetitions, and its errors, the mean over pictures.
struct TradeoffPoint {
  std::string name;                                         // "paper", "samples 16", …
  std::vector<std::pair<std::string, std::string>> knobs;  // what it changes of the exact rendering; empty for a preset
  std::string settings;                                     // render_settings_json
  double milliseconds = 0, fastest = 0, slowest = 0;        // of a picture of a new pose, everything included but baking
  double milliseconds_same_pose = 0;                        // of another picture of that pose
  double baking_milliseconds = 0;                           // once for each code, before its first picture: the mean over the pictures
  std::vector<std::pair<std::string, double>> stages;       // milliseconds of a picture on the device, by stage; empty without timestamps
  double gflop = 0;                                         // of a picture: 10^9 operations of the launches, as their formulas count
  double rays = 0, samples_a_ray = 0, shaded_a_ray = 0, search_steps_a_sample = 0, found = 0;  // found: share of samples with a correspondence
  uint64_t memory_bytes = 0;                                // on the device
  double psnr_exact = 0;                                    // against the exact rendering, dB; +infinity: the same
  double psnr = 0;                                          // against the photographs, inside the body's box, dB
  std::optional<double> ssim_exact, ssim;
  std::optional<double> lpips_exact, lpips;  // where it was measured
  double depth_error = 0;   // metres, mean over the pixels that both see
  double normal_error = 0;  // degrees, likewise
  bool pareto = false;      // nothing measured is both faster and nearer to the exact rendering
};

struct Tradeoff {
  std::vector<TradeoffPoint> points;  // the exact rendering ("paper") first
  std::vector<ReportRow> pictures;    // photograph, exact, and each preset with its error
  std::vector<std::string> left_out;  // knob values and presets that this device cannot follow or this avatar does not have, with the reason
  std::string device, driver;
  int width = 0, height = 0, pictures_measured = 0, repetitions = 0;
  std::filesystem::path lpips;  // the network; empty: not measured
};

// progress: the part done, 0..1, and what is being measured. Throws InputError as evaluate does. ranks: that share out the settings,
// picture by picture, each to the one that is free; collective: the study on the first rank, on the others one without points.
Tradeoff measure_tradeoff(Device& device, const Avatar& avatar, const Capture& capture, const TradeoffSettings& settings,
                          const std::function<void(double, const std::string&)>& progress = {}, const Ranks& ranks = {});

// The fastest point whose PSNR against the photographs is at most `decibels` below the exact rendering's; the point nearest to
// the exact rendering within this time. Null: none.
const TradeoffPoint* fastest_within_error(const Tradeoff& tradeoff, double decibels);
const TradeoffPoint* nearest_within_time(const Tradeoff& tradeoff, double milliseconds);

std::string tradeoff_csv(const Tradeoff& tradeoff);
// Time against the error of the exact rendering, one dot a setting, the front joined by a line.
Plot tradeoff_plot(const Tradeoff& tradeoff);
std::string tradeoff_table(const Tradeoff& tradeoff);
Report tradeoff_report(Tradeoff tradeoff, const Avatar& avatar, const std::string& avatar_path, const Capture& capture);

}  // namespace arah

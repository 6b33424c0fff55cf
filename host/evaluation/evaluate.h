// How near an avatar's renderings are to a capture's photographs, picture by picture (ARAH.md, "Metrics").
#pragma once

#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "host/avatar/avatar.h"
#include "host/evaluation/bad_pixels.h"
#include "host/evaluation/report.h"
#include "host/evaluation/surface_error.h"
#include "host/rendering/renderer.h"
#include "host/training/ranks.h"

namespace arah {

// One picture to compare with.
struct EvaluationPlace {
  std::size_t camera = 0;  // of the capture
  int frame = 0;           // its number
};

struct EvaluationSettings {
  std::string protocol;              // its name where these are a protocol's; empty otherwise
  std::string split = "train";
  std::string cameras = "held-out";  // "training", "held-out", "all", or names with commas between
  int every = 1;                     // takes every so-many-th frame that has a picture, camera by camera
  int size = 0;                      // columns that photographs are reduced to; 0: as they are
  std::optional<RenderSettings> render;  // none: exact
  std::filesystem::path lpips;       // the network's file (lpips.h); empty: LPIPS is not measured
  bool pictures = true;              // keep photograph, rendering, error and normals for the report
};

// The paper's protocols (ARAH.md section 8), of pictures as large as they are stored: "novel-view": training frames from held-out cameras, every
// 30th; "novel-pose": the split `novel` from held-out cameras, every 30th; "training-pose": training frames and cameras, every 30th;
// "out-of-distribution": the split `ood` from held-out cameras. Throws InputError naming them for another word.
EvaluationSettings evaluation_protocol(const std::string& name);
const std::vector<std::string>& evaluation_protocols();

struct Evaluation {
  EvaluationSettings settings;
  std::vector<ReportRow> rows;  // by frame, then camera
  std::optional<double> psnr;   // mean over the pictures, dB; absent where none is finite
  std::optional<double> ssim;   // mean over the pictures; absent where none has one
  std::optional<double> ssim_of_the_paper;         // with its data range
  std::optional<double> psnr_spread, ssim_spread;  // standard deviations over the pictures; absent for fewer than two
  std::optional<double> lpips;  // mean over the pictures; absent where it was not measured
  RootFindingCounts root_finding;
  std::vector<BadPixels> bad;   // by row
  std::size_t unmeasured = 0;   // pictures with colours that are not finite where they are compared: they have no figures and are in no mean
  std::vector<std::optional<double>> found;  // by row: share of the picture's correspondences that the search found, 0..1; absent where none was searched
  double seconds = 0;  // of rendering
  std::vector<SurfaceError> surface;  // where it was measured; evaluate() leaves it empty
  SurfaceSettings surface_settings;   // of these figures
  std::optional<PoseImprovement> poses;  // of an avatar with refined poses: their distance from the capture's training poses
};

// The pictures that the settings choose, by frame, then camera. Throws InputError as evaluate does.
std::vector<EvaluationPlace> evaluation_places(const Avatar& avatar, const Capture& capture, const EvaluationSettings& settings);

// [pixels][3] on black of a picture's RGBA, which is premultiplied.
std::vector<float> rgb_on_black(const Image& image);

// A training frame is rendered in its refined pose where the avatar has one, others in the capture's.
// PSNR over the pixels of the projected box of the posed template ± 5 cm, photographs on black; SSIM on that region's
// bounding rectangle, data range 1; LPIPS on that rectangle too, where wanted; no 8-bit rounding. A frame without a latent code of its own takes the last one.
// progress: the part done, 0..1; return false to stop (throws std::runtime_error "stopped").
// Throws InputError: a split or camera that the capture does not have, no picture to compare with, a person of whom
// nothing is in view, a template with another skeleton than the avatar's, a picture that cannot be read, a file that is not the
// LPIPS network (read before anything is rendered).
// ranks: that share the pictures out among them, each to the one that is free; collective: the whole evaluation on the first rank, on
// the others one without rows.
Evaluation evaluate(Device& device, const Avatar& avatar, const Capture& capture, const EvaluationSettings& settings,
                    const std::function<bool(double)>& progress = {}, const Ranks& ranks = {});

// {"mean": {"psnr", "ssim", "ssim_data_range_2", "lpips"}, "spread": {"psnr", "ssim"}, "images": [{"frame", "camera", "psnr", "ssim", "ssim_data_range_2", "found_percent", "bad_pixels", "lpips"}], "bad_pixels" (of all pictures), "unmeasured" (pictures), "lpips_network", "protocol_name", "split", "protocol", "avatar", "capture",
// "device", "driver", "version", "seed", "steps", "root_finding": {"points", "converged", ..., "rescued_by_newton", "rescued_from_bones", "rescue_evaluations", "least_found_percent" (of a picture)}, "seconds", "surface": [{"frame", "mean_mm", "percentile_95_mm", "chamfer_cm2", "normal_consistency", "normal_consistency_of_the_paper", "f_score_5mm"}], "surface_mean": the same without "frame", "surface_settings": {"cell_mm", "largest_part", "ground": [a, b, c, d] or null}, "poses": {"frames", "before": {"joints_mm", "rotations_degrees"},
// "after"} with refined poses}; what is not
// defined, such as the PSNR of identical pictures, is null, and "lpips" and "lpips_network" are there only where it was measured. avatar_path: as the user knows it.
std::string evaluation_json(const Evaluation& evaluation, const Avatar& avatar, const std::string& avatar_path,
                            const Capture& capture, const Device& device);

// The page's facts, definition and summary for the figures of one or more evaluations; rows are moved in.
Report evaluation_report(std::vector<Evaluation> evaluations, const Avatar& avatar, const std::string& avatar_path,
                         const Capture& capture, const Device& device);

// The least of `found`; absent where nothing was searched.
std::optional<double> least_found(const Evaluation& evaluation);

// "split train, cameras held-out: PSNR 28.60 ± 1.21 dB, SSIM 0.9120 ± 0.0110 (20 pictures)".
std::string describe(const Evaluation& evaluation);

// One line for each picture that has pixels that are not finite, the first `most` of them, and one for the others. avatar_path: as the user knows it.
std::vector<std::string> warnings_of(const Evaluation& evaluation, const std::string& avatar_path, std::size_t most = 5);

}  // namespace arah

// report.html: what an evaluation found, as one file that opens in any browser, without a network and on a phone.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "host/evaluation/plot.h"

namespace arah {

struct ReportImage {
  std::string label;              // shown below the picture: "photograph", "rendering", "error ×4", "normals", "depth"
  std::vector<std::uint8_t> png;  // the bytes of a PNG file
};

// One evaluated picture.
struct ReportRow {
  std::string split;                                     // groups the summary: "novel view", "novel pose"
  std::string camera;                                    // one line a camera in the plot
  int frame = 0;                                         // the frame's number in the capture
  double psnr = 0;                                       // dB; +infinity = identical pictures; NaN = not measured
  std::optional<double> ssim;                            // absent where it is not defined
  std::vector<std::pair<std::string, double>> measures;  // further columns, with their units: {"depth error (mm)", 3.2}
  std::vector<ReportImage> images;                       // shown side by side in this order; may be empty
  std::optional<double> lpips;                           // absent where it was not measured; its column where a row has one
  std::optional<double> ssim_of_the_paper;               // with the paper's data range; its column where a row has one
};

struct Report {
  std::string title;
  std::string summary;                                     // a sentence or two below the title; may be empty
  std::string definition;                                  // what the figures mean: region, data range, window
  std::vector<std::pair<std::string, std::string>> facts;  // {"avatar", "out/avatar.safetensors"}, {"device", "..."}
  std::vector<ReportRow> rows;
  std::vector<Plot> plots;  // further plots, such as the training curve
};

// The wording of `definition` for figures of image_metrics().
std::string metrics_definition();

// The whole page. Means leave out what is not finite and say how many were left out; pictures come worst PSNR first
// (not measured before all, identical last). Every text is escaped, every picture embedded; the page runs no script and
// asks for no other file.
std::string to_html(const Report& report);

// The beginning of such a page, with the title as its heading; what follows closes main, body and html.
std::string page_start(const std::string& title);
// One embedded picture with its label below; of: what it shows, for those who cannot see it.
std::string figure_html(const ReportImage& image, const std::string& of);

}  // namespace arah

#include "host/evaluation/capture_page.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <iterator>

#include "host/capture/software_renderer.h"
#include "host/evaluation/picture.h"
#include "host/evaluation/report.h"
#include "host/evaluation/scene_plan.h"
#include "host/input_error.h"

namespace arah {
namespace {

constexpr int kColumns = 512;
constexpr float kBackground = 0.35f;      // grey where a photograph is transparent
constexpr float kTint = 0.12f;            // of the template's colour on the photograph
constexpr float kLimbEdge = 0.05f;        // m between neighbouring pixels' depths
constexpr std::array<float, 3> kTemplateColour{0.0f, 0.95f, 0.95f}, kMaskColour{1.0f, 0.6f, 0.0f};
constexpr const char* kGood = "#009e73";  // Okabe and Ito's
constexpr const char* kBad = "#d55e00";

using Flags = std::vector<std::uint8_t>;  // [height][width]

// Whether something of `inside` ends at a pixel: it is in and its right or lower neighbour is not, or the other way round.
Flags outline_of(const Flags& inside, int width, int height) {
  Flags edge(inside.size(), 0);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const auto at = static_cast<std::size_t>(y) * static_cast<std::size_t>(width) + static_cast<std::size_t>(x);
      const bool right = x + 1 < width && inside[at] != inside[at + 1];
      const bool below = y + 1 < height && inside[at] != inside[at + static_cast<std::size_t>(width)];
      edge[at] = right || below ? 1 : 0;
    }
  }
  return edge;
}

// Where the template is drawn, and its lines.
struct Drawn {
  Flags covered, lines;
};

Drawn drawn_template(const Camera& camera, const std::vector<glm::vec3>& vertices, const std::vector<glm::uvec3>& triangles) {
  const std::vector<VisiblePlace> places = visible_places(camera, vertices, triangles);
  std::vector<float> depths(places.size(), 0.0f);
  Drawn drawn{Flags(places.size(), 0), {}};
  for (std::size_t i = 0; i < places.size(); ++i) {
    if (places[i].triangle == VisiblePlace::no_triangle) continue;
    const glm::uvec3& t = triangles[places[i].triangle];
    const glm::vec3 point = places[i].barycentric.x * vertices[t.x] + places[i].barycentric.y * vertices[t.y] + places[i].barycentric.z * vertices[t.z];
    depths[i] = static_cast<float>(camera.to_camera(glm::dvec3(point)).z);
    drawn.covered[i] = 1;
  }
  drawn.lines = outline_of(drawn.covered, camera.width, camera.height);
  const auto width = static_cast<std::size_t>(camera.width);
  for (std::size_t i = 0; i < places.size(); ++i) {
    for (const std::size_t next : {i + 1, i + width}) {
      if (next >= places.size() || (next == i + 1 && next % width == 0) || !drawn.covered[i] || !drawn.covered[next]) continue;
      if (std::abs(depths[i] - depths[next]) > kLimbEdge) drawn.lines[i] = 1;
    }
  }
  return drawn;
}

std::string as_percent(double part) { return fmt::format("{:.1f} %", 100.0 * part); }

std::string fit_text(const InspectedView& view) {
  return view.measured == 0 ? "not measured" : fmt::format("{} of the template in the mask (mean of {}: {}), overlap {:.0f} %", as_percent(view.least), view.measured, as_percent(view.inside), 100.0 * view.overlap);
}

std::string warnings_section(const std::vector<std::string>& warnings) {
  if (warnings.empty()) return fmt::format("<p style=\"color:{};font-weight:600\">Nothing looks wrong.</p>\n", kGood);
  std::string html = fmt::format("<div class=\"card\" style=\"border-left:6px solid {}\"><h3>What looks wrong</h3><ul>\n", kBad);
  for (const std::string& warning : warnings) html += fmt::format("<li>{}</li>\n", escape_html(warning));
  return html + "</ul></div>\n";
}

std::string coverage_section(const Capture& capture, const CaptureInspection& found) {
  std::string html =
      "<div class=\"scroll\"><table><tr><th class=\"left\">split</th><th class=\"left\">camera</th><th>pictures measured</th><th>template in the mask, mean</th><th>least</th><th>in frame</th><th>silhouettes overlap</th></tr>\n";
  for (const InspectedView& view : found.views) {
    if (view.frame < 0) continue;
    html += fmt::format("<tr><td class=\"left\">{}</td><td class=\"left\">{}</td><td>{}</td>", escape_html(view.split), escape_html(capture.cameras[view.camera].name), view.measured);
    html += view.measured == 0 ? "<td>–</td><td>–</td><td>–</td><td>–</td></tr>\n"
                               : fmt::format("<td>{}</td><td>{}</td><td>{}</td><td>{:.0f} %</td></tr>\n", as_percent(view.inside), as_percent(view.least), view.frame, 100.0 * view.overlap);
  }
  return html + "</table></div>\n";
}

std::string fit_pictures_section(const Capture& capture, const CaptureInspection& found) {
  std::string html, split;
  for (const InspectedView& view : found.views) {
    if (view.frame < 0) continue;
    const std::string name = fmt::format("{}, frame {}", capture.cameras[view.camera].name, view.frame);
    ReportImage picture{fmt::format("{}: {}", name, fit_text(view)), {}};
    try {
      picture.png = fit_picture(capture, view);
    } catch (const InputError&) {
      continue;
    }
    if (view.split != split) {
      if (!split.empty()) html += "</div>\n";
      split = view.split;
      html += fmt::format("<h2>Split {}</h2>\n<div class=\"pictures\" style=\"grid-template-columns:repeat(auto-fill,minmax(min(260px,100%),1fr))\">\n", escape_html(split));
    }
    html += figure_html(picture, "template and mask over the photograph of split " + split);
  }
  return split.empty() ? "" : html + "</div>\n";
}

}  // namespace

std::vector<std::uint8_t> fit_picture(const Capture& capture, const InspectedView& view) {
  const int columns = std::min(kColumns, capture.cameras[view.camera].width);
  const Image image = load_image(capture, view.split, view.camera, view.frame, columns);
  const int factor = std::max(1, kColumns / columns), width = factor * image.width, height = factor * image.height;
  Camera camera = capture.cameras[view.camera].scaled(width);
  camera.height = height;  // of the reduced picture, rounded before it is enlarged
  const Drawn body = drawn_template(camera, posed_vertices(capture.body_template, find_frame(motion_of(capture, view.split), view.frame)->pose), capture.body_template.triangles);
  std::vector<float> rgb;
  Flags masked;
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const float* pixel = &image.rgba[4 * (static_cast<std::size_t>(y / factor) * static_cast<std::size_t>(image.width) + static_cast<std::size_t>(x / factor))];
      for (int k = 0; k < 3; ++k) rgb.push_back(pixel[k] + (1.0f - pixel[3]) * kBackground);
      masked.push_back(pixel[3] >= 0.5f ? 1 : 0);
    }
  }
  const Flags mask_lines = outline_of(masked, width, height);
  for (std::size_t i = 0; i < masked.size(); ++i) {
    for (std::size_t k = 0; k < 3; ++k) {
      float& value = rgb[3 * i + k];
      if (body.covered[i]) value += kTint * (kTemplateColour[k] - value);
      if (mask_lines[i]) value = kMaskColour[k];
      if (body.lines[i]) value = kTemplateColour[k];
    }
  }
  return encode_png(rgb, width, height, 3);
}

std::string capture_page(const Capture& capture, const CaptureInspection& found) {
  std::string html = page_start("Capture " + (capture.path.has_filename() ? capture.path : capture.path.parent_path()).filename().string());
  std::string splits;
  for (const auto& [split, motion] : capture.motions) splits += fmt::format("{}{} ({} frames)", splits.empty() ? "" : ", ", split, motion.frames.size());
  html += fmt::format("<p class=\"quiet\">{} cameras; splits: {}.</p>\n", capture.cameras.size(), escape_html(splits));
  html += warnings_section(found.warnings());
  html += "<h2>Cameras and the body's way</h2>\n<div class=\"plots\">\n";
  for (const PlanView view : {PlanView::above, PlanView::front}) html += "<div class=\"plot\">" + scene_plan_svg(capture, view) + "</div>\n";
  html += "</div>\n<h2>How the template fits the masks</h2>\n";
  html += "<p class=\"quiet\">Of the template's projected vertices, the share that lies in the mask grown by 3 pixels of 512 columns: close to 100 % where calibration, poses and masks are right. Silhouettes overlap by less, because clothes and hair lie outside the body.</p>\n";
  html += coverage_section(capture, found);
  html += "<p class=\"quiet\">Pictures: of each camera the frame that fits worst; the template is cyan, the mask's outline orange.</p>\n";
  html += fit_pictures_section(capture, found);
  html += "<h2>Report</h2>\n<div class=\"scroll\"><pre>" + escape_html(found.report) + "</pre></div>\n</main></body></html>\n";
  return html;
}

}  // namespace arah

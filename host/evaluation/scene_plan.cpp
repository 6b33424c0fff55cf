#include "host/evaluation/scene_plan.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <glm/mat3x3.hpp>
#include <glm/matrix.hpp>
#include <glm/trigonometric.hpp>
#include <iterator>
#include <limits>

#include "host/evaluation/plot.h"

namespace arah {
namespace {

constexpr double kPlanWidth = 720, kMostPlanHeight = 720, kLeastPlanHeight = 160;  // of the drawing, and of its inner height
constexpr double kPlanLeft = 64, kPlanRight = 24, kPlanTop = 34, kPlanBottom = 46;
constexpr double kPlanLegendRow = 18;
constexpr double kFarthest = 1e9;         // m
constexpr std::size_t kDots = 1500;       // of the template's vertices
constexpr std::size_t kFirstSplit = 2;    // colours 0 and 1 are the cameras'
constexpr double kPlanMargin = 0.06;          // of the extent

struct Extent {
  glm::dvec2 low{std::numeric_limits<double>::infinity()}, high{-std::numeric_limits<double>::infinity()};

  void add(const glm::dvec2& point) {
    low = glm::min(low, point);
    high = glm::max(high, point);
  }
};

// A camera's field of view as a triangle, and the point that its optical axis goes to.
struct Wedge {
  glm::dvec2 place{0.0}, first{0.0}, second{0.0}, ahead{0.0};
};

glm::dvec2 flat(const glm::dvec3& point, PlanView view) { return {point.x, view == PlanView::above ? point.y : point.z}; }

Wedge wedge_of(const Camera& camera, PlanView view, double length) {
  const glm::dvec3 place = camera.center(), axis = glm::transpose(camera.R)[2];
  const glm::dvec2 middle(camera.K[2][0], camera.K[2][1]);
  const auto end = [&](double u, double v) {
    const glm::dvec3 direction = camera.ray(u, v).direction;
    return flat(place + length / std::max(0.05, glm::dot(direction, axis)) * direction, view);
  };
  const bool above = view == PlanView::above;
  return {flat(place, view), above ? end(-0.5, middle.y) : end(middle.x, -0.5), above ? end(camera.width - 0.5, middle.y) : end(middle.x, camera.height - 0.5),
          flat(place + 1.6 * length * axis, view)};
}

// Between the rays through the middles of opposite borders, degrees.
double field_of_view(const Camera& camera, bool horizontal) {
  const glm::dvec2 middle(camera.K[2][0], camera.K[2][1]);
  const PixelRay a = horizontal ? camera.ray(-0.5, middle.y) : camera.ray(middle.x, -0.5);
  const PixelRay b = horizontal ? camera.ray(camera.width - 0.5, middle.y) : camera.ray(middle.x, camera.height - 0.5);
  return glm::degrees(std::acos(std::clamp(glm::dot(a.direction, b.direction), -1.0, 1.0)));
}

}  // namespace

std::string scene_plan_svg(const Capture& capture, PlanView view) {
  const bool above = view == PlanView::above;
  const std::string title = above ? "Plan: seen from above" : "Elevation: seen from the front";
  const Motion& first = capture.motions.begin()->second;
  const std::vector<glm::vec3> body = posed_vertices(capture.body_template, first.frames.at(0).pose);
  glm::dvec3 middle(0.0);
  for (const glm::vec3& vertex : body) middle += glm::dvec3(vertex) / static_cast<double>(body.size());

  Extent extent;
  std::vector<double> distances;
  for (const Camera& camera : capture.cameras) distances.push_back(glm::distance(camera.center(), middle));
  std::nth_element(distances.begin(), distances.begin() + static_cast<std::ptrdiff_t>(distances.size() / 2), distances.end());
  const double length = std::max(0.05, 0.28 * distances[distances.size() / 2]);  // of what is drawn of a field of view, m
  std::vector<Wedge> wedges;
  for (const Camera& camera : capture.cameras) {
    wedges.push_back(wedge_of(camera, view, length));
    for (const glm::dvec2& point : {wedges.back().place, wedges.back().first, wedges.back().second, wedges.back().ahead}) extent.add(point);
  }
  for (const auto& [split, motion] : capture.motions) {
    for (const MotionFrame& frame : motion.frames) extent.add(flat(frame.pose.root_position, view));
  }
  for (const glm::vec3& vertex : body) extent.add(flat(glm::dvec3(vertex), view));
  const glm::dvec2 margin = kPlanMargin * std::max(1e-6, std::max(extent.high.x - extent.low.x, extent.high.y - extent.low.y)) * glm::dvec2(1.0);
  extent.add(extent.low - margin);
  extent.add(extent.high + margin);
  const glm::dvec2 size = extent.high - extent.low;
  const bool drawn = glm::length(extent.low) < kFarthest && glm::length(extent.high) < kFarthest;

  const double inner_width = kPlanWidth - kPlanLeft - kPlanRight;
  const double scale = drawn ? std::min(inner_width / size.x, (kMostPlanHeight - kPlanTop - kPlanBottom) / size.y) : 1.0;  // units a metre
  const double inner_height = drawn ? std::max(kLeastPlanHeight, scale * size.y) : kLeastPlanHeight;
  const double height = kPlanTop + inner_height + kPlanBottom;
  const glm::dvec2 center = 0.5 * (extent.low + extent.high);
  const auto at_x = [&](double x) { return kPlanLeft + 0.5 * inner_width + scale * (x - center.x); };
  const auto at_y = [&](double y) { return kPlanTop + 0.5 * inner_height - scale * (y - center.y); };

  std::string svg;
  auto out = std::back_inserter(svg);
  const double legend = height + 4;
  fmt::format_to(out,
                 "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {} {:.1f}\" role=\"img\" font-family=\"system-ui,sans-serif\" font-size=\"13\" "
                 "fill=\"currentColor\"><title>{}</title>\n<text x=\"{}\" y=\"16\" font-weight=\"600\">{}</text>\n",
                 kPlanWidth, height + kPlanLegendRow * std::ceil(static_cast<double>(capture.motions.size() + 2) / 3.0), title, kPlanLeft, title);
  if (!drawn) {
    fmt::format_to(out, "<text x=\"{}\" y=\"{}\" text-anchor=\"middle\">too far apart to be drawn</text>\n</svg>\n", 0.5 * kPlanWidth, kPlanTop + 0.5 * inner_height);
    return svg;
  }

  // The grid, one step for both axes.
  const double half_x = 0.5 * inner_width / scale, half_y = 0.5 * inner_height / scale;
  const double step = round_axis(center.x - half_x, center.x + half_x).step;
  for (double k = std::ceil((center.x - half_x) / step); k * step <= center.x + half_x; ++k) {
    fmt::format_to(out, "<line x1=\"{0:.1f}\" x2=\"{0:.1f}\" y1=\"{1}\" y2=\"{2:.1f}\" stroke=\"currentColor\" opacity=\".15\"/><text x=\"{0:.1f}\" y=\"{3:.1f}\" text-anchor=\"middle\">{4}</text>\n", at_x(k * step), kPlanTop,
                   kPlanTop + inner_height, kPlanTop + inner_height + 18, tick_text(k * step, step));
  }
  for (double k = std::ceil((center.y - half_y) / step); k * step <= center.y + half_y; ++k) {
    fmt::format_to(out, "<line x1=\"{0}\" x2=\"{1}\" y1=\"{2:.1f}\" y2=\"{2:.1f}\" stroke=\"currentColor\" opacity=\".15\"/><text x=\"{3}\" y=\"{4:.1f}\" text-anchor=\"end\">{5}</text>\n", kPlanLeft, kPlanWidth - kPlanRight, at_y(k * step),
                   kPlanLeft - 8, at_y(k * step) + 4, tick_text(k * step, step));
  }
  fmt::format_to(out, "<text x=\"{}\" y=\"{:.1f}\" text-anchor=\"middle\">x (m)</text>\n", kPlanLeft + 0.5 * inner_width, height - 8);
  fmt::format_to(out, "<text transform=\"translate(14 {:.1f}) rotate(-90)\" text-anchor=\"middle\">{} (m)</text>\n", kPlanTop + 0.5 * inner_height, above ? "y" : "z");

  // The body.
  std::string dots;
  for (std::size_t i = 0; i < body.size(); i += std::max<std::size_t>(1, body.size() / kDots)) {
    const glm::dvec2 point = flat(glm::dvec3(body[i]), view);
    fmt::format_to(std::back_inserter(dots), "M{:.1f} {:.1f}h0", at_x(point.x), at_y(point.y));
  }
  fmt::format_to(out, "<path d=\"{}\" fill=\"none\" stroke=\"currentColor\" stroke-width=\"1.6\" stroke-linecap=\"round\" opacity=\".35\"/>\n", dots);

  for (std::size_t c = 0; c < wedges.size(); ++c) {
    const Camera& camera = capture.cameras[c];
    const Wedge& wedge = wedges[c];
    const char* colour = plot_colour(camera.role == "train" ? 0 : 1);
    const glm::dvec3 place = camera.center();
    const std::string name = escape_html(camera.name);
    fmt::format_to(out, "<g stroke=\"{0}\"><path d=\"M{1:.1f} {2:.1f}L{3:.1f} {4:.1f}L{5:.1f} {6:.1f}Z\" fill=\"{0}\" fill-opacity=\".12\" stroke-opacity=\".7\"/>", colour, at_x(wedge.place.x), at_y(wedge.place.y), at_x(wedge.first.x),
                   at_y(wedge.first.y), at_x(wedge.second.x), at_y(wedge.second.y));
    fmt::format_to(out, "<path d=\"M{:.1f} {:.1f}L{:.1f} {:.1f}\" stroke-dasharray=\"5 4\"/>", at_x(wedge.place.x), at_y(wedge.place.y), at_x(wedge.ahead.x), at_y(wedge.ahead.y));
    fmt::format_to(out, "<circle cx=\"{:.1f}\" cy=\"{:.1f}\" r=\"4\" fill=\"{}\"><title>{} ({}): at ({:.3g}, {:.3g}, {:.3g}) m, field of view {:.0f} x {:.0f} degrees</title></circle></g>\n", at_x(wedge.place.x), at_y(wedge.place.y),
                   colour, name, camera.role, place.x, place.y, place.z, field_of_view(camera, true), field_of_view(camera, false));
    // Beside the camera, away from where it looks.
    const bool looks_right = wedge.ahead.x > wedge.place.x;
    const double x = std::clamp(at_x(wedge.place.x) + (looks_right ? -8.0 : 8.0), kPlanLeft, kPlanWidth - kPlanRight);
    const bool room = looks_right ? x > kPlanLeft + 60 : x < kPlanWidth - kPlanRight - 60;
    fmt::format_to(out, "<text x=\"{:.1f}\" y=\"{:.1f}\" text-anchor=\"{}\" font-size=\"12\">{}</text>\n", x, at_y(wedge.place.y) + (room ? 4 : -8), looks_right == room ? "end" : "start", name);
  }

  std::size_t number = 0;
  const auto key = [&](const char* colour, const std::string& label) {
    const double x = kPlanLeft + static_cast<double>(number % 3) * (kPlanWidth - kPlanLeft) / 3.0, y = legend + kPlanLegendRow * static_cast<double>(number / 3);
    fmt::format_to(out, "<circle cx=\"{:.1f}\" cy=\"{:.1f}\" r=\"4\" fill=\"{}\"/><text x=\"{:.1f}\" y=\"{:.1f}\">{}</text>\n", x, y, colour, x + 9, y + 4, escape_html(label));
    ++number;
  };
  key(plot_colour(0), "training cameras");
  key(plot_colour(1), "held-out cameras");
  std::size_t colour = kFirstSplit;
  for (const auto& [split, motion] : capture.motions) {
    std::string path;
    for (const MotionFrame& frame : motion.frames) {
      const glm::dvec2 point = flat(frame.pose.root_position, view);
      fmt::format_to(std::back_inserter(path), "{}{:.1f} {:.1f}", path.empty() ? 'M' : 'L', at_x(point.x), at_y(point.y));
    }
    fmt::format_to(out, "<path d=\"{}\" fill=\"none\" stroke=\"{}\" stroke-width=\"2\" stroke-linejoin=\"round\" stroke-linecap=\"round\"/>\n", path, plot_colour(colour));
    key(plot_colour(colour++), "root over the frames of " + split);
  }
  svg += "</svg>\n";
  return svg;
}

}  // namespace arah

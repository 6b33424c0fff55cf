#include "host/evaluation/conditioning_page.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <limits>

#include "host/capture/software_renderer.h"
#include "host/evaluation/picture.h"

namespace arah {
namespace {

struct ColourStop {
  double sigma;
  std::array<float, 3> rgb;
};
constexpr std::array<ColourStop, 5> colour_stops{{{0, {0.25f, 0.0f, 0.02f}}, {0.1, {0.70f, 0.08f, 0.04f}}, {0.3, {0.93f, 0.45f, 0.10f}}, {0.6, {0.97f, 0.82f, 0.42f}}, {1, {0.82f, 0.83f, 0.84f}}}};
constexpr std::array<float, 3> folded_colour{0.0f, 0.35f, 0.80f};
constexpr float page_white = 1.0f;
constexpr float lit_from_the_side = 0.55f;  // of the colour, where the surface is seen from the side
constexpr float fold_shows = 0.7f;         // of the blue, over what hides a fold
constexpr std::array<float, 3> dot_colour{0.85f, 0.0f, 0.75f};
constexpr double dot_radius = 2.6, ring_radius = 3.8;  // pixels
constexpr double filled = 0.9;                         // of a close-up, by the body

std::string hex(const std::array<float, 3>& rgb) {
  const auto byte = [](float value) { return static_cast<int>(std::lround(255.0f * value)); };
  return fmt::format("#{:02x}{:02x}{:02x}", byte(rgb[0]), byte(rgb[1]), byte(rgb[2]));
}

float interpolated(const std::vector<float>& values, const glm::uvec3& triangle, const glm::vec3& barycentric) { return barycentric.x * values[triangle.x] + barycentric.y * values[triangle.y] + barycentric.z * values[triangle.z]; }

void draw_dot(std::vector<float>& rgb, int width, int height, const glm::dvec2& at) {
  const auto whole = [](double value) { return static_cast<int>(std::lround(value)); };
  for (int y = std::max(0, whole(at.y - ring_radius)); y <= std::min(height - 1, whole(at.y + ring_radius)); ++y)
    for (int x = std::max(0, whole(at.x - ring_radius)); x <= std::min(width - 1, whole(at.x + ring_radius)); ++x) {
      const double distance = std::hypot(x - at.x, y - at.y);
      if (distance > ring_radius) continue;
      for (std::size_t k = 0; k < 3; ++k) rgb[3 * (static_cast<std::size_t>(y) * static_cast<std::size_t>(width) + static_cast<std::size_t>(x)) + k] = distance <= dot_radius ? dot_colour[k] : 0.0f;
    }
}

std::string colour_legend() {
  std::string stops;
  for (const ColourStop& stop : colour_stops) stops += fmt::format("<stop offset=\"{:g}%\" stop-color=\"{}\"/>", 100 * stop.sigma, hex(stop.rgb));
  std::string ticks;
  for (const double sigma : {0.0, 0.1, 0.3, 0.6, 1.0}) ticks += fmt::format("<text x=\"{:.0f}\" y=\"44\" text-anchor=\"middle\">{}</text>", 20 + 300 * sigma, sigma == 1 ? "≥ 1" : fmt::format("{:g}", sigma));
  return fmt::format(
      "<svg viewBox=\"0 0 720 52\" width=\"720\" style=\"max-width:100%\" role=\"img\" aria-label=\"colours of the pictures\" font-size=\"13\" fill=\"currentColor\"><defs><linearGradient id=\"sigma\">{}</linearGradient></defs>"
      "<text x=\"20\" y=\"12\">least singular value of J</text><rect x=\"20\" y=\"17\" width=\"300\" height=\"14\" fill=\"url(#sigma)\"/>{}"
      "<rect x=\"370\" y=\"17\" width=\"14\" height=\"14\" fill=\"{}\"/><text x=\"390\" y=\"29\">folded (det J &lt; 0)</text>"
      "<circle cx=\"540\" cy=\"24\" r=\"5\" fill=\"{}\" stroke=\"#000\" stroke-width=\"2\"/><text x=\"554\" y=\"29\">point without a root</text></svg>\n",
      stops, ticks, hex(folded_colour), hex(dot_colour));
}

std::string as_share(double part) { return fmt::format("{:.2f} %", 100 * part); }
double of_samples(const ConditioningFigures& f, std::size_t count) { return f.samples > 0 ? double(count) / double(f.samples) : 0; }

std::string poses_table(const std::vector<ConditioningEntry>& poses) {
  std::string html =
      "<div class=\"scroll\"><table><tr><th>frame</th><th>least σ_min</th><th>median</th><th>below 0.1</th><th>folded</th><th>greatest σ_max</th><th>not found</th><th>refused</th><th>after rescue</th><th>several roots</th><th>near</th><th>amplified</th><th>eikonal</th><th>shell</th></tr>\n";
  for (const ConditioningEntry& entry : poses) {
    const ConditioningFigures& f = entry.figures;
    html += fmt::format("<tr><td>{}</td><td>{:.3f}</td><td>{:.3f}</td><td>{}</td><td>{}</td><td>{:.2f}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{:.3f}</td><td>{:.3f}</td></tr>\n", f.frame, f.least_singular, f.median_singular, as_share(f.nearly_singular_share), as_share(f.folded_share),
                        f.greatest_singular, as_share(of_samples(f, f.unfound())), f.refused, as_share(of_samples(f, f.unsolved())), as_share(f.several_share), as_share(f.several_near_share), as_share(f.amplified_share), f.eikonal, f.shell_eikonal);
  }
  return html + "</table></div>\n";
}

// Shares of the points that were still searching after so many steps, and how many were found by each.
std::string steps_section(const std::vector<ConditioningEntry>& poses, uint32_t most_steps) {
  std::vector<std::size_t> steps(most_steps + 1, 0);
  std::size_t found = 0, samples = 0, refused = 0, diverged = 0, exhausted = 0;
  for (const ConditioningEntry& entry : poses) {
    for (std::size_t s = 0; s < steps.size(); ++s) steps[s] += entry.figures.steps[s];
    found += entry.figures.found;
    samples += entry.figures.samples;
    refused += entry.figures.refused;
    diverged += entry.figures.diverged;
    exhausted += entry.figures.exhausted;
  }
  const std::size_t most = std::max<std::size_t>(1, *std::max_element(steps.begin(), steps.end()));
  constexpr double left = 64, right = 700, top = 16, bottom = 232;
  const double width = (right - left) / double(steps.size()), decades = std::max(1.0, std::ceil(std::log10(double(most))));
  // Logarithmic, because the slow tail is what matters; a single point is a bar too.
  const auto height = [&](double count) { return (bottom - top) * (std::log10(count) + 0.3) / (decades + 0.3); };
  std::string svg = "<svg viewBox=\"0 0 720 276\" width=\"720\" style=\"max-width:100%\" role=\"img\" aria-label=\"histogram of steps\" font-size=\"12\" fill=\"currentColor\">";
  for (double decade = 0; decade <= decades; ++decade) {
    const double y = bottom - height(std::pow(10, decade));
    svg += fmt::format("<line x1=\"{0}\" x2=\"{1}\" y1=\"{2:.1f}\" y2=\"{2:.1f}\" stroke=\"#8884\"/><text x=\"{3}\" y=\"{4:.1f}\" text-anchor=\"end\">{5:.0f}</text>", left, right, y, left - 6, y + 4, std::pow(10, decade));
  }
  for (std::size_t s = 0; s < steps.size(); ++s) {
    if (steps[s] > 0) svg += fmt::format("<rect x=\"{:.2f}\" y=\"{:.2f}\" width=\"{:.2f}\" height=\"{:.2f}\" fill=\"{}\"><title>{} points after {} steps</title></rect>", left + width * double(s) + 0.5, bottom - height(double(steps[s])), std::max(0.5, width - 1), height(double(steps[s])), plot_colour(0), steps[s], s);
    if (s % 5 == 0) svg += fmt::format("<text x=\"{:.1f}\" y=\"{}\" text-anchor=\"middle\">{}</text>", left + width * (double(s) + 0.5), bottom + 16, s);
  }
  svg += fmt::format("<text x=\"{}\" y=\"268\" text-anchor=\"middle\">steps of Broyden's method until the root was found (points, logarithmic)</text></svg>", 0.5 * (left + right));
  return fmt::format("<div class=\"plots\"><div class=\"plot\">{}</div></div>\n<p class=\"quiet\">{} of {} points were found. Not found: {} had no start (the blended rotation there has no inverse, or something is not finite), {} diverged, {} ran out of steps.</p>\n", svg, found, samples, refused, diverged, exhausted);
}

}  // namespace

std::array<float, 3> singular_value_colour(double sigma) {
  if (!(sigma > 0)) return colour_stops.front().rgb;
  for (std::size_t i = 1; i < colour_stops.size(); ++i) {
    const ColourStop &low = colour_stops[i - 1], &high = colour_stops[i];
    if (sigma > high.sigma) continue;
    const auto part = static_cast<float>((sigma - low.sigma) / (high.sigma - low.sigma));
    std::array<float, 3> rgb{};
    for (std::size_t k = 0; k < 3; ++k) rgb[k] = low.rgb[k] + part * (high.rgb[k] - low.rgb[k]);
    return rgb;
  }
  return colour_stops.back().rgb;
}

Camera close_up(const Camera& camera, std::span<const glm::vec3> vertices) {
  glm::dvec2 low(std::numeric_limits<double>::infinity()), high(-low);
  for (const glm::vec3& vertex : vertices) {
    const glm::dvec2 at = camera.project(glm::dvec3(vertex));
    low = glm::min(low, at);
    high = glm::max(high, at);
  }
  const glm::dvec2 extent = glm::max(high - low, glm::dvec2(1e-6)), middle = 0.5 * (low + high);
  const double larger = filled * std::min(camera.width / extent.x, camera.height / extent.y);
  Camera closer = camera;
  for (const int k : {0, 1}) {
    closer.K[0][k] *= larger;
    closer.K[1][k] *= larger;
  }
  closer.K[2] = {larger * (camera.K[2][0] - middle.x) + 0.5 * (camera.width - 1), larger * (camera.K[2][1] - middle.y) + 0.5 * (camera.height - 1), 1.0};
  return closer;
}

std::vector<std::uint8_t> conditioning_picture(const ExaminedPose& pose, const Camera& camera, double reach) {
  const RgbaPicture drawn = rasterise(camera, pose.vertices, pose.triangles, [&](const SurfaceSample& sample) {
    const glm::uvec3& t = pose.triangles[sample.triangle];
    const std::array<float, 3> rgb = singular_value_colour(double{interpolated(pose.singular, t, sample.barycentric)});
    const glm::vec3 across = glm::cross(pose.vertices[t.y] - pose.vertices[t.x], pose.vertices[t.z] - pose.vertices[t.x]);
    const float facing = glm::length(across) > 0 ? std::abs(glm::dot(glm::normalize(across), sample.view_direction)) : 1.0f;
    return (lit_from_the_side + (1 - lit_from_the_side) * facing) * glm::vec3(rgb[0], rgb[1], rgb[2]);
  });
  std::vector<glm::uvec3> turned;
  for (const glm::uvec3& t : pose.triangles)
    if (std::min({pose.determinants[t.x], pose.determinants[t.y], pose.determinants[t.z]}) < 0) turned.push_back(t);
  const RgbaPicture folds = rasterise(camera, pose.vertices, turned, [](const SurfaceSample&) { return glm::vec3(folded_colour[0], folded_colour[1], folded_colour[2]); });
  std::vector<float> rgb;
  for (std::size_t i = 0; i < drawn.rgba.size(); i += 4) {
    const float alpha = static_cast<float>(drawn.rgba[i + 3]) / 255.0f, fold = fold_shows * static_cast<float>(folds.rgba[i + 3]) / 255.0f;
    for (std::size_t k = 0; k < 3; ++k) {
      const float surface = alpha * static_cast<float>(drawn.rgba[i + k]) / 255.0f + (1 - alpha) * page_white;
      rgb.push_back(surface + fold * (folded_colour[k] - surface));
    }
  }
  const std::vector<VisiblePlace> places = visible_places(camera, pose.vertices, pose.triangles);
  for (const glm::vec3& point : pose.unsolved) {
    const double depth = camera.to_camera(glm::dvec3(point)).z;
    if (!(depth > 0)) continue;
    const glm::dvec2 at = camera.project(glm::dvec3(point));
    if (!(at.x >= 0 && at.y >= 0 && at.x <= camera.width - 1 && at.y <= camera.height - 1)) continue;
    const VisiblePlace& seen = places[static_cast<std::size_t>(std::lround(at.y)) * static_cast<std::size_t>(camera.width) + static_cast<std::size_t>(std::lround(at.x))];
    if (seen.triangle != VisiblePlace::no_triangle) {
      const glm::uvec3& t = pose.triangles[seen.triangle];
      const glm::vec3 front = seen.barycentric.x * pose.vertices[t.x] + seen.barycentric.y * pose.vertices[t.y] + seen.barycentric.z * pose.vertices[t.z];
      if (camera.to_camera(glm::dvec3(front)).z < depth - 1.1 * reach) continue;  // a little more: normals need not face the camera
    }
    draw_dot(rgb, camera.width, camera.height, at);
  }
  return encode_png(rgb, camera.width, camera.height, 3);
}

std::string conditioning_page(const std::string& name, const std::string& where, const Avatar& avatar, const ConditioningSettings& settings, std::vector<ConditioningEntry> poses) {
  std::stable_sort(poses.begin(), poses.end(), [](const ConditioningEntry& a, const ConditioningEntry& b) { return a.figures.bad_share > b.figures.bad_share; });
  std::string html = page_start("Conditioning of " + name);
  html += fmt::format("<p class=\"quiet\">{} poses of {}; {} steps trained, b = {:.2f} mm; surface meshed at {:g} mm; {} points in a shell of ±{:g} cm about each posed surface.</p>\n", poses.size(), escape_html(where), avatar.steps, 1000 * density_scale(avatar), 1000 * settings.cell, poses.empty() ? 0 : poses.front().figures.samples, 100 * settings.reach);
  html += "<h2>Poses, worst first</h2>\n<p class=\"quiet\">J = ∂x̄/∂x is the Jacobian of linear blend skinning at canonical points; σ_min and σ_max are its least and greatest singular values: how many times it shortens and lengthens. Where σ_min comes near 0 posed points tell little about canonical ones; where det J is negative the surface is turned inside out. "
          "Not found: points of the shell to which Broyden's method gave no canonical point; refused: the number of these whose start had no inverse; after rescue: what damped Newton left too. Several roots: searches from the nearest vertex and the nearest bones ended more than 1 mm apart; near: two of the roots lie within twice the shell's reach of the surface. "
          "Amplified: roots through which gradients may grow more than tenfold (σ_min below 0.1). Eikonal: the mean of ||∇f| − 1| on the surface, and at the shell's roots.</p>\n";
  html += poses_table(poses);
  if (!poses.empty()) html += "<h2>Steps of the searches</h2>\n" + steps_section(poses, settings.max_iterations);
  html += "<h2>Pictures</h2>\n" + colour_legend();
  for (const ConditioningEntry& entry : poses) {
    html += fmt::format("<h3>Frame {}</h3>\n<p class=\"quiet\">{}</p>\n<div class=\"pictures\" style=\"grid-template-columns:repeat(auto-fill,minmax(min(300px,100%),1fr))\">\n", entry.figures.frame, escape_html(describe(entry.figures)));
    for (const ReportImage& picture : entry.pictures) html += figure_html(picture, fmt::format("the surface in frame {} by its least singular value", entry.figures.frame));
    html += "</div>\n";
  }
  return html + "</main></body></html>\n";
}

}  // namespace arah

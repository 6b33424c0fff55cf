#include "host/evaluation/plot.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <limits>

namespace arah {
namespace {

constexpr double kWidth = 720;
constexpr double kHeight = 300;
constexpr double kLeft = 64;
constexpr double kRight = 30;
constexpr double kTop = 34;
constexpr double kBottom = 46;
// The legend stands below the plot.
constexpr std::size_t kMostLegendColumns = 3;
constexpr double kLetter = 7.8;  // width of a letter, as wide as the usual fonts have it at 13 units
constexpr double kLegendRow = 18;
// A line of more points than this is drawn without dots: they would hide it.
constexpr std::size_t kMostDots = 120;
// Okabe and Ito's colours, told apart with colour-blind eyes too.
constexpr std::array<const char*, 7> kColours = {"#0072b2", "#d55e00", "#009e73", "#cc79a7",
                                                 "#e69f00", "#56b4e9", "#7f7f7f"};

bool is_drawn(const PlotPoint& point) {
  return std::isfinite(point.x) && std::isfinite(point.y);
}

}  // namespace

PlotAxis round_axis(double low, double high) {
  if (!(low <= high)) return {};
  if (low == high) {
    const double margin = low == 0 ? 1 : 0.1 * std::fabs(low);
    low -= margin;
    high += margin;
  }
  const double raw = (high - low) / 5;
  const double power = std::pow(10.0, std::floor(std::log10(raw)));
  const double step = raw <= 1.0001 * power ? power
                      : raw <= 2 * power    ? 2 * power
                      : raw <= 5 * power    ? 5 * power
                                            : 10 * power;
  return {step * std::floor(low / step), step * std::ceil(high / step), step};
}

std::string tick_text(double value, double step) {
  return fmt::format("{:.6g}", std::fabs(value) < 1e-9 * step ? 0.0 : value);
}

const char* plot_colour(std::size_t index) {
  return kColours[index % kColours.size()];
}

namespace {

// Of a UTF-8 text: bytes that begin one.
std::ptrdiff_t letters(const std::string& text) {
  return std::count_if(text.begin(), text.end(), [](char c) { return (static_cast<unsigned char>(c) & 0xc0) != 0x80; });
}

}  // namespace

std::string escape_html(std::string_view text) {
  std::string out;
  out.reserve(text.size());
  for (const char c : text) {
    switch (c) {
      case '&':
        out += "&amp;";
        break;
      case '<':
        out += "&lt;";
        break;
      case '>':
        out += "&gt;";
        break;
      case '"':
        out += "&quot;";
        break;
      case '\'':
        out += "&#39;";
        break;
      default:
        if ((static_cast<unsigned char>(c) < 0x20 && c != '\n' && c != '\t') || c == 0x7f) {
          out += "\xef\xbf\xbd";
        } else {
          out += c;
        }
    }
  }
  return out;
}

std::string to_svg(const Plot& plot) {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  double low_x = kInfinity, high_x = -kInfinity, low_y = kInfinity, high_y = -kInfinity;
  for (const PlotSeries& series : plot.series) {
    for (const PlotPoint& point : series.points) {
      if (!is_drawn(point)) continue;
      low_x = std::min(low_x, point.x);
      high_x = std::max(high_x, point.x);
      low_y = std::min(low_y, point.y);
      high_y = std::max(high_y, point.y);
    }
  }
  const bool empty = low_x > high_x;
  const PlotAxis x_axis = round_axis(low_x, high_x);
  const PlotAxis y_axis = round_axis(low_y, high_y);
  auto at_x = [&](double x) {
    return kLeft + (x - x_axis.low) / (x_axis.high - x_axis.low) * (kWidth - kLeft - kRight);
  };
  auto at_y = [&](double y) {
    return kHeight - kBottom - (y - y_axis.low) / (y_axis.high - y_axis.low) * (kHeight - kTop - kBottom);
  };

  // As many columns as leave room for the longest name. One series is named by the title and the axis.
  std::ptrdiff_t longest = 1;
  for (const PlotSeries& series : plot.series) longest = std::max(longest, letters(series.label));
  const std::size_t legend_columns = std::clamp<std::size_t>(static_cast<std::size_t>((kWidth - kLeft) / (kLetter * static_cast<double>(longest) + 24)), 1, kMostLegendColumns);
  const std::size_t legend_rows = plot.series.size() > 1 ? (plot.series.size() + legend_columns - 1) / legend_columns : 0;
  std::string svg;
  auto out = std::back_inserter(svg);
  fmt::format_to(out,
                 "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {} {}\" role=\"img\" "
                 "font-family=\"system-ui,sans-serif\" "
                 "font-size=\"13\" fill=\"currentColor\"><title>{}</title>\n",
                 kWidth, kHeight + kLegendRow * static_cast<double>(legend_rows), escape_html(plot.title));
  fmt::format_to(out, "<text x=\"{}\" y=\"16\" font-weight=\"600\">{}</text>\n", kLeft, escape_html(plot.title));

  const int x_ticks = static_cast<int>(std::lround((x_axis.high - x_axis.low) / x_axis.step));
  const int y_ticks = static_cast<int>(std::lround((y_axis.high - y_axis.low) / y_axis.step));
  for (int i = 0; i <= y_ticks; ++i) {
    const double value = y_axis.low + i * y_axis.step;
    fmt::format_to(out,
                   "<line x1=\"{0}\" x2=\"{1}\" y1=\"{2:.1f}\" y2=\"{2:.1f}\" stroke=\"currentColor\" opacity=\".18\"/>"
                   "<text x=\"{3}\" y=\"{4:.1f}\" text-anchor=\"end\">{5}</text>\n",
                   kLeft, kWidth - kRight, at_y(value), kLeft - 8, at_y(value) + 4, tick_text(value, y_axis.step));
  }
  for (int i = 0; i <= x_ticks; ++i) {
    const double value = x_axis.low + i * x_axis.step;
    fmt::format_to(out, "<text x=\"{:.1f}\" y=\"{}\" text-anchor=\"middle\">{}</text>\n", at_x(value),
                   kHeight - kBottom + 18, tick_text(value, x_axis.step));
  }
  fmt::format_to(out, "<text x=\"{}\" y=\"{}\" text-anchor=\"middle\">{}</text>\n", (kLeft + kWidth - kRight) / 2,
                 kHeight - 8, escape_html(plot.x_label));
  fmt::format_to(out, "<text transform=\"translate(14 {}) rotate(-90)\" text-anchor=\"middle\">{}</text>\n",
                 (kTop + kHeight - kBottom) / 2, escape_html(plot.y_label));
  if (empty) {
    fmt::format_to(out, "<text x=\"{}\" y=\"{}\" text-anchor=\"middle\">no data</text>\n",
                   (kLeft + kWidth - kRight) / 2, (kTop + kHeight - kBottom) / 2);
  }

  for (std::size_t s = 0; s < plot.series.size(); ++s) {
    const PlotSeries& series = plot.series[s];
    const char* colour = plot_colour(s);
    if (plot.lines) {
      std::string path;
      bool joined = false;
      for (const PlotPoint& point : series.points) {
        if (is_drawn(point)) {
          fmt::format_to(std::back_inserter(path), "{}{:.1f} {:.1f}", joined ? 'L' : 'M', at_x(point.x), at_y(point.y));
        }
        joined = is_drawn(point);
      }
      if (!path.empty()) {
        fmt::format_to(out,
                       "<path d=\"{}\" fill=\"none\" stroke=\"{}\" stroke-width=\"1.8\" stroke-linejoin=\"round\"/>\n",
                       path, colour);
      }
    }
    if (!plot.lines || series.points.size() <= kMostDots) {
      for (const PlotPoint& point : series.points) {
        if (!is_drawn(point)) continue;
        fmt::format_to(out, "<circle cx=\"{:.1f}\" cy=\"{:.1f}\" r=\"3\" fill=\"{}\">", at_x(point.x), at_y(point.y),
                       colour);
        if (!point.name.empty()) fmt::format_to(out, "<title>{}</title>", escape_html(point.name));
        svg += "</circle>\n";
      }
    }
    if (legend_rows > 0) {
      const double x = kLeft + static_cast<double>(s % legend_columns) * (kWidth - kLeft) / static_cast<double>(legend_columns);
      const double y = kHeight + 6 + kLegendRow * static_cast<double>(s / legend_columns);
      fmt::format_to(
          out, "<circle cx=\"{:.1f}\" cy=\"{:.1f}\" r=\"4\" fill=\"{}\"/><text x=\"{:.1f}\" y=\"{:.1f}\">{}</text>\n",
          x, y, colour, x + 9, y + 4, escape_html(series.label));
    }
  }
  svg += "</svg>\n";
  return svg;
}

}  // namespace arah

// Small line and scatter plots as SVG text, to stand in a page or in a file of their own.
#pragma once

#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

namespace arah {

struct PlotPoint {
  double x = 0;
  double y = 0;
  std::string name;  // shown when the pointer rests on the point; may be empty
};

struct PlotSeries {
  std::string label;
  std::vector<PlotPoint> points;  // in the order in which a line joins them
};

struct Plot {
  std::string title;
  std::string x_label;
  std::string y_label;
  std::vector<PlotSeries> series;
  bool lines = true;  // false: points only
};

// `<svg ...>...</svg>`, 720 units wide and 300 high plus the legend (none for a single series), as wide as its
// container allows; axes at round numbers that cover the points. Points with a coordinate that is not finite are left
// out, and a line breaks there. With no point left, the axes carry the words "no data". Every text is escaped.
std::string to_svg(const Plot& plot);

// What other drawings share: one axis with ends and spacing of its ticks, about five of 1, 2 or 5 times a power of ten around
// [low, high]; a tick's text, where a rounding error such as 5e-17 reads 0; and colours that are told apart with
// colour-blind eyes too, over and over.
struct PlotAxis {
  double low = 0;
  double high = 1;
  double step = 0.2;
};
PlotAxis round_axis(double low, double high);
std::string tick_text(double value, double step);
const char* plot_colour(std::size_t index);

// Text with the five characters that mean something to HTML and XML replaced by entities; control characters, which XML
// forbids, become U+FFFD.
std::string escape_html(std::string_view text);

}  // namespace arah

// Small line and scatter plots as SVG text, to stand in a page or in a file of their own.
#pragma once

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

// Text with the five characters that mean something to HTML and XML replaced by entities; control characters, which XML
// forbids, become U+FFFD.
std::string escape_html(std::string_view text);

}  // namespace arah

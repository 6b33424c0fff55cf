// The report as a reader's browser gets it: complete, escaped, without any other file.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <string>
#include <vector>

#include "host/evaluation/report.h"

namespace arah {
namespace {

using testing::HasSubstr;
using testing::Not;

constexpr double kInfinity = std::numeric_limits<double>::infinity();

std::size_t count(const std::string& text, const std::string& part) {
  std::size_t found = 0;
  for (std::size_t at = text.find(part); at != std::string::npos; at = text.find(part, at + part.size())) ++found;
  return found;
}

std::vector<std::uint8_t> bytes(const std::string& text) {
  return {text.begin(), text.end()};
}

Report example() {
  Report report;
  report.title = "Avatar of <Ada> & \"Bob\"";
  report.summary = "a summary with <b>";
  report.definition = metrics_definition();
  report.facts = {{"avatar's file", "out/<avatar>.safetensors"}};
  report.rows = {
      {"novel view", "cam<04>", 0, 24.0, 0.91, {{"depth error <mm>", 3.25}}, {{"photo<graph>", bytes("a")}}},
      {"novel view", "cam<04>", 6, 20.0, 0.87, {}, {{"photo<graph>", bytes("ab")}, {"error ×4", bytes("abc")}}},
      {"novel pose", "cam&05", 6, 22.0, std::nullopt, {}, {{"photo<graph>", bytes("abcd")}}},
  };
  report.plots = {
      {"loss <L>", "step & time", "value \"v\"", {{"line<1>", {{0, 1, "p<0>"}, {10, 0.1, ""}}}, {"line 2", {}}}}};
  return report;
}

TEST(Report, HoldsEveryTextEscaped) {
  const std::string html = to_html(example());
  for (const char* text :
       {"Avatar of &lt;Ada&gt; &amp; &quot;Bob&quot;", "a summary with &lt;b&gt;", "data range 2", "avatar&#39;s file",
        "out/&lt;avatar&gt;.safetensors", "cam&lt;04&gt; · frame 6", "cam&amp;05 · frame 6", "depth error &lt;mm&gt;",
        "photo&lt;graph&gt;", "error ×4", "loss &lt;L&gt;", "step &amp; time", "value &quot;v&quot;", "line&lt;1&gt;",
        "p&lt;0&gt;", "novel view", "novel pose"}) {
    EXPECT_THAT(html, HasSubstr(text));
  }
  for (const char* raw : {"<Ada>", "<avatar>", "<04>", "<mm>", "<graph>", "<L>", "<1>", "<0>"}) {
    EXPECT_THAT(html, Not(HasSubstr(raw)));
  }
}

TEST(Report, ControlCharactersNeverReachThePage) {
  EXPECT_EQ(escape_html(std::string("a\x01\n\x7f", 4)), "a\xef\xbf\xbd\n\xef\xbf\xbd");
}

TEST(Report, EmbedsItsPicturesAndAsksForNothingElse) {
  const std::string html = to_html(example());
  for (const char* data : {"base64,YQ==\"", "base64,YWI=\"", "base64,YWJj\"", "base64,YWJjZA==\""}) {
    EXPECT_THAT(html, HasSubstr(data));
  }
  EXPECT_EQ(count(html, "<img "), 4u);
  EXPECT_EQ(count(html, " src=\""), count(html, " src=\"data:image/png;base64,"));
  EXPECT_THAT(html, Not(HasSubstr("<script")));
  EXPECT_THAT(html, Not(HasSubstr("<link")));
  EXPECT_THAT(html, Not(HasSubstr("@import")));
  EXPECT_THAT(html, Not(HasSubstr("url(")));
  EXPECT_EQ(count(html, "http"), count(html, "xmlns=\"http://www.w3.org/2000/svg\""));
}

TEST(Report, ShowsTheWorstPicturesFirst) {
  Report report = example();
  report.rows.push_back({"novel pose", "unmeasured", 7, std::nan(""), std::nullopt, {}, {{"rendering", bytes("x")}}});
  report.rows.push_back({"novel pose", "identical", 8, kInfinity, 1.0, {}, {{"rendering", bytes("y")}}});
  const std::string html = to_html(report);
  const std::string pictures = html.substr(html.find("worst first"));
  std::vector<std::size_t> places;
  for (const char* heading : {"<h3>unmeasured · frame 7", "<h3>cam&lt;04&gt; · frame 6", "<h3>cam&amp;05 · frame 6",
                              "<h3>cam&lt;04&gt; · frame 0", "<h3>identical · frame 8"}) {
    places.push_back(pictures.find(heading));
    ASSERT_NE(places.back(), std::string::npos) << heading;
  }
  EXPECT_TRUE(std::is_sorted(places.begin(), places.end()));
}

TEST(Report, SummarisesEachSplitAndAll) {
  const std::string html = to_html(example());
  EXPECT_THAT(html, HasSubstr("novel view</td><td>2</td><td>22.00 ± 2.83</td><td>20.00</td><td>0.8900 ± 0.0283</td>"));
  EXPECT_THAT(html, HasSubstr("novel pose</td><td>1</td><td>22.00</td><td>22.00</td><td>–</td>"));
  EXPECT_THAT(html, HasSubstr("all</td><td>3</td><td>22.00 ± 2.00</td><td>20.00</td><td>0.8900 ± 0.0283</td>"));
  EXPECT_THAT(html, HasSubstr("<td>24.00</td><td>0.9100</td><td>3.250</td>"));
  EXPECT_THAT(html, HasSubstr("Left out of the mean SSIM: 1 without one."));
  EXPECT_THAT(html, Not(HasSubstr("Left out of the mean PSNR")));
}

TEST(Report, SaysWhatTheMeanLeavesOut) {
  Report report = example();
  report.rows[0].psnr = kInfinity;
  report.rows[1].psnr = std::nan("");
  const std::string html = to_html(report);
  EXPECT_THAT(html, HasSubstr("novel view</td><td>2</td><td>–</td><td>∞</td>"));
  EXPECT_THAT(html, HasSubstr("Left out of the mean PSNR: 1 identical to the truth"));
  EXPECT_THAT(html, HasSubstr("Left out of the mean PSNR: 1 not measured"));
}

TEST(Report, LpipsHasItsColumnsWhereItWasMeasuredAndNoNameElsewhere) {
  Report report = example();
  EXPECT_THAT(to_html(report), Not(HasSubstr("LPIPS")));
  report.rows[0].lpips = 0.25;
  report.rows[1].lpips = 0.125;
  const std::string html = to_html(report);
  EXPECT_THAT(html, HasSubstr("<b>0.1875</b>mean LPIPS"));
  EXPECT_THAT(html, HasSubstr("<th>mean LPIPS</th></tr>"));
  EXPECT_THAT(html, HasSubstr("novel view</td><td>2</td><td>22.00 ± 2.83</td><td>20.00</td><td>0.8900 ± 0.0283</td><td>0.1875</td></tr>"));
  EXPECT_THAT(html, HasSubstr("novel pose</td><td>1</td><td>22.00</td><td>22.00</td><td>–</td><td>–</td></tr>"));
  EXPECT_THAT(html, HasSubstr("<th>SSIM</th><th>LPIPS</th>"));
  EXPECT_THAT(html, HasSubstr("<td>24.00</td><td>0.9100</td><td>0.2500</td><td>3.250</td>"));
  EXPECT_THAT(html, HasSubstr("SSIM 0.8700 · LPIPS 0.1250</span>"));
  EXPECT_THAT(html, HasSubstr("Left out of the mean LPIPS: 1 without one."));
}

TEST(Report, AnEmptyReportIsStillAPage) {
  const std::string html = to_html({});
  EXPECT_THAT(html, HasSubstr("<!doctype html>"));
  EXPECT_THAT(html, HasSubstr("</html>"));
  EXPECT_THAT(html, Not(HasSubstr("<svg")));
}

TEST(Plot, PutsPointsBetweenRoundTicks) {
  const Plot plot{"curve", "frame", "PSNR", {{"a", {{0, 21.3, ""}, {30, 24.8, ""}}}}, true};
  const std::string svg = to_svg(plot);
  for (const char* tick : {">21<", ">25<", ">0<", ">30<"}) EXPECT_THAT(svg, HasSubstr(tick));
  EXPECT_EQ(count(svg, "<circle"), 2u);
  EXPECT_EQ(count(svg, "<path"), 1u);
}

TEST(Plot, BreaksTheLineWhereThereIsNoNumber) {
  const Plot plot{"", "", "", {{"a", {{0, 1, ""}, {1, 2, ""}, {2, kInfinity, ""}, {3, 2, ""}, {4, 1, ""}}}}, true};
  const std::string svg = to_svg(plot);
  const std::size_t from = svg.find("<path");
  const std::string path = svg.substr(from, svg.find("/>", from) - from);
  EXPECT_EQ(count(path, "M"), 2u);
  EXPECT_EQ(count(path, "L"), 2u);
  EXPECT_EQ(count(svg, "<circle"), 4u);
  EXPECT_THAT(svg, Not(HasSubstr("inf")));
}

TEST(Plot, DrawsOnePointAndNone) {
  const std::string one = to_svg({"", "", "", {{"a", {{3, -1e-9, ""}}}}, false});
  EXPECT_EQ(count(one, "<circle"), 1u);
  EXPECT_THAT(one, Not(HasSubstr("nan")));
  EXPECT_THAT(to_svg({"", "", "", {{"a", {{kInfinity, 1, ""}}}}, true}), HasSubstr("no data"));
}

}  // namespace
}  // namespace arah

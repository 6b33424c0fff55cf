#include "host/evaluation/report.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <span>
#include <string_view>

#include "host/evaluation/image_metrics.h"

namespace arah {
namespace {

constexpr std::string_view kStyle = R"(
:root{color-scheme:light dark;--back:#fff;--card:#f5f6f8;--text:#16181d;--quiet:#5c6370;--line:#dcdfe5;--accent:#0072b2}
@media(prefers-color-scheme:dark){:root{--back:#14161a;--card:#1d2026;--text:#e8eaee;--quiet:#9aa2b1;--line:#333842;--accent:#56b4e9}}
*{box-sizing:border-box}
body{margin:0;background:var(--back);color:var(--text);font:16px/1.5 system-ui,-apple-system,"Segoe UI",sans-serif}
main{max-width:1200px;margin:0 auto;padding:24px 16px 64px}
h1{font-size:1.75rem;line-height:1.2;margin:.2em 0}
h2{font-size:1.2rem;margin:2em 0 .6em}
h3{font-size:1rem;margin:0 0 .5em}
p{margin:.4em 0}
.quiet{color:var(--quiet)}
.cards{display:grid;grid-template-columns:repeat(auto-fit,minmax(150px,1fr));gap:12px;margin:1.2em 0}
.card,.shot,.plot{background:var(--card);border:1px solid var(--line);border-radius:12px;padding:14px 16px}
.card b{display:block;font-size:1.7rem;line-height:1.2;color:var(--accent)}
.scroll{overflow-x:auto;-webkit-overflow-scrolling:touch}
table{border-collapse:collapse;width:100%;font-variant-numeric:tabular-nums}
th,td{padding:6px 12px;text-align:right;border-bottom:1px solid var(--line);white-space:nowrap}
th{font-weight:600;color:var(--quiet);vertical-align:bottom}
.facts th{vertical-align:top}
.left{text-align:left}
.wide th,.wide .words{white-space:normal}
.wide th,.wide td{padding:6px 8px}
.wide .words{min-width:11em}
.fact{text-align:left;white-space:normal;overflow-wrap:anywhere}
.shot,.plot{margin:0 0 16px}
.plots{display:grid;grid-template-columns:repeat(auto-fit,minmax(min(520px,100%),1fr));gap:0 16px}
.plot{overflow-x:auto}
.plot svg{display:block;width:100%;min-width:460px;height:auto}
.facts th{width:1%}
.pictures{display:grid;grid-template-columns:repeat(auto-fit,minmax(140px,1fr));gap:10px}
figure{margin:0}
figure img{display:block;width:100%;height:auto;border-radius:6px;background:#000;image-rendering:auto}
figcaption{font-size:.85rem;color:var(--quiet);margin-top:4px;text-align:center}
@media(max-width:480px){.pictures{grid-template-columns:1fr 1fr}th,td{padding:6px 8px}.facts th{white-space:normal;min-width:8em}}
)";

std::string base64(std::span<const std::uint8_t> bytes) {
  constexpr char kDigits[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string text;
  text.reserve((bytes.size() + 2) / 3 * 4);
  for (std::size_t i = 0; i < bytes.size(); i += 3) {
    const std::size_t left = bytes.size() - i;
    const unsigned group = bytes[i] << 16 | (left > 1 ? bytes[i + 1] << 8 : 0) | (left > 2 ? bytes[i + 2] : 0);
    text += kDigits[group >> 18];
    text += kDigits[group >> 12 & 63];
    text += left > 1 ? kDigits[group >> 6 & 63] : '=';
    text += left > 2 ? kDigits[group & 63] : '=';
  }
  return text;
}

std::string number(double value, int digits) {
  if (std::isnan(value)) return "–";
  if (std::isinf(value)) return value > 0 ? "∞" : "−∞";
  return fmt::format("{:.{}f}", value, digits);
}

std::string number(const std::optional<double>& value, int digits) {
  return value ? number(*value, digits) : "–";
}

std::string row_text(const ReportRow& row) { return row.camera + (row.camera.empty() ? "" : " · ") + fmt::format("frame {}", row.frame); }
std::string row_name(const ReportRow& row) { return escape_html(row_text(row)); }

struct Summary {
  std::string split;
  std::vector<double> psnr;
  std::vector<double> ssim, ssim_of_the_paper;
  std::vector<double> lpips;
};

Summary summarise(const Report& report, const std::string* split) {
  Summary summary;
  summary.split = split ? *split : "all";
  for (const ReportRow& row : report.rows) {
    if (split && row.split != *split) continue;
    summary.psnr.push_back(row.psnr);
    if (row.ssim) summary.ssim.push_back(*row.ssim);
    if (row.ssim_of_the_paper) summary.ssim_of_the_paper.push_back(*row.ssim_of_the_paper);
    if (row.lpips) summary.lpips.push_back(*row.lpips);
  }
  return summary;
}

// "28.60 ± 1.21", or without the spread where there is none.
std::string mean_and_spread(const std::vector<double>& values, int digits) {
  const std::optional<double> spread = spread_of_finite(values);
  return number(mean_of_finite(values), digits) + (spread ? " ± " + number(spread, digits) : "");
}

bool has_paper_ssim(const Report& report) {
  return std::any_of(report.rows.begin(), report.rows.end(), [](const ReportRow& row) { return row.ssim_of_the_paper.has_value(); });
}

bool has_lpips(const Report& report) {
  return std::any_of(report.rows.begin(), report.rows.end(), [](const ReportRow& row) { return row.lpips.has_value(); });
}

template <typename Value>
void add_once(std::vector<Value>& values, const Value& value) {
  if (std::find(values.begin(), values.end(), value) == values.end()) values.push_back(value);
}

std::string summary_section(const Report& report) {
  std::vector<std::string> splits;
  for (const ReportRow& row : report.rows) add_once(splits, row.split);
  std::vector<Summary> summaries;
  for (const std::string& split : splits) summaries.push_back(summarise(report, &split));
  const Summary all = summarise(report, nullptr);
  if (splits.size() > 1) summaries.push_back(all);
  const bool lpips = has_lpips(report), paper_ssim = has_paper_ssim(report);

  std::string html = "<div class=\"cards\">";
  auto out = std::back_inserter(html);
  fmt::format_to(out, "<div class=\"card\"><b>{} dB</b>mean PSNR</div>", number(mean_of_finite(all.psnr), 2));
  fmt::format_to(out, "<div class=\"card\"><b>{}</b>mean SSIM</div>", number(mean_of_finite(all.ssim), 4));
  if (lpips) fmt::format_to(out, "<div class=\"card\"><b>{}</b>mean LPIPS</div>", number(mean_of_finite(all.lpips), 4));
  fmt::format_to(out, "<div class=\"card\"><b>{}</b>{}</div></div>\n", all.psnr.size(),
                 all.psnr.size() == 1 ? "picture" : "pictures");

  html +=
      "<div class=\"scroll\"><table><tr><th class=\"left\">split</th><th>pictures</th><th>mean PSNR (dB)</th>"
      "<th>lowest PSNR (dB)</th><th>mean SSIM</th>";
  if (paper_ssim) html += "<th>mean SSIM, data range 2</th>";
  html += lpips ? "<th>mean LPIPS</th></tr>\n" : "</tr>\n";
  for (const Summary& summary : summaries) {
    double lowest = std::numeric_limits<double>::quiet_NaN();
    for (double psnr : summary.psnr) lowest = std::fmin(lowest, psnr);
    fmt::format_to(out, "<tr><td class=\"left\">{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td>",
                   escape_html(summary.split), summary.psnr.size(), mean_and_spread(summary.psnr, 2), number(lowest, 2), mean_and_spread(summary.ssim, 4));
    if (paper_ssim) fmt::format_to(out, "<td>{}</td>", mean_and_spread(summary.ssim_of_the_paper, 4));
    if (lpips) fmt::format_to(out, "<td>{}</td>", number(mean_of_finite(summary.lpips), 4));
    html += "</tr>\n";
  }
  html += "</table></div>\n";

  const auto identical = std::count_if(all.psnr.begin(), all.psnr.end(), [](double psnr) { return std::isinf(psnr); });
  const auto unmeasured = std::count_if(all.psnr.begin(), all.psnr.end(), [](double psnr) { return std::isnan(psnr); });
  if (identical > 0) {
    fmt::format_to(out, "<p class=\"quiet\">Left out of the mean PSNR: {} identical to the truth (∞ dB).</p>\n",
                   identical);
  }
  if (unmeasured > 0)
    fmt::format_to(out, "<p class=\"quiet\">Left out of the mean PSNR: {} not measured.</p>\n", unmeasured);
  if (all.ssim.size() < all.psnr.size()) {
    fmt::format_to(out, "<p class=\"quiet\">Left out of the mean SSIM: {} without one.</p>\n",
                   all.psnr.size() - all.ssim.size());
  }
  if (lpips && all.lpips.size() < all.psnr.size())
    fmt::format_to(out, "<p class=\"quiet\">Left out of the mean LPIPS: {} without one.</p>\n", all.psnr.size() - all.lpips.size());
  return html;
}

std::string table_section(const Report& report) {
  std::vector<std::string> measures;
  for (const ReportRow& row : report.rows) {
    for (const auto& [name, value] : row.measures) add_once(measures, name);
  }
  std::string html =
      "<div class=\"scroll\"><table><tr><th class=\"left\">picture</th><th class=\"left\">split</th>"
      "<th>PSNR (dB)</th><th>SSIM</th>";
  auto out = std::back_inserter(html);
  const bool lpips = has_lpips(report);
  const bool paper_ssim = has_paper_ssim(report);
  if (paper_ssim) html += "<th>SSIM, data range 2</th>";
  if (lpips) html += "<th>LPIPS</th>";
  for (const std::string& name : measures) fmt::format_to(out, "<th>{}</th>", escape_html(name));
  html += "</tr>\n";
  for (const ReportRow& row : report.rows) {
    fmt::format_to(out, "<tr><td class=\"left\">{}</td><td class=\"left\">{}</td><td>{}</td><td>{}</td>", row_name(row),
                   escape_html(row.split), number(row.psnr, 2), number(row.ssim, 4));
    if (paper_ssim) fmt::format_to(out, "<td>{}</td>", number(row.ssim_of_the_paper, 4));
    if (lpips) fmt::format_to(out, "<td>{}</td>", number(row.lpips, 4));
    for (const std::string& name : measures) {
      const auto found =
          std::find_if(row.measures.begin(), row.measures.end(), [&](const auto& m) { return m.first == name; });
      fmt::format_to(out, "<td>{}</td>", found == row.measures.end() ? "–" : number(found->second, 3));
    }
    html += "</tr>\n";
  }
  html += "</table></div>\n";
  return html;
}

// One line a camera and split, in the order of the frames.
Plot psnr_plot(const Report& report) {
  Plot plot{"PSNR over frames", "frame", "PSNR (dB)", {}, true};
  std::vector<std::pair<std::string, std::string>> lines;
  for (const ReportRow& row : report.rows) add_once(lines, std::make_pair(row.split, row.camera));
  const bool several = std::any_of(lines.begin(), lines.end(), [&](const auto& line) { return line.first != lines[0].first; });
  for (const auto& [split, camera] : lines) {
    PlotSeries series;
    series.label = camera;
    if (several || camera.empty()) series.label += (camera.empty() || split.empty() ? "" : ", ") + split;
    for (const ReportRow& row : report.rows) {
      if (row.split != split || row.camera != camera) continue;
      series.points.push_back(
          {static_cast<double>(row.frame), row.psnr,
           fmt::format("{}{}frame {}: {} dB", camera, camera.empty() ? "" : ", ", row.frame, number(row.psnr, 2))});
    }
    std::stable_sort(series.points.begin(), series.points.end(),
                     [](const PlotPoint& a, const PlotPoint& b) { return a.x < b.x; });
    plot.series.push_back(std::move(series));
  }
  return plot;
}

std::string pictures_section(const Report& report) {
  std::vector<const ReportRow*> rows;
  for (const ReportRow& row : report.rows) {
    if (!row.images.empty()) rows.push_back(&row);
  }
  // What could not be measured comes first: it is what most needs a look.
  auto rank = [](double psnr) { return std::isnan(psnr) ? -std::numeric_limits<double>::infinity() : psnr; };
  std::stable_sort(rows.begin(), rows.end(),
                   [&](const ReportRow* a, const ReportRow* b) { return rank(a->psnr) < rank(b->psnr); });
  std::string html;
  auto out = std::back_inserter(html);
  for (const ReportRow* row : rows) {
    fmt::format_to(out,
                   "<section class=\"shot\"><h3>{} <span class=\"quiet\">{} · PSNR {} dB · SSIM {}{}</span></h3>\n<div "
                   "class=\"pictures\">",
                   row_name(*row), escape_html(row->split), number(row->psnr, 2), number(row->ssim, 4),
                   row->lpips ? " · LPIPS " + number(*row->lpips, 4) : "");
    for (const ReportImage& image : row->images) {
      html += figure_html(image, row_text(*row));
    }
    html += "</div></section>\n";
  }
  return html;
}

}  // namespace

std::string metrics_definition() {
  return fmt::format(
      "PSNR: −10 log₁₀ of the mean squared error over the pixels of the region mask and their three channels, values in [0, 1], not quantised. SSIM: 7×7 uniform "
      "window, sample covariance, K₁ = 0.01, K₂ = 0.03, data range {}, over the bounding rectangle of the same mask less a border of 3 pixels, mean over the channels; the paper's "
      "tables have data range {}, which gives higher figures.",
      kDataRange, kDataRangeOfThePaper);
}

std::string page_start(const std::string& title) {
  return fmt::format(
      "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">"
      "<meta name=\"viewport\" content=\"width=device-width,initial-scale=1\"><title>{}</title><style>{}</style></head><body><main>\n<h1>{}</h1>\n",
      escape_html(title), kStyle, escape_html(title));
}

std::string figure_html(const ReportImage& image, const std::string& of) {
  const std::string label = escape_html(image.label);
  return fmt::format("<figure><img loading=\"lazy\" alt=\"{}, {}\" src=\"data:image/png;base64,{}\"><figcaption>{}</figcaption></figure>\n", label, escape_html(of), base64(image.png), label);
}

std::string to_html(const Report& report) {
  std::string html = page_start(report.title);
  auto out = std::back_inserter(html);
  if (!report.summary.empty()) fmt::format_to(out, "<p class=\"quiet\">{}</p>\n", escape_html(report.summary));

  if (!report.rows.empty()) html += summary_section(report);
  if (!report.definition.empty()) fmt::format_to(out, "<p class=\"quiet\">{}</p>\n", escape_html(report.definition));
  if (!report.facts.empty()) {
    html += "<table class=\"facts\">";
    for (const auto& [name, value] : report.facts) {
      fmt::format_to(out, "<tr><th class=\"left\">{}</th><td class=\"fact\">{}</td></tr>\n", escape_html(name),
                     escape_html(value));
    }
    html += "</table>\n";
  }

  std::vector<Plot> plots = report.plots;
  if (!report.rows.empty()) plots.insert(plots.begin(), psnr_plot(report));
  if (!plots.empty()) html += "<h2>Curves</h2>\n<div class=\"plots\">\n";
  for (const Plot& plot : plots) html += "<div class=\"plot\">" + to_svg(plot) + "</div>\n";
  if (!plots.empty()) html += "</div>\n";

  const std::string pictures = pictures_section(report);
  if (!pictures.empty()) html += "<h2>Pictures, worst first</h2>\n" + pictures;
  if (!report.rows.empty()) html += "<h2>Every picture</h2>\n" + table_section(report);
  html += "</main></body></html>\n";
  return html;
}

}  // namespace arah

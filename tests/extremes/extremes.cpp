#include "tests/extremes/extremes.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <map>
#include <set>
#include <sstream>

#include "tests/kernels/device_fixture.h"

namespace arah::extremes {
namespace {

struct Title {
  const char* words;     // DESIGN.md, section 8
  const char* backward;  // why there is no way back, or empty
};
constexpr std::array<Title, row_count> titles = {{
    {"A NaN or Inf never leaves a kernel unnoticed", ""},
    {"b from 1e-6 to 1e6 and |sdf|/b up to 1e9", ""},
    {"density·δ from 0 to 1e12", ""},
    {"Transmittance underflow on 1,000 opaque samples", ""},
    {"One sample, no sample, all samples masked", ""},
    {"Broyden: singular and near-singular Jacobians, zero denominators, start at the root, start 10 m away, NaN start", ""},
    {"Rays parallel to a box face, starting inside the box, degenerate boxes", "Rays are constants: no gradient goes to cameras or boxes."},
    {"Rotations of 0, 1e-8, π − 1e-7, π, 10 π; non-orthogonal input", ""},
    {"Logits ±1e4 before the ×20", ""},
    {"Softplus β = 100 at ±1e6", ""},
    {"Sine phases to 1e4", ""},
    {"Bodies of 1 mm and 1 km, cameras at 1 cm and 10 km", ""},
    {"1×1 and 8192-wide images", ""},
    {"Denormals", ""},
    {"All-black and all-foreground masks", ""},
    {"One frame, one camera, one joint, 64 joints", ""},
    {"Penalties of distances from −1e6 to 1e6", ""},
}};

// A bar would end a table's cell.
std::string escaped(std::string text) {
  for (size_t at = 0; (at = text.find('|', at)) != std::string::npos; at += 2) text.insert(at, 1, '\\');
  return text;
}

struct Case {
  Way way;
  std::string what, expected, measured;
  // The page's line without what was measured, which differs from device to device.
  std::string key() const { return fmt::format("| {} | {} | {} |", way == Way::forward ? "forward" : "backward", escaped(what), escaped(expected)); }
};

std::array<std::vector<Case>, row_count> cases;
std::map<std::string, std::string> pictures;

void keep(Row row, Case made) {
  std::vector<Case>& of_row = cases[static_cast<size_t>(row)];
  for (const Case& other : of_row) {
    if (other.key() == made.key()) ADD_FAILURE() << "two cases are called " << made.key();
  }
  of_row.push_back(std::move(made));
}

std::string text_of(const std::filesystem::path& path) {
  std::ifstream file(path);
  return {std::istreambuf_iterator<char>(file), {}};
}

std::string page(const DeviceReport& device) {
  std::string text = fmt::format(
      "# At the extremes\n\nWritten by `tests/extremes` (`ARAH_WRITE_EXTREMES=1 test_extremes`), not by hand: what goes in at the ends of every\n"
      "range, what must come out, forward and backward, and what came out when the page was last written, on\n{}, {}.\n"
      "The figures differ from device to device, within the bounds; a test fails where a case is missing here or a bound is broken.\n\n"
      "Errors of single formulas over their whole ranges, against long double; “plain” is the formula as one would write it first, in the same\n"
      "precision. What lies on the lower edge of a picture has no error that its precision could show.\n\n",
      device.name, device.driver);
  for (const auto& [name, svg] : pictures) text += fmt::format("![{}](pictures/{}.svg)\n\n", name, name);
  for (size_t row = 0; row < titles.size(); ++row) {
    text += fmt::format("## {}\n\n", titles[row].words);
    if (titles[row].backward[0]) text += fmt::format("{}\n\n", titles[row].backward);
    text += "| way | case | must come out | came out |\n|---|---|---|---|\n";
    for (const Case& one : cases[row]) text += fmt::format("{} {} |\n", one.key(), one.measured);
    text += "\n";
  }
  text.pop_back();
  return text;
}

// The lines of cases, without what was measured.
std::multiset<std::string> keys_of(const std::string& text) {
  std::multiset<std::string> keys;
  std::istringstream lines(text);
  for (std::string line; std::getline(lines, line);)
    if (line.starts_with("| forward |") || line.starts_with("| backward |")) keys.insert(line.substr(0, line.rfind('|', line.size() - 2) + 1));
  return keys;
}

// What a picture draws, without where: the texts of its SVG that are no numbers.
std::multiset<std::string> labels_of(const std::string& svg) {
  std::multiset<std::string> labels;
  for (size_t at = 0; (at = svg.find("</text>", at)) != std::string::npos; ++at) {
    const size_t from = svg.rfind('>', at) + 1;
    const std::string label = svg.substr(from, at - from);
    if (label.find_first_not_of("0123456789.-+e") != std::string::npos) labels.insert(label);
  }
  return labels;
}

// After all tests: every row has its cases both ways, and the page in docs/ has them too.
class Page : public testing::Environment {
 public:
  void TearDown() override {
    if (GTEST_FLAG_GET(filter) != "*" || std::getenv("GTEST_TOTAL_SHARDS")) {
      std::printf("Only a run of all tests compares its cases with docs/extremes.md.\n");
      return;
    }
    for (size_t row = 0; row < titles.size(); ++row)
      for (const Way way : {Way::forward, Way::backward}) {
        const bool wanted = way == Way::forward || !titles[row].backward[0];
        const bool found = std::any_of(cases[row].begin(), cases[row].end(), [&](const Case& one) { return one.way == way; });
        if (wanted && !found) ADD_FAILURE() << "no case " << (way == Way::forward ? "forward" : "backward") << " of the row: " << titles[row].words;
      }
    const std::filesystem::path docs = std::filesystem::path(ARAH_SOURCE_DIR) / "docs";
    const std::string now = page(test_device().report());
    if (std::getenv("ARAH_WRITE_EXTREMES")) {
      std::ofstream(docs / "extremes.md") << now;
      for (const auto& [name, svg] : pictures) std::ofstream(docs / "pictures" / (name + ".svg")) << svg;
    }
    const std::multiset<std::string> here = keys_of(now), there = keys_of(text_of(docs / "extremes.md"));
    const char* const advice = "; ARAH_WRITE_EXTREMES=1 writes it anew";
    for (const std::string& key : here)
      if (!there.contains(key)) ADD_FAILURE() << "docs/extremes.md lacks the case " << key << advice;
    for (const std::string& key : there)
      if (!here.contains(key)) ADD_FAILURE() << "docs/extremes.md has a case that no test makes: " << key << advice;
    for (const auto& [name, svg] : pictures)
      if (labels_of(svg) != labels_of(text_of(docs / "pictures" / (name + ".svg")))) ADD_FAILURE() << "docs/pictures/" << name << ".svg draws something else than the tests" << advice;
  }
};
[[maybe_unused]] const testing::Environment* const registered = testing::AddGlobalTestEnvironment(new Page);

}  // namespace

void expect_within(Row row, Way way, const std::string& what, const std::string& expected, double error, double bound) {
  std::printf("  %-60s %.2e, bound %.2e\n", what.c_str(), error, bound);
  EXPECT_LE(error, bound) << what << ": " << expected;  // false for a NaN
  keep(row, {way, what, fmt::format("{}, within {:.1e}", expected, bound), fmt::format("{:.1e}", error)});
}

void expect_that(Row row, Way way, const std::string& what, const std::string& expected, bool came_out) {
  EXPECT_TRUE(came_out) << what << ": " << expected;
  keep(row, {way, what, expected, came_out ? "yes" : "**no**"});
}

void keep_picture(const std::string& name, const std::string& svg) { pictures[name] = svg; }

double largest_error(std::span<const double> found, std::span<const double> truth, double scale) {
  if (found.size() != truth.size() || found.empty()) return std::nan("");
  double largest = 0;
  for (size_t i = 0; i < found.size(); ++i) {
    if (!std::isfinite(found[i])) return std::nan("");
    const double difference = std::abs(found[i] - truth[i]);
    if (difference > 0) largest = std::max(largest, difference / (scale + std::abs(truth[i])));
  }
  return largest;
}

double error_of_largest(std::span<const double> found, std::span<const double> truth) {
  double scale = 0;
  for (const double value : truth) scale = std::max(scale, std::abs(value));
  if (found.size() != truth.size() || found.empty()) return std::nan("");
  double largest = 0;
  for (size_t i = 0; i < found.size(); ++i) {
    if (!std::isfinite(found[i])) return std::nan("");
    largest = std::max(largest, std::abs(found[i] - truth[i]));
  }
  return largest > 0 ? largest / scale : 0;
}

bool all_finite(std::span<const double> values) {
  return !values.empty() && std::all_of(values.begin(), values.end(), [](double value) { return std::isfinite(value); });
}

bool all_zero(std::span<const double> values) {
  return !values.empty() && std::all_of(values.begin(), values.end(), [](double value) { return value == 0; });
}

}  // namespace arah::extremes

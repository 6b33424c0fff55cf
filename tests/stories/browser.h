// What a browser makes of a page, where one is installed.
#pragma once

#include <fmt/format.h>

#include <nlohmann/json.hpp>
#include <opencv2/imgcodecs.hpp>
#include <optional>

#include "tests/host/body/glb_reader.h"
#include "tests/stories/program.h"

namespace arah {

// The command of a headless browser; none where there is neither Chromium nor Chrome on the PATH.
inline std::optional<std::string> browser() {
  for (const char* name : {"chromium", "chromium-browser", "google-chrome"}) {
    if (output_of(fmt::format("command -v {}", name))) return name;
  }
  return {};
}

inline constexpr int kBrowsedHeight = 3000;  // pixels

// A page opened in a window of `width` pixels, without a network: no name resolves.
class BrowsedPage {
 public:
  // folder: for the browser's profile, a copy of the page and the screenshot. Throws std::runtime_error where the browser says nothing.
  BrowsedPage(const std::string& program, const std::filesystem::path& page, const std::filesystem::path& folder, int width) {
    const std::string options = fmt::format(
        "timeout 120 {} --headless --disable-gpu --no-sandbox --hide-scrollbars --force-device-scale-factor=1 --host-resolver-rules='MAP * ~NOTFOUND' --user-data-dir='{}' --window-size={},{}",
        program, (folder / "profile").string(), width, kBrowsedHeight);
    const std::filesystem::path asked = folder / "asked.html", shot = folder / fmt::format("{}_{}.png", page.stem().string(), width);
    std::ofstream(asked, std::ios::binary) << read_all(page) << kQuestions;
    const std::string dom = output_of(fmt::format("{} --virtual-time-budget=20000 --dump-dom 'file://{}' 2>/dev/null", options, asked.string())).value_or("");
    const std::size_t from = dom.find(kMark), to = dom.rfind(kMark);
    if (from == to) throw std::runtime_error("the browser gave no answer about " + page.string() + ": " + dom.substr(0, 300));
    answers = nlohmann::json::parse(dom.substr(from + kMark.size(), to - from - kMark.size()));
    output_of(fmt::format("{} --screenshot='{}' 'file://{}' 2>/dev/null", options, shot.string(), page.string()));
    screenshot = cv::imread(shot.string());
  }

  // title; images: [alt, natural width, natural height, width on the page]; headings of the pictures; resources that were fetched;
  // overflow: pixels by which the page is wider than its window; covered: pairs of texts in a plot that lie on each other, or a text
  // that leaves its plot.
  nlohmann::json answers;
  cv::Mat screenshot;

 private:
  static constexpr std::string_view kMark = "@@answers@@";
  static constexpr const char* kQuestions = R"(<script>
addEventListener('load', async () => {
  for (const img of document.images) img.loading = 'eager';
  for (let i = 0; i < 200 && [...document.images].some(img => !img.complete); ++i) await new Promise(done => setTimeout(done, 50));
  const covered = [];
  for (const svg of document.querySelectorAll('svg')) {
    const frame = svg.getBoundingClientRect(), texts = [...svg.querySelectorAll('text')].map(t => [t.textContent, t.getBoundingClientRect()]);
    texts.forEach(([name, a], i) => {
      if (a.left < frame.left - 1 || a.right > frame.right + 1 || a.bottom > frame.bottom + 2) covered.push(name + ' leaves its plot');
      for (const [other, b] of texts.slice(0, i)) if (a.left + 1 < b.right && b.left + 1 < a.right && a.top + 3 < b.bottom && b.top + 3 < a.bottom) covered.push(name + ' on ' + other);
    });
  }
  const answers = {
    title: document.title,
    images: [...document.images].map(i => [i.alt, i.naturalWidth, i.naturalHeight, i.getBoundingClientRect().width]),
    headings: [...document.querySelectorAll('section.shot h3')].map(h => h.textContent),
    resources: performance.getEntriesByType('resource').map(r => r.name.slice(0, 100)).filter(n => !n.startsWith('data:')),
    overflow: document.documentElement.scrollWidth - innerWidth,
    covered: covered,
  };
  const mark = '@@' + 'answers@@';
  document.body.textContent = mark + JSON.stringify(answers).replace(/[<>&]/g, c => '\\u00' + c.charCodeAt(0).toString(16)) + mark;
});
</script>)";
};

}  // namespace arah

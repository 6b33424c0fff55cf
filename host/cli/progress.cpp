#include "host/cli/progress.h"

#include <fmt/format.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>

namespace arah {
namespace {

constexpr int kBarWidth = 24;
constexpr double kTerminalInterval = 0.1;  // seconds between two drawings
constexpr double kPlainInterval = 10.0;
constexpr double kFirstRate = 0.5;  // seconds before a rate means something

// Columns of the terminal, so that a line never wraps (a wrapped line cannot be drawn over).
std::size_t columns(std::FILE* stream) {
  winsize size{};
  const bool known = ::ioctl(::fileno(stream), TIOCGWINSZ, &size) == 0 && size.ws_col > 0;
  return known ? size.ws_col : 80;
}

}  // namespace

void write_text(std::FILE* stream, const std::string& text) {
  std::fputs(text.c_str(), stream);
}

std::string duration_text(double seconds) {
  if (!std::isfinite(seconds) || seconds < 0 || seconds > 1e9) return "?";
  const long whole = std::lround(seconds);
  if (whole < 3600) return fmt::format("{}:{:02}", whole / 60, whole % 60);
  return fmt::format("{}:{:02}:{:02}", whole / 3600, whole / 60 % 60, whole % 60);
}

std::string progress_line(const std::string& title, double done, double total, const std::string& unit, double rate,
                          const std::string& note, bool bar) {
  const double fraction = std::clamp(total > 0 ? done / total : 0.0, 0.0, 1.0);
  std::string line = title;
  if (bar) {
    const int full = static_cast<int>(fraction * kBarWidth);
    line += fmt::format("  [{:#<{}}{:-<{}}]", "", full, "", kBarWidth - full);
  }
  // Rounded down: 100 % means done.
  line += fmt::format("  {} %", static_cast<int>(100.0 * fraction));
  if (!unit.empty()) line += fmt::format("  {:.0f}/{:.0f} {}", done, total, unit);
  if (std::isfinite(rate) && rate > 0) {
    if (!unit.empty())
      line += rate >= 1 ? fmt::format("  {:.1f} {}/s", rate, unit) : fmt::format("  {:.2g} {}/s", rate, unit);
    line += fmt::format("  {} left", duration_text((total - done) / rate));
  }
  if (!note.empty()) line += "  " + note;
  return line;
}

Progress::Progress(std::string title, double total, std::string unit, double first, std::FILE* stream)
    : title_(std::move(title)),
      unit_(std::move(unit)),
      total_(total),
      first_(first),
      done_(first),
      stream_(stream),
      terminal_(::isatty(::fileno(stream)) == 1),
      start_(Clock::now()),
      last_(start_) {}

Progress::~Progress() {
  if (drawn_ && !finished_) write_text(stream_, "\n");
}

double Progress::seconds() const {
  return std::chrono::duration<double>(Clock::now() - start_).count();
}

void Progress::update(double done, const std::string& note) {
  const std::lock_guard lock(mutex_);
  done_ = done;
  note_ = note;
  const Clock::time_point now = Clock::now();
  const double since = std::chrono::duration<double>(now - last_).count();
  if (since >= (terminal_ ? kTerminalInterval : kPlainInterval)) draw(now);
}

void Progress::say(const std::string& line) {
  const std::lock_guard lock(mutex_);
  clear();
  write_text(stream_, line + "\n");
  if (terminal_) draw(Clock::now());
}

void Progress::finish(const std::string& note) {
  const std::lock_guard lock(mutex_);
  if (finished_) return;
  clear();
  finished_ = true;
  std::string line = fmt::format("{}  done in {}", title_, duration_text(seconds()));
  if (!unit_.empty()) line += fmt::format("  {:.0f} {}", total_, unit_);
  if (!note.empty()) line += "  " + note;
  write_text(stream_, line + "\n");
  std::fflush(stream_);
}

void Progress::draw(Clock::time_point now) {
  last_ = now;
  const double elapsed = seconds();
  const double rate = elapsed > kFirstRate ? (done_ - first_) / elapsed : 0.0;
  std::string line = progress_line(title_, done_, total_, unit_, rate, note_, terminal_);
  if (terminal_) {
    clear();
    write_text(stream_, line.substr(0, columns(stream_) - 1));
    drawn_ = true;
  } else {
    write_text(stream_, line + "\n");
  }
  std::fflush(stream_);
}

void Progress::clear() {
  if (drawn_) write_text(stream_, "\r\x1b[K");
  drawn_ = false;
}

}  // namespace arah

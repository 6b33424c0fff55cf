// A screen without a monitor (Xvfb), the viewer on it, and hands (xdotool).
#pragma once

#include <fcntl.h>
#include <fmt/format.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <functional>
#include <nlohmann/json.hpp>
#include <opencv2/core.hpp>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "tests/stories/program.h"

namespace arah {

// In words what is missing for tests with a window, empty where nothing is.
inline std::string desktop_missing() {
  for (const char* program : {"Xvfb", "xdotool"})
    if (std::system(fmt::format("command -v {} >/dev/null 2>&1", program).c_str()) != 0) return fmt::format("{} is not installed (Debian: xvfb, xdotool)", program);
  return {};
}

class Desktop {
 public:
  Desktop(int width, int height, std::filesystem::path folder) : folder_(std::move(folder)) {
    std::filesystem::create_directories(folder_);
    int number[2];
    if (::pipe(number) != 0) throw std::runtime_error("no pipe");
    server_ = ::fork();
    if (server_ == 0) {
      ::close(number[0]);
      if (!std::freopen((folder_ / "xvfb.txt").c_str(), "w", stderr)) ::_exit(126);
      const std::string screen = fmt::format("{}x{}x24", width, height), descriptor = std::to_string(number[1]);
      ::execlp("Xvfb", "Xvfb", "-displayfd", descriptor.c_str(), "-screen", "0", screen.c_str(), "-fbdir", folder_.c_str(), "-nolisten", "tcp", nullptr);
      ::_exit(127);
    }
    ::close(number[1]);
    std::string text;  // the number and a line's end, in two writes
    for (char letter = 0; !text.ends_with('\n') && ::read(number[0], &letter, 1) == 1;) text.push_back(letter);
    ::close(number[0]);
    if (text.empty()) throw std::runtime_error("Xvfb did not start: " + read_all(folder_ / "xvfb.txt"));
    display_ = ":" + std::to_string(std::atoi(text.c_str()));
  }
  ~Desktop() {
    ::kill(server_, SIGTERM);
    ::waitpid(server_, nullptr, 0);
  }
  Desktop(const Desktop&) = delete;
  Desktop& operator=(const Desktop&) = delete;

  const std::string& display() const { return display_; }

  // One call of xdotool with these words. Throws where it fails.
  void hands(const std::string& words) const {
    if (std::system(fmt::format("DISPLAY={} xdotool {} >/dev/null 2>&1", display_, words).c_str()) != 0) throw std::runtime_error("xdotool " + words);
  }

  // What the screen shows, BGR. Xvfb keeps it in a file in X's window dump format: a header of big-endian words, the colour map,
  // rows of four bytes a pixel.
  cv::Mat screen() const {
    const std::string bytes = read_all(folder_ / "Xvfb_screen0");
    const auto word = [&](size_t index) {
      uint32_t value = 0;
      for (size_t i = 0; i < 4; ++i) value = value << 8 | static_cast<uint8_t>(bytes.at(4 * index + i));
      return value;
    };
    const int width = static_cast<int>(word(4)), height = static_cast<int>(word(5));
    const size_t row = word(12), first = word(0) + 12ull * word(19);
    cv::Mat image(height, width, CV_8UC3);
    for (int y = 0; y < height; ++y)
      for (int x = 0; x < width; ++x) {
        const size_t at = first + row * static_cast<size_t>(y) + 4ull * static_cast<size_t>(x);
        image.at<cv::Vec3b>(y, x) = {static_cast<uint8_t>(bytes.at(at)), static_cast<uint8_t>(bytes.at(at + 1)), static_cast<uint8_t>(bytes.at(at + 2))};
      }
    return image;
  }

 private:
  std::filesystem::path folder_;
  pid_t server_ = -1;
  std::string display_;
};

// arah-view on a desktop. It tells of itself in lines of JSON (--json).
class ViewerOnDesktop {
 public:
  using Event = nlohmann::json;

  ViewerOnDesktop(Desktop& desktop, std::vector<std::string> words, const std::filesystem::path& folder)
      : desktop_(desktop), output_(folder / "stdout.txt"), program_(with_json(std::move(words)), folder, [&desktop] {
          ::setenv("DISPLAY", desktop.display().c_str(), 1);
          ::setenv("ARAH_VALIDATION", "1", 1);
        }) {}

  // The first event from the place reached so far for which `wanted` holds; the place moves behind it. Throws with what came after so many seconds.
  Event wait_for(const std::string& what, const std::function<bool(const Event&)>& wanted, double seconds = 120) {
    const auto end = std::chrono::steady_clock::now() + std::chrono::duration<double>(seconds);
    for (;;) {
      const bool running = program_.running();
      const std::vector<Event> all = events();
      for (; seen_ < all.size(); ++seen_)
        if (wanted(all[seen_])) return all[seen_++];
      if (!running) throw std::runtime_error(fmt::format("the viewer ended while it was waited for {}: {}", what, program_.wait().errors));
      if (std::chrono::steady_clock::now() > end) throw std::runtime_error(fmt::format("no {} in {} s; last: {}", what, seconds, all.empty() ? "nothing" : all.back().dump()));
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
    }
  }
  Event wait_for(const std::string& event, double seconds = 120) {
    return wait_for(event, [&](const Event& e) { return e.at("event") == event; }, seconds);
  }
  // Until the picture is as fine as it becomes and stays so for a while. What the hands did last may take a moment to show: a picture that came
  // since the last wait, or two and a half seconds, are waited for first.
  void wait_for_rest(double seconds = 120) {
    using Clock = std::chrono::steady_clock;
    const auto since = [](Clock::time_point time) { return std::chrono::duration<double>(Clock::now() - time).count(); };
    const auto is_picture = [](const Event& e) { return e.at("event") == "picture"; };
    const Clock::time_point start = Clock::now();
    Clock::time_point last_news = start;
    size_t known = seen_;
    for (bool news = false; since(start) < seconds; std::this_thread::sleep_for(std::chrono::milliseconds(20))) {
      const bool running = program_.running();
      const std::vector<Event> all = events();
      for (; known < all.size(); ++known)
        if (is_picture(all[known])) news = true, last_news = Clock::now();
      if (!running) throw std::runtime_error("the viewer ended before its picture was at rest: " + program_.wait().errors);
      const auto last = std::find_if(all.rbegin(), all.rend(), is_picture);
      if ((!news && since(start) < 2.5) || last == all.rend() || last->at("finest") != true || since(last_news) < 0.8) continue;
      seen_ = all.size();
      return;
    }
    throw std::runtime_error(fmt::format("no picture at rest in {} s", seconds));
  }
  std::vector<Event> events() const {
    std::vector<Event> all;
    std::ifstream file(output_);
    for (std::string line; std::getline(file, line);)
      if (line.starts_with("{") && line.ends_with("}")) all.push_back(Event::parse(line));
    return all;
  }
  void key(const std::string& key) const { desktop_.hands("key " + key); }
  void click(double x, double y, int button = 1) const { desktop_.hands(fmt::format("mousemove {:.0f} {:.0f} sleep 0.1 click {}", x, y, button)); }
  void drag(double x, double y, double to_x, double to_y, int button = 1) const {
    std::string words = fmt::format("mousemove {:.0f} {:.0f} sleep 0.1 mousedown {} sleep 0.1", x, y, button);
    for (int i = 1; i <= 8; ++i) words += fmt::format(" mousemove {:.0f} {:.0f} sleep 0.05", x + (to_x - x) * i / 8, y + (to_y - y) * i / 8);
    desktop_.hands(words + fmt::format(" mouseup {}", button));
  }
  Outcome close() {
    key("ctrl+q");
    return program_.wait();
  }
  Program& program() { return program_; }

 private:
  static std::vector<std::string> with_json(std::vector<std::string> words) {
    words.emplace_back("--json");
    return words;
  }
  Desktop& desktop_;
  std::filesystem::path output_;
  Program program_;
  size_t seen_ = 0;
};

}  // namespace arah

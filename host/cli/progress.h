// How far a long work is: a bar with rate and time left on a terminal, a plain line every ten seconds elsewhere.
#pragma once

#include <chrono>
#include <cstdio>
#include <mutex>
#include <string>

namespace arah {

// To a stream that may refuse it (a terminal that is gone, a full disk, a pipe that nobody reads): the work counts, not what is
// told of it.
void write_text(std::FILE* stream, const std::string& text);

// "0:07", "12:34", "3:05:00"; negative or unknown (not finite) times give "?".
std::string duration_text(double seconds);

// One state in words: "train  45 %  4500/10000 steps  33.1 steps/s  2:46 left  loss 0.12". `bar` puts "[####----]"
// before the percentage; an empty unit leaves counts and rate out; a rate that is not positive leaves rate and time
// left out.
std::string progress_line(const std::string& title, double done, double total, const std::string& unit, double rate,
                          const std::string& note, bool bar);

// Safe to call from several threads. Writes nothing to a terminal more than ten times a second.
class Progress {
 public:
  // total: in units, > 0. unit: plural, such as "steps"; empty where `total` counts nothing that a user knows. `first`:
  // what was done before this run (a resumed one), which the rate leaves out. stream: not owned.
  Progress(std::string title, double total, std::string unit, double first = 0, std::FILE* stream = stderr);
  // Ends the bar's line if finish() was not called (an error is on its way).
  ~Progress();
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;

  // done: 0..total. note: a few words that may change, such as the loss; one line.
  void update(double done, const std::string& note = "");

  // A line of its own above the bar, such as "checkpoint written".
  void say(const std::string& line);

  // The last line: the work's duration and `note`.
  void finish(const std::string& note = "");

 private:
  using Clock = std::chrono::steady_clock;
  double seconds() const;
  void draw(Clock::time_point now);
  void clear();

  std::mutex mutex_;
  std::string title_, unit_, note_;
  double total_, first_, done_;
  std::FILE* stream_;
  bool terminal_;
  bool drawn_ = false;  // a bar stands on the current line
  bool finished_ = false;
  Clock::time_point start_, last_;
};

}  // namespace arah

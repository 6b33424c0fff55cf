// The built program, run as a user would.
#pragma once

#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <functional>
#include <iterator>
#include <stdexcept>
#include <string>
#include <vector>

namespace arah {

struct Outcome {
  int code = -1;       // exit code; -1: ended by a signal
  std::string output;  // standard output
  std::string errors;  // standard error
  uint64_t peak_bytes = 0;  // most resident memory
};

inline std::string read_all(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

// A running `arah WORDS...`, its output going to files in `folder`.
class Program {
 public:
  // in_child: what the child does before it becomes the program, its output being set up.
  Program(const std::vector<std::string>& words, const std::filesystem::path& folder, const std::function<void()>& in_child = {})
      : output_(folder / "stdout.txt"), errors_(folder / "stderr.txt") {
    child_ = ::fork();
    if (child_ < 0) throw std::runtime_error("fork failed");
    if (child_ > 0) return;
    std::vector<char*> arguments{const_cast<char*>(ARAH_PROGRAM)};
    for (const std::string& word : words) arguments.push_back(const_cast<char*>(word.c_str()));
    arguments.push_back(nullptr);
    if (!std::freopen(output_.c_str(), "w", stdout) || !std::freopen(errors_.c_str(), "w", stderr)) ::_exit(126);
    // `nohup` and a shell's background leave some of these ignored, and so would the program.
    for (const int number : {SIGHUP, SIGINT, SIGQUIT, SIGTERM}) std::signal(number, SIG_DFL);
    if (in_child) in_child();
    ::execv(ARAH_PROGRAM, arguments.data());
    ::_exit(127);
  }
  ~Program() {
    if (child_ <= 0) return;
    ::kill(child_, SIGKILL);
    ::waitpid(child_, nullptr, 0);
  }
  Program(const Program&) = delete;
  Program& operator=(const Program&) = delete;

  pid_t id() const { return child_; }
  // Nothing where it has ended and been waited for.
  void signal(int number) const {
    if (child_ > 0) ::kill(child_, number);
  }
  bool running() {
    if (child_ > 0 && ::waitpid(child_, &status_, WNOHANG) == child_) child_ = 0;
    return child_ > 0;
  }
  Outcome wait() {
    rusage usage{};
    if (child_ > 0) ::wait4(child_, &status_, 0, &usage);
    child_ = 0;
    return {WIFEXITED(status_) ? WEXITSTATUS(status_) : -1, read_all(output_), read_all(errors_), static_cast<uint64_t>(usage.ru_maxrss) * 1024};
  }

 private:
  std::filesystem::path output_, errors_;
  pid_t child_ = -1;
  int status_ = 0;
};

}  // namespace arah

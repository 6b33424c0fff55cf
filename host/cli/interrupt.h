// Ctrl-C, SIGTERM and a terminal that closes (SIGHUP) as a wish that long work can grant when it suits.
#pragma once

#include <array>
#include <csignal>

namespace arah {

// While it lives, the first SIGINT or SIGTERM is only noted; the next one ends the program as usual. SIGHUP is noted however
// often it comes: a shell and its terminal both send it, and nobody is left to be impatient. What the caller had ignored
// (nohup, jobs in the background) stays ignored. A reader of the output that goes away (SIGPIPE) ends nothing. One at a time.
class Interrupt {
 public:
  Interrupt();
  ~Interrupt();
  Interrupt(const Interrupt&) = delete;
  Interrupt& operator=(const Interrupt&) = delete;

  bool wanted() const;

 private:
  static constexpr std::array kSignals{SIGINT, SIGTERM, SIGHUP, SIGPIPE};
  std::array<struct sigaction, kSignals.size()> before_{};
};

}  // namespace arah

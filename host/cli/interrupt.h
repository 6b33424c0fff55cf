// Ctrl-C and SIGTERM as a wish that long work can grant when it suits.
#pragma once

namespace arah {

// While it lives, the first SIGINT or SIGTERM is only noted; the next one ends the program as usual. One at a time.
class Interrupt {
 public:
  Interrupt();
  ~Interrupt();
  Interrupt(const Interrupt&) = delete;
  Interrupt& operator=(const Interrupt&) = delete;

  bool wanted() const;
};

}  // namespace arah

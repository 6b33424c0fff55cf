// What the watch over a training's numbers found in a step: numbers that are NaN, infinite or out of their range, from the first
// stage on that had any; and the file in which such a step is kept, so that it can be looked at and repeated.
#pragma once

#include <cstdint>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "host/avatar/safetensors.h"

namespace arah {

struct BadTensor {
  std::string stage;   // of the step, as profiles name it, such as "distances"
  std::string tensor;  // such as "signed distances"
  uint64_t index = 0;  // of the first bad number, row-major
  std::string place;   // what that number belongs to, such as "sample 3 of ray 17, column 40, row 22 of camera 'left', frame 5"
  uint64_t nan = 0, infinite = 0;
  uint64_t beyond = 0;  // finite, but of a magnitude above `limit`
  double limit = 0;     // 0: none
};

struct BadValues {
  uint64_t step = 0;               // the first is 1
  std::vector<BadTensor> tensors;  // in the order of the step's stages; the first is where to look
  bool state = false;              // whether the state before the step is bad itself: the first tensors are of it
  std::string searches;            // what became of the step's searches for correspondences, in words; empty: there were none
};

// One line: step, stage, tensor, how many, the first one's place, and the names of those that were bad after it.
std::string describe(const BadValues& bad);

// A step that was not taken. what(): describe(found).
class BadValueError : public std::runtime_error {
 public:
  explicit BadValueError(BadValues found) : std::runtime_error(describe(found)), found_(std::move(found)) {}
  const BadValues& found() const { return found_; }

 private:
  BadValues found_;
};

// As the metadata "failure" of a checkpoint: {"step", "state", "searches", "tensors": [{"stage", "tensor", "index", "place", "nan",
// "infinite", "beyond", "limit"}]}.
void put_bad_values(SafetensorsFile& file, const BadValues& bad);
// Absent where the file has none; InputError naming file and field where it is malformed.
std::optional<BadValues> bad_values_of(const SafetensorsFile& file);
// Several lines for `arah inspect`, one a tensor.
std::string bad_values_report(const BadValues& bad);

}  // namespace arah

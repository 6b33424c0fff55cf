// A rendering beside, before or against the photograph of the same camera and frame.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "host/capture/capture.h"
#include "host/rendering/renderer.h"

namespace arah {

enum class ComparisonMode {
  off,        // the rendering alone
  behind,     // the photograph where the rendering is transparent
  blink,      // one and the other, half of the period each
  split,      // the photograph left of the position, the rendering right of it
  error_map,  // error_map() of both on black (host/evaluation/picture.h): Inferno, black where they are equal
};
constexpr const char* to_string(ComparisonMode mode) {
  switch (mode) {
    case ComparisonMode::off: return "off";
    case ComparisonMode::behind: return "behind";
    case ComparisonMode::blink: return "blink";
    case ComparisonMode::split: return "split";
    case ComparisonMode::error_map: return "error_map";
  }
  return "off";
}

inline constexpr double kShortestBlink = 0.1, kLongestBlink = 10;
inline constexpr double kLeastErrorGain = 0.5, kLargestErrorGain = 100;

struct Comparison {
  ComparisonMode mode = ComparisonMode::off;
  double position = 0.5;  // of the split, 0 to 1 of the width
  double period = 1;      // seconds, kShortestBlink to kLongestBlink
  double gain = 4;        // of the error map, kLeastErrorGain to kLargestErrorGain: its brightest colour means a mean difference of 1 / gain over the channels

  bool operator==(const Comparison&) const = default;
};

// Whether a blinking comparison shows the photograph at this time, seconds: in the second half of each period.
bool blink_shows_photograph(const Comparison& comparison, double time);

struct Rgba8 {
  int width = 0;
  int height = 0;
  std::vector<std::uint8_t> bytes;  // [height][width][4], straight alpha; a pixel that is not finite is opaque magenta
};

// What is shown: as large as the rendering, whose colours are multiplied by alpha, as the photograph's are. photograph: load_image() of the camera and
// frame at the rendering's width; null: there is none, and the rendering is shown alone whatever the mode. time: seconds, for blink. The error map is opaque, all else has the
// alpha of what it shows. Throws std::invalid_argument where the sizes differ or do not fit.
Rgba8 compared(const Picture& rendering, const Image* photograph, const Comparison& comparison, double time);

// PSNR of the rendering against the photograph, both on black, over the projected box of the body (projected_box_mask), dB, as evaluate() does it; +infinity
// for equal ones. Absent where the mask is empty or where a colour is not finite. Throws std::invalid_argument where sizes differ.
std::optional<double> compared_psnr(const Picture& rendering, const Image& photograph, const PixelMask& mask);

}  // namespace arah

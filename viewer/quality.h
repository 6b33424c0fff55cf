// Which quality a picture has: while something moves what the time allows, at rest from coarse to fine.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "host/rendering/render_settings.h"

namespace arah {

// A preset of rendering, every so-many-th pixel of it.
struct Quality {
  std::string preset;
  int pixel_step = 1;
  bool operator==(const Quality&) const = default;
  auto operator<=>(const Quality&) const = default;
};
std::string to_string(const Quality& quality);  // "preview 1/4"

// The preset with these knobs changed, set in the order of render_knobs(). Throws InputError as render_preset() and set_render_knob() do.
RenderSettings preset_with_knobs(const Avatar& avatar, const std::string& preset, const std::map<std::string, std::string>& knobs);

// The qualities that this avatar can be drawn in, finest first: "paper" to "preview" at every pixel, then fewer pixels of the quickest.
// A density has no "preview" (render_preset()).
std::vector<Quality> qualities(const Avatar& avatar);
// The same without what is finer than `finest`, coarsest first: how a picture at rest is refined. Whole pictures only.
std::vector<Quality> refinement(const Avatar& avatar, const std::string& finest);

// Chooses from what pictures took so far. Not safe for several threads.
class MovingQuality {
 public:
  // seconds: what a picture may take.
  MovingQuality(const Avatar& avatar, double seconds);

  // pixels: of the whole picture, before pixel_step. new_pose: whether the body moved since the last picture of this quality.
  void took(const Quality& quality, double pixels, bool new_pose, double seconds);
  // The finest quality that is expected to take no more than the budget; the coarsest where none does. Nothing is known at first:
  // the coarsest. What was never tried is expected to take as much longer than the next coarser one as it has more pixels, or four
  // times as long, about what the step from one preset to the next costs. A finer
  // quality than the last choice must leave a quarter of the budget free. No finer preset than `finest` is chosen.
  Quality choose(double pixels, bool new_pose, const std::string& finest);
  double expected(const Quality& quality, double pixels, bool new_pose) const;  // seconds; infinite where nothing is known

 private:
  double budget_;
  std::vector<Quality> choices_;  // finest first
  size_t last_;
  struct Known {
    double seconds = 0, pixels = 0;
  };
  std::map<std::pair<Quality, bool>, Known> known_;
};

}  // namespace arah

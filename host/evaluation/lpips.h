// LPIPS: how far apart two pictures look to a network (Zhang et al., "The Unreasonable Effectiveness of Deep Features as a
// Perceptual Metric", CVPR 2018). The network is the user's file: none comes with the program, and without one there is no
// figure of this name.
#pragma once

#include <filesystem>
#include <memory>
#include <string>

#include "host/evaluation/image_metrics.h"

namespace arah {

class Lpips {
 public:
  // network: an ONNX file with two float32 inputs of the shape [1 or open][3][open][open] (pictures, channels R G B, rows,
  // columns; values in [-1, 1]) and one output, of one number. The two are taken in the file's order and may have any names. Reads
  // it, and tries it on a pair of 80 x 64 pixels. Throws InputError, naming the file, what was expected and what was found, for
  // a file that is no such network, that OpenCV's dnn cannot run, or that is no distance: equal pictures must be 0 apart and
  // those of the trial more than that.
  explicit Lpips(const std::filesystem::path& network);
  ~Lpips();
  Lpips(Lpips&&) noexcept;
  Lpips& operator=(Lpips&&) noexcept;

  // Of the two crops, whose values x in [0, 1] the network sees as 2x - 1: the authors' preprocessing with normalize=True, and
  // ARAH's (ARAH.md, "Metrics"). At least 0 for a network of theirs, 0 for equal pictures; no unit. The network is fitted to each
  // new size of crop: the file is parsed again. Throws std::invalid_argument where sizes do not fit, the crop leaves a picture
  // or is empty, or a number in it is not finite; InputError where the network cannot take pictures of that size, or its
  // number is not finite.
  double distance(const RgbPicture& rendering, const RgbPicture& truth, const CropRectangle& crop);

  const std::filesystem::path& path() const;

 private:
  struct Network;
  std::unique_ptr<Network> network_;
};

// The sentence about it in a report's definition; begins with a space.
std::string lpips_definition(const std::filesystem::path& network);

}  // namespace arah

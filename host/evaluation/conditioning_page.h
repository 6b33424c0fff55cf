// conditioning.html: where poses break an avatar's skinning (conditioning.h), as one page that opens in any browser, without a network.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "host/capture/camera.h"
#include "host/evaluation/conditioning.h"
#include "host/evaluation/report.h"

namespace arah {

// RGB, 0 to 1: grey where σ_min is 1 and above, over yellow and orange to nearly black red at 0.
std::array<float, 3> singular_value_colour(double sigma);

// A camera in the same place whose picture of the same size the vertices fill, but for a twentieth at each edge; all must be in front of it.
Camera close_up(const Camera& camera, std::span<const glm::vec3> vertices);

// The surface seen from the camera, lit from there, as an opaque PNG of the camera's size: in the colour of its σ_min, blue where it is folded, through
// what hides that as well, because folds lie in creases. Magenta dots in black rings: points of the shell without a root, where no surface lies before
// them by more than the reach.
std::vector<std::uint8_t> conditioning_picture(const ExaminedPose& pose, const Camera& camera, double reach);

struct ConditioningEntry {
  ConditioningFigures figures;
  std::vector<ReportImage> pictures;
};

// A table of the poses and the pictures of each, the greatest share of a nearly singular or folded surface first; between them the
// steps that searches took, over all poses. name: the avatar's; where: that the poses are from. Every text is escaped; the page runs no script and asks for no
// other file.
std::string conditioning_page(const std::string& name, const std::string& where, const Avatar& avatar, const ConditioningSettings& settings, std::vector<ConditioningEntry> poses);

}  // namespace arah

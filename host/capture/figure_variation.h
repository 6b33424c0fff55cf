// How one built-in figure differs from another in build and clothes. Every default is the figure of average build, in
// t-shirt, shorts and shoes.
#pragma once

#include <cstdint>
#include <glm/glm.hpp>

namespace arah {

// Factors on the average build.
struct Build {
  double height = 1;                                      // of everything
  double arm_length = 1, leg_length = 1, trunk_length = 1;  // shoulder to wrist, hip to ankle, hip to neck
  double arm_girth = 1, leg_girth = 1, trunk_girth = 1;   // of the radii; hands belong to the arms, feet keep theirs
};

// Places are those of the average build, metres.
struct Wardrobe {
  bool shirt = true, shorts = true, shoes = true;
  double shirt_hem = 0.845;   // above the ground, 0.76..0.90
  double sleeve_end = 0.345;  // from the middle, 0.24..0.64: the wrist is at 0.68
  double shorts_hem = 0.515;  // above the ground, 0.14..0.64: trousers from 0.45 down
  double looseness = 1;       // factor on how far cloth stands off the skin, 0.6..1.4
};

struct FigureVariation {
  Build build;
  Wardrobe clothes;
};

// One of a family of people: heights within 8 %, limbs' lengths within 8 % and girths within 15 to 20 %, most of them in
// a shirt and shorts or trousers of varying length. Seed 0 is the default.
FigureVariation varied_figure(std::uint64_t seed);

// The places of the average build's body, divided by height, against those of a build with other lengths: along x beyond
// the shoulders and along y between ankle, hip and neck, each linear in pieces.
class Stretch {
 public:
  Stretch() = default;
  explicit Stretch(const Build& build) : arm_(build.arm_length), leg_(build.leg_length), trunk_(build.trunk_length) {}
  bool none() const { return arm_ == 1 && leg_ == 1 && trunk_ == 1; }
  glm::dvec3 from_average(const glm::dvec3& place) const;
  glm::dvec3 to_average(const glm::dvec3& place) const;

 private:
  double arm_ = 1, leg_ = 1, trunk_ = 1;
};

}  // namespace arah

// Where a ray is sampled: ARAH.md section 6 (paper section "Differentiable Volume Rendering") and stratified sampling
// of a shell around the template. Depths in metres along the unit direction, ascending.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

namespace arah::reference {

inline constexpr int kNoSurfaceSample = -1;

struct RaySamples {
  std::vector<double> depths;
  int surface = kNoSurfaceSample;  // index of the sample at the surface depth, kNoSurfaceSample on a miss
};

struct SurfaceSampling {
  double half_width = 0.05;  // metres, around the surface
  int around_surface = 17;   // odd: the middle one is the surface point itself
  int before_surface = 16;
};

// A ray that hits the surface at depth d: `around_surface` equally spaced samples on [d − half_width, d + half_width]
// and `before_surface` on near + max(d − half_width − near, 1e-5)·[0, 1], merged in ascending order; of equal depths
// the ones in front come first. The samples are not clipped to the box. `around_surface` must be odd, both counts
// positive.
RaySamples surface_samples(double near, double depth, const SurfaceSampling& sampling = {});

// A ray without a surface: `count` >= 1 equally spaced samples on [near, far], ends included (one sample: near).
RaySamples uniform_samples(double near, double far, int count = 64);

// Training's jitter: depth i becomes lower + (upper − lower)·random[i], where lower and upper are the midpoints to the
// neighbours (before jitter), or the end sample itself at the ends; the surface sample stays. random: [samples], [0,
// 1).
void jitter(RaySamples& samples, std::span<const double> random);

// The sample of a ray at which the distance is least, the first of several; -1 where no sample counts.
int least_distance(std::span<const double> sdf, std::span<const std::uint8_t> counts);

inline constexpr int kShellBins = 64;

struct ShellSamples {
  std::vector<double> depths;
  double delta = 0;  // metres that each sample stands for: union length / count
};

// Stratified samples over a ray's kept bins. [near, far] is cut into 64 equal bins; bit i of `kept` keeps the i-th from
// near. The kept bins, laid end to end (their union, of length U), are cut into `count` equal strata; sample j lies at
// fraction random[j] of stratum j and is mapped back to its bin. No kept bin, or near >= far: no samples, delta 0.
// random: [count], [0, 1).
ShellSamples shell_samples(double near, double far, std::uint64_t kept, int count, std::span<const double> random);

}  // namespace arah::reference

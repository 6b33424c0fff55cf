#include "kernels/reference/sampling.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>

namespace arah::reference {

static double linear_space(double first, double last, int count, int index) {
  return count == 1 ? first : first + (last - first) * index / (count - 1);
}

RaySamples surface_samples(double near, double depth, const SurfaceSampling& sampling) {
  const double front = near + std::max(depth - sampling.half_width - near, 1e-5);
  std::vector<double> before(sampling.before_surface), around(sampling.around_surface);
  for (int i = 0; i < sampling.before_surface; ++i) before[i] = linear_space(near, front, sampling.before_surface, i);
  for (int i = 0; i < sampling.around_surface; ++i)
    around[i] = linear_space(depth - sampling.half_width, depth + sampling.half_width, sampling.around_surface, i);
  const int middle = sampling.around_surface / 2;
  around[middle] = depth;

  RaySamples samples;
  samples.depths.resize(before.size() + around.size());
  std::merge(before.begin(), before.end(), around.begin(), around.end(), samples.depths.begin());
  // std::merge keeps `before` first among equals, so every front sample up to the surface depth precedes it.
  samples.surface = middle + static_cast<int>(std::upper_bound(before.begin(), before.end(), depth) - before.begin());
  return samples;
}

RaySamples uniform_samples(double near, double far, int count) {
  RaySamples samples;
  samples.depths.resize(count);
  for (int i = 0; i < count; ++i) samples.depths[i] = linear_space(near, far, count, i);
  return samples;
}

void jitter(RaySamples& samples, std::span<const double> random) {
  const std::vector<double> depths = samples.depths;
  const int count = static_cast<int>(depths.size());
  for (int i = 0; i < count; ++i) {
    if (i == samples.surface) continue;
    const double lower = i > 0 ? (depths[i - 1] + depths[i]) / 2 : depths[i];
    const double upper = i + 1 < count ? (depths[i] + depths[i + 1]) / 2 : depths[i];
    samples.depths[i] = lower + (upper - lower) * random[i];
  }
}

ShellSamples shell_samples(double near, double far, std::uint64_t kept, int count, std::span<const double> random) {
  ShellSamples samples;
  const int bins = std::popcount(kept);
  if (bins == 0 || count <= 0 || !(near < far)) return samples;
  std::array<int, kShellBins> bin_of;  // the n-th kept bin
  for (int bin = 0, n = 0; bin < kShellBins; ++bin)
    if (kept >> bin & 1) bin_of[n++] = bin;

  const double width = (far - near) / kShellBins;
  samples.delta = width * bins / count;
  samples.depths.resize(count);
  for (int j = 0; j < count; ++j) {
    const double position = (j + random[j]) / count * bins;  // in bins along the union
    const int n = std::min(static_cast<int>(position), bins - 1);
    samples.depths[j] = near + (bin_of[n] + (position - n)) * width;
  }
  return samples;
}

int least_distance(std::span<const double> sdf, std::span<const std::uint8_t> counts) {
  int least = -1;
  for (std::size_t i = 0; i < sdf.size(); ++i)
    if (counts[i] && (least < 0 || sdf[i] < sdf[static_cast<std::size_t>(least)])) least = static_cast<int>(i);
  return least;
}

}  // namespace arah::reference

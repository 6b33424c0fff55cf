// The two root searches alone, for a trained avatar in a pose that bends all its joints: rays with the surface, points with
// their canonical correspondences (ARAH.md §§4, 5).
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "host/avatar/avatar.h"
#include "kernels/vulkan/device.h"

namespace arah {

struct SearchBenchSettings {
  uint32_t rays = 16384;    // that hit the surface, seen from in front, as many of them as 512 x 512 pixels have; at least 1, at most 16,384
  uint32_t points = 65536;  // about the posed template's surface, N(0, 1 cm) from it; at least 1, at most 65,536
  uint32_t repetitions = 5;
};

struct SearchBench {
  std::string name;  // "sphere tracing", "joint search", "correspondence search"
  uint64_t searches = 0;
  double steps = 0;         // a search, mean; 0: not counted
  double converged = 0;     // share of the searches
  double milliseconds = 0;  // median; the first two by the device's timestamps (0 without), the third by the clock
  double gflops = 0;        // of the arithmetic that its launches state, per second; 0 without timestamps
};

// In this order. Sphere tracing gives the joint search its starts. Throws InputError where the avatar has no skinning network:
// its correspondences are looked up.
std::vector<SearchBench> run_search_bench(Device& device, const Avatar& avatar, const SearchBenchSettings& settings = {}, const std::function<void(double)>& progress = {});
std::string search_bench_table(const std::vector<SearchBench>& searches);

}  // namespace arah

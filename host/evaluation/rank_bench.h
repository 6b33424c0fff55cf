// What training on several ranks takes and sends, and what that makes of more ranks, by a model of measured figures.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "host/evaluation/plot.h"
#include "host/training/ranks.h"
#include "kernels/vulkan/device.h"

namespace arah {

struct RankBenchSettings {
  uint32_t warm_up = 4, steps = 12;  // of each kind of step; the medians count. Of the preset paper half of these
  bool with_paper = true;            // the preset paper in its whole size too: 1.5 GB a rank
  uint32_t papers_rays = 256;        // of its measured step, a multiple of 256
};

// A step's times with so many ranks, milliseconds. The numbers of a step that are added up take 2 (n - 1) / n times their bytes in and
// out of each rank.
struct RankBenchPoint {
  uint32_t ranks = 1;
  double step = 0;           // with the exchange begun beside the way back
  double step_in_turns = 0;  // with the exchange after it
  double exchange = 0;       // of `step`, what the host spent in MPI, waiting for others included
  double beside = 0;         // of that, while the device had work of its own
};

struct RankBenchWork {
  std::string name, description;
  uint32_t rays = 0;                // of a step, of all ranks together
  uint32_t rays_of_preset = 0;
  uint64_t bytes = 0;               // added up in a step
  uint64_t bytes_of_gradients = 0;  // that a step without factors would add up: of every parameter that it learns
  double part_step = 0;             // one rank's with a quarter of the rays
  std::vector<RankBenchPoint> points;  // 1, 2, ... ranks
};

struct RankBench {
  std::string device;
  double gigabytes = 0;     // a second, in and out of a rank, while all ranks add up 64 MB: of this machine's links
  double microseconds = 0;  // of adding up one number
  std::vector<RankBenchWork> works;
};

// Collective: trains on the first 1, 2, ... of the ranks. Returns the figures on the first, on the others nothing that counts.
// progress: of the first rank, the name of each measurement before it starts. Throws std::runtime_error where the temporary folder
// of the capture cannot be written, InputError where a step has too few rays for so many ranks.
RankBench run_rank_bench(Device& device, const Ranks& ranks, const RankBenchSettings& settings, const std::function<void(const std::string&)>& progress = {});

// A step of n ranks and so many rays, milliseconds: what of it no rank is spared, a share of its rays, and the exchange, of which
// nothing is taken to happen beside the way back: T(n) = compute (fixed + per_ray rays / n) + 2 (n - 1) / n bytes / rate + 2
// collectives (n - 1) latency. fixed and per_ray come from one rank's step and from that with a quarter of the rays.
struct Link {
  std::string name;
  double gigabits = 10;      // a second, each way
  double microseconds = 20;  // from one rank to another
};
double modelled_step(const RankBenchWork& work, uint32_t rays, uint64_t bytes, uint32_t ranks, const Link& link, double compute = 1);

std::string rank_bench_table(const RankBench& bench);
std::string rank_bench_json(const RankBench& bench);
// How many times as fast as one rank: measured, and modelled for 1 to 64 ranks over links of 10 and 100 Gb/s, also with the preset's
// rays and devices that are a hundred times as fast as this one, and there without factors.
Plot scaling_plot(const RankBench& bench, const RankBenchWork& work);

}  // namespace arah

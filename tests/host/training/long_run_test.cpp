// A training of many steps keeps what it needs and no more: memory of the process and of the device stays where it was after the first
// steps, the events grow by a line every two seconds, no number is bad, and the losses fall. 10,000 steps with ./run test --long.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <map>

#include "host/training/training_run.h"
#include "tests/host/body/rigs.h"
#include "tests/host/training/finite_run.h"
#include "tests/host/training/training_scene.h"
#include "tests/long_form.h"

namespace arah {
namespace {

namespace fs = std::filesystem;

// Bytes of the process in memory.
uint64_t resident_bytes() {
  std::ifstream file("/proc/self/statm");
  uint64_t size = 0, resident = 0;
  if (!(file >> size >> resident)) throw std::runtime_error("/proc/self/statm cannot be read");
  return resident * static_cast<uint64_t>(::sysconf(_SC_PAGESIZE));
}

struct Step {
  double color = 0, total = 0;
  uint64_t resident = 0, on_device = 0;  // bytes
};

template <typename Number>
double mean(const std::vector<Step>& steps, size_t first, size_t last, Number Step::*number) {
  double sum = 0;
  for (size_t i = first; i < last; ++i) sum += double(steps[i].*number);
  return sum / double(last - first);
}

void expect_steady(const char* name, TrainingSettings settings) {
  SCOPED_TRACE(name);
  settings.steps = long_form() ? 10'000 : 300;
  settings.checkpoint_minutes = long_form() ? 0.2 : 0.01;
  // The device of other tests has Vulkan's validation layer, which remembers more and more.
  Device device(DeviceOptions::from_environment());
  const TemporaryFolder folder;
  RunOptions options;
  options.folder = folder / "run";
  const RunFolder run(options.folder);
  std::vector<Step> steps;
  steps.resize(settings.steps);  // its pages are in memory from the start
  steps.clear();
  size_t checkpoints = 0, not_finite = 0;
  const auto start = std::chrono::steady_clock::now();
  const RunResult result = run_training(device, small_capture(), make_run_config(small_capture(), settings, small_spec()), options, [&](const RunEvent& event) {
    checkpoints += event.kind == RunEvent::Kind::checkpoint;
    if (event.kind != RunEvent::Kind::step) return true;
    const StepReport& r = event.step;
    for (const double number : {r.color, r.alpha, r.eikonal, r.off_surface, r.inside, r.skinning, r.total, r.sdf_norm, r.b, r.converged, r.shaded}) not_finite += !std::isfinite(number);
    steps.push_back({r.color, r.total, resident_bytes(), device.allocated_bytes()});
    return true;
  });
  const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  ASSERT_EQ(result.steps, settings.steps);
  EXPECT_EQ(result.skipped, 0u);
  ASSERT_EQ(steps.size(), settings.steps);
  EXPECT_EQ(not_finite, 0u);

  const size_t tenth = steps.size() / 10;
  const auto most = [&](size_t first, size_t last, uint64_t Step::*number) {
    uint64_t found = 0;
    for (size_t i = first; i < last; ++i) found = std::max(found, steps[i].*number);
    return found;
  };
  for (size_t i = 0; i < 10; ++i)
    std::printf("  %-8s steps %5zu to %5zu: colour %.4f  total %9.3f  resident %.2f MB (at most %.2f)  on the device %.3f MB\n", name, i * tenth + 1, (i + 1) * tenth, mean(steps, i * tenth, (i + 1) * tenth, &Step::color),
                mean(steps, i * tenth, (i + 1) * tenth, &Step::total), 1e-6 * mean(steps, i * tenth, (i + 1) * tenth, &Step::resident), 1e-6 * double(most(i * tenth, (i + 1) * tenth, &Step::resident)),
                1e-6 * double(most(i * tenth, (i + 1) * tenth, &Step::on_device)));
  std::printf("  %-8s %zu steps in %.1f s, %zu checkpoints, events of %zu bytes\n", name, steps.size(), seconds, checkpoints, size_t(fs::file_size(run.events_file())));
  std::fflush(stdout);

  // What a step keeps for the next would be seen thousands of times; what is left is the allocator's and the driver's own.
  const size_t ready = 2 * tenth;  // every frame and picture has been asked for, and checkpoints have been written
  EXPECT_LE(most(ready, steps.size(), &Step::resident), most(tenth, ready, &Step::resident) + (long_form() ? 1u << 20 : 8u << 20));
  // Shells of refined poses are made again as the poses move, a little larger or smaller; there is nothing else that may change.
  const auto [least_on_device, most_on_device] = std::minmax_element(steps.begin() + static_cast<ptrdiff_t>(tenth), steps.end(), [](const Step& a, const Step& b) { return a.on_device < b.on_device; });
  EXPECT_LE(most_on_device->on_device, least_on_device->on_device + (settings.pose_refinement ? least_on_device->on_device / 100 : 0));
  const auto mean_of = [&](size_t part, double Step::*number) { return mean(steps, part * tenth, (part + 1) * tenth, number); };
  EXPECT_LT(mean_of(9, &Step::color), (long_form() ? 0.6 : 0.8) * mean_of(0, &Step::color));
  EXPECT_LT(mean_of(9, &Step::total), (long_form() ? 0.8 : 0.9) * mean_of(0, &Step::total));

  // Every line of the events is accounted for: one a start, fit, ready and end, one a checkpoint, one every two seconds.
  std::map<std::string, size_t> lines;
  std::ifstream events(run.events_file());
  size_t longest = 0;
  for (std::string line; std::getline(events, line);) {
    lines[nlohmann::json::parse(line)["event"].get<std::string>()] += 1;
    longest = std::max(longest, line.size());
  }
  EXPECT_LE(lines["step"], size_t(seconds / 2) + 1);
  EXPECT_LT(longest, 600u);
  lines.erase("step");
  EXPECT_THAT(lines, testing::UnorderedElementsAre(testing::Pair("start", 1u), testing::Pair("fit", 1u), testing::Pair("ready", 1u), testing::Pair("end", 1u), testing::Pair("checkpoint", checkpoints)));
  EXPECT_THAT(events_not_finite(run), testing::IsEmpty());
  const auto files = std::distance(fs::directory_iterator(options.folder / "checkpoints"), fs::directory_iterator());
  EXPECT_LE(files, 2) << "checkpoints kept, of " << checkpoints;
  EXPECT_THAT(tensors_not_finite(*run.newest_checkpoint()), testing::IsEmpty());
}

TEST(LongRun, NeedsNoMoreAndLearns) { expect_steady("plain", small_settings()); }

// Poses that move, shells and grids that follow them, errors by pixel.
TEST(LongRun, NeedsNoMoreWithEveryPartThatRemembers) {
  TrainingSettings settings = small_settings();
  settings.pose_refinement = true;
  settings.poses = {.rate = 2e-3, .freeze = 20};
  settings.poses_every = 4;
  settings.disturb_degrees = 3;
  settings.disturb_metres = 0.01;
  settings.ray_importance = 0.3;
  settings.view_augmentation = 0.5;
  settings.sampling.root.correspondence = Correspondence::search_from_grid;
  settings.grid_steps = 1000;
  expect_steady("all", settings);
}

}  // namespace
}  // namespace arah

// A device that is lost, one without memory, and one with more or fewer threads.
#include "tests/faults/faults.h"

namespace arah {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

// Over the layer of tests/faults/layer, which fails from the moment on that `file` exists.
std::function<void()> once_it_exists(const char* fault, const std::string& file) {
  return [=] {
    ::setenv("VK_LAYER_PATH", ARAH_LAYERS, 1);
    ::setenv("VK_INSTANCE_LAYERS", "VK_LAYER_ARAH_faults", 1);
    ::setenv(fault, file.c_str(), 1);
  };
}

TEST_F(Faults, ALostDeviceCostsNoCheckpoint) {
  // Over the layer alone nothing changes.
  const Outcome untouched = arah(training("layered"), once_it_exists("ARAH_FAULT_LOST", at("never")));
  ASSERT_EQ(untouched.code, 0) << untouched.errors;
  expect_same_bits("layered");

  // In the fit nothing is there to keep.
  const Outcome early = arah(training("lost"), once_it_exists("ARAH_FAULT_LOST", at("lost/config.json")));
  expect_complaint(early, 1, {"VK_ERROR_DEVICE_LOST", "the device or its driver has stopped"});
  EXPECT_FALSE(fs::exists(at("lost")));

  for (const int step : {1, 5}) {
    const std::string run = fmt::format("lost_after_{}", step);
    const Outcome lost = arah(training(run), once_it_exists("ARAH_FAULT_LOST", at(fmt::format("{}/checkpoints/step_{:08}.safetensors", run, step))));
    expect_complaint(lost, 1, {"VK_ERROR_DEVICE_LOST", fmt::format("--resume goes on from the checkpoint of step {}", step)});
    EXPECT_EQ(newest_step(run), static_cast<uint64_t>(step));
    EXPECT_THAT(unfinished(run), testing::IsEmpty());
    expect_resumed_to_same_bits(run);
  }
}

TEST_F(Faults, ADeviceWithoutMemoryIsSaidAndNothingIsLost) {
  const Outcome fresh = arah(training("no_memory"), once_it_exists("ARAH_FAULT_NO_MEMORY", at("no_memory/config.json")));
  expect_complaint(fresh, 1, {"buffer '", "asks for ", "VK_ERROR_OUT_OF_DEVICE_MEMORY", "are in use by this program", "Use fewer rays"});
  EXPECT_FALSE(fs::exists(at("no_memory")));

  auto words = training("no_memory");
  words.insert(words.end(), {"--stop-at", "4"});
  ASSERT_EQ(arah(words).code, 1);
  const Outcome resumed = arah(resuming("no_memory"), once_it_exists("ARAH_FAULT_NO_MEMORY", at("no_memory/config.json")));
  expect_complaint(resumed, 1, {"buffer '", "VK_ERROR_OUT_OF_DEVICE_MEMORY"});
  EXPECT_EQ(newest_step("no_memory"), 4u);
  expect_resumed_to_same_bits("no_memory");
}

// Threads of the process whose name begins with `name`.
int threads_named(pid_t process, const std::string& name) {
  int count = 0;
  std::error_code gone;
  for (const auto& entry : fs::directory_iterator(fmt::format("/proc/{}/task", process), gone)) count += read_all(entry.path() / "comm").starts_with(name);
  return count;
}

TEST_F(Faults, TheBitsDoNotDependOnTheNumberOfThreads) {
  for (const int threads : {1, 2, 4}) {
    const std::string run = fmt::format("threads_{}", threads);
    Program program(training(run), folder(), [&] { ::setenv("LP_NUM_THREADS", std::to_string(threads).c_str(), 1); });
    ASSERT_TRUE(reaches_step(program, run, 1)) << program.wait().errors;
    const int of_lavapipe = threads_named(program.id(), "llvmpipe-");
    const Outcome trained = program.wait();
    ASSERT_EQ(trained.code, 0) << trained.errors;
    if (trained.errors.find("device: llvmpipe") != std::string::npos) {
      EXPECT_EQ(of_lavapipe, threads) << "LP_NUM_THREADS was not heard";
    } else {
      std::printf("  not lavapipe: LP_NUM_THREADS means nothing here, three equal runs are compared\n");
    }
    expect_same_bits(run);
  }
  const Outcome other = arah(training("seed", "1"));
  ASSERT_EQ(other.code, 0) << other.errors;
  EXPECT_FALSE(read_all(at("seed/avatar.safetensors")) == read_all(at("whole/avatar.safetensors"))) << "another seed";
}

}  // namespace
}  // namespace arah

// A tiny capture, a tiny run of it that nothing disturbed, and runs like it that something does.
#pragma once

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <cstdlib>
#include <filesystem>
#include <string>
#include <thread>
#include <vector>

#include "host/avatar/avatar_file.h"
#include "host/training/run_folder.h"
#include "tests/host/body/rigs.h"
#include "tests/long_form.h"
#include "tests/stories/program.h"

namespace arah {

class Faults : public testing::Test {
 protected:
  using Clock = std::chrono::steady_clock;
  static constexpr int kSteps = 12;  // with a checkpoint after each

  static void SetUpTestSuite() {
    folder_ = new TemporaryFolder;
    const Outcome made = arah({"synth", capture(), "--frames", "3", "--size", "64"});
    ASSERT_EQ(made.code, 0) << made.errors;
    // Twice: the first may compile shaders, the second says how long a run takes. Both say the same bits, or nothing below can.
    for (const char* name : {"first", "whole"}) {
      const Clock::time_point start = Clock::now();
      const Outcome trained = arah(training(name));
      ASSERT_EQ(trained.code, 0) << trained.errors;
      seconds_ = std::chrono::duration<double>(Clock::now() - start).count();
    }
    ASSERT_TRUE(read_all(at("first/avatar.safetensors")) == read_all(at("whole/avatar.safetensors")));
  }
  static void TearDownTestSuite() {
    delete folder_;
    folder_ = nullptr;
  }

  static std::string at(const std::string& name) { return (*folder_ / name).string(); }
  static const std::filesystem::path& folder() { return folder_->path(); }
  static std::string capture() { return at("capture"); }
  static double seconds_of_a_run() { return seconds_; }
  // From the first checkpoint to the end.
  static double seconds_of_steps() {
    const std::vector<LoggedStep> steps = logged_steps(RunFolder(at("whole")));
    const auto end = run_end(RunFolder(at("whole")));
    return end && !steps.empty() ? end->seconds - steps.front().seconds : 0;
  }
  static Outcome arah(const std::vector<std::string>& words, const std::function<void()>& in_child = {}) {
    return Program(words, folder(), in_child).wait();
  }

  static std::vector<std::string> training(const std::string& run, const std::string& seed = "0") {
    return {"train", capture(), "-o", at(run), "--steps", std::to_string(kSteps), "--seed", seed, "--set", "fit_steps=20", "--set", "fit_skinning_steps=10", "--set", "checkpoint_minutes=1e-6"};
  }
  static std::vector<std::string> resuming(const std::string& run) { return {"train", capture(), "-o", at(run), "--resume"}; }

  // Whether the program still runs once that checkpoint, or a later one, lies there.
  static bool reaches_step(Program& program, const std::string& run, uint64_t step) {
    while (program.running()) {
      if (newest_step(run) >= step) return true;
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
    return false;
  }
  // By the names of the files; 0: none.
  static uint64_t newest_step(const std::string& run) {
    uint64_t newest = 0;
    std::error_code gone;  // a file may go while the folder is read
    for (const auto& entry : std::filesystem::directory_iterator(at(run + "/checkpoints"), gone)) {
      const std::string name = entry.path().filename().string();
      if (name.starts_with("step_")) newest = std::max<uint64_t>(newest, std::strtoull(name.c_str() + 5, nullptr, 10));
    }
    return newest;
  }
  static std::vector<std::string> unfinished(const std::string& run) {
    std::vector<std::string> found;
    for (const auto& entry : std::filesystem::recursive_directory_iterator(at(run)))
      if (entry.path().extension() == ".part") found.push_back(entry.path().string());
    return found;
  }

  // The avatar's bytes against those of the run that nothing disturbed.
  static void expect_same_bits(const std::string& run) {
    const std::string expected = read_all(at("whole/avatar.safetensors")), found = read_all(at(run + "/avatar.safetensors"));
    ASSERT_GT(expected.size(), 1000u);
    EXPECT_TRUE(found == expected) << run << ": another avatar than the undisturbed run's";
  }
  // Goes on where the run was left, to its end.
  static void expect_resumed_to_same_bits(const std::string& run) {
    const Outcome resumed = arah(resuming(run));
    ASSERT_EQ(resumed.code, 0) << resumed.errors;
    expect_same_bits(run);
    EXPECT_THAT(unfinished(run), testing::IsEmpty());
  }
  // Exit code, and one line, the last, with all of `parts`.
  static void expect_complaint(const Outcome& outcome, int code, const std::vector<std::string>& parts) {
    EXPECT_EQ(outcome.code, code) << outcome.errors;
    const std::size_t line = outcome.errors.rfind("arah: ");
    ASSERT_NE(line, std::string::npos) << outcome.errors;
    EXPECT_EQ(outcome.errors.find('\n', line), outcome.errors.size() - 1) << outcome.errors;
    for (const std::string& part : parts) EXPECT_THAT(outcome.errors.substr(line), testing::HasSubstr(part));
  }

 private:
  inline static TemporaryFolder* folder_ = nullptr;
  inline static double seconds_ = 0;
};

}  // namespace arah

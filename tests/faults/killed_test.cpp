// kill -9 at random moments: what was saved opens, and goes on to the same bits.
#include <fmt/format.h>

#include <random>

#include "host/file_writing.h"
#include "tests/faults/faults.h"

namespace arah {
namespace {

namespace fs = std::filesystem;

TEST_F(Faults, KilledAtAnyMomentARunGoesOnToTheSameBits) {
  const int wanted = long_form() ? 200 : 10;
  std::mt19937 random(1);
  // Of a whole run's time, beyond which a run ends by itself; and, because a start takes most of that, every other time of the
  // steps' time, from the call's first checkpoint on.
  std::uniform_real_distribution<double> moment(0, 1.1);
  int killed = 0, before_config = 0, before_steps = 0, survived = 0, finished = 0, left_unfinished = 0;
  for (int i = 0; killed < wanted; ++i) {
    const std::string run = fmt::format("killed_{}", i);
    uint64_t step = 0;
    for (bool ended = false; !ended;) {
      // What a user would call: what was not begun cannot be resumed.
      const bool begun = fs::exists(at(run + "/config.json"));
      Program program(begun ? resuming(run) : training(run), folder());
      const bool in_steps = killed % 2 == 1;
      if (in_steps) reaches_step(program, run, step + 1);
      const auto end = Clock::now() + std::chrono::duration<double>(moment(random) * (in_steps ? seconds_of_steps() : seconds_of_a_run()));
      // After the last kill the run may end.
      while (program.running() && (killed == wanted || Clock::now() < end)) std::this_thread::sleep_for(std::chrono::microseconds(200));
      program.signal(SIGKILL);
      const Outcome outcome = program.wait();
      if (outcome.code >= 0) {
        ASSERT_EQ(outcome.code, 0) << run << ": " << outcome.errors;
        expect_same_bits(run);
        EXPECT_THAT(unfinished(run), testing::IsEmpty());
        ++finished;
        ended = true;
        continue;
      }
      ++killed;
      if (!fs::exists(at(run + "/config.json"))) {
        ++before_config;
        ++survived;
        continue;
      }
      left_unfinished += !unfinished(run).empty();
      std::vector<std::string> damaged;
      const auto newest = RunFolder(at(run)).newest_checkpoint(&damaged);
      EXPECT_THAT(damaged, testing::IsEmpty());
      before_steps += !newest;
      const uint64_t now = newest ? avatar_from_tensors(*newest).steps : 0;
      EXPECT_EQ(now, newest_step(run));
      EXPECT_GE(now, step) << "steps that were saved before";
      step = now;
      if (fs::exists(at(run + "/avatar.safetensors"))) {
        EXPECT_LE(load_avatar(at(run + "/avatar.safetensors")).steps, step);
      }
      survived += damaged.empty() && now == newest_step(run);
      if (killed % 20 == 0) {
        std::printf("  killed %d times so far, survived %d, %d runs brought to their end with the same bits\n", killed, survived, finished);
        std::fflush(stdout);
      }
    }
    fs::remove_all(at(run));
  }
  std::printf("  killed %d times (%d before config.json, %d more before the first checkpoint, %d in the midst of writing a file), survived %d; %d runs brought to their end with the same bits\n", killed, before_config, before_steps, left_unfinished, survived, finished);
  std::fflush(stdout);
  EXPECT_EQ(survived, killed);
  EXPECT_GT(finished, 0);
}

// A process in a container often has the id of the one that was killed there before it.
TEST_F(Faults, WhatAKilledWriterOfTheSameIdLeftIsNotInTheWay) {
  for (int serial = 0; serial < 100; ++serial) std::ofstream(at(fmt::format(".text.txt.{}.{}.part", ::getpid(), serial))) << "half";
  write_file_safely(at("text.txt"), "whole");
  EXPECT_EQ(read_all(at("text.txt")), "whole");
  // Nor is a new run's folder taken by what was left before anything was whole.
  fs::create_directories(at("begun"));
  std::ofstream(at("begun/.config.json.7.0.part")) << "{";
  const Outcome trained = arah(training("begun"));
  ASSERT_EQ(trained.code, 0) << trained.errors;
  expect_same_bits("begun");
  EXPECT_THAT(unfinished("begun"), testing::IsEmpty());
}

}  // namespace
}  // namespace arah

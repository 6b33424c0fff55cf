// A training that is asked to stop: by hand, by the system, by a terminal that closes.
#include <fcntl.h>
#include <pty.h>
#include <sys/ioctl.h>

#include "tests/faults/faults.h"

namespace arah {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

TEST_F(Faults, ASignalLeavesACheckpointToGoOnFrom) {
  // SIGHUP twice: a shell sends it on to what the terminal has sent it to.
  const std::vector<std::pair<std::string, std::vector<int>>> ways{{"interrupted", {SIGINT}}, {"terminated", {SIGTERM}}, {"hung_up", {SIGHUP, SIGHUP}}};
  for (const auto& [run, signals] : ways) {
    Program program(training(run), folder());
    ASSERT_TRUE(reaches_step(program, run, 1)) << program.wait().errors;
    for (const int number : signals) {
      program.signal(number);
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
    }
    const Outcome stopped = program.wait();
    const uint64_t step = newest_step(run);
    expect_complaint(stopped, 1, {fmt::format("stopped at step {}; continue with --resume", step)});
    EXPECT_LT(step, static_cast<uint64_t>(kSteps));
    EXPECT_EQ(load_avatar(at(run + "/avatar.safetensors")).steps, step) << "the avatar is that of the checkpoint";
    EXPECT_THAT(unfinished(run), testing::IsEmpty());
    expect_resumed_to_same_bits(run);
  }
}

TEST_F(Faults, ASecondCtrlCEndsAtOnceAndLosesNoCheckpoint) {
  Program program(training("impatient"), folder());
  ASSERT_TRUE(reaches_step(program, "impatient", 1)) << program.wait().errors;
  program.signal(SIGSTOP);  // so that both are there before a step ends
  program.signal(SIGINT);
  program.signal(SIGTERM);
  program.signal(SIGCONT);
  std::this_thread::sleep_for(std::chrono::milliseconds(2));
  program.signal(SIGINT);
  program.signal(SIGTERM);
  EXPECT_LE(program.wait().code, 1);
  EXPECT_GE(newest_step("impatient"), 1u);
  expect_resumed_to_same_bits("impatient");
}

TEST_F(Faults, WhatNohupIgnoresStaysIgnored) {
  Program program(training("nohup"), folder(), [] { std::signal(SIGHUP, SIG_IGN); });
  ASSERT_TRUE(reaches_step(program, "nohup", 1)) << program.wait().errors;
  program.signal(SIGHUP);
  const Outcome whole = program.wait();
  EXPECT_EQ(whole.code, 0) << whole.errors;
  expect_same_bits("nohup");
}

TEST_F(Faults, ATerminalThatClosesLeavesACheckpointToGoOnFrom) {
  int terminal = -1, end = -1;
  ASSERT_EQ(::openpty(&terminal, &end, nullptr, nullptr, nullptr), 0);
  Program program(training("closed"), folder(), [&] {
    ::close(terminal);
    ::setsid();
    if (::ioctl(end, TIOCSCTTY, 0) != 0) ::_exit(125);
    ::dup2(end, 1);
    ::dup2(end, 2);
    ::close(end);
  });
  ::close(end);
  ASSERT_EQ(::fcntl(terminal, F_SETFL, O_NONBLOCK), 0);
  std::string seen;
  bool running = true;
  while ((running = program.running()) && newest_step("closed") < 1) {
    char text[4096];
    const ssize_t count = ::read(terminal, text, sizeof text);  // or the terminal is full and the program waits
    if (count > 0) seen.append(text, static_cast<std::size_t>(count));
    else std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  ::close(terminal);  // the system hangs up: SIGHUP, and whatever is written now is refused
  ASSERT_TRUE(running) << seen;
  EXPECT_THAT(seen, HasSubstr("device: "));
  EXPECT_EQ(program.wait().code, 1);
  const uint64_t step = newest_step("closed");
  EXPECT_LT(step, static_cast<uint64_t>(kSteps));
  EXPECT_TRUE(run_end(RunFolder(at("closed"))).has_value()) << "stopped in good order";
  EXPECT_EQ(load_avatar(at("closed/avatar.safetensors")).steps, step);
  expect_resumed_to_same_bits("closed");
}

TEST_F(Faults, AReaderOfTheOutputThatGoesAwayEndsNothing) {
  int pipe[2];
  ASSERT_EQ(::pipe(pipe), 0);
  Program program(training("unread"), folder(), [&] {
    ::dup2(pipe[1], 1);
    ::dup2(pipe[1], 2);
    ::close(pipe[0]);
    ::close(pipe[1]);
  });
  ::close(pipe[1]);
  EXPECT_TRUE(reaches_step(program, "unread", 1));  // what it says until then fits into the pipe
  ::close(pipe[0]);
  EXPECT_EQ(program.wait().code, 0);
  expect_same_bits("unread");
}

}  // namespace
}  // namespace arah

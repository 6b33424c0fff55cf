// Several ranks, as a user starts them: mpirun -n 2 arah train ... and animate. What they make is what one makes, and one that dies is
// named and costs no more than the steps since the last checkpoint.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <nlohmann/json.hpp>
#include <thread>

#include "host/avatar/avatar_file.h"
#include "host/training/run_folder.h"
#include "tests/stories/ranks.h"

namespace arah {
namespace {

namespace fs = std::filesystem;
using testing::AllOf;
using testing::HasSubstr;

class RanksStory : public RanksTest {
 protected:
  // From the first step on with everything that training learns: poses and shape too, rays by importance, a skinning network.
  static std::vector<std::string> training(const std::string& run, uint64_t steps, const std::vector<std::string>& more = {}) {
    std::vector<std::string> words{"train", at("capture"), "-o", at(run), "--steps", std::to_string(steps)};
    std::vector<std::string> settings{"rays=192", "fit_steps=40", "fit_skinning_steps=20", "checkpoint_minutes=1e-6", "pictures_per_frame=2", "pose_refinement=true", "poses_every=1", "ray_importance=0.5"};
    for (const char* group : {"sdf", "mapping", "skinning", "pose_code", "low_rank", "deviation", "poses"})
      for (const char* zero : {"freeze", "warm_up"}) settings.push_back(fmt::format("{}.{}=0", group, zero));
    settings.push_back("color.warm_up=0");
    settings.insert(settings.end(), more.begin(), more.end());
    for (const std::string& setting : settings) words.insert(words.end(), {"--set", setting});
    return words;
  }
  static SafetensorsFile checkpoint(const std::string& run, uint64_t step) { return read_safetensors(at(fmt::format("{}/checkpoints/step_{:08}.safetensors", run, step))); }

  // |a - b| / |b|, Euclidean, of the numbers from `begin` to before `end`.
  static double difference(const std::vector<double>& a, const std::vector<double>& b, uint64_t begin = 0, uint64_t end = ~uint64_t{0}) {
    double apart = 0, size = 0;
    for (size_t i = begin; i < std::min<uint64_t>(end, b.size()); ++i) apart += (a.at(i) - b[i]) * (a.at(i) - b[i]), size += b[i] * b[i];
    return size > 0 ? std::sqrt(apart / size) : apart;
  }
  // Adam's first moments after one step from the same state are a tenth of the gradients and what was there: of each group of
  // parameters, and of the poses, they are the same but for sums of floats in another grouping.
  static void expect_same_gradients(const std::string& of_several, const std::string& of_one, uint64_t step = 1, bool of_density = true) {
    const SafetensorsFile several = checkpoint(of_several, step), one = checkpoint(of_one, step);
    const auto moments = one.at("optimizer.first_moments").as<double>(), shared = several.at("optimizer.first_moments").as<double>();
    std::string found;
    for (const ParameterGroup& group : avatar_from_tensors(one).layout.groups) {
      if (group.size() == 0) continue;
      const double apart = difference(shared, moments, group.begin, group.end);
      found += fmt::format(" {} {:.2g}", group.name, apart);
      EXPECT_LT(apart, 1e-5) << of_several << ": " << group.name;
      const bool some = std::any_of(moments.begin() + static_cast<std::ptrdiff_t>(group.begin), moments.begin() + static_cast<std::ptrdiff_t>(group.end), [](double m) { return m != 0; });
      EXPECT_EQ(some, of_density || group.name != "deviation") << group.name;
    }
    if (one.tensors.contains("optimizer.pose_first_moments")) {
      const double apart = difference(several.at("optimizer.pose_first_moments").as<double>(), one.at("optimizer.pose_first_moments").as<double>());
      found += fmt::format(" poses {:.2g}", apart);
      EXPECT_LT(apart, 1e-5) << of_several << ": poses";
    }
    std::printf("  %s:%s apart\n", of_several.c_str(), found.c_str());
    std::fflush(stdout);
  }
};

TEST_F(RanksStory, TrainAsOneRankDoesWithinTheSumsRounding) {
  for (const int ranks : {1, 2, 3}) {
    const Outcome trained = arah(ranks, training(fmt::format("of_{}", ranks), 1));
    ASSERT_EQ(trained.code, 0) << trained.errors;
  }
  const SafetensorsFile one = checkpoint("of_1", 1);
  const double loss = logged_steps(RunFolder(at("of_1"))).at(0).total, color = logged_steps(RunFolder(at("of_1"))).at(0).color;
  for (const int ranks : {2, 3}) {
    const std::string run = fmt::format("of_{}", ranks);
    const SafetensorsFile several = checkpoint(run, 1);
    const LoggedStep step = logged_steps(RunFolder(at(run))).at(0);
    // Sums of floats in another grouping: measured 4e-7 of the gradients, 3e-8 of the loss.
    EXPECT_NEAR(step.total, loss, 2e-7 * loss);
    EXPECT_NEAR(step.color, color, 2e-7 * color);
    expect_same_gradients(run, "of_1");
    // As many places in pictures were seen, and with the same errors but for rounding.
    EXPECT_LT(difference(several.at("training.ray_importance").as<double>(), one.at("training.ray_importance").as<double>()), 1e-6);
  }
}

TEST_F(RanksStory, RepeatBitForBitAndGoOnAsAnotherNumber) {
  for (const char* run : {"first", "second"}) {
    const Outcome trained = arah(2, training(run, 6));
    ASSERT_EQ(trained.code, 0) << trained.errors;
  }
  EXPECT_TRUE(read_all(at("first/avatar.safetensors")) == read_all(at("second/avatar.safetensors")));

  std::vector<std::string> half = training("half", 6);
  half.insert(half.end(), {"--stop-at", "3"});
  EXPECT_NE(arah(2, half).code, 0);
  for (const char* run : {"on_one", "on_two", "on_three"}) fs::copy(at("half"), at(run), fs::copy_options::recursive);
  for (const auto& [run, ranks] : {std::pair{"on_one", 1}, {"on_two", 2}, {"on_three", 3}}) {
    const Outcome resumed = arah(ranks, {"train", at("capture"), "-o", at(run), "--resume"});
    ASSERT_EQ(resumed.code, 0) << resumed.errors;
    EXPECT_EQ(load_avatar(at(std::string(run) + "/avatar.safetensors")).steps, 6u);
  }
  EXPECT_TRUE(read_all(at("on_two/avatar.safetensors")) == read_all(at("first/avatar.safetensors"))) << "interrupted or not";
  const auto parameters = [&](const std::string& run) { return checkpoint(run, 6).at("optimizer.parameters").as<double>(); };
  for (const char* run : {"on_one", "on_three"}) {
    const double apart = difference(parameters(run), parameters("first"));
    std::printf("  %s from step 3 to 6: parameters %.3g apart\n", run, apart);
    std::fflush(stdout);
    EXPECT_LT(apart, 3e-4);  // Adam divides small gradients by their own size, and rounding with them: measured 6e-5
  }
}

TEST_F(RanksStory, SurfaceRenderingToo) {
  for (const int ranks : {1, 2}) {
    const Outcome trained = arah(ranks, training(fmt::format("surface_{}", ranks), 1, {"rendering=surface", "alpha_weight=0", "pose_refinement=false"}));
    ASSERT_EQ(trained.code, 0) << trained.errors;
  }
  expect_same_gradients("surface_2", "surface_1", 1, false);
}

// What lies behind the SDF's weights is worked out on every rank from gradients that were added up before it, of two frames a step.
TEST_F(RanksStory, TheSdfMayFollowCodeAndPose) {
  for (const std::string pose : {"low_rank", "hypernetwork"}) {
    const std::vector<std::string> settings{"spec.sdf.pose=" + pose, "spec.sdf.pose_width=16", "spec.sdf.pose_hidden_layers=1", "spec.sdf.conditioning=latent", "spec.sdf.mapping_width=16", "spec.sdf.mapping_hidden_layers=1",
                                            "frames_per_step=2", "hyper.freeze=0", "hyper.warm_up=0", "hyper_last.freeze=0", "hyper_last.warm_up=0", "parameter_weight=1e-3", "ray_importance=0"};
    // After some steps, because the pose's last layers begin at 0 and pass nothing on.
    std::vector<std::string> start = training(pose + "_1", 4, settings);
    start.insert(start.end(), {"--stop-at", "3"});
    EXPECT_NE(arah(1, start).code, 0);
    fs::copy(at(pose + "_1"), at(pose + "_2"), fs::copy_options::recursive);
    for (const int ranks : {1, 2}) {
      const Outcome trained = arah(ranks, {"train", at("capture"), "-o", at(fmt::format("{}_{}", pose, ranks)), "--resume"});
      ASSERT_EQ(trained.code, 0) << trained.errors;
    }
    const double loss = logged_steps(RunFolder(at(pose + "_1"))).back().total;
    EXPECT_NEAR(logged_steps(RunFolder(at(pose + "_2"))).back().total, loss, 2e-7 * loss);
    expect_same_gradients(pose + "_2", pose + "_1", 4);
  }
}

// The second rank's device calls itself by another name and rounds differently: vectors of 512 bits.
TEST_F(RanksStory, UnequalDevicesShareByTheirSpeed) {
  std::vector<std::string> words = on(1, training("unequal", 3)), other = on(1, training("unequal", 3));
  words.push_back(":");
  other.insert(other.begin() + 2, {"env", "LP_NATIVE_VECTOR_WIDTH=512"});
  words.insert(words.end(), other.begin(), other.end());
  const Outcome trained = Program({}, folder_->path(), mpirun(words)).wait();
  if (trained.errors.find("no usable Vulkan device") != std::string::npos) GTEST_SKIP() << "there is no second kind of device here";
  ASSERT_EQ(trained.code, 0) << trained.errors;  // the ranks' parameters are the same at the end, or they say so
  const std::size_t told = trained.errors.find("shares of the ranks in these: ");
  ASSERT_NE(told, std::string::npos) << trained.errors;
  const Outcome again = arah(2, [&] {
    std::vector<std::string> same = training("told", 1);
    const std::size_t begin = told + std::strlen("shares of the ranks in these: ");
    same.insert(same.end(), {"--shares", trained.errors.substr(begin, trained.errors.find('\n', begin) - begin)});
    return same;
  }());
  ASSERT_EQ(again.code, 0) << again.errors;
  const double loss = logged_steps(RunFolder(at("unequal"))).at(0).total;
  EXPECT_NEAR(logged_steps(RunFolder(at("told"))).at(0).total, loss, 1e-5 * loss);

  std::vector<std::string> uneven = training("uneven", 1);
  uneven.insert(uneven.end(), {"--shares", "1,2,3"});
  const Outcome refused = arah(2, uneven);
  EXPECT_EQ(refused.code, 2);
  EXPECT_THAT(refused.errors, HasSubstr("shares: expected 2, one a rank, each from 1 on, found 1,2,3."));
}

TEST_F(RanksStory, CtrlCLeavesACheckpoint) {
  Program program({}, folder_->path(), mpirun(on(2, training("stopped", 100000, {"checkpoint_minutes=100"}))));
  while (program.running() && (!fs::exists(at("stopped/events.jsonl")) || read_all(at("stopped/events.jsonl")).find("\"step\"") == std::string::npos)) std::this_thread::sleep_for(std::chrono::milliseconds(5));
  program.signal(SIGINT);
  const Outcome outcome = program.wait();
  EXPECT_NE(outcome.code, 0);
  EXPECT_THAT(outcome.errors, HasSubstr("continue with --resume"));
  EXPECT_TRUE(RunFolder(at("stopped")).newest_checkpoint());
}

TEST_F(RanksStory, BenchMeasuresEachNumberOfRanks) {
  const Outcome bench = arah(2, {"bench", "--mpi", "--quick", "--json", at("ranks.json"), "--plots", at("plots")});
  ASSERT_EQ(bench.code, 0) << bench.errors;
  const auto json = nlohmann::json::parse(read_all(at("ranks.json")));
  const auto& work = json.at("works").at(0);
  ASSERT_EQ(work.at("points").size(), 2u);
  EXPECT_GT(json.at("gigabytes_per_second").get<double>(), 0);
  // Each number that the step learns travels once, as a float, with some padding and the step's losses and counts.
  const double bytes = work.at("bytes"), gradients = work.at("bytes_of_gradients");
  EXPECT_GT(bytes, 0.9 * gradients);
  EXPECT_LT(bytes, 1.1 * gradients);
  for (const auto& point : work.at("points")) EXPECT_GT(point.at("step_milliseconds").get<double>(), 0);
  EXPECT_GT(work.at("points").at(1).at("exchange_milliseconds").get<double>(), 0);
  EXPECT_EQ(work.at("points").at(0).at("exchange_milliseconds").get<double>(), 0) << "one rank exchanges nothing";
  EXPECT_THAT(read_all(at("plots/ranks-tiny.svg")), HasSubstr("measured: "));
}

TEST_F(RanksStory, RanksThatWouldNotTrainTheSameAreRefused) {
  const auto refusal = [&](const std::vector<std::string>& of_first, const std::vector<std::string>& of_second) {
    std::vector<std::string> words = on(1, of_first), other = on(1, of_second);
    words.push_back(":");
    words.insert(words.end(), other.begin(), other.end());
    const Outcome mixed = Program({}, folder_->path(), mpirun(words)).wait();
    EXPECT_EQ(mixed.code, 2) << mixed.errors;
    EXPECT_FALSE(fs::exists(at("mixed")));
    return mixed.errors;
  };
  const std::vector<std::string> usual = training("mixed", 2);
  EXPECT_THAT(refusal(usual, training("mixed", 2, {"eikonal_points=65"})), HasSubstr("arah (rank 0 of 2): rank 1: setting eikonal_points: expected what rank 0 has, 256, found 65."));
  EXPECT_THAT(refusal(usual, training("mixed", 2, {"spec.sdf.width=32"})), HasSubstr("arah (rank 0 of 2): rank 1: spec sdf: expected what rank 0 has, "));
  // Another picture of the same name and size.
  fs::copy(at("capture"), at("other_capture"), fs::copy_options::recursive);
  fs::copy_file(at("capture/images/train/cam_00/000001.png"), at("other_capture/images/train/cam_00/000000.png"), fs::copy_options::overwrite_existing);
  std::vector<std::string> other = usual;
  other[1] = at("other_capture");
  EXPECT_THAT(refusal(usual, other), HasSubstr("arah (rank 0 of 2): rank 1: capture: images/train/cam_00: expected what rank 0 has, "));

  const Outcome few = arah(3, training("few", 2, {"rays=128"}));
  EXPECT_EQ(few.code, 2) << few.errors;
  EXPECT_THAT(few.errors, HasSubstr("training on 3 ranks: rays: expected at least 129, found 128."));
  EXPECT_FALSE(fs::exists(at("few")));

  const Outcome export_of_two = arah(2, {"export", at("first"), "-o", at("person.glb")});
  EXPECT_EQ(export_of_two.code, 2) << export_of_two.errors;
  EXPECT_THAT(export_of_two.errors, HasSubstr("to be called without mpirun"));
}

// The process that is that rank of that run: by what mpirun tells it.
pid_t process_of(const std::string& rank, const std::string& run) {
  for (const auto& entry : fs::directory_iterator("/proc")) {
    const std::string name = entry.path().filename().string();
    if (name.find_first_not_of("0123456789") != std::string::npos) continue;
    const std::string words = read_all(entry.path() / "cmdline"), environment = read_all(entry.path() / "environ");
    if (words.starts_with(ARAH_PROGRAM) && words.find(run) != std::string::npos && environment.find("OMPI_COMM_WORLD_RANK=" + rank + '\0') != std::string::npos) return std::atoi(name.c_str());
  }
  return 0;
}

TEST_F(RanksStory, OneThatDiesIsNamedAndTheLastCheckpointOpens) {
  for (const char* rank : {"1", "0"}) {
    const std::string run = std::string("dies_") + rank;
    Program program({}, folder_->path(), mpirun(on(2, training(run, 100000))));
    const auto some = [&] { return fs::exists(at(run + "/checkpoints/step_00000003.safetensors")); };
    while (program.running() && !some()) std::this_thread::sleep_for(std::chrono::milliseconds(5));
    const pid_t process = process_of(rank, at(run));
    ASSERT_GT(process, 0);
    ::kill(process, SIGKILL);
    const Outcome outcome = program.wait();
    EXPECT_NE(outcome.code, 0);
    EXPECT_THAT(outcome.errors + outcome.output, HasSubstr(std::string("rank ") + rank)) << "which one";
    std::printf("  %s\n", outcome.errors.substr(outcome.errors.find(rank == std::string("1") ? "arah (rank" : "rank ")).c_str());
    std::vector<std::string> damaged;
    const auto newest = RunFolder(at(run)).newest_checkpoint(&damaged);
    ASSERT_TRUE(newest);
    EXPECT_THAT(damaged, testing::IsEmpty());
    const uint64_t step = avatar_from_tensors(*newest).steps;
    EXPECT_GE(step, 3u);
    const Outcome resumed = arah(1, {"train", at("capture"), "-o", at(run), "--resume", "--steps", std::to_string(step + 1)});
    EXPECT_EQ(resumed.code, 0) << resumed.errors;
  }
}

TEST_F(RanksStory, AnimateToTheSamePictures) {
  ASSERT_EQ(arah(1, training("to_show", 2)).code, 0);
  for (const int ranks : {1, 2, 3}) {
    const Outcome made = arah(ranks, {"animate", at("to_show"), "-o", at(fmt::format("turn_{}", ranks)), "--turntable", "--count", "7", "--size", "40"});
    ASSERT_EQ(made.code, 0) << made.errors;
    for (int frame = 0; frame < 7; ++frame) {
      const std::string name = fmt::format("/{:06}.png", frame), picture = read_all(at(fmt::format("turn_{}", ranks)) + name);
      ASSERT_GT(picture.size(), 100u) << name;
      EXPECT_TRUE(picture == read_all(at("turn_1") + name)) << ranks << " ranks: " << name;
    }
  }
  // What is missing is made, and a video of it all.
  fs::remove(at("turn_2/000003.png"));
  const Outcome again = arah(2, {"animate", at("to_show"), "-o", at("turn_2"), "--turntable", "--count", "7", "--size", "40"});
  ASSERT_EQ(again.code, 0) << again.errors;
  EXPECT_TRUE(read_all(at("turn_2/000003.png")) == read_all(at("turn_1/000003.png")));
  const Outcome video = arah(2, {"animate", at("to_show"), "-o", at("turn.mp4"), "--turntable", "--count", "7", "--size", "40"});
  ASSERT_EQ(video.code, 0) << video.errors;
  EXPECT_TRUE(fs::exists(at("turn.mp4")));
  EXPECT_FALSE(fs::exists(at("turn.mp4.frames")));
}

}  // namespace
}  // namespace arah

// A training whose numbers go bad, as a user meets it: it stops by name, what is kept can be looked at and repeated, and training goes on
// without such steps where that is wanted.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "host/avatar/avatar_file.h"
#include "host/training/run_folder.h"
#include "tests/host/body/rigs.h"
#include "tests/stories/program.h"

namespace arah {
namespace {

namespace fs = std::filesystem;
using testing::AllOf;
using testing::HasSubstr;

// The line that begins with "arah: ".
std::string complaint(const Outcome& outcome) {
  const std::size_t line = outcome.errors.rfind("arah: ");
  return line == std::string::npos ? "none: " + outcome.errors : outcome.errors.substr(line);
}

TEST(FailureStory, ABadStepIsNamedLookedAtRepeatedAndLeftOut) {
  const TemporaryFolder folder;
  const auto arah = [&](const std::vector<std::string>& words) { return Program(words, folder.path()).wait(); };
  const std::string capture = (folder / "capture").string(), run = (folder / "run").string();
  ASSERT_EQ(arah({"synth", capture, "--frames", "4", "--size", "64"}).code, 0);
  // A shape that reads each frame's code.
  const Outcome trained = arah({"train", capture, "-o", run, "--steps", "3", "--set", "fit_steps=60", "--set", "fit_skinning_steps=30", "--set", "spec.sdf.conditioning=latent", "--set", "spec.sdf.mapping_width=16", "--set", "spec.sdf.mapping_hidden_layers=1"});
  ASSERT_EQ(trained.code, 0) << trained.errors;

  // What a flaw of a driver or of memory would do: the code of one frame is beyond all measure.
  const RunFolder files(run);
  SafetensorsFile checkpoint = files.newest_checkpoint().value();
  const Avatar avatar = avatar_from_tensors(checkpoint);
  ASSERT_TRUE(avatar.layout.has("latent"));
  std::vector<float> parameters = checkpoint.tensors.at("optimizer.parameters").as<float>();
  for (uint32_t i = 0; i < avatar.spec.latent_size; ++i) parameters[avatar.layout.slot("latent").offset + i] = 1e38f;
  checkpoint.tensors["optimizer.parameters"] = Tensor::from<float>({static_cast<int64_t>(parameters.size())}, parameters);
  files.save_checkpoint(3, checkpoint);
  const std::string before = read_all(files.avatar_file());

  const Outcome stopped = arah({"train", capture, "-o", run, "--resume", "--steps", "40"});
  EXPECT_EQ(stopped.code, 1);
  const std::string message = complaint(stopped);
  std::vector<fs::path> kept;
  for (const auto& entry : fs::directory_iterator(run))
    if (entry.path().filename().string().starts_with("failure_")) kept.push_back(entry.path());
  ASSERT_EQ(kept.size(), 1u) << message;
  const std::string failure = kept[0].string();
  EXPECT_THAT(message, AllOf(HasSubstr("training step "), HasSubstr("stage '"), HasSubstr("Kept in " + failure), HasSubstr("arah inspect"), HasSubstr("--resume --from " + failure)));
  EXPECT_EQ(std::count(message.begin(), message.end(), '\n'), 1) << message;
  EXPECT_TRUE(read_all(files.avatar_file()) == before) << "an avatar of a step that was not taken";

  const std::size_t first = message.find("stage '"), last = std::min(message.find("; after it"), message.find(". Kept in"));
  const Outcome looked = arah({"inspect", failure});
  EXPECT_EQ(looked.code, 0) << looked.errors;
  EXPECT_THAT(looked.output, AllOf(HasSubstr("a training step that failed: step "), HasSubstr("the file holds the state before it"), HasSubstr("  " + message.substr(first, last - first) + "\n")));

  // The step again, by the words of the message.
  const Outcome repeated = arah({"train", capture, "-o", run, "--resume", "--from", failure, "--steps", "40"});
  EXPECT_EQ(repeated.code, 1);
  EXPECT_EQ(complaint(repeated), message);
  EXPECT_EQ(arah({"train", capture, "-o", run, "--from", failure}).code, 2) << "without --resume";
  const Outcome nowhere = arah({"train", capture, "-o", run, "--resume", "--from", (folder / "nowhere").string()});
  EXPECT_EQ(nowhere.code, 2);
  EXPECT_THAT(complaint(nowhere), HasSubstr("nowhere"));

  const Outcome through = arah({"train", capture, "-o", run, "--resume", "--from", failure, "--steps", "40", "--set", "on_bad_value=skip"});
  ASSERT_EQ(through.code, 0) << through.errors;
  uint64_t told = 0;
  nlohmann::json end;
  std::ifstream events(files.events_file());
  for (std::string line; std::getline(events, line);) {
    const nlohmann::json event = nlohmann::json::parse(line);
    told += event["event"] == "bad_values" && event.contains("skipped");
    if (event["event"] == "end") end = event;
  }
  EXPECT_EQ(end["step"], 40);
  EXPECT_EQ(end["skipped"], told);
  EXPECT_GT(told, 0u);
  EXPECT_LT(told, 37u) << "other frames' steps are good";
  EXPECT_THAT(through.errors, HasSubstr(fmt::format("40 steps, of which {} were skipped for bad values", told)));
  EXPECT_EQ(load_avatar(files.avatar_file()).steps, 40u);
}

}  // namespace
}  // namespace arah

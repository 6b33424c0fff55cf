// A sequence of a public dataset, from its folder to an avatar, as a user asks for it.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/host/capture/made_up_sequence.h"
#include "tests/host/capture/made_up_snapshot.h"
#include "tests/stories/program.h"

namespace arah {
namespace {

using testing::AllOf;
using testing::HasSubstr;

TEST(ImportStory, ASequenceBecomesACaptureThatTrains) {
  const MadeUpSequence sequence;
  const auto at = [&](const std::string& name) { return (sequence.root / name).string(); };
  const auto arah = [&](const std::vector<std::string>& words) { return Program(words, sequence.root.path()).wait(); };
  const std::vector<std::string> import{"import", "zju-mocap", sequence.folder.string(), at("capture"), "--train-cameras", "1", "--frames", "train=0:3", "--frames", "novel=3:4"};
  const auto with = [&](const std::vector<std::string>& more) {
    std::vector<std::string> words = import;
    words.insert(words.end(), more.begin(), more.end());
    return words;
  };

  const Outcome presets = arah({"import", "--list-presets"});
  EXPECT_EQ(presets.code, 0);
  EXPECT_THAT(presets.output, AllOf(HasSubstr("CoreView_377"), HasSubstr("S11")));

  const Outcome no_body = arah(import);
  EXPECT_EQ(no_body.code, 2);
  EXPECT_THAT(no_body.errors, HasSubstr("--body"));
  EXPECT_FALSE(std::filesystem::exists(at("capture")));

  const Outcome imported = arah(with({"--body", at("body.glb")}));
  ASSERT_EQ(imported.code, 0) << imported.errors;
  const Outcome inspected = arah({"inspect", at("capture")});
  EXPECT_EQ(inspected.code, 0) << inspected.errors;
  EXPECT_THAT(inspected.output, AllOf(HasSubstr("Camera_B1"), HasSubstr("Camera_B2"), HasSubstr("novel")));
  const Outcome trained = arah({"train", at("capture"), "-o", at("run"), "--steps", "2", "--set", "fit_steps=20", "--set", "fit_skinning_steps=20"});
  ASSERT_EQ(trained.code, 0) << trained.errors;
  EXPECT_THAT(trained.output + trained.errors, HasSubstr("pose refinement: on")) << "a fit's poses are estimates";

  // A file that would run a command names it instead, and what was imported before stays.
  sequence.write("annots.npy", python::npy_of_value(python::call(python::name("os", "system"), {python::text("touch " + at("ran"))})));
  const Outcome hostile = arah(with({"--body", at("body.glb")}));
  EXPECT_EQ(hostile.code, 2);
  EXPECT_THAT(hostile.errors, AllOf(HasSubstr("annots.npy"), HasSubstr("'os.system'")));
  EXPECT_FALSE(std::filesystem::exists(at("ran")));
  EXPECT_TRUE(std::filesystem::exists(at("capture") + "/cameras.json"));
}

TEST(ImportStory, AVideoOfOneCameraBecomesACapture) {
  const MadeUpSnapshot sequence;
  const auto at = [&](const std::string& name) { return (sequence.root / name).string(); };
  const auto arah = [&](const std::vector<std::string>& words) { return Program(words, sequence.root.path()).wait(); };
  const Outcome imported = arah({"import", "people-snapshot", sequence.folder.string(), at("capture"), "--body", at("body.glb"), "--frames", "train=0:4", "--frames", "novel=4:5"});
  ASSERT_EQ(imported.code, 0) << imported.errors;
  EXPECT_THAT(imported.output, AllOf(HasSubstr("note: The sequence has 6 poses, 5 pictures and 5 masks"), HasSubstr("SMPL's female model")));
  const Outcome inspected = arah({"inspect", at("capture")});
  EXPECT_EQ(inspected.code, 0) << inspected.errors;
  EXPECT_THAT(inspected.output, AllOf(HasSubstr("camera"), HasSubstr("novel")));

  sequence.write("masks.hdf5", "no masks");
  const Outcome damaged = arah({"import", "people-snapshot", sequence.folder.string(), at("capture"), "--body", at("body.glb")});
  EXPECT_EQ(damaged.code, 2);
  EXPECT_THAT(damaged.errors, AllOf(HasSubstr("masks.hdf5"), HasSubstr("expected an HDF5 file")));
  EXPECT_TRUE(std::filesystem::exists(at("capture") + "/cameras.json"));
}

}  // namespace
}  // namespace arah

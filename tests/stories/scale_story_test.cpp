// A capture whose lengths are not metres, as a user meets it: refused by name, with the unit that it seems to be in.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "host/avatar/avatar_file.h"
#include "host/capture/capture.h"
#include "tests/host/body/rigs.h"
#include "tests/stories/program.h"

namespace arah {
namespace {

namespace fs = std::filesystem;
using testing::AllOf;
using testing::HasSubstr;
using testing::Not;

// All lengths of a capture times `factor`; its pictures are the same then.
void scale_capture(const fs::path& from, const fs::path& to, double factor) {
  fs::copy(from, to, fs::copy_options::recursive);
  Capture capture = open_capture(to);
  BodyTemplate& body = capture.body_template;
  body.shape = {};
  for (glm::vec3& vertex : body.vertices) vertex *= static_cast<float>(factor);
  for (glm::dvec3& joint : body.skeleton.rest_joints) joint *= factor;
  write_body_template(to / "template.glb", body);
  for (Camera& camera : capture.cameras) camera.T *= factor;
  write_cameras(to / "cameras.json", capture.cameras);
  for (auto& [split, motion] : capture.motions) {
    for (glm::dvec3& joint : motion.skeleton.rest_joints) joint *= factor;
    for (MotionFrame& frame : motion.frames) frame.pose.root_position *= factor;
    write_motion(to / ("motion_" + split + ".json"), motion);
  }
}

TEST(ScaleStory, BodiesOfAMillimetreAndAKilometreAreRefusedByName) {
  const TemporaryFolder folder;
  const auto arah = [&](const std::vector<std::string>& words) { return Program(words, folder.path()).wait(); };
  const fs::path capture = folder / "capture";
  ASSERT_EQ(arah({"synth", capture.string(), "--frames", "4", "--size", "48"}).code, 0);
  const std::vector<std::string> few_steps{"--steps", "2", "--set", "fit_steps=20", "--set", "fit_skinning_steps=20"};

  struct Scale {
    double factor;
    const char *size, *unit;
  };
  for (const Scale& scale : {Scale{1000, " m.", "seem to be in millimetres: multiply them by 0.001"}, Scale{100, " m.", "seem to be in centimetres: multiply them by 0.01"},
                             Scale{1e-3, " m.", "seem to be in kilometres: multiply them by 1000"}, Scale{1.0 / 1740, "one of 0.00", "kilometres"}}) {
    SCOPED_TRACE(fmt::format("times {:g}", scale.factor));
    const fs::path scaled = folder / fmt::format("times_{:g}", scale.factor);
    scale_capture(capture, scaled, scale.factor);
    std::vector<std::string> words{"train", scaled.string(), "-o", (folder / "refused").string()};
    words.insert(words.end(), few_steps.begin(), few_steps.end());
    const Outcome refused = arah(words);
    EXPECT_EQ(refused.code, 2) << refused.errors;
    EXPECT_THAT(refused.errors, AllOf(HasSubstr((scaled / "template.glb").string() + ": vertices: expected a body of 0.05 to 5 m, found one of "), HasSubstr(scale.size), HasSubstr(scale.unit)));
    const Outcome inspected = arah({"inspect", scaled.string()});
    EXPECT_EQ(inspected.code, 0) << inspected.errors;
    EXPECT_THAT(inspected.output + inspected.errors, AllOf(HasSubstr("warning: no avatar can be trained from it: " + (scaled / "template.glb").string()), HasSubstr(scale.unit)));
  }

  // What is within the bounds works, a child or a doll.
  const fs::path half = folder / "half";
  scale_capture(capture, half, 0.5);
  std::vector<std::string> words{"train", half.string(), "-o", (folder / "run").string()};
  words.insert(words.end(), few_steps.begin(), few_steps.end());
  const Outcome trained = arah(words);
  ASSERT_EQ(trained.code, 0) << trained.errors;
  EXPECT_THAT(arah({"inspect", half.string()}).output, Not(HasSubstr("no avatar can be trained")));

  // An avatar whose file says that it is a kilometre tall.
  SafetensorsFile file = read_safetensors(folder / "run" / "avatar.safetensors");
  const Avatar avatar = avatar_from_tensors(file);
  file.metadata["cube"] = fmt::format("{{\"center\":[0,0,0],\"cmin\":{},\"cmax\":{}}}", 1000 * avatar.cube.cmin, 1000 * avatar.cube.cmax);
  write_safetensors(folder / "tall.safetensors", file);
  const Outcome tall = arah({"render", (folder / "tall.safetensors").string(), "-o", (folder / "tall.png").string()});
  EXPECT_EQ(tall.code, 2) << tall.errors;
  EXPECT_THAT(tall.errors, AllOf(HasSubstr("tall.safetensors: "), HasSubstr("a body of 0.05 to 5 m")));
  EXPECT_FALSE(fs::exists(folder / "tall.png"));
}

}  // namespace
}  // namespace arah

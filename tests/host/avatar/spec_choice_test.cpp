// What is chosen for a capture, and the facts that it is chosen from.
#include "host/avatar/spec_choice.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/host/body/rigs.h"

namespace arah {
namespace {

using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

constexpr CaptureFacts kStudio{23, 300, 24, false, false};  // a paper's capture
constexpr CaptureFacts kHome{4, 60, 24, false, true};

TEST(ChooseSpec, AStudioCaptureKeepsThePreset) {
  for (const std::string& preset : preset_names()) EXPECT_EQ(choose_spec(preset, kStudio).spec, preset_spec(preset));
}

TEST(ChooseSpec, FewCamerasDropTheViewDirection) {
  const SpecChoice choice = choose_spec("paper", kHome);
  AvatarSpec expected = preset_spec("paper");
  expected.color.view = false;
  EXPECT_EQ(choice.spec, expected);
  EXPECT_THAT(choice.reasons, Contains(HasSubstr("view direction: off, because 4 training cameras (fewer than 10)")));
  CaptureFacts ten = kHome;
  ten.training_cameras = 10;
  EXPECT_TRUE(choose_spec("paper", ten).spec.color.view);
}

TEST(ChooseSpec, OneFrameNeedsNeitherSkinningNorCodes) {
  const CaptureFacts one{12, 1, 24, true, false};
  for (const std::string& preset : preset_names()) {
    const AvatarSpec spec = choose_spec(preset, one).spec;
    EXPECT_EQ(spec.skinning.kind, Skinning::none);
    EXPECT_EQ(spec.sdf.conditioning, SdfConditioning::none);
    EXPECT_EQ(spec.sdf.pose, PoseConditioning::none);
    EXPECT_EQ(spec.latent_size, 0u);
    EXPECT_FALSE(spec.color.latent);
  }
}

TEST(ChooseSpec, ManyFramesOfOnePoseKeepTheColourCode) {
  const AvatarSpec spec = choose_spec("paper", {12, 9, 24, true, false}).spec;
  EXPECT_EQ(spec.skinning.kind, Skinning::none);
  EXPECT_EQ(spec.sdf.conditioning, SdfConditioning::none);
  EXPECT_EQ(spec.sdf.pose, PoseConditioning::none);
  EXPECT_TRUE(spec.color.latent);
  EXPECT_EQ(spec.latent_size, 128u);
}

TEST(ChooseSpec, OneJointNeedsNoNetwork) {
  EXPECT_EQ(choose_spec("tiny", {4, 9, 1, false, false}).spec.skinning.kind, Skinning::template_weights);
}

TEST(ChooseSpec, RefinesPosesThatAreStatedToBeEstimates) {
  CaptureFacts estimated = kStudio;
  estimated.estimated_poses = true;
  const SpecChoice estimates = choose_spec("tiny", estimated), exact = choose_spec("tiny", kHome), unknown = choose_spec("tiny", kStudio), still = choose_spec("tiny", {12, 9, 24, true, false});
  EXPECT_TRUE(estimates.pose_refinement);
  EXPECT_THAT(estimates.reasons, Contains("pose refinement: on, because the capture states that its poses are estimates"));
  EXPECT_FALSE(estimates.shape_refinement);
  EXPECT_THAT(estimates.reasons, Contains("shape refinement: off, because no morph target of the template moves its joints"));
  estimated.shape_moves_joints = true;
  EXPECT_TRUE(choose_spec("tiny", estimated).shape_refinement);
  estimated.estimated_poses = false;
  EXPECT_FALSE(choose_spec("tiny", estimated).shape_refinement);
  EXPECT_FALSE(exact.pose_refinement);
  EXPECT_FALSE(unknown.pose_refinement);
  EXPECT_THAT(unknown.reasons, Contains(HasSubstr("--set pose_refinement=true")));
  EXPECT_FALSE(still.pose_refinement);
  EXPECT_THAT(still.reasons, Contains("pose refinement: off, because there is one pose, which is the canonical one"));
}

TEST(ChooseSpec, GivesOneReasonAPart) {
  for (const CaptureFacts& facts : {kStudio, kHome, CaptureFacts{1, 1, 1, true, true}}) {
    for (const std::string& preset : preset_names()) {
      const SpecChoice choice = choose_spec(preset, facts);
      ASSERT_EQ(choice.reasons.size(), 8u);
      for (const char* part : {"skinning: ", "SDF conditioning: ", "SDF by pose: ", "colour latent: ", "colour view direction: ",
                               "colour normal: ", "colour feature grid: ", "pose refinement: "}) {
        EXPECT_THAT(choice.reasons, Contains(AllOf(testing::StartsWith(part), HasSubstr(", because "))));
      }
    }
  }
}

// Three frames in a folder with picture files; their content is not looked at.
class Facts : public ::testing::Test {
 protected:
  void SetUp() override {
    capture.path = folder.path();
    capture.body_template = tetrahedron(3);
    for (const char* name : {"a", "b", "held"}) {
      Camera camera;
      camera.name = name;
      capture.cameras.push_back(camera);
    }
    capture.cameras[2].role = "test";
    Motion& motion = capture.motions["train"];
    for (int number : {3, 4, 9}) motion.frames.push_back({number, rest_pose(capture.body_template.skeleton), ""});
  }
  void picture(std::size_t camera, int frame) {
    folder.write(std::filesystem::relative(image_path(capture, "train", camera, frame), folder.path()).string(), "png");
  }

  TemporaryFolder folder;
  Capture capture;
};

TEST_F(Facts, CountOnlyWhatTrainingCamerasSee) {
  picture(0, 3);
  picture(0, 4);
  picture(2, 9);  // a held-out camera
  EXPECT_THAT(training_frames(capture), ElementsAre(3, 4));
  const CaptureFacts facts = capture_facts(capture);
  EXPECT_EQ(facts.training_cameras, 1u);
  EXPECT_EQ(facts.training_frames, 2u);
  EXPECT_EQ(facts.joints, 3u);
  EXPECT_TRUE(facts.single_pose);
  EXPECT_FALSE(facts.exact_poses);
  EXPECT_FALSE(facts.estimated_poses) << "nothing is said of them";
}

TEST_F(Facts, ASecondPoseCountsOnlyWherePicturesShowIt) {
  picture(0, 3);
  picture(1, 4);
  capture.motions["train"].frames[2].pose.theta[1] = {0.1, 0, 0};
  capture.motions["train"].frames[1].pose.root_position = {5, 0, 0};
  EXPECT_TRUE(capture_facts(capture).single_pose);
  EXPECT_EQ(capture_facts(capture).training_cameras, 2u);
  picture(1, 9);
  EXPECT_FALSE(capture_facts(capture).single_pose);
}

TEST_F(Facts, ExactPosesAreStated) {
  picture(0, 3);
  folder.write("synthetic.json", R"({"poses": "estimated"})");
  EXPECT_FALSE(capture_facts(capture).exact_poses);
  EXPECT_TRUE(capture_facts(capture).estimated_poses);
  folder.write("synthetic.json", R"({"poses": "exact"})");
  EXPECT_TRUE(capture_facts(capture).exact_poses);
  EXPECT_FALSE(capture_facts(capture).estimated_poses);
}

TEST_F(Facts, WithoutATrainingPictureThereIsNothingToLearn) {
  picture(2, 3);
  expect_input_error([&] { capture_facts(capture); }, {folder.path().string(), "images/train", "none"});
  capture.motions.clear();
  expect_input_error([&] { capture_facts(capture); }, {"split", "'train'"});
}

}  // namespace
}  // namespace arah

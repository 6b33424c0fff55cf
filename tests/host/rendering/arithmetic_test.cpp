// The knob `arithmetic`: what halves cost a picture, and what more is asked of a device.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "host/input_error.h"
#include "host/rendering/renderer.h"
#include "kernels/linear/cooperative.h"
#include "tests/host/rendering/capsule_scene.h"

namespace arah {
namespace {

class ArithmeticKnob : public DeviceTest {
 protected:
  Picture render(const Avatar& avatar, const char* preset, const char* arithmetic, uint64_t* bytes = nullptr) {
    RenderSettings settings = render_preset(avatar, preset);
    set_render_knob(settings, "arithmetic", arithmetic);
    settings.normals = true;
    const uint64_t before = device.allocated_bytes();
    Renderer renderer(device, avatar, settings);
    Picture picture = renderer.render(capsule_camera(45, 53), bent_pose(avatar.body.skeleton), 0);
    if (bytes) *bytes = device.allocated_bytes() - before;
    return picture;
  }
};

struct Difference {
  double color = 0, color_root_mean_square = 0, alpha = 0;
  double depth = 0;  // metres, where both see
};

Difference compare(const std::string& what, const Picture& a, const Picture& b) {
  Difference d;
  for (size_t i = 0; i < a.color.size(); ++i) {
    const double x = std::abs(a.color[i] - b.color[i]);
    EXPECT_TRUE(std::isfinite(b.color[i]));
    d.color = std::max(d.color, x);
    d.color_root_mean_square += x * x / double(a.color.size());
  }
  for (size_t i = 0; i < a.alpha.size(); ++i) {
    d.alpha = std::max<double>(d.alpha, std::abs(a.alpha[i] - b.alpha[i]));
    if (a.depth[i] > 0 && b.depth[i] > 0) d.depth = std::max<double>(d.depth, std::abs(a.depth[i] - b.depth[i]));
  }
  d.color_root_mean_square = std::sqrt(d.color_root_mean_square);
  std::printf("  %-40s colours differ by up to %.2e, %.2e in the mean of squares, alpha by %.2e, depth by %.3f mm\n", what.c_str(), d.color, d.color_root_mean_square, d.alpha, 1000 * d.depth);
  return d;
}

TEST_F(ArithmeticKnob, HalvesChangeAPictureALittle) {
  AvatarSpec with_code = small_paper_spec(), plain = small_paper_spec();
  plain.sdf = {24, 3, 30.0, SdfConditioning::none, 0, 0};
  plain.color.skip = -1, plain.color.narrow = 0;
  plain.color.normal = false;
  for (const AvatarSpec& spec : {with_code, plain}) {
    const Avatar avatar = capsule_avatar(device, spec);
    for (const char* preset : {"paper", "balanced"}) {
      uint64_t full = 0, half = 0;
      const Picture exact = render(avatar, preset, "float32", &full), halves = render(avatar, preset, "half_storage", &half);
      const Difference d = compare(std::string(preset) + (spec.color.normal ? ", a code, normals, a skip" : ", none of these"), exact, halves);
      EXPECT_NE(exact.color, halves.color) << "the knob does nothing";
      EXPECT_NE(exact.alpha, halves.alpha) << "the distances are as before";
      // b is 2 mm; an eighth of a grey level of 255, and a tenth of b.
      EXPECT_LE(d.color_root_mean_square, 5e-4);
      EXPECT_LE(d.depth, 2e-4);
      EXPECT_LT(half, full) << "and takes no less memory";
      EXPECT_EQ(render(avatar, preset, "half_storage").color, halves.color) << "the same bits again";
    }
  }
}

TEST_F(ArithmeticKnob, IsExactUnlessTold) {
  const Avatar avatar = make_avatar(small_paper_spec(), capsule_body(), {0}, 1);
  RenderSettings settings = render_preset(avatar, "paper");
  EXPECT_EQ(settings.arithmetic, Arithmetic::float32) << "the exact one unless told otherwise";
  EXPECT_THAT(render_settings_json(settings), testing::HasSubstr(R"("arithmetic":"float32")"));
  set_render_knob(settings, "arithmetic", "half_storage");
  EXPECT_THAT(render_settings_json(settings), testing::HasSubstr(R"("arithmetic":"half_storage")"));
  EXPECT_THROW(set_render_knob(settings, "arithmetic", "half"), InputError);
  EXPECT_THAT(render_knobs(), testing::Contains("arithmetic"));
}

// Where the device has them, a picture like that of half storage, but for the weights' rounding; elsewhere the reason.
TEST_F(ArithmeticKnob, CooperativeMatricesAreRefusedWhereTheDeviceHasNone) {
  AvatarSpec spec = small_paper_spec();
  spec.sdf.width = spec.color.width = 32;  // multiples of 16: layers that they can compute
  if (!cooperative_refusal(device).empty()) {
    const Avatar avatar = make_avatar(spec, capsule_body(), {0}, 1);
    try {
      render(avatar, "paper", "cooperative_matrix");
      ADD_FAILURE() << "taken on a device without them";
    } catch (const InputError& error) {
      std::printf("  %s\n", error.what());
      EXPECT_THAT(error.what(), testing::AllOf(testing::HasSubstr("arithmetic cooperative_matrix"), testing::HasSubstr(device.report().name), testing::HasSubstr(cooperative_refusal(device)), testing::HasSubstr("half_storage")));
    }
    return;
  }
  const Avatar avatar = capsule_avatar(device, spec);
  const Picture exact = render(avatar, "paper", "float32"), halves = render(avatar, "paper", "half_storage"), cooperative = render(avatar, "paper", "cooperative_matrix");
  EXPECT_NE(halves.color, cooperative.color) << "the weights are as before";
  const Difference d = compare("cooperative matrices", exact, cooperative);
  EXPECT_LE(d.color_root_mean_square, 1e-3);
  EXPECT_LE(d.depth, 4e-4);
}

TEST_F(ArithmeticKnob, TrainingIsRefused) {
  const Avatar avatar = make_avatar(small_paper_spec(), capsule_body(), {0}, 1);
  AvatarNetworks networks(device, avatar, true);
  EXPECT_THROW(Field(device, networks, 64, 1, {64}, true, Arithmetic::half_storage), std::invalid_argument);
}

}  // namespace
}  // namespace arah

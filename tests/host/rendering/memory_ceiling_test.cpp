// Under a memory ceiling fewer rays go together, the picture stays what it was, and what cannot fit is refused with the least
// ceiling that would do.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <regex>

#include "host/rendering/memory_plan.h"
#include "host/rendering/renderer.h"
#include "tests/host/rendering/capsule_scene.h"

namespace arah {
namespace {

using testing::HasSubstr;

struct Rendered {
  Picture picture;
  uint64_t most = 0;  // bytes allocated at any moment
};

Rendered render_under(uint64_t ceiling, const Avatar& avatar, const char* mode) {
  DeviceOptions options = DeviceOptions::from_environment();
  options.memory_ceiling = ceiling;
  Device device(options);
  RenderSettings settings = render_preset(avatar, "balanced");  // with the frame's grid of correspondences
  set_render_knob(settings, "sampling_mode", mode);
  set_render_knob(settings, "samples", "64");
  settings.normals = true;
  Renderer renderer(device, avatar, settings);
  Rendered rendered;
  rendered.picture = renderer.render(capsule_camera(45, 53), bent_pose(avatar.body.skeleton), 0);
  rendered.most = device.most_allocated_bytes();
  return rendered;
}

// The ceiling that an error recommends, bytes.
uint64_t recommended(const std::string& error) {
  std::smatch match;
  return std::regex_search(error, match, std::regex("A ceiling of ([0-9]+)M")) ? std::stoull(match[1]) << 20 : 0;
}

class MemoryCeiling : public DeviceTest {};

TEST_F(MemoryCeiling, APictureIsTheSameInSmallChunks) {
  const Avatar avatar = capsule_avatar(device, small_paper_spec());
  for (const char* mode : {"shell", "surface"}) {
    const Rendered free = render_under(0, avatar, mode);
    std::string refusal;
    try {
      render_under(1 << 20, avatar, mode);
    } catch (const MemoryCeilingError& error) {
      refusal = error.what();
    }
    EXPECT_THAT(refusal, AllOf(HasSubstr("asks for"), HasSubstr("the memory ceiling is 1.0M"), HasSubstr("held"), HasSubstr("--memory")));
    const uint64_t least = recommended(refusal);
    ASSERT_GT(least, 0u) << refusal;
    for (const uint64_t ceiling : {least, least + (free.most - least) / 2}) {
      const Rendered small = render_under(ceiling, avatar, mode);
      std::printf("  %s: %.1f MB without a ceiling, %.1f of %.1f MB with it\n", mode, 1e-6 * double(free.most), 1e-6 * double(small.most), 1e-6 * double(ceiling));
      EXPECT_LE(small.most, ceiling);
      EXPECT_LT(small.most, free.most);
      EXPECT_EQ(small.picture.color, free.picture.color);
      EXPECT_EQ(small.picture.alpha, free.picture.alpha);
      EXPECT_EQ(small.picture.depth, free.picture.depth);
      EXPECT_EQ(small.picture.normal, free.picture.normal);
    }
  }
}

TEST_F(MemoryCeiling, TheMostRaysThatFitAreFound) {
  DeviceOptions options = DeviceOptions::from_environment();
  options.memory_ceiling = 1 << 20;
  Device small(options);
  const Buffer held(small, "held: this", 1 << 18, BufferPlace::device);
  const auto make = [&](uint32_t rays) { Buffer(small, "rays", rays * 1024ull, BufferPlace::device); };
  // 768 KiB are left, 128 of them for later: 640 rays of 1 KiB.
  EXPECT_EQ(rays_that_fit(small, "work", 1000, 1 << 17, make), 640u);
  EXPECT_EQ(rays_that_fit(small, "work", 500, 1 << 17, make), 500u) << "all that are wanted, though no multiple of 64";
  EXPECT_EQ(rays_that_fit(small, "work", 639, 1 << 17, make), 639u);
  EXPECT_EQ(small.allocated_bytes(), held.bytes()) << "a plan holds nothing";
  try {
    rays_that_fit(small, "work", 1000, 3 << 18, make);
    ADD_FAILURE() << "64 rays more than what is left were accepted";
  } catch (const MemoryCeilingError& error) {
    EXPECT_THAT(error.what(), AllOf(HasSubstr("work: asks for 0.8M"), HasSubstr("0.2M are held: 0.2M held")));
    EXPECT_EQ(recommended(error.what()), 2u << 20);
  }
  EXPECT_EQ(rays_that_fit(device, "work", 1000, 1ull << 40, make), 1000u) << "no ceiling, no limit";
}

}  // namespace
}  // namespace arah

// What a picture tells of each pixel beside its colour.
#include <gtest/gtest.h>

#include <numeric>

#include "host/rendering/renderer.h"
#include "tests/host/rendering/capsule_scene.h"

namespace arah {
namespace {

uint64_t total(const std::vector<uint32_t>& of_pixels) { return std::accumulate(of_pixels.begin(), of_pixels.end(), uint64_t{0}); }

class PictureInspection : public DeviceTest {
 protected:
  static RenderSettings inspected(const Avatar& avatar, const std::string& quality) {
    RenderSettings settings = render_preset(avatar, quality);
    settings.inspect = true;
    if (settings.baked_distances) set_render_knob(settings, "bake_cell", "0.02");
    return settings;
  }
};

// At rest a canonical point is the posed one: the capsule's canonical pose is its rest, whatever the weights.
TEST_F(PictureInspection, SaysWhereOnTheBodyAPixelLies) {
  for (const Skinning kind : {Skinning::network, Skinning::none}) {
    AvatarSpec spec = small_paper_spec();
    if (kind == Skinning::none) spec.skinning = {kind, 0, 0};
    const Avatar avatar = capsule_avatar(device, spec);
    Pose pose = kind == Skinning::none ? bent_pose(avatar.body.skeleton) : rest_pose(avatar.body.skeleton);
    pose.root_position += glm::dvec3(0.1, -0.2, 0.2);
    const glm::dvec3 translation = root_translation(avatar.body.skeleton, pose);
    const Camera camera = capsule_camera(37, 41);
    Renderer renderer(device, avatar, inspected(avatar, "paper"));
    const Picture picture = renderer.render(camera, pose, 0);
    ASSERT_TRUE(picture.inspection);
    size_t seen = 0;
    double farthest = 0;
    for (size_t i = 0; i < picture.alpha.size(); ++i) {
      const std::array<float, 4>& canonical = picture.inspection->canonical[i];
      EXPECT_NEAR(canonical[3], picture.alpha[i], 1e-5);
      if (picture.depth[i] <= 0) continue;
      seen += 1;
      const PixelRay ray = camera.ray(double(i % 37), double(i / 37));
      farthest = std::max(farthest, glm::distance(ray.origin + double{picture.depth[i]} * ray.direction - translation, glm::dvec3(canonical[0], canonical[1], canonical[2])));
    }
    std::printf("  skinning %-8s %zu pixels, up to %.1e m off\n", to_string(kind), seen, farthest);
    EXPECT_GT(seen, 100u);
    EXPECT_LT(farthest, 2e-5);  // the search's tolerance of 1e-5 m, and float32 depths of 2 m
  }
}

// In every way of placing samples and finding their canonical points, numbers of pixels add up to those of the work.
TEST_F(PictureInspection, AddsUpToTheWorkAndChangesNothing) {
  const Avatar avatar = capsule_avatar(device, small_paper_spec());
  const Pose pose = bent_pose(avatar.body.skeleton);
  const Camera camera = capsule_camera(37, 41);
  struct Way {
    const char* quality;
    std::vector<std::pair<const char*, const char*>> knobs;
    bool searches;
  };
  const std::vector<Way> ways{{"paper", {}, true},
                              {"paper", {{"root_initialisations", "3"}}, true},
                              {"paper", {{"root_max_iterations", "2"}}, true},
                              {"paper", {{"root_max_iterations", "2"}, {"root_rescue_steps", "10"}}, true},
                              {"paper", {{"root_correspondence", "search_from_grid"}}, true},
                              {"paper", {{"sampling_mode", "surface"}, {"samples", "40"}}, true},
                              {"paper", {{"sampling_mode", "surface_only"}, {"samples", "1"}}, false},
                              {"balanced", {}, true},
                              {"fast", {{"root_correspondence", "grid_alone"}}, false},
                              {"preview", {}, false}};
  for (const Way& way : ways) {
    RenderSettings settings = inspected(avatar, way.quality);
    std::string name = way.quality;
    for (const auto& [knob, value] : way.knobs) set_render_knob(settings, knob, value), name += std::string(" ") + knob + "=" + value;
    Renderer renderer(device, avatar, settings);
    const Picture picture = renderer.render(camera, pose, 0);
    const Inspection& told = *picture.inspection;
    const RootFindingCounts counts = renderer.root_finder().counts();
    std::printf("  %-60s %llu samples, %llu wanted, %llu without a root, %llu shaded, %llu steps\n", name.c_str(), static_cast<unsigned long long>(total(told.placed)), static_cast<unsigned long long>(total(told.wanted)),
                static_cast<unsigned long long>(total(told.unfound)), static_cast<unsigned long long>(total(told.shaded)), static_cast<unsigned long long>(total(told.steps)));
    EXPECT_EQ(total(told.shaded), renderer.work().shaded) << name;
    EXPECT_LE(total(told.placed), renderer.work().samples) << name;
    EXPECT_GT(total(told.placed), 0u) << name;
    const bool on_surface = settings.sampling->mode == SamplingMode::surface_only;
    if (on_surface) {
      EXPECT_EQ(total(told.wanted), total(told.placed)) << name;
    } else {
      EXPECT_EQ(total(told.wanted) - total(told.unfound), counts.converged) << name;
    }
    EXPECT_EQ(total(told.steps), counts.steps) << name;
    EXPECT_EQ(total(told.steps) > 0, way.searches) << name;
    // What the grid cannot tell and is not searched, the finder does not count.
    if (settings.sampling->root.correspondence == Correspondence::grid_alone) {
      EXPECT_GT(total(told.unfound), 0u) << name;
    } else {
      EXPECT_EQ(total(told.unfound), counts.diverged + counts.exhausted) << name;
    }
    for (size_t i = 0; i < told.steps.size(); ++i) {
      EXPECT_LE(told.most_steps[i], told.steps[i]);
      EXPECT_LE(told.steps[i], told.most_steps[i] * told.wanted[i]);
      EXPECT_EQ(told.canonical[i][3] > 0, picture.alpha[i] > 0);
    }
    settings.inspect = false;
    Renderer plain(device, avatar, settings);
    const Picture same = plain.render(camera, pose, 0);
    EXPECT_FALSE(same.inspection);
    EXPECT_EQ(same.color, picture.color) << name;
    EXPECT_EQ(same.alpha, picture.alpha) << name;
    EXPECT_EQ(same.depth, picture.depth) << name;
  }
  // Few steps find fewer roots, and the rescue finds some of what is left; else the sums above were of zeros.
  const auto unfound = [&](const char* knob, const char* value) {
    RenderSettings settings = inspected(avatar, "paper");
    set_render_knob(settings, "root_max_iterations", "2");
    set_render_knob(settings, knob, value);
    Renderer renderer(device, avatar, settings);
    return total(renderer.render(camera, pose, 0).inspection->unfound);
  };
  const uint64_t without = unfound("root_rescue_steps", "0");
  EXPECT_GT(without, 0u);
  EXPECT_LT(unfound("root_rescue_steps", "10"), without);
}

TEST_F(PictureInspection, OfEveryFewthPixelRepeatsTheNearest) {
  const Avatar avatar = capsule_avatar(device, small_paper_spec());
  const Pose pose = bent_pose(avatar.body.skeleton);
  RenderSettings settings = inspected(avatar, "paper");
  set_render_knob(settings, "pixel_step", "3");
  const Picture large = Renderer(device, avatar, settings).render(capsule_camera(36, 42), pose, 0);
  set_render_knob(settings, "pixel_step", "1");
  const Picture small = Renderer(device, avatar, settings).render(capsule_camera(36, 42).scaled(12), pose, 0);
  ASSERT_EQ(large.inspection->placed.size(), 36u * 42u);
  for (size_t v = 0; v < 42; ++v)
    for (size_t u = 0; u < 36; ++u) {
      EXPECT_EQ(large.inspection->canonical[36 * v + u], small.inspection->canonical[12 * (v / 3) + u / 3]);
      EXPECT_EQ(large.inspection->steps[36 * v + u], small.inspection->steps[12 * (v / 3) + u / 3]);
    }
  EXPECT_EQ(total(large.inspection->shaded), 9 * total(small.inspection->shaded));
}

}  // namespace
}  // namespace arah

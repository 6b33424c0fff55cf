// Both ways of sampling rays show the same body, with every kind of skinning.
#include <gtest/gtest.h>

#include "host/input_error.h"
#include "host/rendering/renderer.h"
#include "tests/host/rendering/capsule_scene.h"

namespace arah {
namespace {

class SamplingModes : public DeviceTest {
 protected:
  Picture render(const Avatar& avatar, SamplingMode mode, bool normals = false, uint32_t samples = 64) {
    RenderSettings settings;
    settings.sampling.emplace();
    settings.sampling->mode = mode;
    settings.sampling->samples = samples;
    settings.normals = normals;
    Renderer renderer(device, avatar, settings);
    return renderer.render(capsule_camera(45, 53), bent_pose(avatar.body.skeleton), 0);
  }
};

struct Agreement {
  double overlap = 0;  // intersection over union of the silhouettes, Σ w > ½
  double depth = 0;    // mean difference in both, metres
  size_t pixels = 0;   // in both
};

Agreement compare(const char* what, const Picture& a, const Picture& b) {
  size_t both = 0, either = 0;
  double depth = 0;
  for (size_t i = 0; i < a.alpha.size(); ++i) {
    const bool in_a = a.alpha[i] > 0.5f, in_b = b.alpha[i] > 0.5f;
    both += in_a && in_b, either += in_a || in_b;
    if (in_a && in_b) depth += std::abs(a.depth[i] - b.depth[i]);
  }
  const Agreement result{double(both) / double(either), depth / double(both), both};
  std::printf("  %-50s overlap %.4f, depths differ by %.2f mm over %zu pixels\n", what, result.overlap, 1000 * result.depth, both);
  return result;
}

TEST_F(SamplingModes, ShowTheSameBody) {
  const Avatar avatar = capsule_avatar(device, small_paper_spec());
  const Picture shell = render(avatar, SamplingMode::shell), surface = render(avatar, SamplingMode::surface, true);
  const Agreement modes = compare("network, shell and surface", shell, surface);
  EXPECT_GT(modes.pixels, 300u);
  EXPECT_GT(modes.overlap, 0.98);
  EXPECT_LT(modes.depth, 0.004);  // the samples about the surface are 6.25 mm apart
  double colors = 0;
  for (size_t i = 0; i < shell.alpha.size(); ++i)
    if (shell.alpha[i] > 0.99f && surface.alpha[i] > 0.99f)
      for (size_t c = 0; c < 3; ++c) colors = std::max<double>(colors, std::abs(shell.color[3 * i + c] - surface.color[3 * i + c]));
  std::printf("  largest difference of a colour inside %.4f\n", colors);
  EXPECT_LT(colors, 0.05);
  // Normals of what is seen are of unit length and face the camera, which stands towards +z.
  for (size_t i = 0; i < surface.alpha.size(); ++i) {
    if (surface.alpha[i] < 0.99f) continue;
    const glm::vec3 n(surface.normal[3 * i], surface.normal[3 * i + 1], surface.normal[3 * i + 2]);
    EXPECT_GT(glm::length(n), 0.9f) << i;
    EXPECT_LT(glm::length(n), 1.01f) << i;
    EXPECT_GT(n.z, -0.2f) << i;
  }

  // Evenly over the box the same body is seen, the better the more samples.
  const Agreement coarse = compare("network, shell and 64 evenly", shell, render(avatar, SamplingMode::uniform));
  EXPECT_GT(coarse.overlap, 0.98);
  EXPECT_LT(coarse.depth, 0.004);
  const Agreement fine = compare("network, shell and 1,024 evenly", shell, render(avatar, SamplingMode::uniform, false, 1024));
  EXPECT_GT(fine.overlap, 0.98);
  EXPECT_LT(fine.depth, 0.001);
  EXPECT_LT(fine.depth, coarse.depth);

  // The template's own weights in the network's place move the body almost alike.
  AvatarSpec spec = avatar.spec;
  spec.skinning = {Skinning::template_weights, 0, 0};
  const Pose pose = bent_pose(avatar.body.skeleton);
  Avatar by_template = make_avatar(spec, avatar.body, {0, 7}, 5, &pose);
  for (const TensorSlot& slot : by_template.layout.slots) {
    const std::span<const float> from = avatar.tensor(slot.name);
    std::copy(from.begin(), from.end(), by_template.tensor(slot.name).begin());
  }
  const Picture template_shell = render(by_template, SamplingMode::shell, true), template_surface = render(by_template, SamplingMode::surface);
  const Agreement template_modes = compare("template weights, shell and surface", template_shell, template_surface);
  EXPECT_GT(template_modes.overlap, 0.98);
  EXPECT_LT(template_modes.depth, 0.004);
  const Agreement skinnings = compare("shell, network and template weights", shell, template_shell);
  EXPECT_GT(skinnings.overlap, 0.95);
  EXPECT_LT(skinnings.depth, 0.01);
}

// Each knob against the exact picture: what it leaves out is nothing, or as little as it says.
TEST_F(SamplingModes, KnobsCostWhatTheySay) {
  const Avatar avatar = capsule_avatar(device, small_paper_spec());
  const auto picture = [&](const char* mode, const std::vector<std::pair<std::string, std::string>>& knobs) {
    RenderSettings settings = render_preset(avatar, "paper");
    set_render_knob(settings, "sampling_mode", mode);
    set_render_knob(settings, "samples", "64");
    for (const auto& [name, value] : knobs) set_render_knob(settings, name, value);
    Renderer renderer(device, avatar, settings);
    return renderer.render(capsule_camera(45, 53), bent_pose(avatar.body.skeleton), 0);
  };
  struct Difference {
    double largest = 0, root_mean_square = 0;
  };
  const auto difference = [](const std::string& what, const Picture& a, const Picture& b) {
    Difference d;
    for (size_t i = 0; i < a.color.size(); ++i) {
      const double x = std::abs(a.color[i] - b.color[i]);
      d.largest = std::max(d.largest, x);
      d.root_mean_square += x * x;
    }
    d.root_mean_square = std::sqrt(d.root_mean_square / double(a.color.size()));
    std::printf("  %-50s colours differ by up to %.2e, %.2e in the mean of squares\n", what.c_str(), d.largest, d.root_mean_square);
    return d;
  };
  // Samples outside the shell add nothing. But some of them have no correspondence, and a sample that the search loses takes
  // its factor 1 + 1e-7 of the transmittance with it: at most 64 roundings of 1.2e-7.
  const Picture around = picture("surface", {});
  EXPECT_LE(difference("surface, without the shell's bound", around, picture("surface", {{"shell_bound", "false"}})).largest, 64 * 1.2e-7);
  // Another start ends at another place within the tolerance of 1e-5 m: two of these in b = 2 mm.
  EXPECT_LE(difference("surface, traced from the shell", around, picture("surface", {{"trace_start", "shell"}})).largest, 2e-5 / 2e-3);
  EXPECT_LE(difference("surface, traced to a millimetre", around, picture("surface", {{"trace_tolerance", "1e-3"}})).largest, 2e-5 / 2e-3);
  const Picture exact = picture("shell", {});
  EXPECT_LE(difference("shell, from the grid", exact, picture("shell", {{"root_correspondence", "search_from_grid"}})).root_mean_square, 2e-4);
  EXPECT_LE(difference("shell, the grid's answer", exact, picture("shell", {{"root_correspondence", "grid"}})).root_mean_square, 5e-3);
  EXPECT_LE(difference("shell, the grid alone", exact, picture("shell", {{"root_correspondence", "grid_alone"}})).root_mean_square, 2e-2);
  // At most 64 samples of this weight and a colour of at most 1 are missing.
  for (const char* weight : {"1e-5", "1e-3"})
    EXPECT_LE(difference(std::string("shell, least weight ") + weight, exact, picture("shell", {{"least_weight", weight}})).largest, 64 * std::stod(weight));
  EXPECT_LE(difference("shell, looser search", exact, picture("shell", {{"root_tolerance", "1e-4"}, {"root_max_iterations", "12"}})).root_mean_square, 2e-3);
  // b is 2 mm: an error of a tenth of a millimetre in the distance is one of a twentieth in the density.
  EXPECT_LE(difference("shell, baked distances", exact, picture("shell", {{"distances", "baked"}})).root_mean_square, 1e-2);
  EXPECT_LE(difference("shell, baked distances, finer", exact, picture("shell", {{"distances", "baked"}, {"bake_cell", "0.003"}})).root_mean_square, 3e-3);
  const Difference one = difference("shell, one colour group", exact, picture("shell", {{"color_groups", "1"}})),
                   many = difference("shell, eight colour groups", exact, picture("shell", {{"color_groups", "8"}}));
  EXPECT_LE(one.root_mean_square, 1e-2);
  EXPECT_LE(many.root_mean_square, one.root_mean_square);
  EXPECT_LE(difference("surface, from the mesh", around, picture("surface", {{"surface", "mesh"}})).root_mean_square, 5e-2);
  EXPECT_LE(difference("shell, every second pixel", exact, picture("shell", {{"pixel_step", "2"}})).root_mean_square, 0.1);

  RenderSettings settings = render_preset(avatar, "balanced");
  for (const auto& [name, value] : std::vector<std::pair<std::string, std::string>>{{"samples", "0"}, {"samples", "many"}, {"sampling_mode", "everywhere"}, {"shell_bound", "1"}, {"surface", "above"}, {"distances", "near"}, {"bake_cell", "0"}, {"outline", "-1"}, {"color_groups", "0.5"}, {"quality", "best"}})
    EXPECT_THROW(set_render_knob(settings, name, value), InputError) << name << " " << value;
  EXPECT_THROW(render_preset(avatar, "best"), InputError);
  set_render_knob(settings, "sampling_mode", "surface");
  set_render_knob(settings, "samples", "32");
  EXPECT_THROW(Renderer(device, avatar, settings), InputError) << "33 are the least around a surface";
  set_render_knob(settings, "sampling_mode", "surface_only");
  set_render_knob(settings, "samples", "2");
  EXPECT_THROW(Renderer(device, avatar, settings), InputError) << "a surface is one sample";
}

TEST_F(SamplingModes, FollowHowTheAvatarWasTrained) {
  Avatar avatar = make_avatar(small_paper_spec(), capsule_body(), {0}, 1);
  EXPECT_EQ(picture_sampling(avatar).mode, SamplingMode::shell);
  avatar.settings = settings_to_json(preset_settings("tiny"));
  EXPECT_EQ(picture_sampling(avatar).mode, SamplingMode::shell);
  EXPECT_EQ(picture_sampling(avatar).samples, 32u);
  avatar.settings = settings_to_json(preset_settings("paper"));
  EXPECT_EQ(picture_sampling(avatar).mode, SamplingMode::surface);
  EXPECT_EQ(picture_sampling(avatar).samples, 64u);
  TrainingSettings trained = preset_settings("tiny");
  trained.sampling.mode = SamplingMode::uniform;
  avatar.settings = settings_to_json(trained);
  EXPECT_EQ(picture_sampling(avatar).mode, SamplingMode::uniform);
  EXPECT_EQ(picture_sampling(avatar).samples, 64u);
  trained.rendering = Rendering::surface;
  avatar.settings = settings_to_json(trained);
  EXPECT_EQ(picture_sampling(avatar).mode, SamplingMode::surface_only) << "whatever sampling_mode says";
  EXPECT_EQ(picture_sampling(avatar).samples, 1u);
  EXPECT_EQ(picture_sampling(avatar).surface, SurfaceSource::search);
  for (const std::string& preset : render_presets()) EXPECT_EQ(render_preset(avatar, preset).sampling->mode, SamplingMode::surface_only) << preset;
}

TEST_F(SamplingModes, ShowABodyThatNeverMoves) {
  AvatarSpec spec = small_paper_spec();
  spec.skinning = {Skinning::none, 0, 0};
  const Avatar avatar = capsule_avatar(device, spec);
  const Picture shell = render(avatar, SamplingMode::shell, true), surface = render(avatar, SamplingMode::surface);
  const Agreement modes = compare("no skinning, shell and surface", shell, surface);
  EXPECT_GT(modes.pixels, 300u);
  EXPECT_GT(modes.overlap, 0.98);
  EXPECT_LT(modes.depth, 0.004);
}

// The preset `paper` leaves out weights of at most 1e-8, of 64 samples together 6.4e-7 of a colour; and how many samples are
// shaded together changes nothing.
TEST_F(SamplingModes, PaperIsExactToAMillionth) {
  const Avatar avatar = capsule_avatar(device, small_paper_spec());
  RenderSettings paper = render_preset(avatar, "paper");
  paper.sampling->mode = SamplingMode::surface;
  paper.sampling->samples = 64;
  const auto render = [&](double least_weight, uint64_t memory) {
    RenderSettings settings = paper;
    settings.least_weight = least_weight;
    settings.memory_bytes = memory;
    Renderer renderer(device, avatar, settings);
    const Picture picture = renderer.render(capsule_camera(45, 53), bent_pose(avatar.body.skeleton), 0);
    return std::pair{picture, renderer.work()};
  };
  const auto [all, all_work] = render(0, paper.memory_bytes);
  const auto [exact, exact_work] = render(paper.least_weight, paper.memory_bytes);
  const auto [small, small_work] = render(0, 1'000'000);  // 64 rays at a time: fewer samples than go into one batch
  float most = 0;
  for (size_t i = 0; i < all.color.size(); ++i) most = std::max(most, std::abs(all.color[i] - exact.color[i]));
  std::printf("  %llu of %llu samples shaded, colours differ by %.2g\n", static_cast<unsigned long long>(exact_work.shaded), static_cast<unsigned long long>(all_work.shaded), double(most));
  EXPECT_LE(most, 1e-6f);
  EXPECT_LT(exact_work.shaded, all_work.shaded);
  EXPECT_EQ(small_work.shaded, all_work.shaded);
  EXPECT_EQ(small.color, all.color);
  EXPECT_LE(all_work.rays, 1024u);    // one chunk …
  EXPECT_GT(all_work.shaded, 8192u);  // … shaded in two batches
}

}  // namespace
}  // namespace arah

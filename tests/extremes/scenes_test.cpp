// Whole scenes at the ends of what can be asked for: bodies, cameras, pictures, masks, and captures of one of everything.
#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <opencv2/imgcodecs.hpp>

#include "host/input_error.h"
#include "host/rendering/renderer.h"
#include "host/training/trainer.h"
#include "kernels/reference/hierarchical_softmax.h"
#include "kernels/reference/lbs.h"
#include "kernels/skinning/joint_tree.h"
#include "kernels/skinning/lbs.h"
#include "kernels/skinning/lbs_backward.h"
#include "tests/extremes/extremes.h"
#include "tests/host/rendering/capsule_scene.h"
#include "tests/host/training/training_scene.h"
#include "tests/kernels/composited.h"
#include "tests/kernels/skinning_scene.h"

namespace arah {
namespace {

using namespace extremes;

double mean_difference(const std::vector<float>& a, const std::vector<float>& b) {
  double sum = a.size() == b.size() && !a.empty() ? 0 : std::nan("");
  for (size_t i = 0; i < std::min(a.size(), b.size()); ++i) sum += std::abs(double{a[i]} - double{b[i]});
  return sum / static_cast<double>(a.size());
}
bool is_finite(const Picture& picture) {
  const auto finite = [](const std::vector<float>& values) { return std::all_of(values.begin(), values.end(), [](float value) { return std::isfinite(value); }); };
  return !picture.color.empty() && finite(picture.color) && finite(picture.alpha) && finite(picture.depth);
}

class SceneExtremes : public CompositingTest {
 protected:
  const Avatar& capsule() {
    static const Avatar avatar = capsule_avatar(device, small_paper_spec());
    return avatar;
  }
  Picture render(const Camera& camera, const char* mode) {
    RenderSettings settings = render_preset(capsule(), "paper");
    set_render_knob(settings, "sampling_mode", mode);
    set_render_knob(settings, "samples", "64");
    return Renderer(device, capsule(), settings).render(camera, bent_pose(capsule().body.skeleton), 0);
  }
  // In front of the pose, with a focal length that keeps the body as large in the picture.
  static Camera from(double distance, int pixels) {
    Camera camera = capsule_camera(pixels, pixels);
    camera.K[0][0] = camera.K[1][1] = 1.55 * pixels * distance / 2;
    camera.T = -(camera.R * glm::dvec3(0.35, 0.55, 0.4 + distance));
    return camera;
  }
};

// What is set in metres for people fits neither.
TEST_F(SceneExtremes, BodiesOfAMillimetreAndAKilometre) {
  for (const auto& [factor, name, found, unit] : {std::tuple{1.25e-3, "1 mm", "one of 0.001 m", "kilometres: multiply them by 1000"}, {1250.0, "1 km", "one of 1e+03 m", "millimetres: multiply them by 0.001"}}) {
    BodyTemplate body = capsule_body();
    for (glm::vec3& vertex : body.vertices) vertex *= static_cast<float>(factor);
    for (glm::dvec3& joint : body.skeleton.rest_joints) joint *= factor;
    expect_error<InputError>(Row::sizes, Way::forward, fmt::format("an avatar of a body of {}", name), {"template", "a body of 0.05 to 5 m", found, unit}, [&] { make_avatar(small_paper_spec(), body, {0}, 3); });
    // The kernels know no such bounds.
    const uint32_t rows = 65, padded = padded_points(rows);
    const JointTree tree(smpl_tree());
    const reference::JointTree truth_tree(smpl_tree());
    std::vector<double> bones = random_bones(generator, 24, 1.5), x, g, logits;
    for (size_t j = 0; j < 24; ++j)
      for (size_t i = 0; i < 3; ++i) bones[16 * j + 4 * i + 3] = static_cast<float>(bones[16 * j + 4 * i + 3] * factor);
    for (const float value : uniform(3 * rows)) x.push_back(static_cast<float>(value * factor));
    for (const float value : uniform(3 * rows)) g.push_back(value);
    for (const float value : uniform(25 * rows, -0.2, 0.2)) logits.push_back(value);
    const std::vector<FrameConstants> constants = {frame_constants({}, bones)};
    Buffer frame = filled("frame", constants), logit_rows = filled("logits", padded_rows(logits, 25, 32)), canonical = filled("canonical", padded_rows(x, 3, 4)), cotangents = filled("cotangents", padded_rows(g, 3, 4)), posed = empty("posed", padded * 16ull),
           transforms = empty("transforms", padded * 48ull), weights = empty("weights", padded * 96ull), d_logits = empty("d logits", padded * 128ull), d_canonical = empty("d canonical", padded * 16ull);
    const Rows over{{rows, {}}, {}};
    record_lbs(commands, {&tree, over, {logit_rows.slice(), 32, 0}, frame.slice(), canonical.slice(), posed.slice(), transforms.slice(), {weights.slice(), 24, 0}});
    record_lbs_backward(commands, {&tree, over, {logit_rows.slice(), 32, 0}, frame.slice(), canonical.slice(), cotangents.slice(), 3, {d_logits.slice(), 32, 0}, d_canonical.slice()});
    commands.submit_and_wait();
    std::vector<double> scaled = logits;
    for (double& value : scaled) value *= 20;
    const std::vector<double> w = reference::hierarchical_softmax_forward(truth_tree, rows, scaled);
    std::vector<double> truth = reference::hierarchical_softmax_backward(truth_tree, rows, scaled, reference::lbs_backward(rows, w, bones, x, g, {}).weights);
    for (double& value : truth) value *= 20;
    expect_within(Row::sizes, Way::forward, fmt::format("linear blend skinning of points of a body of {}", name), "error of posed points / size", largest_error(rows_of(device.download<float>(posed.slice()), rows, 3, 4), reference::lbs_forward(rows, w, bones, x), factor), 1e-6);
    expect_within(Row::sizes, Way::backward, fmt::format("linear blend skinning of points of a body of {}", name), "error of dL/dlogits, of the largest", error_of_largest(rows_of(device.download<float>(d_logits.slice()), rows, 25, 32), truth), 1e-5);
  }
}

TEST_F(SceneExtremes, CamerasAtACentimetreAndTenKilometres) {
  for (const char* const mode : {"shell", "surface", "uniform"}) {
    const Picture near = render(from(0.01, 24), mode), at_1km = render(from(1000, 24), mode), at_10km = render(from(1e4, 24), mode);
    double covered = 0;
    for (const float alpha : near.alpha) covered += double{alpha} / static_cast<double>(near.alpha.size());
    expect_that(Row::sizes, Way::forward, fmt::format("a camera 1 cm before the body, samples by {}", mode), "finite, the body all over the picture", is_finite(near) && covered > 0.8);
    // Seen from so far both are parallel projections.
    expect_within(Row::sizes, Way::forward, fmt::format("a camera at 10 km, samples by {}", mode), "mean difference of colours from those at 1 km", is_finite(at_10km) ? mean_difference(at_10km.color, at_1km.color) : std::nan(""), 2e-4);
    expect_within(Row::sizes, Way::forward, fmt::format("a camera at 10 km, samples by {}", mode), "mean difference of Σ weights from those at 1 km", mean_difference(at_10km.alpha, at_1km.alpha), 2e-4);
  }
}

TEST_F(SceneExtremes, PicturesOfOnePixelAndEightThousand) {
  Camera one = capsule_camera(1, 1);
  one.K[0][0] = one.K[1][1] = 4;
  one.K[2][0] = one.K[2][1] = 0;
  const Picture pixel = render(one, "shell");
  expect_that(Row::images, Way::forward, "a picture of 1×1", "finite, the body in its one pixel", pixel.color.size() == 3 && is_finite(pixel) && pixel.alpha[0] > 0.9f);
  // One row of 8192 pixels through the body, against the same row of 256.
  const auto row = [](int width) {
    Camera camera = capsule_camera(width, 1);
    camera.K[0][0] = camera.K[1][1] = width;
    camera.K[2][0] = 0.5 * width - 0.5;
    camera.K[2][1] = 0;
    return camera;
  };
  const Picture wide = render(row(8192), "shell"), narrow = render(row(256), "shell");
  double covered_wide = 0, covered_narrow = 0;
  for (const float alpha : wide.alpha) covered_wide += double{alpha} / 8192;
  for (const float alpha : narrow.alpha) covered_narrow += double{alpha} / 256;
  expect_that(Row::images, Way::forward, "a picture of 8192×1", "finite, 8192 pixels", is_finite(wide) && wide.alpha.size() == 8192);
  expect_within(Row::images, Way::forward, "a picture of 8192×1: share of it that the body covers", "difference from a picture of 256×1", covered_narrow > 0.05 ? std::abs(covered_wide - covered_narrow) : std::nan(""), 1.0 / 256);
  for (const uint32_t rays : {1u, 8192u}) {
    const SampleBatch batch = random_batch(rays, 8, 0.01F);
    const CompositedBatch found = run(batch, false, 0), truth = composited_truth(batch, false);
    expect_within(Row::images, Way::backward, fmt::format("compositing of {} pixels: dL/dsdf", rays), "error, of the largest", error_of_largest(found.d_sdf, truth.d_sdf), 1e-5);
    double size = 0;
    for (const double value : truth.d_sdf) size += std::abs(value);
    expect_within(Row::images, Way::backward, fmt::format("compositing of {} pixels: dL/db, summed over them", rays), "error / Σ |dL/dsdf|", std::abs(found.d_parameter - truth.d_parameter) / std::max(size, 1.0), 4e-5);
  }
}

// Small synthetic captures, changed on disk.
class CaptureExtremes : public DeviceTest {
 protected:
  struct Folder {
    std::filesystem::path path = std::filesystem::temp_directory_path() / fmt::format("arah_extremes_{}", getpid());
    ~Folder() { std::filesystem::remove_all(path); }
  };
  // alpha: of every training pixel, on 8 bits; −1: as they are.
  Capture capture(const std::string& name, int frames, int alpha) {
    static const Folder folder;
    const std::filesystem::path path = folder.path / name;
    write_synthetic_capture(path, {{}, frames, 48, 5});
    if (alpha >= 0)
      for (const auto& entry : std::filesystem::recursive_directory_iterator(path / "images" / "train")) {
        if (entry.path().extension() != ".png") continue;
        cv::Mat picture = cv::imread(entry.path().string(), cv::IMREAD_UNCHANGED);
        for (int v = 0; v < picture.rows; ++v)
          for (int u = 0; u < picture.cols; ++u) picture.at<cv::Vec4b>(v, u)[3] = static_cast<uchar>(alpha);
        cv::imwrite(entry.path().string(), picture);
      }
    return open_capture(path);
  }
  struct Trained {
    double first_alpha = 0, last_alpha = 0, first_color = 0, last_color = 0;  // means of 8 steps
    bool finite = true, moved = false;
    double found = 0;  // share of the correspondences
  };
  Trained train(const Capture& capture) {
    constexpr int steps = 48;
    Avatar avatar = make_avatar(small_spec(), capture, 3);
    TrainingSettings settings = small_settings();
    settings.sdf.freeze = 0;
    settings.color = {.rate = 1e-2};
    fit_template(device, avatar, settings);
    Trainer trainer(device, capture, avatar, settings);
    Trained trained;
    for (int i = 0; i < steps; ++i) {
      const StepReport report = trainer.step(static_cast<uint64_t>(steps - i));
      trained.finite = trained.finite && std::isfinite(report.total) && std::isfinite(report.sdf_norm);
      trained.found += report.converged / steps;
      if (i < 8) trained.first_alpha += report.alpha / 8, trained.first_color += report.color / 8;
      if (i >= steps - 8) trained.last_alpha += report.alpha / 8, trained.last_color += report.color / 8;
    }
    const Avatar after = trainer.avatar();
    check_finite(after);
    trained.moved = after.parameters != avatar.parameters;
    std::printf("  alpha loss %.3f to %.3f, colour loss %.3f to %.3f, %.3f of correspondences\n", trained.first_alpha, trained.last_alpha, trained.first_color, trained.last_color, trained.found);
    return trained;
  }
};

TEST_F(CaptureExtremes, MasksThatAreBlackOrForegroundThroughout) {
  for (const auto& [alpha, name] : {std::pair{0, "all masks black"}, {255, "all masks foreground"}}) {
    const Trained trained = train(capture(name, 2, alpha));
    expect_that(Row::masks, Way::forward, fmt::format("a capture with {}: 48 steps of training", name), "finite losses, four of five correspondences found and more", trained.finite && trained.found > 0.8);
    expect_that(Row::masks, Way::backward, fmt::format("a capture with {}: 48 steps of training", name), "finite parameters that moved, a lower mask loss", trained.moved && trained.last_alpha < trained.first_alpha);
  }
}

TEST_F(CaptureExtremes, OneFrameOfOneCamera) {
  Capture one = capture("one", 1, -1);
  bool first = true;
  for (Camera& camera : one.cameras) {
    if (camera.role == "train" && !first) camera.role = "test";
    if (camera.role == "train") first = false;
  }
  const Trained trained = train(one);
  expect_that(Row::counts, Way::forward, "one frame of one camera: 48 steps of training", "finite losses, four of five correspondences found and more", trained.finite && trained.found > 0.8);
  expect_that(Row::counts, Way::backward, "one frame of one camera: 48 steps of training", "finite parameters that moved, a lower colour loss", trained.moved && trained.last_color < trained.first_color);
  for (Camera& camera : one.cameras) camera.role = "test";
  expect_error<InputError>(Row::counts, Way::forward, "no camera to train by", {"images/train", "a training camera", "none"}, [&] { train(one); });
}

// Cameras moved back along their axes, their focal lengths with them.
TEST_F(CaptureExtremes, TrainedFromTenKilometres) {
  Capture far = capture("far", 2, -1);
  for (Camera& camera : far.cameras) {
    const double distance = glm::length(camera.center() - glm::dvec3(0, 1, 0)), factor = 1e4 / distance;
    camera.T.z += 1e4 - distance;
    camera.K[0][0] *= factor, camera.K[1][1] *= factor;
  }
  const Trained trained = train(far);
  expect_that(Row::sizes, Way::backward, "cameras at 10 km: 48 steps of training", "finite parameters that moved, a lower colour loss", trained.finite && trained.moved && trained.last_color < trained.first_color);
}

}  // namespace
}  // namespace arah

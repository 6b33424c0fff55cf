#include "viewer/picture_worker.h"

#include <gtest/gtest.h>

#include <chrono>
#include <thread>

#include "host/input_error.h"
#include "tests/host/rendering/capsule_scene.h"

namespace arah {
namespace {

class PictureWorkerTest : public DeviceTest {
 protected:
  static const std::shared_ptr<const Avatar>& capsule() {
    static const auto avatar = std::make_shared<const Avatar>(capsule_avatar(test_device(), small_paper_spec()));
    return avatar;
  }
  static PictureOrder order(int width = 45, int height = 53) {
    PictureOrder order;
    order.camera = capsule_camera(width, height);
    order.pose = bent_pose(capsule()->body.skeleton);
    return order;
  }
  // The next picture for which `wanted` holds.
  template <typename Wanted>
  static DrawnPicture next(PictureWorker& worker, const Wanted& wanted) {
    const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(120);
    while (std::chrono::steady_clock::now() < end) {
      if (std::optional<DrawnPicture> drawn = worker.take(); drawn && wanted(*drawn)) return *drawn;
      std::this_thread::sleep_for(std::chrono::milliseconds(2));
    }
    throw std::runtime_error("no such picture in two minutes");
  }
  static Picture rendered(const PictureOrder& order, const Avatar& avatar, const std::string& preset) { return Renderer(test_device(), avatar, render_preset(avatar, preset)).render(order.camera, order.pose, order.latent_row); }
};

TEST_F(PictureWorkerTest, EndsWithWhatTheRendererDraws) {
  for (const std::string preset : {"balanced", "paper"}) {
    PictureOrder wanted = order();
    wanted.finest = preset;
    DrawnPicture drawn;
    {
      PictureWorker worker(test_device(), capsule(), 0.05, {});
      const uint64_t number = worker.order(wanted);
      drawn = next(worker, [&](const DrawnPicture& d) { return d.order == number && d.finest; });
    }
    EXPECT_EQ(drawn.quality, (Quality{preset, 1}));
    const Picture expected = rendered(wanted, *capsule(), preset);
    EXPECT_EQ(drawn.picture->color, expected.color) << preset;
    EXPECT_EQ(drawn.picture->alpha, expected.alpha);
    EXPECT_EQ(drawn.picture->depth, expected.depth);
  }
}

TEST_F(PictureWorkerTest, TheNewestOrderIsTheOneThatIsRefined) {
  PictureWorker worker(test_device(), capsule(), 0.05, {});
  PictureOrder wanted = order(160, 180);
  wanted.finest = "paper";
  worker.order(wanted);
  next(worker, [](const DrawnPicture& d) { return d.quality.pixel_step == 1; });  // it is being refined
  wanted.camera = capsule_camera(30, 40);
  const uint64_t number = worker.order(wanted);
  const DrawnPicture drawn = next(worker, [](const DrawnPicture& d) { return d.finest; });
  EXPECT_EQ(drawn.order, number) << "the first order was refined to its end";
  EXPECT_EQ(drawn.picture->width, 30);
}

TEST_F(PictureWorkerTest, PartsHaveTheFinerRowsAboveTheCoarser) {
  PictureWorker worker(test_device(), capsule(), 0.05, {});
  PictureOrder wanted = order(200, 240);
  wanted.finest = "paper";
  worker.order(wanted);
  std::optional<DrawnPicture> part, whole;
  while (!whole) {
    const DrawnPicture drawn = next(worker, [](const DrawnPicture& d) { return d.quality == Quality{"paper", 1}; });
    if (drawn.part < 1) part = drawn;
    else whole = drawn;
  }
  ASSERT_TRUE(part) << "a picture that takes this long is shown while it is made";
  const auto rows = static_cast<size_t>(std::lround(part->part * 240));
  EXPECT_GT(rows, 0u);
  EXPECT_TRUE(std::equal(part->picture->color.begin(), part->picture->color.begin() + static_cast<std::ptrdiff_t>(3 * 200 * rows), whole->picture->color.begin()));
  EXPECT_NE(part->picture->color, whole->picture->color);
}

// Of every second pixel the rows so far are of another size than the coarser picture: they are not laid over it.
TEST_F(PictureWorkerTest, FewerPixelsAreNotMixedIntoWholePictures) {
  PictureWorker worker(test_device(), capsule(), 0.05, {});
  PictureOrder wanted = order(400, 480);
  wanted.layer = PictureLayer::samples;
  wanted.finest = "paper";
  wanted.knobs = {{"pixel_step", "2"}};
  worker.order(wanted);
  const DrawnPicture drawn = next(worker, [](const DrawnPicture& d) { return d.quality == Quality{"paper", 1}; });
  EXPECT_EQ(drawn.part, 1);
  EXPECT_TRUE(drawn.finest);
  ASSERT_TRUE(drawn.picture->inspection);
  EXPECT_EQ(drawn.picture->inspection->placed.size(), 400u * 480u);
}

TEST_F(PictureWorkerTest, ComparesWithTheExactPicture) {
  PictureWorker worker(test_device(), capsule(), 0.05, {});
  PictureOrder wanted = order();
  wanted.finest = "preview";
  wanted.compare_with_exact = true;
  worker.order(wanted);
  const DrawnPicture coarse = next(worker, [](const DrawnPicture& d) { return d.exact.has_value(); });
  EXPECT_GT(coarse.exact->psnr, 10);
  EXPECT_LT(coarse.exact->psnr, 60);
  wanted.finest = "paper";
  worker.order(wanted);
  EXPECT_EQ(next(worker, [](const DrawnPicture& d) { return d.exact.has_value(); }).exact->psnr, std::numeric_limits<double>::infinity());
}

TEST_F(PictureWorkerTest, KnobsThatDoNotGoTogetherAreToldAndTheNextOrderIsDrawn) {
  PictureWorker worker(test_device(), capsule(), 0.05, {});
  PictureOrder wanted = order();
  wanted.finest = "balanced";
  wanted.knobs = {{"sampling_mode", "surface_only"}, {"samples", "7"}};
  worker.order(wanted);
  EXPECT_THROW(next(worker, [](const DrawnPicture& d) { return d.finest; }), InputError);
  wanted.knobs.clear();
  const uint64_t number = worker.order(wanted);
  EXPECT_EQ(next(worker, [](const DrawnPicture& d) { return d.finest; }).order, number);
}

TEST_F(PictureWorkerTest, ANewCheckpointIsDrawnWithoutANewOrder) {
  PictureWorker worker(test_device(), capsule(), 0.05, {});
  PictureOrder wanted = order();
  wanted.finest = "preview";
  worker.order(wanted);
  const DrawnPicture before = next(worker, [](const DrawnPicture& d) { return d.finest; });
  auto other = std::make_shared<Avatar>(*capsule());
  other->steps = 77;
  for (const TensorSlot& slot : other->layout.slots)
    if (slot.name.starts_with("color."))
      for (float& number : other->tensor(slot.name)) number *= -2;
  worker.set_avatar(other);
  const DrawnPicture after = next(worker, [](const DrawnPicture& d) { return d.finest && d.avatar->steps == 77; });
  EXPECT_NE(before.picture->color, after.picture->color);
}

TEST_F(PictureWorkerTest, JobsRunBetweenPicturesAndCanBeStopped) {
  PictureWorker worker(test_device(), capsule(), 0.05, {});
  PictureOrder wanted = order();
  wanted.finest = "preview";
  worker.order(wanted);
  worker.start({"count", [](Device&, const Avatar& avatar, const std::function<bool(double)>& progress) {
                  progress(0.5);
                  return std::to_string(avatar.body.skeleton.size());
                }});
  const auto wait = [&] {
    const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(60);
    while (worker.job().running && std::chrono::steady_clock::now() < end) std::this_thread::sleep_for(std::chrono::milliseconds(2));
    return worker.job();
  };
  EXPECT_EQ(wait().outcome, "3");
  worker.start({"endless", [](Device&, const Avatar&, const std::function<bool(double)>& progress) -> std::string {
                  while (progress(0.1)) std::this_thread::sleep_for(std::chrono::milliseconds(1));
                  throw std::runtime_error("given up");
                }});
  worker.stop_job();
  EXPECT_EQ(wait().outcome, "endless: given up");
  next(worker, [](const DrawnPicture& d) { return d.finest; });
}

}  // namespace
}  // namespace arah

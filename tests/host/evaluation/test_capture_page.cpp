#include "host/evaluation/capture_page.h"

#include <opencv2/imgcodecs.hpp>
#include <regex>

#include "host/evaluation/scene_plan.h"
#include "tests/host/capture/small_capture.h"

namespace arah {
namespace {

using testing::HasSubstr;
using testing::Not;

std::size_t count_of(const std::string& text, const std::string& part) {
  std::size_t count = 0;
  for (std::size_t at = text.find(part); at != text.npos; at = text.find(part, at + 1)) ++count;
  return count;
}

// Where the plan's dots for cameras are, in order.
std::vector<glm::dvec2> camera_dots(const std::string& svg) {
  static const std::regex dot("<circle cx=\"([0-9.]+)\" cy=\"([0-9.]+)\" r=\"4\" fill=\"#[0-9a-f]+\"><title>");
  std::vector<glm::dvec2> places;
  for (std::sregex_iterator match(svg.begin(), svg.end(), dot), end; match != end; ++match) places.emplace_back(std::stod((*match)[1]), std::stod((*match)[2]));
  return places;
}

TEST(ScenePlan, IsToScaleInBothDirections) {
  const SmallCapture made;
  Capture capture = open_capture(made.folder.path());
  const glm::dvec3 at[3] = {{0, 0, 1}, {3, 0, 1}, {0, 2, 2.5}};
  capture.cameras.resize(3, capture.cameras[0]);
  for (int c = 0; c < 3; ++c) capture.cameras[static_cast<std::size_t>(c)].T = -(capture.cameras[0].R * at[c]);
  capture.cameras[2].name = "<third>";
  const std::string above = scene_plan_svg(capture, PlanView::above), front = scene_plan_svg(capture, PlanView::front);
  EXPECT_THAT(above, testing::AllOf(HasSubstr("x (m)"), HasSubstr("y (m)"), HasSubstr("&lt;third&gt;"), Not(HasSubstr("<third>")), HasSubstr("root over the frames of train")));
  EXPECT_THAT(front, HasSubstr("z (m)"));
  const std::vector<glm::dvec2> plan = camera_dots(above), elevation = camera_dots(front);
  ASSERT_EQ(plan.size(), 3u);
  ASSERT_EQ(elevation.size(), 3u);
  const double metre = (plan[1].x - plan[0].x) / 3.0, upright = (elevation[1].x - elevation[0].x) / 3.0;
  EXPECT_GT(metre, 20.0);
  EXPECT_NEAR((plan[0].y - plan[2].y) / 2.0, metre, 0.1);  // y goes up the page
  EXPECT_NEAR((elevation[0].y - elevation[2].y) / 1.5, upright, 0.1);
  capture.cameras[1].T *= 1e200;
  EXPECT_THAT(scene_plan_svg(capture, PlanView::above), HasSubstr("too far apart to be drawn"));
}

TEST(CapturePage, ShowsTheWorstFrameOfEachView) {
  const SmallCapture made;
  const Capture capture = open_capture(made.folder.path());
  const CaptureInspection found = examine_capture(capture);
  ASSERT_EQ(found.views.size(), 2u);
  const std::string page = capture_page(capture, found);
  EXPECT_EQ(count_of(page, "data:image/png;base64,"), 2u);
  EXPECT_EQ(count_of(page, "<svg"), 2u);
  EXPECT_THAT(page, testing::AllOf(HasSubstr("What looks wrong"), HasSubstr("<li>train: frames without a picture: 9</li>"), HasSubstr("left, frame "), HasSubstr("Split train")));
  EXPECT_THAT(page, testing::AllOf(Not(HasSubstr("<script")), Not(HasSubstr("src=\"http")), Not(HasSubstr("href="))));
  CaptureInspection good = found;
  good.report = "fine\n";
  EXPECT_THAT(capture_page(capture, good), HasSubstr("Nothing looks wrong."));

  // A picture that cannot be read is left out, the other stays.
  made.folder.write("images/train/right/000003.png", "no picture");
  made.folder.write("images/train/right/000004.png", "no picture");
  const CaptureInspection damaged = examine_capture(capture);
  const std::string rest = capture_page(capture, damaged);
  EXPECT_EQ(count_of(rest, "data:image/png;base64,"), 1u);
  EXPECT_THAT(rest, HasSubstr("expected a PNG picture"));
}

TEST(CapturePage, DrawsTemplateAndMaskOverThePhotograph) {
  const SmallCapture made;
  const Capture capture = open_capture(made.folder.path());
  const CaptureInspection found = examine_capture(capture);
  const cv::Mat picture = cv::imdecode(fit_picture(capture, found.views[0]), cv::IMREAD_COLOR);
  ASSERT_EQ(picture.cols, 480);  // 40 columns, twelve times
  ASSERT_EQ(picture.rows, 360);
  int cyan = 0, orange = 0, widest = 0;
  for (int y = 0; y < picture.rows; ++y) {
    int first = -1, last = -1;
    for (int x = 0; x < picture.cols; ++x) {
      const cv::Vec3b& pixel = picture.at<cv::Vec3b>(y, x);
      if (pixel == cv::Vec3b(242, 242, 0)) ++cyan;
      if (pixel != cv::Vec3b(0, 153, 255)) continue;
      ++orange;
      if (first < 0) first = x;
      last = x;
    }
    widest = std::max(widest, last - first);
  }
  const PixelMask box = projected_box_mask(capture.cameras[0], posed_vertices(capture.body_template, find_frame(motion_of(capture, "train"), found.views[0].frame)->pose));
  int columns = 0;
  for (int u = 0; u < box.width; ++u) {
    bool any = false;
    for (int v = 0; v < box.height; ++v) any = any || box.inside[static_cast<std::size_t>(v * box.width + u)] != 0;
    columns += any ? 1 : 0;
  }
  EXPECT_EQ(widest, 12 * columns);
  EXPECT_GT(cyan, 100);
  EXPECT_GT(orange, 100);
}

}  // namespace
}  // namespace arah

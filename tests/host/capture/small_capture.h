// A capture of a tetrahedron by two cameras, in a temporary folder, for tests to spoil.
#pragma once

#include <glm/geometric.hpp>
#include <opencv2/imgcodecs.hpp>

#include "host/capture/capture.h"
#include "tests/host/body/rigs.h"

namespace arah {

// Looks along world −z from (0.1, 1.1, 2): x right, y down.
inline Camera front_camera(const std::string& name, int width, int height) {
  Camera camera;
  camera.name = name;
  camera.width = width;
  camera.height = height;
  camera.K = {61.0, 0.0, 0.0, 0.0, 60.0, 0.0, 0.5 * width - 1.7, 0.5 * height + 0.3, 1.0};
  camera.R = {1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, -1.0};
  camera.T = -(camera.R * glm::dvec3(0.1, 1.1, 2.0));
  return camera;
}

// A camera in general position, turned and skewed.
inline Camera odd_camera() {
  Camera camera = front_camera("odd", 37, 23);
  camera.K[1][0] = 0.7;
  camera.R = rotation_from_axis_angle({2.9, 0.3, -0.4});
  camera.T = {0.1, 0.9, 2.4};
  return camera;
}

inline void write_picture(const std::filesystem::path& path, const cv::Mat& bgra) {
  std::filesystem::create_directories(path.parent_path());
  ASSERT_TRUE(cv::imwrite(path.string(), bgra));
}

// Cameras "left" (train, 40×30) and "right" (test, 37×23); frames 3, 4 and 9 of split "train", frame 9 without
// pictures. The pictures show the region of the body's box in one colour.
class SmallCapture {
 public:
  SmallCapture() {
    cameras = {front_camera("left", 40, 30), front_camera("right", 37, 23)};
    cameras[1].role = "test";
    write_cameras(folder / "cameras.json", cameras);
    body = tetrahedron(3);
    write_body_template(folder / "template.glb", body);
    motion.split = "train";
    motion.skeleton = body.skeleton;
    for (int number : {3, 4, 9}) {
      Pose pose = rest_pose(body.skeleton);
      pose.root_position.x += 0.01 * number;
      motion.frames.push_back({number, pose, ""});
    }
    write_motion(folder / "motion_train.json", motion);
    for (const Camera& camera : cameras) {
      for (std::size_t f = 0; f < 2; ++f) {
        const PixelMask mask = projected_box_mask(camera, posed_vertices(body, motion.frames[f].pose));
        cv::Mat picture(camera.height, camera.width, CV_8UC4, cv::Scalar(0, 0, 0, 0));
        for (int v = 0; v < camera.height; ++v) {
          for (int u = 0; u < camera.width; ++u) {
            if (mask.inside[static_cast<std::size_t>(v * camera.width + u)] != 0) {
              picture.at<cv::Vec4b>(v, u) = cv::Vec4b(30, 20, 10, 255);
            }
          }
        }
        write_picture(picture_path(camera.name, motion.frames[f].number), picture);
      }
    }
  }

  std::filesystem::path picture_path(const std::string& camera, int frame) const {
    return folder.path() / "images" / "train" / camera / fmt::format("{:06}.png", frame);
  }

  TemporaryFolder folder;
  std::vector<Camera> cameras;
  BodyTemplate body;
  Motion motion;
};

}  // namespace arah

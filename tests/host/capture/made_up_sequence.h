// A sequence in the layout of ZJU-MoCap that a test makes up: two cameras, four frames, a person of one joint moved.
#pragma once

#include <glm/geometric.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "host/capture/dataset.h"
#include "host/capture/synthetic_figure.h"
#include "tests/host/body/python_files.h"
#include "tests/host/capture/small_capture.h"

namespace arah {

struct MadeUpSequence {
  // `old_names`: as the sequences 313 and 315 have them, "Camera (1)/CoreView_313_Camera_(1)_0001_….png".
  explicit MadeUpSequence(const std::string& name = "CoreView_7", bool old_names = false) : folder(root / name) {
    cameras = {front_camera("Camera_B1", 96, 80), front_camera("Camera_B2", 96, 80)};
    cameras[1].R = rotation_from_axis_angle({0.0, 0.3, 0.1}) * cameras[1].R;
    cameras[1].distortion = {-0.2, 0.05, 0.01, -0.005, 0.0};
    for (int f = 0; f < 4; ++f) {
      fits.push_back({std::vector<glm::dvec3>(24, glm::dvec3(0.0)), {0.3 + f, -1.1, 0.4}, {0.1, 0.2 * f, -0.3}, std::vector<double>(10, 0.0)});
      fits.back().poses[4] = {0.5, 0.1 * f, 0.0};
      fits.back().poses[18] = {0.0, -0.7, 0.2};
    }
    std::vector<std::string> ims;
    for (int f = 0; f < 4; ++f) {
      std::vector<std::string> paths;
      for (int c = 0; c < 2; ++c) {
        const std::string directory = old_names ? fmt::format("Camera ({})", c + 1) : cameras[static_cast<std::size_t>(c)].name;
        const std::string stem = old_names ? fmt::format("CoreView_313_Camera_({})_{:04}_2019-08-23", c + 1, f + 1) : fmt::format("{:06}", f);
        paths.push_back(directory + "/" + stem + ".png");
        write_picture(folder / paths.back(), photograph(cameras[static_cast<std::size_t>(c)], f));
        cv::Mat mask(80, 96, CV_8U, cv::Scalar(0));
        cv::rectangle(mask, cv::Rect(20, 10, 50, 60), cv::Scalar(3), cv::FILLED);  // a label of CIHP's
        cv::rectangle(mask, cv::Rect(40, 30, 10, 10), cv::Scalar(7), cv::FILLED);
        write_picture(folder / "mask_cihp" / paths.back(), mask);
      }
      std::vector<std::string> texts;
      for (const std::string& path : paths) texts.push_back(python::text(path));
      ims.push_back(python::dictionary({{"ims", python::list(texts)}}));
      write_fit(old_names ? f + 1 : f, fits[static_cast<std::size_t>(f)]);
    }
    std::vector<std::string> K, R, T, D;
    for (const Camera& camera : cameras) {
      K.push_back(python::array({3, 3}, rows(camera.K)));
      R.push_back(python::array({3, 3}, rows(camera.R)));
      T.push_back(python::array({3, 1}, {1000 * camera.T.x, 1000 * camera.T.y, 1000 * camera.T.z}));
      D.push_back(python::array({5, 1}, {camera.distortion.begin(), camera.distortion.end()}));
    }
    annotations = python::dictionary({{"cams", python::dictionary({{"K", python::list(K)}, {"R", python::list(R)}, {"T", python::list(T)}, {"D", python::list(D)}})},
                                      {"ims", python::list(ims)}});
    write("annots.npy", python::npy_of_value(annotations));
    body = make_clothed_figure(0).body;
    write_body_template(root / "body.glb", body);
  }

  static std::vector<double> rows(const glm::dmat3& matrix) {
    std::vector<double> numbers;
    for (int r = 0; r < 3; ++r)
      for (int c = 0; c < 3; ++c) numbers.push_back(matrix[c][r]);
    return numbers;
  }
  // Grey, with a red square about where the camera sees `mark`.
  static cv::Mat photograph(const Camera& camera, int frame) {
    cv::Mat picture(80, 96, CV_8UC3, cv::Scalar(90, 100, 110 + frame));
    const glm::dvec2 at = camera.distort(camera.project(mark));
    cv::rectangle(picture, cv::Rect(static_cast<int>(std::lround(at.x)) - 2, static_cast<int>(std::lround(at.y)) - 2, 5, 5), cv::Scalar(0, 0, 255), cv::FILLED);
    return picture;
  }
  void write(const std::string& name, const std::string& content) const { root.write(folder.filename().string() + "/" + name, content); }
  void write_fit(int number, const BodyFit& fit) const {
    std::vector<double> poses;
    for (const glm::dvec3& pose : fit.poses) poses.insert(poses.end(), {pose.x, pose.y, pose.z});
    write(fmt::format("new_params/{}.npy", number),
          python::npy_of_value(python::dictionary({{"poses", python::array({1, poses.size()}, poses)},
                                                   {"Rh", python::array({1, 3}, {fit.Rh.x, fit.Rh.y, fit.Rh.z})},
                                                   {"Th", python::array({1, 3}, {fit.Th.x, fit.Th.y, fit.Th.z})},
                                                   {"shapes", python::array({1, fit.shapes.size()}, fit.shapes)}})));
  }

  static inline const glm::dvec3 mark{0.25, 1.3, 0.1};
  TemporaryFolder root;
  std::filesystem::path folder;
  std::vector<Camera> cameras;
  std::vector<BodyFit> fits;
  std::string annotations;
  BodyTemplate body;
};

}  // namespace arah

// A sequence of People Snapshot that a test makes up, in files as the set has them: a camera, a person on the spot, five frames.
#pragma once

#include <hdf5.h>

#include <functional>
#include <opencv2/imgproc.hpp>
#include <opencv2/videoio.hpp>

#include "host/capture/dataset.h"
#include "host/capture/synthetic_figure.h"
#include "tests/host/body/python_files.h"
#include "tests/host/capture/small_capture.h"

namespace arah {

// LZF as its packers write it: what is there already is repeated, all else follows as it is.
inline std::string packed_lzf(const std::string& plain) {
  std::string packed, literal;
  const auto flush = [&] {
    for (std::size_t at = 0; at < literal.size(); at += 32) {
      const std::string some = literal.substr(at, 32);
      packed += static_cast<char>(some.size() - 1) + some;
    }
    literal.clear();
  };
  for (std::size_t at = 0; at < plain.size();) {
    std::size_t longest = 0, back = 0;
    for (const std::size_t distance : {std::size_t{1}, std::size_t{48}, std::size_t{1920}}) {  // a byte, a row and a plane ago
      std::size_t count = 0;
      while (distance <= at && count < 264 && at + count < plain.size() && plain[at + count] == plain[at + count - distance]) ++count;
      if (count > longest) longest = count, back = distance - 1;
    }
    if (longest < 3) {
      literal += plain[at++];
      continue;
    }
    flush();
    packed += static_cast<char>(std::min<std::size_t>(longest - 2, 7) << 5 | back >> 8);
    if (longest >= 9) packed += static_cast<char>(longest - 9);
    packed += static_cast<char>(back & 255);
    at += longest;
  }
  flush();
  return packed;
}

enum class Hdf5Packing { plain, deflate, lzf };

// An HDF5 file that is closed with this.
class Hdf5Writer {
 public:
  explicit Hdf5Writer(const std::filesystem::path& path) : file_(H5Fcreate(path.c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT)) { EXPECT_GE(file_, 0); }
  ~Hdf5Writer() { H5Fclose(file_); }
  Hdf5Writer(const Hdf5Writer&) = delete;
  Hdf5Writer& operator=(const Hdf5Writer&) = delete;
  hid_t id() const { return file_; }

  void write(const char* name, hid_t type, const std::vector<hsize_t>& shape, hid_t memory, const void* values) const {
    const hid_t space = H5Screate_simple(static_cast<int>(shape.size()), shape.data(), nullptr);
    const hid_t data = H5Dcreate2(file_, name, type, space, H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT);
    EXPECT_GE(H5Dwrite(data, memory, H5S_ALL, H5S_ALL, H5P_DEFAULT, values), 0);
    H5Dclose(data);
    H5Sclose(space);
  }
  // float32, as the set's poses are.
  void write(const char* name, const std::vector<hsize_t>& shape, const std::vector<double>& values) const {
    write(name, H5T_IEEE_F32LE, shape, H5T_NATIVE_DOUBLE, values.data());
  }
  // The same in one chunk for every two rows, compressed by LZF, as they are published.
  void write_packed(const char* name, const std::vector<hsize_t>& shape, const std::vector<double>& values) const {
    std::vector<hsize_t> chunk = shape;
    chunk[0] = std::min<hsize_t>(2, chunk[0]);
    const hid_t space = H5Screate_simple(static_cast<int>(shape.size()), shape.data(), nullptr), properties = H5Pcreate(H5P_DATASET_CREATE);
    H5Pset_chunk(properties, static_cast<int>(chunk.size()), chunk.data());
    const std::size_t row = values.size() / shape[0];
    const unsigned numbers[3] = {4, 0x0105, static_cast<unsigned>(8 * row)};
    H5Pset_filter(properties, 32000, H5Z_FLAG_OPTIONAL, 3, numbers);
    const hid_t data = H5Dcreate2(file_, name, H5T_IEEE_F32LE, space, H5P_DEFAULT, properties, H5P_DEFAULT);
    for (std::size_t r = 0; r < shape[0]; r += 2) {
      std::vector<float> some(chunk[0] * row, 0.0f);
      for (std::size_t i = 0; i < some.size() && r * row + i < values.size(); ++i) some[i] = static_cast<float>(values[r * row + i]);
      const std::string packed = packed_lzf(python::raw(some));
      const hsize_t at[2] = {r, 0};
      EXPECT_GE(H5Dwrite_chunk(data, H5P_DEFAULT, 0, at, packed.size(), packed.data()), 0);
    }
    H5Dclose(data);
    H5Pclose(properties);
    H5Sclose(space);
  }
  // [frame][row][column] in chunks of 2 x 40 x 48, and int8, which the published masks are, where they are compressed by LZF.
  void write_masks(const std::vector<cv::Mat>& masks, Hdf5Packing packing) const {
    const hsize_t shape[3] = {masks.size(), static_cast<hsize_t>(masks[0].rows), static_cast<hsize_t>(masks[0].cols)}, chunk[3] = {2, 40, 48};
    std::string bytes;
    for (const cv::Mat& mask : masks) bytes.append(mask.ptr<char>(), mask.total());
    if (packing == Hdf5Packing::plain) return write("masks", H5T_STD_U8LE, {shape[0], shape[1], shape[2]}, H5T_NATIVE_UINT8, bytes.data());
    const hid_t space = H5Screate_simple(3, shape, nullptr), properties = H5Pcreate(H5P_DATASET_CREATE);
    H5Pset_chunk(properties, 3, chunk);
    const unsigned numbers[3] = {4, 0x0105, 2 * 40 * 48};  // versions, and a chunk's bytes
    if (packing == Hdf5Packing::deflate) H5Pset_shuffle(properties), H5Pset_deflate(properties, 4);
    else H5Pset_filter(properties, 32000, H5Z_FLAG_OPTIONAL, 3, numbers);
    const hid_t data = H5Dcreate2(file_, "masks", packing == Hdf5Packing::lzf ? H5T_STD_I8LE : H5T_STD_U8LE, space, H5P_DEFAULT, properties, H5P_DEFAULT);
    EXPECT_GE(data, 0);
    if (packing == Hdf5Packing::deflate) {
      EXPECT_GE(H5Dwrite(data, H5T_NATIVE_UINT8, H5S_ALL, H5S_ALL, H5P_DEFAULT, bytes.data()), 0);
    } else {
      for (hsize_t f = 0; f < shape[0]; f += chunk[0])
        for (hsize_t v = 0; v < shape[1]; v += chunk[1])
          for (hsize_t u = 0; u < shape[2]; u += chunk[2]) {
            std::string plain;
            for (hsize_t i = 0; i < chunk[0]; ++i)
              for (hsize_t j = 0; j < chunk[1]; ++j) {
                for (hsize_t k = 0; k < chunk[2]; ++k) {
                  const bool inside = f + i < shape[0] && v + j < shape[1] && u + k < shape[2];
                  plain += inside ? bytes[((f + i) * shape[1] + v + j) * shape[2] + u + k] : '\0';
                }
              }
            const std::string packed = packed_lzf(plain);
            const hsize_t at[3] = {f, v, u};
            EXPECT_GE(H5Dwrite_chunk(data, H5P_DEFAULT, 0, at, packed.size(), packed.data()), 0);
          }
    }
    H5Dclose(data);
    H5Pclose(properties);
    H5Sclose(space);
  }

 private:
  hid_t file_;
};

struct MadeUpSnapshot {
  static constexpr int kFrames = 5, kWidth = 96, kHeight = 80;

  explicit MadeUpSnapshot(const std::string& name = "female-3-sport") : folder(root / name) {
    std::filesystem::create_directories(folder);
    camera = {{"width", python::integer(kWidth)},
              {"height", python::integer(kHeight)},
              {"camera_f", python::array({2}, {90.5, 91.0})},
              {"camera_c", python::array({2}, {47.0, 40.25})},
              {"camera_k", python::array({5}, {-0.2, 0.05, 0.01, -0.005, 0.0})},
              {"camera_t", python::array({3}, {0, 0, 0})},
              {"camera_rt", python::array({3}, {0, 0, 0})}};
    write("camera.pkl", python::pickle(python::dictionary(camera)));
    // One pose more than frames, as published.
    for (int f = 0; f <= kFrames; ++f) {
      std::vector<double> pose(72, 0.0);
      pose[0] = 3.0;  // upright before a camera whose y is down
      pose[2] = 0.125 * f;
      pose[3 * 16 + 2] = -0.75;
      pose[3 * 5] = 0.25 + 0.0625 * f;
      poses.push_back(pose);
      places.push_back({0.125, 0.25 - 0.03125 * f, 2.75});
    }
    write_poses();
    for (int f = 0; f < kFrames; ++f) {
      cv::Mat mask(kHeight, kWidth, CV_8U, cv::Scalar(0));
      cv::rectangle(mask, cv::Rect(20 + 3 * f, 10, 40, 60), cv::Scalar(1), cv::FILLED);
      masks.push_back(mask);
      pictures.emplace_back(kHeight, kWidth, CV_8UC3, cv::Scalar(40 + 30 * f, 120, 200 - 30 * f));
    }
    Hdf5Writer(folder / "masks.hdf5").write_masks(masks, Hdf5Packing::lzf);
    write_video(folder / (name + ".mp4"), kFrames);
    body = make_clothed_figure(0).body;
    write_body_template(root / "body.glb", body);
  }

  void write(const std::string& name, const std::string& content) const { root.write(folder.filename().string() + "/" + name, content); }
  void write_poses() const {
    Hdf5Writer file(folder / "reconstructed_poses.hdf5");
    std::vector<double> all, trans;
    for (const std::vector<double>& pose : poses) all.insert(all.end(), pose.begin(), pose.end());
    for (const std::vector<double>& place : places) trans.insert(trans.end(), place.begin(), place.end());
    file.write_packed("pose", {poses.size(), 72}, all);
    file.write_packed("trans", {places.size(), 3}, trans);
    file.write_packed("betas", {10}, betas);
  }
  // Without a codec the frames lie in image/ instead, and it says so.
  void write_video(const std::filesystem::path& path, int frames) const {
    cv::VideoWriter writer;
    if (!writer.open(path.string(), cv::VideoWriter::fourcc('m', 'p', '4', 'v'), 30.0, {kWidth, kHeight})) {
      std::printf("  no codec for mp4v in this OpenCV: frames are picture files\n");
      return write_pictures(".png");
    }
    for (int f = 0; f < frames; ++f) writer.write(pictures[static_cast<std::size_t>(f % kFrames)]);
  }
  bool has_video() const { return !std::filesystem::exists(folder / "image"); }
  void write_pictures(const std::string& extension, int first = 0) const {
    for (int f = 0; f < kFrames; ++f) write_picture(folder / "image" / (std::to_string(first + f) + extension), pictures[static_cast<std::size_t>(f)]);
  }

  TemporaryFolder root;
  std::filesystem::path folder;
  std::vector<std::pair<std::string, std::string>> camera;
  std::vector<std::vector<double>> poses, places;
  std::vector<double> betas = std::vector<double>(10, 0.0);
  std::vector<cv::Mat> masks, pictures;
  BodyTemplate body;
};

}  // namespace arah

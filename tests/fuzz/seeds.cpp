// Writes what the fuzzers begin with: small whole files of every kind, made as the tests make theirs. fuzz_seeds FOLDER
#include <cstdio>
#include <fstream>
#include <iterator>
#include <nlohmann/json.hpp>
#include <opencv2/imgcodecs.hpp>

#include "host/avatar/avatar_file.h"
#include "host/capture/camera.h"
#include "host/training/pretrain_settings.h"
#include "host/training/training_settings.h"
#include "tests/host/body/glb_parts.h"
#include "tests/host/body/python_pickles.h"
#include "tests/host/body/rigs.h"
#include "tests/host/body/small_smpl.h"
#include "tests/host/evaluation/onnx_file.h"
#include "viewer/view_state.h"

namespace arah {
namespace {

namespace fs = std::filesystem;

class Seeds {
 public:
  explicit Seeds(fs::path folder) : folder_(std::move(folder)) {}
  // Into the folder of `target`, under a name of its own.
  fs::path place(const std::string& target) {
    fs::create_directories(folder_ / target);
    return folder_ / target / ("seed_" + std::to_string(count_++));
  }
  void add(const std::string& target, const std::string& content) { std::ofstream(place(target), std::ios::binary) << content; }
  // The file at `path` as another program would write it: with a checksum of ours, nearly all that a fuzzer makes of it would be refused for that.
  static void drop_checksum(const fs::path& path) {
    std::ifstream file(path, std::ios::binary);
    std::string bytes{std::istreambuf_iterator<char>(file), {}};
    const std::string ours = "arah.crc32", other = "other.name";
    bytes.replace(bytes.find(ours), ours.size(), other);
    std::ofstream(path, std::ios::binary) << bytes;
  }

 private:
  fs::path folder_;
  int count_ = 0;
};

void add_python_files(Seeds& seeds) {
  for (const std::string& file : pickles_of_python()) seeds.add("pickle", file);
  for (int version = 1; version <= 3; ++version) seeds.add("npy", python::npy("<f4", {2, 2}, python::raw<float>({1, 2, 3, 4.5f}), version == 2, version));
  seeds.add("npy", python::npy("<U4", {}, python::raw<std::uint32_t>({'m', 0xe9, 0, 0})));
  seeds.add("npy", python::npy_of_value(python::dictionary({{"a", python::integer(3)}})));
  for (const bool deflated : {false, true}) seeds.add("npz", python::npz({{"a", python::npy({2}, {1, 2})}, {"b", python::npy_of_value(python::list({python::integer(4)}))}}, deflated));
  const SmallModel model;
  for (const std::string& file : {model.npz(false), model.npz(true), model.pickle(false), model.pickle(true)}) {
    seeds.add("smpl_body", file);
    seeds.add("pickle", file);
  }
  const std::vector<double> amass(2 * 72, 0.1), places(2 * 3, 1.0);
  seeds.add("motion_file", python::npz({{"poses", python::npy({2, 72}, amass)}, {"trans", python::npy({2, 3}, places)}, {"mocap_framerate", python::npy({}, {60})}}));
  seeds.add("motion_file", python::pickle(python::dictionary({{"smpl_poses", python::array({2, 72}, amass)}, {"smpl_trans", python::array({2, 3}, places)}, {"smpl_scaling", python::array({1}, {95})}})));
  const auto fit = [](const std::string& poses) {
    return python::npy_of_value(python::dictionary({{"poses", poses}, {"Rh", python::array({1, 3}, {0, 1, 0})}, {"Th", python::array({1, 3}, {0, 1, 0})}, {"shapes", python::array({1, 10}, std::vector<double>(10, 0.5))}}));
  };
  seeds.add("body_fit", fit(python::array({1, 72}, std::vector<double>(72, 0.1))));
  const std::string camera = python::list({python::array({3, 3}, {100, 0, 50, 0, 100, 50, 0, 0, 1})}), turn = python::list({python::array({3, 3}, {1, 0, 0, 0, 1, 0, 0, 0, 1})});
  seeds.add("annotations", python::npy_of_value(python::dictionary(
      {{"cams", python::dictionary({{"K", camera}, {"R", turn}, {"T", python::list({python::array({3, 1}, {1, 2, 3})})}, {"D", python::list({python::array({5, 1}, {0, 0, 0, 0, 0})})}})},
       {"ims", python::list({python::dictionary({{"ims", python::list({python::text("Camera_B1/000000.jpg")})}}), python::dictionary({{"ims", python::list({python::text("Camera_B1/000001.jpg")})}})})}})));
}

void add_texts(Seeds& seeds) {
  seeds.add("bvh",
            "HIERARCHY\nROOT Hips\n{\n\tOFFSET 0.0 90.0 0.0\n\tCHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation\n\tJOINT Leg\n\t{\n\t\tOFFSET 10 -5 +0\n"
            "\t\tCHANNELS 3 Yrotation Zrotation Xrotation\n\t\tEnd Site\n\t\t{\n\t\t\tOFFSET 0 -40 0\n\t\t}\n\t}\n}\nMOTION\nFrames: 2\nFrame Time: 0.0333333\n1 95 3 0 0 0 0 0 0\n2 96 4 90 90 0 90 0 90\n");
  seeds.add("opencv_yaml", "%YAML:1.0\n---\nnames: [ \"1\", \"2\" ]\nlist:\n  - \"a\"\nK_1: !!opencv-matrix\n   rows: 3\n   cols: 1\n   dt: d\n   data: [ 1., 2.5,\n       -3e-2 ]\n");
  nlohmann::json person{{"id", 0}, {"Rh", {{0, 1, 0}}}, {"Th", {{0, 1, 0}}}, {"shapes", {std::vector<double>(10, 0.5)}}, {"poses", {std::vector<double>(72, 0.1)}}};
  seeds.add("body_fit", nlohmann::json::array({person}).dump());
  seeds.add("body_fit", nlohmann::json{{"annots", {person}}}.dump());
}

Motion small_motion() {
  Motion motion;
  motion.split = "train";
  motion.skeleton = chain_skeleton(3);
  motion.frames_per_second = 25;
  for (int number : {4, 7}) motion.frames.push_back({number, rest_pose(motion.skeleton), "made up"});
  return motion;
}

void add_rigs(Seeds& seeds) {
  seeds.add("body_template", text_of(body_template_glb(tetrahedron(3))));
  Parts parts(tetrahedron(2));
  const std::size_t dense = parts.add_floats(std::vector<float>(12, 0.1f), "VEC3", 4);
  const std::size_t indices = parts.add_view(std::vector<std::uint16_t>{1, 3}), values = parts.add_view(std::vector<float>(6, 0.2f));
  parts.head["accessors"].push_back({{"componentType", 5126}, {"type", "VEC3"}, {"count", 4}, {"sparse", {{"count", 2}, {"indices", {{"bufferView", indices}, {"componentType", 5123}}}, {"values", {{"bufferView", values}}}}}});
  parts.primitive()["targets"] = {{{"POSITION", dense}}, {{"POSITION", dense + 1}}};
  parts.head["meshes"][0]["weights"] = {0.5, 0};
  parts.head["meshes"][0]["extras"] = {{"targetNames", {"tall", "wide"}}, {"joint_shapedirs", std::vector(2, std::vector(2, std::vector<double>(3, 0.1)))}};
  seeds.add("body_template", parts.glb());
  Camera camera;
  camera.name = "left";
  camera.width = camera.height = 64;
  camera.K = glm::dmat3(60, 0, 0, 0, 60, 0, 32, 32, 1);
  camera.distortion = {0.1, 0, 0, 0, 0.01};
  write_cameras(seeds.place("cameras"), {camera});
  write_motion(seeds.place("motion"), small_motion());
}

AvatarSpec smallest_spec() {
  AvatarSpec spec;
  spec.skinning = {Skinning::network, 2, 1};
  spec.sdf = {3, 1, 30.0, SdfConditioning::latent, 2, 1};
  spec.color.width = 2;
  spec.color.hidden_layers = 1;
  spec.latent_size = 1;
  spec.grid_cells = {2.0};
  return spec;
}

void add_avatars(Seeds& seeds) {
  for (const char* preset : {"tiny", "paper"}) seeds.add("spec", spec_to_json(preset_spec(preset)));
  seeds.add("spec", spec_to_json(smallest_spec()));
  Avatar avatar = make_avatar(smallest_spec(), tetrahedron(2), {3, 4}, 1);
  avatar.settings = "{}";
  const fs::path of_avatar = seeds.place("avatar"), of_tensors = seeds.place("safetensors");
  save_avatar(of_avatar, avatar);
  Seeds::drop_checksum(of_avatar);
  SafetensorsFile file;
  file.metadata = {{"kind", "small"}};
  file.tensors["a"] = Tensor::from<float>({2, 1}, std::vector<float>{1, 2});
  file.tensors["b"] = Tensor::from<std::uint8_t>({3}, std::vector<std::uint8_t>{1, 2, 3});
  file.tensors["c"] = Tensor::from<std::int64_t>({}, std::vector<std::int64_t>{-4});
  write_safetensors(seeds.place("safetensors"), file);
  write_safetensors(of_tensors, file);
  Seeds::drop_checksum(of_tensors);
}

void add_settings_and_surfaces(Seeds& seeds) {
  seeds.add("settings", settings_to_json(preset_settings("tiny")));
  seeds.add("settings", pretrain_settings_to_json(preset_pretrain_settings("tiny")));
  ViewState view;
  view.turns["head"] = {0, 1, 0};
  view.shape = {0.5};
  view.latent_row = view.blend_frame = 3;
  view.knobs["samples"] = "24";
  seeds.add("view_state", view_state_json(view));
  std::string ply = "ply\nformat binary_little_endian 1.0\ncomment small\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nelement face 1\nproperty list uchar int vertex_indices\nproperty uchar part\nend_header\n";
  ply += python::raw<float>({0, 0, 0, 1, 0, 0, 0, 1, 0}) + "\3" + python::raw<std::int32_t>({0, 1, 2}) + "\1";
  seeds.add("true_surface", ply);
}

void add_pictures_and_networks(Seeds& seeds) {
  for (const int type : {CV_8UC4, CV_16UC4, CV_8UC1}) {
    std::vector<std::uint8_t> bytes;
    cv::imencode(".png", cv::Mat(3, 4, type, cv::Scalar(1, 2, 3, 4)), bytes);
    seeds.add("picture", {bytes.begin(), bytes.end()});
  }
  std::vector<std::uint8_t> bytes;
  cv::imencode(".jpg", cv::Mat(8, 8, CV_8UC3, cv::Scalar(10, 200, 30)), bytes);
  seeds.add("picture", {bytes.begin(), bytes.end()});
  onnx::Graph graph;
  graph.input("in0", {onnx::open, 3, onnx::open, onnx::open});
  graph.input("in1", {onnx::open, 3, onnx::open, onnx::open});
  graph.constant("shift", {1, 3, 1, 1}, {0.1f, 0.2f, 0.3f});
  graph.constant_node("scale", {1}, {2});
  graph.node("Sub", {"in0", "shift"}, "a");
  graph.node("Div", {"a", "scale"}, "out");
  graph.output("out", {1});
  seeds.add("onnx", graph.file());
}

}  // namespace
}  // namespace arah

int main(int count, char** words) {
  if (count != 2) return std::fprintf(stderr, "fuzz_seeds FOLDER\n"), 2;
  arah::Seeds seeds(words[1]);
  arah::add_python_files(seeds);
  arah::add_texts(seeds);
  arah::add_rigs(seeds);
  arah::add_avatars(seeds);
  arah::add_settings_and_surfaces(seeds);
  arah::add_pictures_and_networks(seeds);
  return 0;
}

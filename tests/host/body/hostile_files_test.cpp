// Files that are made to break their readers cost an error each: no crash, at most 512 MB, nothing else opened. Pickles and archives
// have theirs in test_python_files.cpp.
#include <gmock/gmock.h>
#include <sys/stat.h>

#include <chrono>
#include <cmath>

#include "host/body/json_fields.h"
#include "host/body/motion_file.h"
#include "host/body/pickle.h"
#include "tests/host/body/glb_parts.h"
#include "tests/host/body/hostile_json.h"
#include "tests/host/body/memory_of_refusal.h"
#include "tests/host/body/python_files.h"
#include "tests/host/body/rigs.h"

namespace arah {
namespace {

void expect_cheap_refusal(const std::string& title, const std::function<void()>& action) {
  const auto start = std::chrono::steady_clock::now();
  const std::uint64_t bytes = memory_of_refusal(action);
  std::printf("  %-44s %4.0f MB %6.2f s\n", title.c_str(), 1e-6 * static_cast<double>(bytes), std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count());
  EXPECT_LT(bytes, kMostMemoryOfRefusal) << title;
}

TEST(HostileJson, IsRefusedByItsDepth) {
  const TemporaryFolder folder;
  EXPECT_EQ(parse_json(nested_lists(64), "deep.json").size(), 1u);
  // Brackets within texts do not count.
  EXPECT_EQ(parse_json("[\"" + std::string(100, '[') + "\\\"{{{\"]", "text.json").size(), 1u);
  for (const std::string& deep : {nested_lists(65), nested_lists(10'000), nested_objects(10'000), std::string(10'000, '['), nested_lists(5'000'000)}) {
    for (const std::string& text : {deep, "{\"joint_names\":" + deep + "}", "{\"joint_names\":[],\"parents\":[],\"joint_rest\":[],\"fps\":" + deep + "}"}) {
      const auto path = folder.write("motion_train.json", text);
      expect_input_error([&] { read_motion(path); }, {"motion_train.json", "nested at most 64 deep"});
    }
  }
}

TEST(HostileJson, BombsStayUnderHalfAGigabyte) {
  const TemporaryFolder folder;
  // Each is what the largest file that is still parsed has of one kind, and then what is refused before.
  const JsonCost cost;
  const auto bomb = [&](const std::string& title, const std::string& item, std::size_t bytes_each, const std::string& before = "", const std::string& after = "") {
    for (const double part : {0.95, 1.5}) {
      const auto count = static_cast<std::size_t>(part * static_cast<double>(cost.most) / static_cast<double>(bytes_each));
      const auto path = folder.write("bomb.json", before + list_of(item, count) + after);
      expect_cheap_refusal(title + (part < 1 ? ", parsed" : ", refused"), [&] { read_motion(path); });
    }
  };
  bomb("empty lists", "[]", cost.list + 2 * cost.item);
  bomb("numbers", "0", cost.item);
  bomb("objects of one member", "{\"\":0}", cost.list + 2 * cost.item + cost.member + cost.text);
  bomb("a list where a text is expected", "[]", cost.list + 2 * cost.item, "{\"joint_names\":[],\"parents\":[],\"joint_rest\":[],\"split\":", "}");
  const auto path = folder.write("large.json", "");
  std::filesystem::resize_file(path, 1'000'000'000);  // holes
  expect_cheap_refusal("a file of a gigabyte", [&] { read_motion(path); });
  expect_input_error([&] { read_motion(path); }, {"large.json", "at most 128000000 bytes", "1000000000"});
}

TEST(HostileGltf, IndicesOutOfRangeAreNamed) {
  const std::vector<std::pair<std::function<void(Parts*)>, std::vector<std::string>>> cases = {
      {[](Parts* p) { p->primitive()["attributes"]["POSITION"] = 77; }, {"POSITION", "accessor 77"}},
      {[](Parts* p) { p->primitive()["attributes"]["JOINTS_0"] = -2; }, {"JOINTS_0", "accessor -2"}},
      {[](Parts* p) { p->primitive()["indices"] = 99; }, {"figure.glb", "out of bounds"}},
      {[](Parts* p) { p->primitive()["indices"] = 1'000'000'000'000; }, {"figure.glb"}},
      {[](Parts* p) { p->head["skins"][0]["inverseBindMatrices"] = 50; }, {"inverseBindMatrices", "accessor 50"}},
      {[](Parts* p) { p->head["skins"][0]["joints"][1] = 40; }, {"skin joint 1", "node 40"}},
      {[](Parts* p) { p->head["skins"][0]["joints"][1] = -1; }, {"skin joint 1", "node -1"}},
      {[](Parts* p) { p->head["accessors"][0]["bufferView"] = 31; }, {"POSITION", "without a buffer view"}},
      {[](Parts* p) { p->head["accessors"][0]["byteOffset"] = 18446744073709551615ull; }, {"figure.glb"}},
      {[](Parts* p) { p->head["accessors"][0]["count"] = 18446744073709551615ull; }, {"figure.glb"}},
      {[](Parts* p) { p->head["accessors"][0]["componentType"] = 1; }, {"figure.glb"}},
      {[](Parts* p) { p->head["bufferViews"][0]["buffer"] = 5; }, {"POSITION", "buffer 5"}},
      {[](Parts* p) { p->head["bufferViews"][0]["byteLength"] = 18446744073709551615ull; }, {"figure.glb"}},
      {[](Parts* p) { p->head["bufferViews"][0]["byteStride"] = 3'000'000'000u; }, {"figure.glb"}},
      {[](Parts* p) { p->head["buffers"][0]["byteLength"] = 4'000'000'000u; }, {"byteLength", "as the file has"}},
      {[](Parts* p) { p->head["buffers"][0]["byteLength"] = 0; }, {"byteLength", "at least 1"}},
      {[](Parts* p) { p->head["buffers"] = "none"; }, {"buffers", "a list"}},
      {[](Parts* p) { p->head["nodes"][3]["mesh"] = 8; }, {"node 3", "mesh 8"}},
      {[](Parts* p) { p->head["nodes"][3]["skin"] = 8; }, {"node 3", "skin 8"}},
      {[](Parts* p) { p->head["nodes"][0]["children"] = {1, 70}; }, {"node 0", "child 70"}},
      {[](Parts* p) { p->set_floats("WEIGHTS_0", std::vector<float>(16, NAN), "VEC4", 4); }, {"vertex 0", "nan"}},
      {[](Parts* p) { p->set_floats("WEIGHTS_0", std::vector<float>(16, INFINITY), "VEC4", 4); }, {"vertex 0", "inf"}},
      {[](Parts* p) { p->set_floats("JOINTS_0", std::vector<float>(16, NAN), "VEC4", 4); }, {"vertex 0", "joint nan"}},
      {[](Parts* p) { p->set_floats("NORMAL", std::vector<float>(12, NAN), "VEC3", 4); }, {"normal 0", "NaN"}},
      {[](Parts* p) { p->primitive()["indices"] = p->add_floats(std::vector<float>(3, NAN), "SCALAR", 3); }, {"index 0", "nan"}},
      {[](Parts* p) { p->primitive()["targets"] = {{{"POSITION", 60}}}; }, {"target 0", "accessor 60"}},
      {[](Parts* p) { p->head["meshes"][0]["weights"] = {0.5}; }, {"weights", "1"}},
  };
  for (std::size_t i = 0; i < cases.size(); ++i) {
    SCOPED_TRACE(i);
    Parts parts(tetrahedron(3));
    cases[i].first(&parts);
    expect_input_error([&] { read(parts); }, cases[i].second);
  }
}

TEST(HostileGltf, SparseIndicesOutOfRangeAreNamed) {
  Parts parts(tetrahedron(3));
  const std::size_t indices = parts.add_view(std::vector<std::uint16_t>{1, 4}), values = parts.add_view(std::vector<float>(6, 0.2f));
  parts.head["accessors"].push_back({{"componentType", 5126}, {"type", "VEC3"}, {"count", 4}, {"sparse", {{"count", 2}, {"indices", {{"bufferView", indices}, {"componentType", 5123}}}, {"values", {{"bufferView", values}}}}}});
  const std::size_t accessor = parts.head["accessors"].size() - 1;
  parts.primitive()["targets"] = {{{"POSITION", accessor}}};
  expect_input_error([&] { read(parts); }, {"target 0", "below 4", "element 4"});
  parts.head["accessors"][accessor]["sparse"]["count"] = 2'000'000'000;
  expect_input_error([&] { read(parts); }, {"target 0", "0 to 4 sparse elements"});
}

TEST(HostileGltf, CyclesAreNoTree) {
  Parts itself(tetrahedron(3));
  itself.head["nodes"][2]["children"] = {2};
  expect_input_error([&] { read(itself); }, {"node"});
  Parts apart(tetrahedron(3));  // below each other, out of the skin's reach
  apart.head["nodes"].push_back({{"children", {apart.head["nodes"].size() + 1}}});
  apart.head["nodes"].push_back({{"children", {apart.head["nodes"].size() - 1}}});
  expect_input_error([&] { read(apart); }, {"node 4", "a tree", "below itself"});
}

TEST(HostileGltf, DepthIsRefusedInBothForms) {
  const TemporaryFolder folder;
  Parts parts(tetrahedron(3));
  const std::string head = parts.head.dump();
  for (const std::string& deep : {nested_lists(10'000), nested_objects(10'000), nested_lists(1'000'000)}) {
    const std::string text = head.substr(0, head.size() - 1) + ",\"extras\":" + deep + "}";
    expect_input_error([&] { read_body_template(folder.write("deep.gltf", text)); }, {"deep.gltf", "nested at most 64 deep"});
    const std::string json = padded(text, ' '), data = padded(parts.buffer, '\0');
    const std::string chunks = word(json.size()) + "JSON" + json + word(data.size()) + std::string("BIN\0", 4) + data;
    expect_input_error([&] { read_body_template(folder.write("deep.glb", "glTF" + word(2) + word(12 + chunks.size()) + chunks)); }, {"deep.glb", "nested at most 64 deep"});
  }
}

TEST(HostileGltf, BombsStayUnderHalfAGigabyte) {
  const TemporaryFolder folder;
  const auto refuse = [&](const std::string& title, const std::function<void(Parts*)>& change) {
    const auto path = [&] {
      Parts parts(tetrahedron(3));
      change(&parts);
      return folder.write("bomb.glb", parts.glb());
    }();
    expect_cheap_refusal(title, [&] { read_body_template(path); });
  };
  // tinygltf copies the whole chunk for each buffer.
  refuse("one chunk as a thousand buffers", [](Parts* p) {
    p->buffer.resize(1'000'000);
    p->head["buffers"] = nlohmann::json::parse(list_of("{\"byteLength\":1000000}", 1000));
  });
  const auto share_vertices = [](Parts* p, std::size_t vertices, std::size_t primitives) {
    p->set_floats("POSITION", std::vector<float>(3 * vertices, 0.1f), "VEC3", vertices);
    p->set_floats("NORMAL", std::vector<float>(3 * vertices, 0.5f), "VEC3", vertices);
    p->set_floats("JOINTS_0", std::vector<float>(4 * vertices, 0.0f), "VEC4", vertices);
    p->set_floats("WEIGHTS_0", std::vector<float>(4 * vertices, 0.25f), "VEC4", vertices);
    const nlohmann::json primitive = p->primitive();
    for (std::size_t i = 1; i < primitives; ++i) p->head["meshes"][0]["primitives"].push_back(primitive);
  };
  refuse("thirty thousand vertices a thousand times", [&](Parts* p) { share_vertices(p, 30'000, 1000); });
  refuse("three million triangles in bytes", [](Parts* p) {
    const std::size_t view = p->add_view(std::vector<std::uint8_t>(9'000'000, 1));
    p->head["accessors"].push_back({{"bufferView", view}, {"componentType", 5121}, {"type", "SCALAR"}, {"count", 9'000'000}});
    p->primitive()["indices"] = p->head["accessors"].size() - 1;
  });
  refuse("sparse targets of a million vertices", [&](Parts* p) {
    share_vertices(p, 33'000, 30);
    const std::size_t indices = p->add_view(std::vector<std::uint16_t>{1}), values = p->add_view(std::vector<float>(3, 0.2f));
    p->head["accessors"].push_back({{"componentType", 5126}, {"type", "VEC3"}, {"count", 33'000}, {"sparse", {{"count", 1}, {"indices", {{"bufferView", indices}, {"componentType", 5123}}}, {"values", {{"bufferView", values}}}}}});
    for (nlohmann::json& primitive : p->head["meshes"][0]["primitives"])
      for (int t = 0; t < 64; ++t) primitive["targets"].push_back({{"POSITION", p->head["accessors"].size() - 1}});
  });
  // As many as are still given to tinygltf.
  for (const char* part : {"nodes", "accessors", "bufferViews", "meshes", "materials", "textures", "samplers", "cameras", "scenes"}) {
    refuse(std::string("sixty thousand ") + part, [&](Parts* p) { p->head[part] = nlohmann::json::parse(list_of("{\"a\":0}", 60'000)); p->head.erase("skins"); });
  }
  refuse("extras of half a million numbers", [](Parts* p) { p->head["extras"] = nlohmann::json::parse(list_of("0", 450'000)); p->head.erase("skins"); });
  refuse("a chain of thirty thousand nodes", [](Parts* p) {
    nlohmann::json nodes = nlohmann::json::array();
    for (std::size_t n = 0; n < 30'000; ++n) nodes.push_back({{"children", {n + 1}}});
    nodes.push_back(nlohmann::json::object());
    p->head["nodes"] = nodes;
    p->head["skins"][0]["joints"] = {0, 20'000, 30'000};
    p->head["nodes"][30'000] = {{"mesh", 0}, {"skin", 0}};
    p->head["accessors"][0]["count"] = 3;
  });
  refuse("two thousand meshes with targets of their own", [](Parts* p) {
    for (int m = 0; m < 2000; ++m) {
      nlohmann::json mesh = p->head["meshes"][0];
      mesh["primitives"][0]["targets"] = {{{"POSITION", 0}}, {{"POSITION", 0}}};
      mesh["extras"]["targetNames"] = {fmt::format("a{}", m), fmt::format("b{}", m)};
      p->head["meshes"].push_back(mesh);
      p->head["nodes"].push_back({{"mesh", m + 1}, {"skin", 0}});
    }
  });
}

// Frames that are nearly free in a file.
TEST(HostileMotion, BombsStayUnderHalfAGigabyte) {
  const TemporaryFolder folder;
  const auto still_joints = [&](std::size_t frames) {
    std::string text = "HIERARCHY\nROOT a {\nOFFSET 0 0 0\nCHANNELS 1 Xrotation\n";
    for (int i = 0; i < 255; ++i) text += "JOINT j" + std::to_string(i) + " {\nOFFSET 0 0 0\nCHANNELS 0\n}\n";
    text += "}\nMOTION\nFrames: " + std::to_string(frames) + "\nFrame Time: 0.01\n";
    for (std::size_t f = 0; f < frames; ++f) text += "0\n";
    return folder.write("still.bvh", text);
  };
  const auto many = still_joints(600'000);
  expect_cheap_refusal("joints that stand still, refused", [&] { read_motion_file(many); });
  expect_input_error([&] { read_motion_file(many); }, {"still.bvh: line 1027: Frames", "at most 22988 frames of 256 joints", "600000"});
  const auto most = still_joints(22'988);
  expect_cheap_refusal("joints that stand still, read", [&] {
    read_motion_file(most);
    throw InputError("the motion is read");
  });
  const std::size_t frames = 600'000;
  const auto amass = folder.write("many.npz", python::npz({{"poses", python::npy("|u1", {frames, 72}, std::string(72 * frames, '\0'))}, {"trans", python::npy("|u1", {frames, 3}, std::string(3 * frames, '\0'))}}, false));
  expect_cheap_refusal("six hundred thousand frames of bytes", [&] { read_motion_file(amass); });
  expect_input_error([&] { read_motion_file(amass); }, {"many.npz: poses", "at most 222222 frames"});
}

// Lists may share what they contain.
TEST(HostilePickle, SharedListsAreNoBomb) {
  const auto repeated = [](const std::string& instruction, std::size_t count) {
    std::string all = "](";
    for (std::size_t i = 0; i < count; ++i) all += instruction;
    return all + "e";
  };
  const std::string nothing = python::pickle("]q\1" "0" + repeated("h\1", 100'000) + "q\2" "0" + repeated("h\2", 100'000));
  expect_cheap_refusal("lists of lists of nothing", [&] {
    const PythonData data = parse_pickle(nothing, "a.pkl");
    python_numbers(*data.root, -1, "a.pkl", "poses");
  });
  const std::string texts = python::pickle(python::text(std::string(1'000'000, 'x')) + "q\1" "0" + repeated("h\1", 100'000));
  expect_cheap_refusal("one long text a hundred thousand times", [&] {
    const PythonData data = parse_pickle(texts, "a.pkl");
    python_texts(*data.root, "a.pkl", "names");
  });
}

// What a body may open: files in its own folder, none for a binary one.
TEST(HostileGltf, OpensNoFileButItsOwn) {
  const TemporaryFolder folder;
  Parts parts(tetrahedron(3));
  folder.write("body.bin", parts.buffer);
  std::filesystem::create_directory(folder / "inner");
  folder.write("inner/below.bin", parts.buffer);
  ASSERT_EQ(::mkfifo((folder / "pipe.bin").c_str(), 0600), 0);
  parts.head["buffers"][0]["byteLength"] = parts.buffer.size();
  const auto with_uri = [&](const std::string& uri) {
    parts.head["buffers"][0]["uri"] = uri;
    return parts.head.dump();
  };
  EXPECT_EQ(read_body_template(folder.write("inner/body.gltf", with_uri("below.bin"))).vertices.size(), 4u);
  EXPECT_EQ(read_body_template(folder.write("body.gltf", with_uri("inner/below.bin"))).vertices.size(), 4u);
  for (const std::string& uri : {std::string("../body.bin"), (folder / "body.bin").string(), std::string("..%2fbody.bin"), std::string("../pipe.bin"), std::string("/dev/zero"), std::string("~/body.bin"), std::string("`true`"), std::string(".")}) {
    expect_input_error([&] { read_body_template(folder.write("inner/body.gltf", with_uri(uri))); }, {"body.gltf", "File not found"});
  }
  expect_input_error([&] { read_body_template(folder.write("body.gltf", with_uri("pipe.bin"))); }, {"body.gltf", "File not found"});
  // A picture that is not there, or is no file, hinders nobody: textures are not ours.
  parts.head["images"] = {{{"uri", "/dev/zero"}}, {{"uri", "pipe.bin"}}, {{"uri", "no.png"}}};
  EXPECT_EQ(read_body_template(folder.write("body.gltf", with_uri("body.bin"))).vertices.size(), 4u);
  parts.head.erase("images");
  with_uri("body.bin");
  expect_input_error([&] { read_body_template(folder.write("body.glb", parts.glb())); }, {"body.glb", "File not found"});
  // A name that would never be waited for: a pipe without a writer.
  expect_input_error([&] { read_body_template(folder / "pipe.bin"); }, {"pipe.bin"});
}

TEST(HostileText, NothingOfAFileReachesTheTerminal) {
  Parts parts(tetrahedron(3));
  parts.head["nodes"][0]["name"] = parts.head["nodes"][1]["name"] = "evil\x1b[2J\nname";
  try {
    read(parts);
    FAIL() << "no error";
  } catch (const InputError& error) {
    EXPECT_THAT(error.what(), testing::HasSubstr("evil?[2J?name"));
  }
}

}  // namespace
}  // namespace arah

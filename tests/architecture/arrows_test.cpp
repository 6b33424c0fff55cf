// Data flows one way through the tree, and so do includes: shaders → kernels → host → viewer, and inside host
// body → capture → avatar → rendering → training → evaluation → cli. An arrow reads "is used by"; nothing points back.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <regex>
#include <string>
#include <vector>

namespace arah {
namespace {

namespace fs = std::filesystem;

const std::vector<std::string> rooms{"shaders", "kernels", "host", "viewer"};
const std::vector<std::string> host_folders{"body",     "capture",  "avatar", "rendering",
                                            "training", "evaluation", "cli"};

// Place in the order; -1 where the name is not in it.
long rank(const std::vector<std::string>& order, const std::string& name) {
  const auto found = std::find(order.begin(), order.end(), name);
  return found == order.end() ? -1 : found - order.begin();
}

// "host/body/pose.h" → {"host", "body", "pose.h"}
std::vector<std::string> parts(const std::string& path) {
  std::vector<std::string> result;
  for (const fs::path& part : fs::path(path)) result.push_back(part.string());
  return result;
}

// Complaints about one file, whose path is relative to the tree's root.
std::vector<std::string> broken_arrows(const std::string& path, const std::string& text) {
  std::vector<std::string> broken;
  const std::vector<std::string> at = parts(path);
  const bool shading_language = path.ends_with(".comp") || path.ends_with(".glsl");
  const bool may_call_vulkan = path.starts_with("kernels/vulkan/") || at[0] == "viewer";
  static const std::regex include(R"(^[ \t]*#[ \t]*include[ \t]*[<"]([^>"]+)[>"])", std::regex::multiline);
  for (std::sregex_iterator match(text.begin(), text.end(), include), end; match != end; ++match) {
    const std::string name = (*match)[1];
    const std::vector<std::string> to = parts(name);
    const auto complain = [&](const std::string& rule) { broken.push_back(path + " includes " + name + ": " + rule); };
    if (shading_language) {
      if (to[0] != "lib" && to[0] != "shared") complain("shaders use shaders/lib and shaders/shared alone");
      continue;
    }
    if (to[0] == "vulkan" && !may_call_vulkan) complain("kernels/vulkan and viewer alone call Vulkan");
    if (to[0] == "GLFW" && at[0] != "viewer") complain("windows belong to the viewer");
    if (to[0] == "tests") complain("nothing needs the tests");
    if (name.find("..") != std::string::npos) complain("paths are given from the root of the tree");
    if (rank(rooms, to[0]) > rank(rooms, at[0])) complain(to[0] + " uses " + at[0] + ", not the other way round");
    if (to[0] == "host" && at[0] == "host" && to.size() > 2) {
      if (rank(host_folders, to[1]) < 0) complain("no known folder of host");
      // files of host itself come before all of its folders
      const long own = at.size() > 2 ? rank(host_folders, at[1]) : -1;
      if (rank(host_folders, to[1]) > own) complain("a later folder of host");
    }
  }
  if ((at[0] == "host" || at[0] == "viewer") && text.find(".spv") != std::string::npos)
    broken.push_back(path + " names a .spv: shaders are launched through kernels/");
  if (at[0] == "host" && at.size() > 2 && rank(host_folders, at[1]) < 0)
    broken.push_back(path + " lies in no known folder of host");
  return broken;
}

TEST(ArrowsTest, EveryFileKeepsThem) {
  const fs::path root = ARAH_SOURCE_DIR;
  size_t files = 0;
  for (const std::string& room : rooms) {
    if (!fs::exists(root / room)) continue;
    for (const fs::directory_entry& entry : fs::recursive_directory_iterator(root / room)) {
      const std::string extension = entry.path().extension().string();
      if (extension != ".h" && extension != ".cpp" && extension != ".comp" && extension != ".glsl") continue;
      std::ifstream file(entry.path());
      const std::string text{std::istreambuf_iterator<char>(file), {}};
      EXPECT_THAT(broken_arrows(fs::relative(entry.path(), root).string(), text), testing::IsEmpty());
      ++files;
    }
  }
  EXPECT_GT(files, 200u) << "the tree was not found";
}

// One line of each kind that must be noticed, and one beside it that is allowed.
TEST(ArrowsTest, ABrokenArrowIsNoticed) {
  const auto breaks = [](const std::string& path, const std::string& line) {
    return broken_arrows(path, "#pragma once\n" + line + "\nint x;\n").size();
  };
  EXPECT_EQ(breaks("kernels/rays/generate.h", "#include \"host/input_error.h\""), 1u);
  EXPECT_EQ(breaks("kernels/rays/generate.h", "#  include <host/input_error.h>"), 1u);
  EXPECT_EQ(breaks("kernels/rays/generate.h", "#include \"shaders/shared/ray.h\""), 0u);
  EXPECT_EQ(breaks("shaders/shared/ray.h", "#include \"kernels/linear/matrix.h\""), 1u);
  EXPECT_EQ(breaks("shaders/shared/ray.h", "#include \"shaders/shared/glsl_types.h\""), 0u);
  EXPECT_EQ(breaks("shaders/rays/generate.comp", "#include \"kernels/linear/matrix.h\""), 1u);
  EXPECT_EQ(breaks("shaders/rays/generate.comp", "#include \"lib/sine.glsl\""), 0u);
  EXPECT_EQ(breaks("host/body/pose.h", "#include \"host/capture/capture.h\""), 1u);
  EXPECT_EQ(breaks("host/capture/capture.h", "#include \"host/body/pose.h\""), 0u);
  EXPECT_EQ(breaks("host/rendering/field.cpp", "#include \"host/training/trainer.h\""), 1u);
  EXPECT_EQ(breaks("host/evaluation/report.cpp", "#include \"host/cli/command.h\""), 1u);
  EXPECT_EQ(breaks("host/input_error.h", "#include \"host/body/pose.h\""), 1u);
  EXPECT_EQ(breaks("host/body/pose.h", "#include \"host/input_error.h\""), 0u);
  EXPECT_EQ(breaks("host/misc/things.h", ""), 1u);
  EXPECT_EQ(breaks("host/cli/main.cpp", "#include \"viewer/window.h\""), 1u);
  EXPECT_EQ(breaks("viewer/window.cpp", "#include \"host/rendering/renderer.h\""), 0u);
  EXPECT_EQ(breaks("host/rendering/field.cpp", "#include <vulkan/vulkan.h>"), 1u);
  EXPECT_EQ(breaks("kernels/rays/generate.cpp", "#include <vulkan/vulkan.h>"), 1u);
  EXPECT_EQ(breaks("kernels/vulkan/device.cpp", "#include <vulkan/vulkan.h>"), 0u);
  EXPECT_EQ(breaks("host/rendering/field.cpp", "#include \"kernels/vulkan/device.h\""), 0u);
  EXPECT_EQ(breaks("host/rendering/field.cpp", "load(\"generate.spv\");"), 1u);
  EXPECT_EQ(breaks("host/rendering/field.cpp", "#include <GLFW/glfw3.h>"), 1u);
  EXPECT_EQ(breaks("host/rendering/field.cpp", "#include \"tests/golden.h\""), 1u);
  EXPECT_EQ(breaks("host/rendering/field.cpp", "#include \"../training/trainer.h\""), 1u);
}

}  // namespace
}  // namespace arah

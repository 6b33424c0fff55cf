// Small rigs and files for the tests of the body.
#pragma once

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <string>

#include "host/body/body_template.h"
#include "host/input_error.h"

namespace arah {

// A folder of its own for one test, removed with everything in it afterwards.
class TemporaryFolder {
 public:
  TemporaryFolder() {
    std::string pattern = (std::filesystem::temp_directory_path() / "arah_test_XXXXXX").string();
    path_ = ::mkdtemp(pattern.data());
  }
  ~TemporaryFolder() { std::filesystem::remove_all(path_); }
  TemporaryFolder(const TemporaryFolder&) = delete;
  TemporaryFolder& operator=(const TemporaryFolder&) = delete;

  std::filesystem::path operator/(const std::string& name) const { return path_ / name; }
  const std::filesystem::path& path() const { return path_; }
  std::filesystem::path write(const std::string& name, const std::string& content) const {
    std::filesystem::create_directories((path_ / name).parent_path());
    std::ofstream(path_ / name, std::ios::binary) << content;
    return path_ / name;
  }

 private:
  std::filesystem::path path_;
};

// Expects `action` to throw an InputError of one line whose text has all of `parts`.
template <typename Action>
void expect_input_error(const Action& action, const std::vector<std::string>& parts) {
  try {
    action();
    FAIL() << "no error; expected one about " << parts.at(0);
  } catch (const InputError& error) {
    for (const std::string& part : parts) EXPECT_THAT(error.what(), testing::HasSubstr(part));
    EXPECT_THAT(error.what(), testing::Not(testing::HasSubstr("\n")));
  }
}

// A chain of `count` joints, 0.1 m apart along x, at a height of 1 m.
inline Skeleton chain_skeleton(int count) {
  Skeleton skeleton;
  for (int j = 0; j < count; ++j) {
    skeleton.names.push_back("bone_" + std::to_string(j));
    skeleton.parents.push_back(j - 1);
    skeleton.rest_joints.emplace_back(0.1 * j, 1.0, 0.01 * j * j);
  }
  return skeleton;
}

// A tetrahedron of a size of 0.3 m, its vertices bound to the first joints of a chain.
inline BodyTemplate tetrahedron(int joints) {
  BodyTemplate body;
  body.skeleton = chain_skeleton(joints);
  body.vertices = {{0.0f, 1.0f, 0.0f}, {0.3f, 1.0f, 0.0f}, {0.0f, 1.3f, 0.0f}, {0.0f, 1.0f, 0.3f}};
  body.normals = {{0.0f, 0.0f, -1.0f}, {1.0f, 0.0f, 0.0f}, {0.0f, 1.0f, 0.0f}, {0.0f, 0.0f, 1.0f}};
  body.triangles = {{0, 2, 1}, {0, 1, 3}, {0, 3, 2}, {1, 2, 3}};
  const auto last = static_cast<glm::u8>(joints - 1);
  body.joints = {{0, 0, 0, 0}, {last, 0, 0, 0}, {0, last, 0, 0}, {last, 0, 0, 0}};
  body.weights = {
      {1.0f, 0.0f, 0.0f, 0.0f}, {0.75f, 0.25f, 0.0f, 0.0f}, {0.5f, 0.5f, 0.0f, 0.0f}, {1.0f, 0.0f, 0.0f, 0.0f}};
  return body;
}

inline std::filesystem::path subject_a() {
  return std::filesystem::path(ARAH_SOURCE_DIR) / ".." / "shared" / "captures" / "subject_a";
}

}  // namespace arah

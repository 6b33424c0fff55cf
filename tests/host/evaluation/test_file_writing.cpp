// Files are whole or absent.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>

#include "host/file_writing.h"
#include "host/input_error.h"

namespace arah {
namespace {

using testing::HasSubstr;
namespace fs = std::filesystem;

class FileWriting : public testing::Test {
 protected:
  void SetUp() override { fs::create_directories(folder_); }
  void TearDown() override { fs::remove_all(folder_); }
  std::size_t files() const {
    return static_cast<std::size_t>(std::distance(fs::directory_iterator(folder_), fs::directory_iterator()));
  }
  static std::string read(const fs::path& path) {
    std::ifstream file(path, std::ios::binary);
    return {std::istreambuf_iterator<char>(file), {}};
  }
  const fs::path folder_ = fs::temp_directory_path() / ("arah-file-writing-" + std::to_string(::getpid()));
};

TEST_F(FileWriting, WritesNewFilesAndReplacesOldOnes) {
  const fs::path path = folder_ / "report.html";
  const std::string first("one\0two", 7);
  write_file_safely(path, first);
  EXPECT_EQ(read(path), first);
  write_file_safely(path, std::string_view(""));
  EXPECT_EQ(read(path), "");
  EXPECT_EQ(files(), 1u);
}

TEST_F(FileWriting, NamesTheFileAndTheReasonWhereTheFolderIsMissing) {
  const fs::path path = folder_ / "absent" / "a.png";
  try {
    write_file_safely(path, std::string_view("x"));
    FAIL() << "nothing was thrown";
  } catch (const InputError& error) {
    EXPECT_THAT(error.what(), HasSubstr(path.string()));
    EXPECT_THAT(error.what(), HasSubstr("No such file or directory"));
  }
}

TEST_F(FileWriting, AFailureLeavesNoTemporaryFile) {
  fs::create_directories(folder_ / "taken" / "inside");
  EXPECT_THROW(write_file_safely(folder_ / "taken", std::string_view("x")), std::runtime_error);
  EXPECT_EQ(files(), 1u);
  EXPECT_TRUE(fs::is_directory(folder_ / "taken" / "inside"));
  EXPECT_THROW(write_file_safely(folder_ / "", std::string_view("x")), InputError);
}

}  // namespace
}  // namespace arah

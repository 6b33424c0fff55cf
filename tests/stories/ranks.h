// Several ranks of the built program, run as a user would: mpirun -n 2 arah ..., on a small synthetic capture.
#pragma once

#include <gtest/gtest.h>

#include <cstdlib>
#include <functional>
#include <string>
#include <vector>

#include "tests/host/body/rigs.h"
#include "tests/stories/program.h"

namespace arah {

class RanksTest : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    folder_ = new TemporaryFolder;
    const Outcome made = Program({"synth", at("capture"), "--frames", "4", "--size", "64"}, folder_->path()).wait();
    ASSERT_EQ(made.code, 0) << made.errors;
  }
  static void TearDownTestSuite() {
    delete folder_;
    folder_ = nullptr;
  }
  void SetUp() override {
    if (!ARAH_WITH_MPI) GTEST_SKIP() << "built without MPI";
    if (std::system("command -v mpirun >/dev/null") != 0) GTEST_SKIP() << "mpirun is not installed";
  }

  static std::string at(const std::string& name) { return (*folder_ / name).string(); }
  // mpirun with these words: "-n", "2", ARAH_PROGRAM, "train", ...
  static std::function<void()> mpirun(const std::vector<std::string>& words) {
    return [words] {
      ::setenv("LP_NUM_THREADS", "1", 1);  // each rank its core
      std::vector<std::string> all{"mpirun", "--allow-run-as-root", "--oversubscribe"};
      all.insert(all.end(), words.begin(), words.end());
      std::vector<char*> arguments;
      for (std::string& word : all) arguments.push_back(word.data());
      arguments.push_back(nullptr);
      ::execvp("mpirun", arguments.data());
      ::_exit(127);
    };
  }
  static std::vector<std::string> on(int ranks, const std::vector<std::string>& words) {
    std::vector<std::string> all{"-n", std::to_string(ranks), ARAH_PROGRAM};
    all.insert(all.end(), words.begin(), words.end());
    return all;
  }
  // One rank is the program itself.
  static Outcome arah(int ranks, const std::vector<std::string>& words) {
    return (ranks == 1 ? Program(words, folder_->path()) : Program({}, folder_->path(), mpirun(on(ranks, words)))).wait();
  }

  static inline TemporaryFolder* folder_ = nullptr;
};

}  // namespace arah

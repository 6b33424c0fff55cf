// Disks that are full, and folders that take no files.
#include <sched.h>
#include <sys/mount.h>
#include <sys/resource.h>

#include <cstring>

#include "tests/faults/faults.h"

namespace arah {
namespace {

namespace fs = std::filesystem;

// A disk of its own in memory, in a namespace of this process and its children, so that nothing of it outlives them.
class SmallDisk {
 public:
  SmallDisk(const fs::path& path, const std::string& size) : path_(path) {
    fs::create_directories(path_);
    if (::unshare(CLONE_NEWNS) != 0 || ::mount("none", "/", nullptr, MS_REC | MS_PRIVATE, nullptr) != 0 || ::mount("tmpfs", path_.c_str(), "tmpfs", 0, ("size=" + size).c_str()) != 0)
      refusal_ = std::strerror(errno);
  }
  ~SmallDisk() {
    if (refusal_.empty()) ::umount2(path_.c_str(), MNT_DETACH);
  }
  SmallDisk(const SmallDisk&) = delete;
  SmallDisk& operator=(const SmallDisk&) = delete;

  const std::string& refusal() const { return refusal_; }  // empty: it is there
  bool resize(const std::string& size) { return ::mount("tmpfs", path_.c_str(), "tmpfs", MS_REMOUNT, ("size=" + size).c_str()) == 0; }
  bool read_only(bool wanted) { return ::mount("tmpfs", path_.c_str(), "tmpfs", MS_REMOUNT | (wanted ? MS_RDONLY : 0), nullptr) == 0; }

 private:
  fs::path path_;
  std::string refusal_;
};

#define SKIP_WITHOUT(disk) \
  if (!(disk).refusal().empty()) GTEST_SKIP() << "this process may not mount a disk of its own (" << (disk).refusal() << "); root may"

TEST_F(Faults, AFullDiskCostsNoCheckpoint) {
  const uint64_t checkpoint = fs::file_size(at(fmt::format("whole/checkpoints/step_{:08}.safetensors", kSteps))), avatar = fs::file_size(at("whole/avatar.safetensors"));
  // Room for one checkpoint with its avatar, and for half of the next; and for one avatar, but not the next on its way.
  SmallDisk disk(at("full"), std::to_string(checkpoint + avatar + checkpoint / 2));
  SKIP_WITHOUT(disk);
  const Outcome full = arah(training("full/run"));
  expect_complaint(full, 1, {at("full/run/checkpoints/step_00000002.safetensors"), "could not be written", "No space left on device", "Make room on that disk", "--resume goes on from the checkpoint of step 1"});
  EXPECT_EQ(newest_step("full/run"), 1u);
  EXPECT_THAT(unfinished("full/run"), testing::IsEmpty());
  const auto saved = RunFolder(at("full/run")).newest_checkpoint();
  ASSERT_TRUE(saved.has_value());
  EXPECT_EQ(avatar_from_tensors(*saved).steps, 1u);
  EXPECT_EQ(load_avatar(at("full/run/avatar.safetensors")).steps, 1u);

  // Still full: the same again, and nothing lost.
  expect_complaint(arah(resuming("full/run")), 1, {"No space left on device", "step 1"});
  EXPECT_EQ(newest_step("full/run"), 1u);
  ASSERT_TRUE(disk.resize("1g"));
  expect_resumed_to_same_bits("full/run");
}

TEST_F(Faults, ADiskThatIsFullFromTheStartIsNamedAndLeftAsItWas) {
  for (const char* size : {"4k", "8k", "12k"}) {  // a page for each folder and each file: no config.json, no events.jsonl, no checkpoint
    SCOPED_TRACE(size);
    SmallDisk disk(at("tiny_disk"), size);
    SKIP_WITHOUT(disk);
    const Outcome full = arah(training("tiny_disk/run"));
    EXPECT_EQ(full.code, 1);
    expect_complaint(full, full.code, {at("tiny_disk/run"), "No space left on device"});
    EXPECT_EQ(newest_step("tiny_disk/run"), 0u);
    if (fs::exists(at("tiny_disk/run"))) {
      EXPECT_THAT(unfinished("tiny_disk/run"), testing::IsEmpty());
    }
  }
}

// The same without root's rights: files that may not grow as large as a checkpoint.
TEST_F(Faults, ACheckpointThatTheSystemCutsOffIsNoCheckpoint) {
  const Outcome limited = arah(training("limited"), [] {
    std::signal(SIGXFSZ, SIG_IGN);
    const rlimit limit{100'000, 100'000};
    ::setrlimit(RLIMIT_FSIZE, &limit);
  });
  expect_complaint(limited, 1, {at("limited/checkpoints/step_00000001.safetensors"), "could not be written (write)", "File too large"});
  EXPECT_EQ(newest_step("limited"), 0u);
  EXPECT_THAT(unfinished("limited"), testing::IsEmpty());
  expect_resumed_to_same_bits("limited");
}

TEST_F(Faults, AReadOnlyFolderIsNamedAndNothingIsLost) {
  SmallDisk disk(at("locked"), "1g");
  SKIP_WITHOUT(disk);
  auto words = training("locked/run");
  words.insert(words.end(), {"--stop-at", "3"});
  ASSERT_EQ(arah(words).code, 1);
  ASSERT_TRUE(disk.read_only(true));
  expect_complaint(arah(training("locked/new")), 2, {at("locked/new"), "could not be made", "Read-only file system", "Choose a folder that takes files"});
  expect_complaint(arah(resuming("locked/run")), 2, {at("locked/run"), "could not be written", "Read-only file system", "Choose a folder that takes files"});
  EXPECT_EQ(newest_step("locked/run"), 3u);
  ASSERT_TRUE(disk.read_only(false));

  // It becomes so while a run goes on.
  Program program(resuming("locked/run"), folder());
  ASSERT_TRUE(reaches_step(program, "locked/run", 5)) << program.wait().errors;
  bool locked = false;
  while (!locked && program.running()) locked = disk.read_only(true);  // refused while a file is being written
  ASSERT_TRUE(locked) << program.wait().errors;
  const Outcome stopped = program.wait();
  expect_complaint(stopped, stopped.code, {at("locked/run"), "could not be written", "Read-only file system"});
  EXPECT_THAT(stopped.code, testing::AnyOf(1, 2));
  const uint64_t step = newest_step("locked/run");
  EXPECT_GE(step, 5u);
  EXPECT_LT(step, static_cast<uint64_t>(kSteps));
  ASSERT_TRUE(disk.read_only(false));
  expect_resumed_to_same_bits("locked/run");
}

// A full folder stands for an old checkpoint that no right and no system lets go.
TEST_F(Faults, AnOldCheckpointThatCannotBeRemovedEndsNoRun) {
  auto words = training("burdened");
  words.insert(words.end(), {"--stop-at", "3"});
  ASSERT_EQ(arah(words).code, 1);
  const fs::path stays = at("burdened/checkpoints/step_00000000.safetensors");
  fs::create_directories(stays / "full");
  expect_resumed_to_same_bits("burdened");
  EXPECT_TRUE(fs::exists(stays / "full"));
  const auto left = fs::directory_iterator(stays.parent_path());
  EXPECT_EQ(std::distance(begin(left), end(left)), 3) << "it and the newest two";
}

TEST_F(Faults, AFolderWithoutTheRightToWriteIsNamed) {
  if (::geteuid() == 0) GTEST_SKIP() << "root may write to every folder; AReadOnlyFolderIsNamedAndNothingIsLost stands for it";
  fs::create_directories(at("others"));
  fs::permissions(at("others"), fs::perms::owner_read | fs::perms::owner_exec);
  expect_complaint(arah(training("others")), 2, {at("others"), "could not be written", "Permission denied", "Choose a folder that takes files"});
  expect_complaint(arah(training("others/run")), 2, {at("others/run"), "could not be made", "Permission denied"});
  fs::permissions(at("others"), fs::perms::owner_all);
}

}  // namespace
}  // namespace arah

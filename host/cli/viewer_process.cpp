#include "host/cli/viewer_process.h"

#include <spawn.h>
#include <unistd.h>

#include <cstdlib>
#include <sstream>

extern char** environ;

namespace arah {

namespace fs = std::filesystem;

fs::path viewer_program() {
  std::error_code error;
  const fs::path own = fs::read_symlink("/proc/self/exe", error);
  if (const fs::path beside = own.parent_path() / "arah-view"; !error && ::access(beside.c_str(), X_OK) == 0) return beside;
  const char* path = std::getenv("PATH");
  std::istringstream folders(path ? path : "");
  for (std::string folder; std::getline(folders, folder, ':');)
    if (const fs::path there = fs::path(folder) / "arah-view"; !folder.empty() && ::access(there.c_str(), X_OK) == 0) return there;
  return {};
}

bool start_viewer(const fs::path& program, const std::vector<std::string>& words) {
  std::vector<char*> arguments{const_cast<char*>(program.c_str())};
  for (const std::string& word : words) arguments.push_back(const_cast<char*>(word.c_str()));
  arguments.push_back(nullptr);
  posix_spawnattr_t attributes;
  if (posix_spawnattr_init(&attributes) != 0) return false;
  posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETSID);
  pid_t child = -1;
  const bool started = posix_spawn(&child, program.c_str(), nullptr, &attributes, arguments.data(), environ) == 0;
  posix_spawnattr_destroy(&attributes);
  return started;
}

}  // namespace arah

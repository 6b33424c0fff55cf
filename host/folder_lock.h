// One writer to a folder at a time.
#pragma once

#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

#include <cerrno>
#include <filesystem>

#include "host/input_error.h"

namespace arah {

// Held as long as it lives, and given up by the system when the process ends, however it ends: nothing of it lies in the
// folder. Advisory: it keeps off other FolderLocks alone, readers need none. Where the file system knows no locks on folders (some
// network file systems), nothing is held.
class FolderLock {
 public:
  // Throws InputError where another one holds that folder, in this process or in another of this machine.
  explicit FolderLock(const std::filesystem::path& folder) : folder_(::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC)) {
    if (folder_ < 0 || ::flock(folder_, LOCK_EX | LOCK_NB) == 0 || errno != EWOULDBLOCK) return;
    ::close(folder_);
    throw InputError(folder.string(), "", "a folder that no other arah writes to", "one that another arah is training in at this moment",
                     "Wait for it, stop it, or choose another name.");
  }
  ~FolderLock() {
    if (folder_ >= 0) ::close(folder_);
  }
  FolderLock(const FolderLock&) = delete;
  FolderLock& operator=(const FolderLock&) = delete;

 private:
  int folder_ = -1;
};

}  // namespace arah

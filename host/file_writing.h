// Files that are whole or absent: a reader never sees half a file, and a failure never costs the file that was there
// before.
#pragma once

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>

#include "host/input_error.h"

namespace arah {

// Writes `bytes` to a temporary name in the folder of `path`, flushes them to the disk and renames the file to `path`,
// which is replaced in one step where it exists (a symbolic link is replaced, not followed). The folder must exist.
// Throws "<path>: could not be written (<step>): <the system's reason>. <advice, for some>": InputError where the folder takes no file,
// std::runtime_error where the disk refuses. `path` is then as it was before, and the temporary file is gone.
inline void write_file_safely(const std::filesystem::path& path, std::span<const std::uint8_t> bytes) {
  static std::atomic<unsigned> serial{0};
  // In the same folder, because a rename is atomic only within one file system; process and serial keep writers apart.
  std::filesystem::path temporary;
  int file = -1;
  auto describe = [&](const char* step) {
    const char* advice = "";
    if (errno == ENOSPC || errno == EDQUOT) advice = ". Make room on that disk";
    if (errno == EROFS || errno == EACCES || errno == EPERM) advice = ". Choose a folder that takes files";
    return fmt::format("{}: could not be written ({}): {}{}", path.string(), step, std::strerror(errno), advice);
  };
  auto fail = [&](const char* step) {
    const std::string text = describe(step);
    if (file >= 0) ::close(file);
    ::unlink(temporary.c_str());
    throw std::runtime_error(text);
  };

  if (!path.has_filename()) {
    errno = EISDIR;
    throw InputError(describe("create"));
  }
  do {  // in a container a process may have the very id of one that was killed there, and left its file
    temporary = path.parent_path() / fmt::format(".{}.{}.{}.part", path.filename().string().substr(0, 200), ::getpid(), serial++);
    file = ::open(temporary.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
  } while (file < 0 && errno == EEXIST);
  if (file < 0) throw InputError(describe("create"));
  for (std::size_t done = 0; done < bytes.size();) {
    const ssize_t written = ::write(file, bytes.data() + done, bytes.size() - done);
    if (written < 0 && errno == EINTR) continue;
    if (written == 0) errno = ENOSPC;
    if (written <= 0) fail("write");
    done += static_cast<std::size_t>(written);
  }
  if (::fsync(file) != 0) fail("flush");
  // Network file systems and quotas report some write errors only here.
  const int closed = ::close(file);
  file = -1;
  if (closed != 0) fail("close");
  if (::rename(temporary.c_str(), path.c_str()) != 0) fail("rename");

  // The new name itself survives a power cut once the folder is flushed; not every file system allows that, and the
  // content is safe either way, so a refusal is no error.
  const std::filesystem::path parent = path.has_parent_path() ? path.parent_path() : std::filesystem::path(".");
  const int folder = ::open(parent.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (folder >= 0) {
    ::fsync(folder);
    ::close(folder);
  }
}

// The same for text.
inline void write_file_safely(const std::filesystem::path& path, std::string_view text) {
  write_file_safely(path,
                    std::span<const std::uint8_t>(reinterpret_cast<const std::uint8_t*>(text.data()), text.size()));
}

}  // namespace arah

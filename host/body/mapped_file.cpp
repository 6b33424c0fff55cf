#include "host/body/mapped_file.h"

#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>

#include "host/input_error.h"

namespace arah {

MappedFile::MappedFile(const std::filesystem::path& path, std::size_t largest) {
  const int file = ::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK);  // a pipe without a writer is refused, not waited for
  struct stat state{};
  if (file < 0 || ::fstat(file, &state) != 0 || !S_ISREG(state.st_mode)) {
    const std::string reason = file < 0 ? std::strerror(errno) : "something else";
    if (file >= 0) ::close(file);
    throw InputError(path.string(), "", "a file that can be read", reason);
  }
  size_ = static_cast<std::size_t>(state.st_size);
  void* mapped = nullptr;
  if (size_ > 0 && size_ <= largest) mapped = ::mmap(nullptr, size_, PROT_READ, MAP_PRIVATE, file, 0);
  ::close(file);
  if (size_ > largest) throw InputError(path.string(), "", fmt::format("at most {} bytes", largest), fmt::format("{}", size_));
  if (mapped == MAP_FAILED) throw InputError(path.string(), "", "a file that can be read", std::strerror(errno));
  start_ = static_cast<const char*>(mapped);
}

MappedFile::~MappedFile() {
  if (start_) ::munmap(const_cast<char*>(start_), size_);
}

}  // namespace arah

// The newest checkpoint of a run that is training, read while the window goes on.
#pragma once

#include <chrono>
#include <filesystem>
#include <future>
#include <memory>
#include <optional>

#include "host/avatar/avatar.h"

namespace arah {

class FollowedRun {
 public:
  // path: a run's folder, or an avatar's file, which is followed where it is replaced. shown: what newest() gives only newer ones than.
  explicit FollowedRun(std::filesystem::path path);
  ~FollowedRun();

  // A newer avatar than the last one given, null where there is none. Looks at the disk at most once a second, and reads on a thread
  // of its own; a file that does not open, as one that training is about to replace, is passed over.
  std::shared_ptr<const Avatar> newest();

  // The file to open first: of a folder avatar.safetensors or, before there is one, the newest checkpoint. Throws InputError where there is
  // neither, as a run that has just begun.
  static std::filesystem::path first_file(const std::filesystem::path& path);

 private:
  std::filesystem::path path_;
  std::optional<std::filesystem::file_time_type> seen_;
  std::chrono::steady_clock::time_point looked_ = std::chrono::steady_clock::now();
  std::future<std::shared_ptr<const Avatar>> reading_;
};

}  // namespace arah

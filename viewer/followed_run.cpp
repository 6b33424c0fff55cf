#include "viewer/followed_run.h"

#include <algorithm>
#include <utility>
#include <vector>

#include "host/avatar/avatar_file.h"
#include "host/input_error.h"

namespace arah {
namespace {

namespace fs = std::filesystem;

// The file that was written last of those that hold the avatar.
std::optional<std::pair<fs::file_time_type, fs::path>> newest_file(const fs::path& path) {
  std::vector<fs::path> files;
  std::error_code error;
  if (fs::is_directory(path, error)) {
    files.push_back(path / "avatar.safetensors");
    for (fs::directory_iterator entry(path / "checkpoints", error), end; !error && entry != end; entry.increment(error))
      if (entry->path().extension() == ".safetensors") files.push_back(entry->path());
  } else {
    files.push_back(path);
  }
  std::optional<std::pair<fs::file_time_type, fs::path>> newest;
  for (const fs::path& file : files) {
    const fs::file_time_type time = fs::last_write_time(file, error);
    if (!error && (!newest || time > newest->first)) newest = {time, file};
  }
  return newest;
}

}  // namespace

FollowedRun::FollowedRun(fs::path path) : path_(std::move(path)) {
  if (const auto file = newest_file(path_)) seen_ = file->first;
}

FollowedRun::~FollowedRun() {
  if (reading_.valid()) reading_.wait();
}

std::shared_ptr<const Avatar> FollowedRun::newest() {
  if (reading_.valid()) {
    if (reading_.wait_for(std::chrono::seconds(0)) != std::future_status::ready) return nullptr;
    return reading_.get();
  }
  const auto now = std::chrono::steady_clock::now();
  if (now - looked_ < std::chrono::seconds(1)) return nullptr;
  looked_ = now;
  const auto file = newest_file(path_);
  if (!file || (seen_ && file->first <= *seen_)) return nullptr;
  seen_ = file->first;
  reading_ = std::async(std::launch::async, [path = file->second]() -> std::shared_ptr<const Avatar> {
    try {
      return std::make_shared<const Avatar>(load_avatar(path));
    } catch (const std::exception&) {
      return nullptr;  // the next one will do
    }
  });
  return nullptr;
}

fs::path FollowedRun::first_file(const fs::path& path) {
  if (!fs::exists(path)) throw InputError(path.string(), "", "an avatar or a run's folder", "no such file", "arah train makes avatars.");
  if (!fs::is_directory(path) || fs::exists(path / "avatar.safetensors")) return fs::is_directory(path) ? path / "avatar.safetensors" : path;
  const auto file = newest_file(path);
  if (!file) throw InputError(path.string(), "", "avatar.safetensors or a checkpoint", "neither", "A run that has just begun has none for a while.");
  return file->second;
}

}  // namespace arah

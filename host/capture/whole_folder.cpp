#include "host/capture/whole_folder.h"

#include "host/file_writing.h"

namespace arah {
namespace {

namespace fs = std::filesystem;

void check_replaceable(const fs::path& out, const std::string& marker, const std::string& what) {
  if (out.empty()) throw InputError(what, "folder", "a name", "nothing");
  if (!fs::exists(out)) return;
  if (!fs::is_directory(out)) throw InputError(out.string(), "", "a folder", "a file", "Choose another name.");
  if (fs::is_empty(out) || fs::exists(out / marker)) return;
  throw InputError(out.string(), "", "an empty folder or an earlier " + what, "other files",
                   "Nothing was written; choose another name.");
}

}  // namespace

WholeFolder::WholeFolder(const fs::path& out, const std::string& marker, const std::string& what) : marker_(marker) {
  check_replaceable(out, marker, what);
  // `out` may end in a slash, which would put the partial folder inside it.
  const fs::path normal = fs::absolute(out).lexically_normal();
  folder_ = normal.has_filename() ? normal : normal.parent_path();
  partial_ = folder_;
  partial_ += ".partial";
  check_replaceable(partial_, marker, what);
}

WholeFolder::~WholeFolder() {
  if (!started_) return;
  std::error_code ignored;
  fs::remove_all(partial_, ignored);
}

void WholeFolder::start(const std::string& marker_text) {
  fs::remove_all(partial_);
  fs::create_directories(partial_);
  started_ = true;
  write_file_safely(partial_ / marker_, marker_text);
}

void WholeFolder::finish() {
  fs::remove_all(folder_);
  fs::rename(partial_, folder_);
  started_ = false;
}

}  // namespace arah

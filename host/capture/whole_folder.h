// A folder that appears under its name once it is complete.
#pragma once

#include <filesystem>
#include <string>

namespace arah {

class WholeFolder {
 public:
  // `marker`: the file by which a folder made like this is known. Throws InputError where `out` is no name, a file, or a
  // folder with anything in it but an earlier one. `what`: "synthetic capture", for errors.
  WholeFolder(const std::filesystem::path& out, const std::string& marker, const std::string& what);
  // Removes what was not finished.
  ~WholeFolder();
  WholeFolder(const WholeFolder&) = delete;
  WholeFolder& operator=(const WholeFolder&) = delete;

  // Empties and makes <out>.partial and writes the marker into it first, so that what a killed run leaves is recognised
  // and replaced.
  void start(const std::string& marker_text);
  const std::filesystem::path& partial() const { return partial_; }
  // Gives the folder its name; an earlier one is replaced.
  void finish();

 private:
  std::filesystem::path folder_, partial_;
  std::string marker_;
  bool started_ = false;
};

}  // namespace arah

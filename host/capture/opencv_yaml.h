// The YAML that OpenCV's FileStorage writes, as far as calibrations use it: matrices, numbers, texts and lists of texts.
#pragma once

#include <filesystem>
#include <map>
#include <string>
#include <vector>

namespace arah {

class OpenCvYaml {
 public:
  // Throws InputError naming file and line.
  explicit OpenCvYaml(const std::filesystem::path& path);

  bool has(const std::string& key) const { return matrices_.contains(key) || texts_.contains(key); }
  // A matrix's `count` numbers row by row (any number of them where it is negative). Throws InputError naming file and key.
  const std::vector<double>& matrix(const std::string& key, long count) const;
  // A list of texts, or one text.
  const std::vector<std::string>& texts(const std::string& key) const;

 private:
  std::string where_;
  std::map<std::string, std::vector<double>> matrices_;
  std::map<std::string, std::vector<std::string>> texts_;
};

}  // namespace arah

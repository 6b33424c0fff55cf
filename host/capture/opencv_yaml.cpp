#include "host/capture/opencv_yaml.h"

#include <charconv>
#include <cmath>

#include "host/body/mapped_file.h"
#include "host/input_error.h"

namespace arah {
namespace {

constexpr std::size_t kMostBytes = 4'000'000;  // a hundred cameras take a hundred thousand

std::string_view trimmed(std::string_view text) {
  const std::size_t first = text.find_first_not_of(" \t\r");
  return first == text.npos ? std::string_view() : text.substr(first, text.find_last_not_of(" \t\r") - first + 1);
}

std::string unquoted(std::string_view text) {
  if (text.size() >= 2 && text.front() == text.back() && (text.front() == '"' || text.front() == '\'')) text = text.substr(1, text.size() - 2);
  return std::string(text);
}

// The items of "[ a, b, c ]".
std::vector<std::string_view> flow_items(std::string_view text) {
  std::vector<std::string_view> items;
  text = trimmed(text.substr(1, text.rfind(']') - 1));
  for (std::size_t from = 0; !text.empty() && from <= text.size();) {
    const std::size_t to = std::min(text.find(',', from), text.size());
    items.push_back(trimmed(text.substr(from, to - from)));
    from = to + 1;
  }
  return items;
}

double yaml_number(std::string_view text, const std::string& where, const std::string& field) {
  double number = 0;
  if (text.ends_with('.')) text.remove_suffix(1);  // OpenCV writes 3.0 as "3."
  const auto [stop, error] = std::from_chars(text.data(), text.data() + text.size(), number);
  if (error != std::errc() || stop != text.data() + text.size() || !std::isfinite(number)) {
    throw InputError(where, field, "a finite number", "'" + std::string(text.substr(0, 40)) + "'");
  }
  return number;
}

}  // namespace

OpenCvYaml::OpenCvYaml(const std::filesystem::path& path) : where_(path.string()) {
  const MappedFile file(path, kMostBytes);
  const std::string_view bytes = file.bytes();
  std::string key;
  bool matrix = false;
  std::size_t rows = 0, columns = 0, line_number = 0;
  for (std::size_t at = 0; at < bytes.size();) {
    const auto take_line = [&] {
      const std::size_t end = std::min(bytes.find('\n', at), bytes.size());
      const std::string_view taken = bytes.substr(at, end - at);
      at = end + 1;
      ++line_number;
      return taken;
    };
    const std::string_view line = take_line();
    const std::string_view text = trimmed(line);
    const std::string field = fmt::format("line {}", line_number);
    const auto fail = [&](const std::string& expected) { return InputError(where_, field, expected, "'" + std::string(text.substr(0, 40)) + "'"); };
    if (text.empty() || text[0] == '#' || text[0] == '%' || text == "---" || text == "...") continue;
    if (text.starts_with("- ")) {
      if (key.empty() || matrix) throw fail("a key before a list");
      texts_[key].push_back(unquoted(trimmed(text.substr(2))));
      continue;
    }
    const std::size_t colon = text.find(':');
    if (colon == text.npos) throw fail("KEY: VALUE");
    const std::string name(trimmed(text.substr(0, colon)));
    std::string value(trimmed(text.substr(colon + 1)));
    if (!value.empty() && value[0] == '[') {
      while (value.find(']') == value.npos && at < bytes.size()) value += " " + std::string(trimmed(take_line()));
      if (value.find(']') == value.npos) throw fail("a list that ends");
    }
    if (line[0] != ' ' && line[0] != '\t') {  // a key of the file
      key = name;
      matrix = value.starts_with("!!opencv-matrix");
      rows = columns = 0;
      if (matrices_.contains(key) || texts_.contains(key)) throw fail("each key once");
      if (matrix) continue;
      std::vector<std::string>& items = texts_[key];
      if (!value.empty() && value[0] == '[') {
        for (const std::string_view item : flow_items(value)) items.push_back(unquoted(item));
      } else if (!value.empty()) {
        items.push_back(unquoted(value));
      }
    } else if (!matrix) {
      throw fail("a matrix, a list or a text");
    } else if (name == "rows" || name == "cols") {
      const double count = yaml_number(value, where_, field);
      if (!(count >= 1 && count <= 1e6) || count != std::floor(count)) throw fail("a number of rows or columns");
      (name == "rows" ? rows : columns) = static_cast<std::size_t>(count);
    } else if (name == "data") {
      if (value.empty() || value[0] != '[') throw fail("numbers in brackets");
      std::vector<double> numbers;
      for (const std::string_view item : flow_items(value)) numbers.push_back(yaml_number(item, where_, field));
      if (numbers.size() != rows * columns) {
        throw InputError(where_, key, fmt::format("{}x{} numbers", rows, columns), fmt::format("{}", numbers.size()));
      }
      matrices_[key] = std::move(numbers);
    } else if (name != "dt") {
      throw fail("rows, cols, dt and data");
    }
  }
}

const std::vector<double>& OpenCvYaml::matrix(const std::string& key, long count) const {
  const auto found = matrices_.find(key);
  if (found == matrices_.end()) throw InputError(where_, key, "a matrix", "none");
  if (count >= 0 && found->second.size() != static_cast<std::size_t>(count)) {
    throw InputError(where_, key, fmt::format("{} numbers", count), fmt::format("{}", found->second.size()));
  }
  return found->second;
}

const std::vector<std::string>& OpenCvYaml::texts(const std::string& key) const {
  const auto found = texts_.find(key);
  if (found == texts_.end()) throw InputError(where_, key, "a list", "none");
  return found->second;
}

}  // namespace arah

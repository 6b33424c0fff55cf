// JSON that is made to break its readers.
#pragma once

#include <string>

namespace arah {

// `depth` lists (or objects) within each other.
inline std::string nested_lists(std::size_t depth) { return std::string(depth, '[') + std::string(depth, ']'); }
inline std::string nested_objects(std::size_t depth) {
  std::string text;
  for (std::size_t i = 0; i < depth; ++i) text += "{\"a\":";
  return text + "1" + std::string(depth, '}');
}

// [item,item,…] of so many.
inline std::string list_of(const std::string& item, std::size_t count) {
  std::string text = "[";
  for (std::size_t i = 0; i < count; ++i) (text += item) += ',';
  text.back() = ']';
  return text;
}

}  // namespace arah

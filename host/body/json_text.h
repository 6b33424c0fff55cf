// What a JSON text would cost, found before it is parsed: parsers build lists within lists as long as brackets open, and a
// value of two letters takes a hundred bytes.
#pragma once

#include <cstddef>
#include <string>
#include <string_view>

namespace arah {

// Lists and objects within each other; the formats that are read here need at most eight.
inline constexpr std::size_t kMostJsonDepth = 64;
inline constexpr std::size_t kMostJsonFile = 128'000'000;  // bytes

// Bytes of memory that a parser takes for each, and how many together. The defaults are nlohmann's, with what growing lists
// leave behind.
struct JsonCost {
  std::size_t list = 48;    // or an object
  std::size_t item = 48;    // of a list or an object, beyond what it is itself
  std::size_t member = 96;  // of an object
  std::size_t text = 48;
  std::size_t most = 320'000'000;
};

// Throws InputError naming `where` and `field`: nested deeper than kMostJsonDepth, or more than cost.most. Whether the text is JSON at all
// is the parser's to say.
void check_json_text(std::string_view text, const std::string& where, const std::string& field = "", const JsonCost& cost = {});

}  // namespace arah

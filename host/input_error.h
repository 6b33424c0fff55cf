// The error for input that a user can mend: a file, a field, a value. The program prints its text as one line and ends with exit code 2.
#pragma once

#include <fmt/format.h>

#include <stdexcept>
#include <string>

namespace arah {

// One line that a terminal can show, whatever names and values of a file it quotes: control characters become '?'.
inline std::string without_controls(std::string text) {
  for (char& letter : text) {
    if (static_cast<unsigned char>(letter) < ' ' || letter == '\x7f') letter = '?';
  }
  return text;
}

// what() reads: "<where>: <field>: expected <expected>, found <found>. <advice>" with empty parts left out.
class InputError : public std::runtime_error {
 public:
  explicit InputError(const std::string& text) : std::runtime_error(without_controls(text)) {}
  InputError(const std::string& where, const std::string& field, const std::string& expected, const std::string& found,
             const std::string& advice = "")
      : InputError(fmt::format("{}{}: expected {}, found {}.{}", where, field.empty() ? "" : ": " + field, expected, found,
                               advice.empty() ? "" : " " + advice)) {}
};

}  // namespace arah

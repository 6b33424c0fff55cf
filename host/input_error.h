// The error for input that a user can mend: a file, a field, a value. The program prints its text as one line and ends with exit code 2.
#pragma once

#include <fmt/format.h>

#include <stdexcept>
#include <string>

namespace arah {

// what() reads: "<where>: <field>: expected <expected>, found <found>. <advice>" with empty parts left out.
class InputError : public std::runtime_error {
 public:
  explicit InputError(const std::string& text) : std::runtime_error(text) {}
  InputError(const std::string& where, const std::string& field, const std::string& expected, const std::string& found,
             const std::string& advice = "")
      : std::runtime_error(fmt::format("{}{}: expected {}, found {}.{}", where, field.empty() ? "" : ": " + field, expected,
                                       found, advice.empty() ? "" : " " + advice)) {}
};

}  // namespace arah

// How a program of ours ends: what went wrong in one line on standard error, and the exit code that says whose turn it is.
#pragma once

#include <functional>
#include <string>

namespace arah {

inline constexpr int kFailed = 1;     // the work failed
inline constexpr int kWrongCall = 2;  // the call was wrong: options, files, settings, too low a ceiling

// "<program>: <text>" in one line on standard error, whatever the text. Returns code.
int report_error(const std::string& program, const std::string& text, int code);

// What run returns; else the code of what it threw, reported.
int outcome_of(const std::string& program, const std::function<int()>& run);

}  // namespace arah

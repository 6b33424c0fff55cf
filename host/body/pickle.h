// A restricted reader of Python's pickles, protocols 0 to 5. It builds None, truth values, integers, reals, texts, bytes,
// lists, tuples and sets (as lists), dictionaries and NumPy arrays and scalars; sparse matrices of scipy and arrays of chumpy
// become their state as plain data. It never executes anything: whatever else a pickle names is refused by that name.
#pragma once

#include <filesystem>
#include <string>
#include <string_view>

#include "host/body/python_value.h"

namespace arah {

// What one pickle may be at most; beyond it lies nothing that this field stores.
inline constexpr std::size_t kMostPickleSteps = 3'000'000;        // values put on the reader's stack
inline constexpr std::size_t kMostPickleValues = 2'000'000;
inline constexpr std::size_t kMostPickleOwnBytes = 128'000'000;   // of texts and arrays that have to be decoded
inline constexpr std::size_t kMostPickleDepth = 64;               // of values within values

// Views refer into `bytes`, which must outlive the result. Throws InputError naming `where` and the byte: truncated,
// unknown instructions, values of another kind than an instruction needs, a class or function that is not plain data (by
// name), references to what was never stored, cycles, arrays whose sizes disagree, and more than the limits above.
PythonData parse_pickle(std::string_view bytes, const std::string& where);
PythonData read_pickle(const std::filesystem::path& path);

}  // namespace arah

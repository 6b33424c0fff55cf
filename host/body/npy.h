// NumPy's .npy files, versions 1 to 3: one array, or any value that NumPy pickled.
#pragma once

#include <cstddef>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "host/body/python_value.h"

namespace arah {

// What stands before an array's elements.
struct NpyHeader {
  ElementType type;
  bool fortran_order = false;
  std::vector<std::size_t> shape;
  std::size_t length = 0;  // bytes up to the elements

  // Of all elements together; 0 for kind 'O'. The header's reader has checked that it does not overflow.
  std::size_t data_bytes() const;
};

// Reads the header from the file's first bytes (`bytes` may end after the header). Throws InputError naming `where`: not
// a .npy file, truncated, structured or unknown elements, more than 32 axes, sizes that overflow.
NpyHeader read_npy_header(std::string_view bytes, const std::string& where);

// The array; for an array of values without axes (np.save of a dictionary) that value itself. Views refer into `bytes`,
// which must outlive the result. Throws InputError naming `where`: as above, too few or too many bytes, and what
// read_pickle() refuses.
PythonData parse_npy(std::string_view bytes, const std::string& where);
PythonData read_npy(const std::filesystem::path& path);

// The length of the product of an array's axes times `size`. Throws InputError where it overflows 2^48.
std::size_t checked_array_bytes(const std::vector<std::size_t>& shape, std::size_t size, const std::string& where,
                                const std::string& field);

}  // namespace arah

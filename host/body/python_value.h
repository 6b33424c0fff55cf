// Values that Python's users store, as plain data: numbers, texts, lists, dictionaries and NumPy arrays. What .npy, .npz
// and pickled files hold (npy.h, npz.h, pickle.h); nothing in it can be executed.
#pragma once

#include <cstdint>
#include <deque>
#include <memory>
#include <string>
#include <string_view>
#include <utility>
#include <variant>
#include <vector>

namespace arah {

struct PythonValue;

// How NumPy stores an element: kind 'b' truth value, 'i' and 'u' integer, 'f' real (2, 4 or 8 bytes), 'S' bytes, 'U' text
// (UTF-32, 4 bytes a letter), 'O' any value.
struct ElementType {
  char kind = 'f';
  std::size_t size = 8;  // bytes
  bool big_endian = false;
};

// From NumPy's notation: "<f8", "|b1", ">i4", "U5", "O8". Throws InputError for what is not in the list above.
ElementType element_type(std::string_view notation, const std::string& where, const std::string& field);

struct PythonNone {};
struct PythonBytes {
  std::string_view content;
};
struct PythonList {  // a list, a tuple or a set
  std::vector<const PythonValue*> items;
};
struct PythonDictionary {
  std::vector<std::pair<const PythonValue*, const PythonValue*>> items;
};
struct PythonArray {
  ElementType type;
  bool fortran_order = false;  // the first index runs fastest in `data`
  std::vector<std::size_t> shape;
  std::string_view data;                  // for all kinds but 'O'
  std::vector<const PythonValue*> items;  // for kind 'O', in the order of `data`

  std::size_t size() const;  // elements
  // Where the element with this place in C order (last index fastest) is stored.
  std::size_t stored_place(std::size_t place) const;
  // The element in C order as a number; kinds 'b', 'i', 'u' and 'f'.
  double number(std::size_t place) const;
  bool numeric() const { return type.kind == 'b' || type.kind == 'i' || type.kind == 'u' || type.kind == 'f'; }
};
// Data of a class that files of this field contain (a sparse matrix, a chumpy array): its name and its state, a dictionary.
struct PythonObject {
  std::string_view type;
  const PythonValue* state = nullptr;
};
// A name of Python's that stands for itself, and a NumPy element type: parts of files, of no use to their readers.
struct PythonName {
  std::string_view name;
};
struct PythonElementType {
  ElementType type;
};

struct PythonValue {
  std::variant<PythonNone, bool, std::int64_t, double, std::string_view, PythonBytes, PythonList, PythonDictionary,
               std::unique_ptr<PythonArray>, PythonObject, PythonName, PythonElementType>
      content;
  std::uint8_t height = 0;  // of the tree below it, once it is known; for the reader
};

// A file's values, which refer to one another and into the file's bytes. Movable.
struct PythonData {
  std::shared_ptr<const void> file;    // keeps the bytes that views refer to; null where the caller does
  std::deque<std::string> own_bytes;   // texts and arrays that had to be decoded
  std::deque<PythonValue> values;
  const PythonValue* root = nullptr;
};

// A value in words, short enough for one line.
std::string python_excerpt(const PythonValue& value);

// Reading a value as what it must be. Each throws InputError naming `where` (the file) and `field` otherwise.

// A dictionary's member, or nullptr; the same for an object's state.
const PythonValue* python_find(const PythonValue& dictionary, std::string_view name);
const PythonValue& python_member(const PythonValue& dictionary, std::string_view name, const std::string& where,
                                 const std::string& field);
// The items of a list, a tuple or an array of values with one axis; `count` of them, or any number where it is negative.
const std::vector<const PythonValue*>& python_items(const PythonValue& value, long count, const std::string& where,
                                                    const std::string& field);
// The texts of such a list, or of an array of texts with one axis.
std::vector<std::string> python_texts(const PythonValue& value, const std::string& where, const std::string& field);
std::string python_text(const PythonValue& value, const std::string& where, const std::string& field);
std::int64_t python_integer(const PythonValue& value, const std::string& where, const std::string& field);
// An array of numbers. Axes of length -1 may have any length.
const PythonArray& python_array(const PythonValue& value, const std::vector<long>& shape, const std::string& where,
                                const std::string& field);
// `count` finite numbers (any number of them where it is negative) of an array of any shape, in C order, of a list or tuple
// of numbers or of such lists, or one number.
std::vector<double> python_numbers(const PythonValue& value, long count, const std::string& where,
                                   const std::string& field);

}  // namespace arah

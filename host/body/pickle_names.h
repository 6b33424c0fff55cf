// What the names in a pickle stand for, where they stand for plain data: the calls and states that pickle.cpp meets.
#pragma once

#include <optional>
#include <string>
#include <string_view>

#include "host/body/python_value.h"

namespace arah {

enum class PickleName {
  kReconstruct,    // numpy's maker of an array, filled by its state
  kFromBuffer,     // the same from bytes, protocol 5
  kArray,          // numpy.ndarray
  kElementType,    // numpy.dtype
  kScalar,         // a numpy number
  kEncode,         // bytes in a text, protocols 0 to 2
  kBytes,          // bytes(): none
  kSet,            // set([...])
  kObject,         // object
  kReconstructor,  // copyreg's maker of an instance, protocols 0 and 1
  kContainer,      // classes whose state is plain data: sparse matrices, chumpy's arrays
};

// "numpy.dtype" → its meaning and the same name in static memory; nothing for a name that is not plain data.
struct KnownPickleName {
  PickleName meaning;
  std::string_view name;
};
std::optional<KnownPickleName> known_pickle_name(std::string_view module, std::string_view name);

// Where values of a pickle are made, within the limits of pickle.h.
class PickleStore {
 public:
  PickleStore(PythonData& data, const std::string& where) : data_(data), where_(where) {}

  template <typename Content>
  PythonValue* make(Content&& content) {
    count_value();
    data_.values.emplace_back().content = std::forward<Content>(content);
    return &data_.values.back();
  }
  // Keeps a decoded text or array.
  std::string_view keep(std::string bytes);
  // A list that another value takes over. Shared ones could otherwise be copied over and over.
  std::vector<const PythonValue*> copied(const std::vector<const PythonValue*>& items);
  const std::string& where() const { return where_; }

  std::size_t place = 0;  // byte of the pickle, for errors
  std::string field() const;

 private:
  void count_value() const;
  PythonData& data_;
  const std::string& where_;
  std::size_t own_bytes_ = 0, copied_items_ = 0;
};

// The value that calling `name` with `arguments` (a tuple) stands for. Throws InputError.
PythonValue* pickled_call(PickleStore& store, std::string_view name, const PythonValue& arguments);
// An empty container of class `name`, as NEWOBJ asks for. Throws InputError.
PythonValue* pickled_instance(PickleStore& store, std::string_view name);
// Fills an array, an element type or a container. Throws InputError.
void set_pickled_state(PickleStore& store, PythonValue& value, const PythonValue& state);

}  // namespace arah

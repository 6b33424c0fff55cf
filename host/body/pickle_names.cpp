#include "host/body/pickle_names.h"

#include <array>
#include <cmath>

#include "host/body/npy.h"
#include "host/body/pickle.h"
#include "host/input_error.h"

namespace arah {
namespace {

// The pickles of NumPy 1 and 2, Python 2 and 3, and scipy before and after 1.8 differ in the names of modules.
constexpr std::array kKnownNames{
    KnownPickleName{PickleName::kReconstruct, "numpy.core.multiarray._reconstruct"},
    KnownPickleName{PickleName::kReconstruct, "numpy._core.multiarray._reconstruct"},
    KnownPickleName{PickleName::kFromBuffer, "numpy.core.numeric._frombuffer"},
    KnownPickleName{PickleName::kFromBuffer, "numpy._core.numeric._frombuffer"},
    KnownPickleName{PickleName::kArray, "numpy.ndarray"},
    KnownPickleName{PickleName::kElementType, "numpy.dtype"},
    KnownPickleName{PickleName::kScalar, "numpy.core.multiarray.scalar"},
    KnownPickleName{PickleName::kScalar, "numpy._core.multiarray.scalar"},
    KnownPickleName{PickleName::kEncode, "_codecs.encode"},
    KnownPickleName{PickleName::kBytes, "__builtin__.bytes"},
    KnownPickleName{PickleName::kBytes, "builtins.bytes"},
    KnownPickleName{PickleName::kSet, "__builtin__.set"},
    KnownPickleName{PickleName::kSet, "builtins.set"},
    KnownPickleName{PickleName::kObject, "__builtin__.object"},
    KnownPickleName{PickleName::kObject, "builtins.object"},
    KnownPickleName{PickleName::kReconstructor, "copy_reg._reconstructor"},
    KnownPickleName{PickleName::kReconstructor, "copyreg._reconstructor"},
    KnownPickleName{PickleName::kContainer, "scipy.sparse.csc.csc_matrix"},
    KnownPickleName{PickleName::kContainer, "scipy.sparse._csc.csc_matrix"},
    KnownPickleName{PickleName::kContainer, "scipy.sparse.csr.csr_matrix"},
    KnownPickleName{PickleName::kContainer, "scipy.sparse._csr.csr_matrix"},
    KnownPickleName{PickleName::kContainer, "chumpy.ch.Ch"},
};

PickleName meaning_of(std::string_view name) {
  for (const KnownPickleName& known : kKnownNames) {
    if (known.name == name) return known.meaning;
  }
  return PickleName::kObject;
}

[[noreturn]] void refuse(const PickleStore& store, const std::string& expected, const std::string& found) {
  throw InputError(store.where(), store.field(), expected, found);
}

// Letters of a text, or of bytes, which is what Python 2 has for texts.
std::string_view letters(const PickleStore& store, const PythonValue& value) {
  if (const auto* text = std::get_if<std::string_view>(&value.content)) return *text;
  if (const auto* bytes = std::get_if<PythonBytes>(&value.content)) return bytes->content;
  refuse(store, "a text", python_excerpt(value));
}

std::string_view raw_bytes(const PickleStore& store, const PythonValue& value) {
  if (const auto* bytes = std::get_if<PythonBytes>(&value.content)) return bytes->content;
  refuse(store, "bytes", python_excerpt(value));
}

const std::vector<const PythonValue*>& tuple(const PickleStore& store, const PythonValue& value, std::size_t least) {
  const auto* list = std::get_if<PythonList>(&value.content);
  if (!list || list->items.size() < least) {
    refuse(store, fmt::format("a tuple of {} values", least), python_excerpt(value));
  }
  return list->items;
}

const ElementType& element_type_in(const PickleStore& store, const PythonValue& value) {
  if (const auto* type = std::get_if<PythonElementType>(&value.content)) return type->type;
  refuse(store, "a type of elements", python_excerpt(value));
}

std::vector<std::size_t> shape_in(const PickleStore& store, const PythonValue& value) {
  std::vector<std::size_t> shape;
  if (const auto* length = std::get_if<std::int64_t>(&value.content); length && *length >= 0) {
    return {static_cast<std::size_t>(*length)};
  }
  for (const PythonValue* item : tuple(store, value, 0)) {
    const auto* length = std::get_if<std::int64_t>(&item->content);
    if (!length || *length < 0 || shape.size() == 32) refuse(store, "lengths of at most 32 axes", python_excerpt(*item));
    shape.push_back(static_cast<std::size_t>(*length));
  }
  return shape;
}

void fill_array(PickleStore& store, PythonArray& array, const PythonValue& shape, const ElementType& type,
                bool fortran_order, const PythonValue& elements) {
  array.shape = shape_in(store, shape);
  array.type = type;
  array.fortran_order = fortran_order;
  const std::size_t bytes = checked_array_bytes(array.shape, type.size, store.where(), store.field());
  if (type.kind == 'O') {
    checked_array_bytes(array.shape, 1, store.where(), store.field());
    const auto& items = tuple(store, elements, 0);
    if (items.size() != array.size()) {
      refuse(store, fmt::format("{} values in an array", array.size()), fmt::format("{}", items.size()));
    }
    array.items = store.copied(items);
    return;
  }
  array.data = raw_bytes(store, elements);
  if (array.data.size() != bytes) {
    refuse(store, fmt::format("{} bytes in an array", bytes), fmt::format("{}", array.data.size()));
  }
}

// Bytes that protocols 0 to 2 store as a text of the letters 0 to 255, in UTF-8.
std::string latin_bytes(const PickleStore& store, std::string_view text) {
  std::string bytes;
  bytes.reserve(text.size());
  for (std::size_t i = 0; i < text.size(); ++i) {
    const auto first = static_cast<unsigned char>(text[i]);
    if (first < 0x80) {
      bytes += text[i];
      continue;
    }
    const unsigned second = i + 1 < text.size() ? static_cast<unsigned char>(text[i + 1]) : 0;
    if ((first != 0xc2 && first != 0xc3) || (second & 0xc0) != 0x80) {
      refuse(store, "a text of letters below 256", "another letter");
    }
    bytes += static_cast<char>(first << 6 | (second & 0x3f));
    ++i;
  }
  return bytes;
}

}  // namespace

std::optional<KnownPickleName> known_pickle_name(std::string_view module, std::string_view name) {
  for (const KnownPickleName& known : kKnownNames) {
    if (known.name.size() == module.size() + 1 + name.size() && known.name.starts_with(module) &&
        known.name[module.size()] == '.' && known.name.ends_with(name)) {
      return known;
    }
  }
  return std::nullopt;
}

std::string_view PickleStore::keep(std::string bytes) {
  own_bytes_ += bytes.size();
  if (own_bytes_ > kMostPickleOwnBytes) {
    refuse(*this, fmt::format("at most {} bytes of decoded texts and arrays", kMostPickleOwnBytes), "more");
  }
  data_.own_bytes.push_back(std::move(bytes));
  return data_.own_bytes.back();
}

std::vector<const PythonValue*> PickleStore::copied(const std::vector<const PythonValue*>& items) {
  copied_items_ += items.size();
  if (copied_items_ > kMostPickleSteps) refuse(*this, fmt::format("at most {} steps", kMostPickleSteps), "more");
  return items;
}

std::string PickleStore::field() const { return fmt::format("byte {} of the pickle", place); }

void PickleStore::count_value() const {
  if (data_.values.size() >= kMostPickleValues) {
    refuse(*this, fmt::format("at most {} values", kMostPickleValues), "more");
  }
}

PythonValue* pickled_call(PickleStore& store, std::string_view name, const PythonValue& arguments) {
  switch (meaning_of(name)) {
    case PickleName::kReconstruct: {
      const auto* type = std::get_if<PythonName>(&tuple(store, arguments, 3)[0]->content);
      if (!type || meaning_of(type->name) != PickleName::kArray) refuse(store, "numpy.ndarray", python_excerpt(arguments));
      auto array = std::make_unique<PythonArray>();
      array->type = {'b', 1, false};
      array->shape = {0};
      return store.make(std::move(array));
    }
    case PickleName::kFromBuffer: {
      const auto& values = tuple(store, arguments, 4);
      auto array = std::make_unique<PythonArray>();
      fill_array(store, *array, *values[2], element_type_in(store, *values[1]), letters(store, *values[3]) == "F", *values[0]);
      return store.make(std::move(array));
    }
    case PickleName::kElementType:
      return store.make(PythonElementType{
          element_type(letters(store, *tuple(store, arguments, 1)[0]), store.where(), store.field())});
    case PickleName::kScalar: {
      const auto& values = tuple(store, arguments, 2);
      const ElementType& type = element_type_in(store, *values[0]);
      PythonArray one;
      one.type = type;
      one.data = type.kind == 'O' ? std::string_view() : raw_bytes(store, *values[1]);
      if (!one.numeric() || one.data.size() != type.size) refuse(store, "a number", python_excerpt(*values[1]));
      const double number = one.number(0);
      if (type.kind == 'b') return store.make(number != 0.0);
      if (type.kind != 'f' && std::abs(number) < 0x1p63) return store.make(static_cast<std::int64_t>(number));
      return store.make(number);
    }
    case PickleName::kEncode: {
      const auto& values = tuple(store, arguments, 2);
      const std::string_view codec = letters(store, *values[1]);
      if (codec != "latin1" && codec != "latin-1") refuse(store, "the codec latin1", python_excerpt(*values[1]));
      return store.make(PythonBytes{store.keep(latin_bytes(store, letters(store, *values[0])))});
    }
    case PickleName::kBytes:
      if (!tuple(store, arguments, 0).empty()) refuse(store, "bytes()", "bytes of something");
      return store.make(PythonBytes{});
    case PickleName::kSet:
      return store.make(PythonList{store.copied(tuple(store, *tuple(store, arguments, 1)[0], 0))});
    case PickleName::kReconstructor: {
      const auto& values = tuple(store, arguments, 3);
      const auto* type = std::get_if<PythonName>(&values[0]->content);
      const auto* base = std::get_if<PythonName>(&values[1]->content);
      const bool plain = type && base && meaning_of(base->name) == PickleName::kObject && base->name.ends_with(".object") &&
                         std::holds_alternative<PythonNone>(values[2]->content);
      if (!plain) refuse(store, "an instance of object", python_excerpt(arguments));
      return pickled_instance(store, type->name);
    }
    case PickleName::kArray:
    case PickleName::kObject:
    case PickleName::kContainer:
      break;
  }
  refuse(store, "plain data", fmt::format("a call of '{}'", name));
}

PythonValue* pickled_instance(PickleStore& store, std::string_view name) {
  if (meaning_of(name) != PickleName::kContainer) refuse(store, "plain data", fmt::format("an instance of '{}'", name));
  return store.make(PythonObject{name, nullptr});
}

void set_pickled_state(PickleStore& store, PythonValue& value, const PythonValue& state) {
  if (auto* array = std::get_if<std::unique_ptr<PythonArray>>(&value.content)) {
    // (version, shape, element type, Fortran order, elements); the version is absent before NumPy 1.0.
    if ((*array)->size() != 0) refuse(store, "an array that is filled once", python_excerpt(value));
    const auto& values = tuple(store, state, 5);
    const auto* fortran = std::get_if<bool>(&values[3]->content);
    const auto* number = std::get_if<std::int64_t>(&values[3]->content);
    if (!fortran && !number) refuse(store, "a truth value", python_excerpt(*values[3]));
    fill_array(store, **array, *values[1], element_type_in(store, *values[2]), fortran ? *fortran : *number != 0, *values[4]);
    return;
  }
  if (auto* type = std::get_if<PythonElementType>(&value.content)) {
    // (version, byte order, …): an element with parts has them in one of the next three.
    const auto& values = tuple(store, state, 5);
    for (std::size_t i = 2; i < 5; ++i) {
      if (!std::holds_alternative<PythonNone>(values[i]->content)) refuse(store, "elements of one kind", "a structure of several");
    }
    type->type.big_endian = letters(store, *values[1]) == ">";
    return;
  }
  if (auto* object = std::get_if<PythonObject>(&value.content)) {
    if (!std::holds_alternative<PythonDictionary>(state.content)) refuse(store, "a dictionary", python_excerpt(state));
    object->state = &state;
    return;
  }
  refuse(store, "an array or another value with a state", python_excerpt(value));
}

}  // namespace arah

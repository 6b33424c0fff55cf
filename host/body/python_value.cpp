#include "host/body/python_value.h"

#include <bit>
#include <charconv>
#include <cmath>
#include <cstring>
#include <limits>

#include "host/input_error.h"

namespace arah {
namespace {

template <typename Bits>
Bits stored_bits(const char* bytes, bool big_endian) {
  Bits bits = 0;
  for (std::size_t i = 0; i < sizeof(Bits); ++i) {
    const auto byte = static_cast<unsigned char>(bytes[big_endian ? i : sizeof(Bits) - 1 - i]);
    bits = static_cast<Bits>(bits << 8 | byte);
  }
  return bits;
}

// IEEE 754's half: sign, 5 bits of exponent, 10 of fraction.
double half_value(std::uint16_t bits) {
  const int exponent = bits >> 10 & 31, fraction = bits & 1023;
  double value = exponent == 0 ? std::ldexp(fraction, -24) : std::ldexp(fraction + 1024, exponent - 25);
  if (exponent == 31) value = fraction ? std::nan("") : std::numeric_limits<double>::infinity();
  return bits >> 15 ? -value : value;
}

double stored_number(const ElementType& type, const char* bytes) {
  switch (type.size) {
    case 1: {
      const auto bits = static_cast<std::uint8_t>(bytes[0]);
      return type.kind == 'i' ? static_cast<std::int8_t>(bits) : bits;
    }
    case 2: {
      const auto bits = stored_bits<std::uint16_t>(bytes, type.big_endian);
      if (type.kind == 'f') return half_value(bits);
      return type.kind == 'i' ? static_cast<std::int16_t>(bits) : bits;
    }
    case 4: {
      const auto bits = stored_bits<std::uint32_t>(bytes, type.big_endian);
      if (type.kind == 'f') return double{std::bit_cast<float>(bits)};
      return type.kind == 'i' ? static_cast<double>(static_cast<std::int32_t>(bits)) : static_cast<double>(bits);
    }
    default: {
      const auto bits = stored_bits<std::uint64_t>(bytes, type.big_endian);
      if (type.kind == 'f') return std::bit_cast<double>(bits);
      return type.kind == 'i' ? static_cast<double>(static_cast<std::int64_t>(bits)) : static_cast<double>(bits);
    }
  }
}

std::string printable(std::string_view text) {
  std::string shown;
  for (const char letter : text.substr(0, 50)) shown += letter >= ' ' && letter <= '~' ? letter : '?';
  return text.size() > 50 ? shown + "..." : shown;
}

void append_letter(std::string& text, std::uint32_t letter) {
  if (letter < 0x80) {
    text += static_cast<char>(letter);
  } else if (letter < 0x800) {
    text += static_cast<char>(0xc0 | letter >> 6);
    text += static_cast<char>(0x80 | (letter & 63));
  } else if (letter < 0x10000) {
    text += static_cast<char>(0xe0 | letter >> 12);
    text += static_cast<char>(0x80 | (letter >> 6 & 63));
    text += static_cast<char>(0x80 | (letter & 63));
  } else {
    text += static_cast<char>(0xf0 | (letter >> 18 & 7));
    text += static_cast<char>(0x80 | (letter >> 12 & 63));
    text += static_cast<char>(0x80 | (letter >> 6 & 63));
    text += static_cast<char>(0x80 | (letter & 63));
  }
}

const PythonArray* as_array(const PythonValue& value) {
  const auto* array = std::get_if<std::unique_ptr<PythonArray>>(&value.content);
  return array ? array->get() : nullptr;
}

bool holds_letters(const PythonArray& array) { return array.type.kind == 'S' || array.type.kind == 'U'; }

std::string stored_text(const PythonArray& array, std::size_t place) {
  const std::string_view stored = array.data.substr(place * array.type.size, array.type.size);
  std::string text;
  if (array.type.kind == 'S') text = std::string(stored);
  for (std::size_t at = 0; array.type.kind == 'U' && at + 4 <= stored.size(); at += 4) {
    append_letter(text, stored_bits<std::uint32_t>(stored.data() + at, array.type.big_endian));
  }
  return text.substr(0, text.find('\0'));  // shorter texts are filled up with zeros
}

// Lists may share what they contain, so that a small file could stand for any number of numbers, of texts, or of lists of nothing.
constexpr std::size_t kMostNumbers = std::size_t{1} << 24, kMostTexts = 1'000'000, kMostTextBytes = 100'000'000;

// Appends the numbers of a value; false where it is something else or has too many. Lists of lists at most three deep.
bool append_numbers(const PythonValue& value, int depth, std::vector<double>& numbers, std::size_t& visited) {
  if (numbers.size() >= kMostNumbers || ++visited > kMostNumbers) return false;
  if (const auto* truth = std::get_if<bool>(&value.content)) {
    numbers.push_back(*truth ? 1.0 : 0.0);
  } else if (const auto* integer = std::get_if<std::int64_t>(&value.content)) {
    numbers.push_back(static_cast<double>(*integer));
  } else if (const auto* real = std::get_if<double>(&value.content)) {
    numbers.push_back(*real);
  } else if (const PythonArray* array = as_array(value); array && array->numeric()) {
    if (array->size() > kMostNumbers - numbers.size()) return false;
    for (std::size_t i = 0; i < array->size(); ++i) numbers.push_back(array->number(i));
  } else if (const auto* list = std::get_if<PythonList>(&value.content); list && depth > 0) {
    for (const PythonValue* item : list->items) {
      if (!append_numbers(*item, depth - 1, numbers, visited)) return false;
    }
  } else {
    return false;
  }
  return true;
}

std::string shape_text(const std::vector<std::size_t>& shape) {
  std::string text;
  for (const std::size_t length : shape) text += fmt::format("{}{}", text.empty() ? "" : "x", length);
  return text.empty() ? "a single element" : text;
}

}  // namespace

ElementType element_type(std::string_view notation, const std::string& where, const std::string& field) {
  ElementType type;
  std::string_view rest = notation;
  if (!rest.empty() && std::string_view("<>=|").find(rest[0]) != rest.npos) {
    type.big_endian = rest[0] == '>';
    rest.remove_prefix(1);
  }
  type.kind = rest.empty() ? '?' : rest[0];
  type.size = 0;
  const char* end = rest.data() + rest.size();
  bool known = std::string_view("biufSUO").find(type.kind) != std::string_view::npos;
  if (known && rest.size() > 1) {
    const auto [stop, error] = std::from_chars(rest.data() + 1, end, type.size);
    known = error == std::errc() && stop == end && type.size < (std::size_t{1} << 20);
  }
  if (type.kind == 'O') type.size = 0;
  if (type.kind == 'U') type.size *= 4;
  const std::size_t size = type.size;
  if (type.kind == 'b') known = known && size == 1;
  if (type.kind == 'i' || type.kind == 'u') known = known && (size == 1 || size == 2 || size == 4 || size == 8);
  if (type.kind == 'f') known = known && (size == 2 || size == 4 || size == 8);
  if (!known) {
    throw InputError(where, field, "elements that are numbers, texts or plain values", "'" + printable(notation) + "'");
  }
  return type;
}

std::size_t PythonArray::size() const {
  std::size_t count = 1;
  for (const std::size_t length : shape) count *= length;
  return count;
}

std::size_t PythonArray::stored_place(std::size_t place) const {
  if (!fortran_order) return place;
  std::size_t stored = 0, rest = place, stride = size();
  for (std::size_t axis = shape.size(); axis-- > 0;) {
    stride /= shape[axis];
    stored += rest % shape[axis] * stride;
    rest /= shape[axis];
  }
  return stored;
}

double PythonArray::number(std::size_t place) const {
  return stored_number(type, data.data() + stored_place(place) * type.size);
}

std::string python_excerpt(const PythonValue& value) {
  struct Words {
    std::string operator()(const PythonNone&) const { return "None"; }
    std::string operator()(bool truth) const { return truth ? "True" : "False"; }
    std::string operator()(std::int64_t number) const { return fmt::format("{}", number); }
    std::string operator()(double number) const { return fmt::format("{}", number); }
    std::string operator()(std::string_view text) const { return "'" + printable(text) + "'"; }
    std::string operator()(const PythonBytes& bytes) const { return fmt::format("{} bytes", bytes.content.size()); }
    std::string operator()(const PythonList& list) const { return fmt::format("a list of {}", list.items.size()); }
    std::string operator()(const PythonDictionary& dictionary) const {
      return fmt::format("a dictionary of {}", dictionary.items.size());
    }
    std::string operator()(const std::unique_ptr<PythonArray>& array) const {
      return fmt::format("an array of {} ('{}{}')", shape_text(array->shape), array->type.kind, array->type.size);
    }
    std::string operator()(const PythonObject& object) const { return "a " + printable(object.type); }
    std::string operator()(const PythonName& name) const { return printable(name.name); }
    std::string operator()(const PythonElementType&) const { return "a type of elements"; }
  };
  return std::visit(Words(), value.content);
}

const PythonValue* python_find(const PythonValue& value, std::string_view name) {
  if (const auto* object = std::get_if<PythonObject>(&value.content)) {
    return object->state ? python_find(*object->state, name) : nullptr;
  }
  const auto* dictionary = std::get_if<PythonDictionary>(&value.content);
  if (!dictionary) return nullptr;
  // Python keeps the last of equal keys.
  for (auto item = dictionary->items.rbegin(); item != dictionary->items.rend(); ++item) {
    const auto* text = std::get_if<std::string_view>(&item->first->content);
    const auto* bytes = std::get_if<PythonBytes>(&item->first->content);
    if ((text && *text == name) || (bytes && bytes->content == name)) return item->second;
  }
  return nullptr;
}

const PythonValue& python_member(const PythonValue& dictionary, std::string_view name, const std::string& where,
                                 const std::string& field) {
  const bool has_members = std::holds_alternative<PythonDictionary>(dictionary.content) ||
                           std::holds_alternative<PythonObject>(dictionary.content);
  if (!has_members) throw InputError(where, field, "a dictionary", python_excerpt(dictionary));
  if (const PythonValue* found = python_find(dictionary, name)) return *found;
  throw InputError(where, field.empty() ? std::string(name) : fmt::format("{} {}", field, name), "this entry", "none");
}

const std::vector<const PythonValue*>& python_items(const PythonValue& value, long count, const std::string& where,
                                                    const std::string& field) {
  const std::vector<const PythonValue*>* items = nullptr;
  if (const auto* list = std::get_if<PythonList>(&value.content)) items = &list->items;
  const PythonArray* array = as_array(value);
  if (array && array->type.kind == 'O' && array->shape.size() == 1) items = &array->items;
  if (!items) throw InputError(where, field, "a list", python_excerpt(value));
  if (count >= 0 && items->size() != static_cast<std::size_t>(count)) {
    throw InputError(where, field, fmt::format("{} values", count), fmt::format("{}", items->size()));
  }
  return *items;
}

std::string python_text(const PythonValue& value, const std::string& where, const std::string& field) {
  if (const auto* text = std::get_if<std::string_view>(&value.content)) return std::string(*text);
  if (const auto* bytes = std::get_if<PythonBytes>(&value.content)) return std::string(bytes->content);
  const PythonArray* array = as_array(value);
  if (array && array->size() == 1 && array->type.kind == 'O') {
    const PythonValue& only = *array->items[0];
    if (std::holds_alternative<std::string_view>(only.content)) return python_text(only, where, field);
  }
  if (array && array->size() == 1 && holds_letters(*array)) return stored_text(*array, 0);
  throw InputError(where, field, "a text", python_excerpt(value));
}

std::vector<std::string> python_texts(const PythonValue& value, const std::string& where, const std::string& field) {
  std::vector<std::string> texts;
  std::size_t bytes = 0;
  const auto add = [&](std::string text) {
    bytes += text.size();
    if (texts.size() >= kMostTexts || bytes > kMostTextBytes) throw InputError(where, field, fmt::format("at most {} texts of {} bytes", kMostTexts, kMostTextBytes), "more");
    texts.push_back(std::move(text));
  };
  const PythonArray* array = as_array(value);
  if (array && holds_letters(*array) && array->type.size > 0 && array->shape.size() == 1) {
    for (std::size_t i = 0; i < array->size(); ++i) add(stored_text(*array, i));
  } else {
    for (const PythonValue* item : python_items(value, -1, where, field)) add(python_text(*item, where, field));
  }
  return texts;
}

std::int64_t python_integer(const PythonValue& value, const std::string& where, const std::string& field) {
  const std::vector<double> number = python_numbers(value, 1, where, field);
  if (number[0] != std::floor(number[0]) || std::abs(number[0]) > 0x1p53) {
    throw InputError(where, field, "an integer", python_excerpt(value));
  }
  return static_cast<std::int64_t>(number[0]);
}

const PythonArray& python_array(const PythonValue& value, const std::vector<long>& shape, const std::string& where,
                                const std::string& field) {
  std::string wanted;
  for (const long length : shape) {
    wanted += (wanted.empty() ? "" : "x") + (length < 0 ? "N" : fmt::format("{}", length));
  }
  const PythonArray* array = as_array(value);
  bool fits = array && array->numeric() && array->shape.size() == shape.size();
  for (std::size_t axis = 0; fits && axis < shape.size(); ++axis) {
    fits = shape[axis] < 0 || array->shape[axis] == static_cast<std::size_t>(shape[axis]);
  }
  if (!fits) throw InputError(where, field, fmt::format("an array of {} numbers", wanted), python_excerpt(value));
  return *array;
}

std::vector<double> python_numbers(const PythonValue& value, long count, const std::string& where,
                                   const std::string& field) {
  std::vector<double> numbers;
  std::size_t visited = 0;
  if (!append_numbers(value, 3, numbers, visited)) throw InputError(where, field, "numbers", python_excerpt(value));
  if (count >= 0 && numbers.size() != static_cast<std::size_t>(count)) {
    throw InputError(where, field, fmt::format("{} numbers", count), python_excerpt(value));
  }
  for (const double number : numbers) {
    if (!std::isfinite(number)) throw InputError(where, field, "finite numbers", fmt::format("{}", number));
  }
  return numbers;
}

}  // namespace arah

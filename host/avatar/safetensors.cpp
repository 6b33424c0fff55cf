#include "host/avatar/safetensors.h"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <zlib.h>

#include <algorithm>
#include <bit>
#include <cstring>
#include <fstream>
#include <limits>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <stdexcept>
#include <tuple>
#include <type_traits>
#include <utility>

#include "host/body/json_text.h"
#include "host/file_writing.h"
#include "host/input_error.h"

namespace arah {
namespace {

using nlohmann::json;

static_assert(std::endian::native == std::endian::little, "safetensors data is little-endian");

constexpr const char* kMetadataName = "__metadata__";
constexpr const char* kKnownTypes = "F32, F64, I32, I64 or U8";
constexpr uint64_t kLargestHeader = 100'000'000;  // the limit of the format's own library
constexpr const char* kDamaged = "The file is damaged or was cut short: write or copy it again.";
constexpr const char* kChecksumName = "arah.crc32";  // in the metadata
constexpr const char* kNoChecksum = "00000000";      // stands in its place while it is formed

std::optional<size_t> element_size(const std::string& dtype) {
  if (dtype == "F64" || dtype == "I64") return 8;
  if (dtype == "F32" || dtype == "I32") return 4;
  if (dtype == "U8") return 1;
  return std::nullopt;
}

template <typename T>
constexpr const char* dtype_of() {
  if constexpr (std::is_same_v<T, float>) return "F32";
  if constexpr (std::is_same_v<T, double>) return "F64";
  if constexpr (std::is_same_v<T, int32_t>) return "I32";
  if constexpr (std::is_same_v<T, int64_t>) return "I64";
  if constexpr (std::is_same_v<T, uint8_t>) return "U8";
}

// The product of the shape, or nothing when an extent is negative or the product leaves int64.
std::optional<int64_t> product(const std::vector<int64_t>& shape) {
  // A 0 anywhere makes the product 0, however large the other extents are.
  if (std::any_of(shape.begin(), shape.end(), [](int64_t extent) { return extent < 0; })) return std::nullopt;
  if (std::find(shape.begin(), shape.end(), 0) != shape.end()) return 0;
  int64_t count = 1;
  for (int64_t extent : shape) {
    if (extent > std::numeric_limits<int64_t>::max() / count) return std::nullopt;
    count *= extent;
  }
  return count;
}

std::string in_words(const std::vector<int64_t>& shape) {
  return fmt::format("[{}]", fmt::join(shape, ", "));
}

template <typename To, typename From>
std::vector<To> convert(const std::vector<std::byte>& data, int64_t count, const std::string& dtype) {
  if (data.size() / sizeof(From) != static_cast<size_t>(count) || data.size() % sizeof(From) != 0) {
    throw std::invalid_argument(
        fmt::format("a tensor of {} numbers of type {} holds {} bytes", count, dtype, data.size()));
  }
  std::vector<From> stored(static_cast<size_t>(count));
  if (count > 0) std::memcpy(stored.data(), data.data(), data.size());
  if constexpr (std::is_same_v<To, From>) {
    return stored;
  } else {
    std::vector<To> result(stored.size());
    for (size_t i = 0; i < stored.size(); ++i) {
      if constexpr (std::is_integral_v<To>) {
        if constexpr (std::is_floating_point_v<From>) {
          throw InputError("tensor", "dtype", "an integer type", dtype);
        } else if (!std::in_range<To>(stored[i])) {
          throw InputError("tensor", fmt::format("number {}", i), fmt::format("a value that fits {}", dtype_of<To>()),
                           fmt::format("{}", stored[i]));
        }
      }
      result[i] = static_cast<To>(stored[i]);
    }
    return result;
  }
}

// One entry of the header, checked against itself; the ranges are checked against each other by the caller.
struct Entry {
  std::string name;
  std::string dtype;
  std::vector<int64_t> shape;
  uint64_t begin = 0;
  uint64_t end = 0;
};

Entry parse_entry(const std::string& file, const std::string& name, const json& value, uint64_t data_size) {
  const std::string field = fmt::format("tensor \"{}\"", name);
  auto fail = [&](const char* part, const std::string& expected, const std::string& found) {
    return InputError(file, fmt::format("{}: {}", field, part), expected, found, kDamaged);
  };
  if (!value.is_object()) throw fail("entry", "an object with dtype, shape and data_offsets", value.type_name());
  Entry entry;
  entry.name = name;
  const auto dtype = value.find("dtype");
  if (dtype == value.end() || !dtype->is_string()) throw fail("dtype", kKnownTypes, "no string");
  entry.dtype = dtype->get<std::string>();
  const auto size = element_size(entry.dtype);
  if (!size)
    throw InputError(file, field + ": dtype", kKnownTypes, entry.dtype, "Convert the tensor before storing it.");

  const auto shape = value.find("shape");
  if (shape == value.end() || !shape->is_array()) throw fail("shape", "an array of extents", "none");
  for (const json& extent : *shape) {
    if (!extent.is_number_unsigned() || extent.get<uint64_t>() > uint64_t{std::numeric_limits<int64_t>::max()}) {
      throw fail("shape", "whole numbers of at least 0", extent.dump(-1, ' ', true, json::error_handler_t::replace));
    }
    entry.shape.push_back(extent.get<int64_t>());
  }

  const auto offsets = value.find("data_offsets");
  if (offsets == value.end() || !offsets->is_array() || offsets->size() != 2 || !(*offsets)[0].is_number_unsigned() ||
      !(*offsets)[1].is_number_unsigned()) {
    throw fail("data_offsets", "two whole numbers of at least 0", offsets == value.end() ? "none" : "something else");
  }
  entry.begin = (*offsets)[0].get<uint64_t>();
  entry.end = (*offsets)[1].get<uint64_t>();
  if (entry.begin > entry.end || entry.end > data_size) {
    throw fail("data_offsets", fmt::format("a range inside the {} data bytes of the file", data_size),
               fmt::format("[{}, {}]", entry.begin, entry.end));
  }
  const auto count = product(entry.shape);
  const uint64_t bytes = entry.end - entry.begin;
  if (!count || static_cast<uint64_t>(*count) > bytes / *size || static_cast<uint64_t>(*count) * *size != bytes) {
    throw fail("shape", fmt::format("the shape of {} bytes of {}", bytes, entry.dtype), in_words(entry.shape));
  }
  return entry;
}

// The JSON header; a name given twice is an error rather than a silent choice.
json parse_header(const std::string& file, const std::string& text) {
  std::set<std::string> names;
  std::string repeated;
  const auto watch = [&](int depth, json::parse_event_t event, json& parsed) {
    if (event == json::parse_event_t::key && depth == 1 && !names.insert(parsed.get<std::string>()).second) {
      repeated = parsed.get<std::string>();
    }
    return true;
  };
  check_json_text(text, file, "header");
  json header;
  try {
    header = json::parse(text, watch);
  } catch (const json::exception& error) {
    throw InputError(file, "header", "JSON", error.what(), kDamaged);
  }
  if (!header.is_object()) throw InputError(file, "header", "a JSON object", header.type_name(), kDamaged);
  if (!repeated.empty()) {
    throw InputError(file, fmt::format("tensor \"{}\"", repeated), "one entry", "several", "Rename one of them.");
  }
  return header;
}

// CRC-32 of the bytes that one call after the other is given.
class Checksum {
 public:
  void add(const void* data, uint64_t size) {
    if (size > 0) value_ = crc32_z(value_, static_cast<const Bytef*>(data), size);  // of no data, zlib gives its first value again
  }
  std::string text() const { return fmt::format("{:08x}", value_); }

 private:
  uLong value_ = crc32_z(0, nullptr, 0);
};

// Where the digits of the checksum stand in a header as write_safetensors() writes it: a quotation mark within a name or a value would be
// escaped, so there is one such place. npos: none.
size_t checksum_place(const std::string& header, const std::string& digits) {
  const std::string before = fmt::format("\"{}\":\"", kChecksumName);
  const size_t found = digits.size() == std::strlen(kNoChecksum) ? header.find(before + digits + '"') : std::string::npos;
  return found == std::string::npos ? found : found + before.size();
}

// The ranges must fill [0, data_size) without gap or overlap.
void check_ranges(const std::string& file, std::vector<Entry>& entries, uint64_t data_size) {
  std::sort(entries.begin(), entries.end(), [](const Entry& a, const Entry& b) {
    return std::tie(a.begin, a.end, a.name) < std::tie(b.begin, b.end, b.name);
  });
  uint64_t filled = 0;
  for (const Entry& entry : entries) {
    if (entry.begin != filled) {
      throw InputError(file, fmt::format("tensor \"{}\": data_offsets", entry.name),
                       fmt::format("a range that starts at {}, where the one before ends", filled),
                       fmt::format("[{}, {}]", entry.begin, entry.end), kDamaged);
    }
    filled = entry.end;
  }
  if (filled != data_size) {
    throw InputError(file, "data", fmt::format("{} bytes, as the header lists", filled), fmt::format("{}", data_size),
                     kDamaged);
  }
}

}  // namespace

int64_t Tensor::count() const {
  const auto count = product(shape);
  if (!count) throw std::invalid_argument("a tensor cannot have the shape " + in_words(shape));
  return *count;
}

template <typename T>
std::vector<T> Tensor::as() const {
  if (dtype == "F32") return convert<T, float>(data, count(), dtype);
  if (dtype == "F64") return convert<T, double>(data, count(), dtype);
  if (dtype == "I32") return convert<T, int32_t>(data, count(), dtype);
  if (dtype == "I64") return convert<T, int64_t>(data, count(), dtype);
  if (dtype == "U8") return convert<T, uint8_t>(data, count(), dtype);
  throw std::invalid_argument(fmt::format("the tensor type is {}, not {}", dtype, kKnownTypes));
}

template <typename T>
Tensor Tensor::from(std::vector<int64_t> shape, std::span<const T> values) {
  Tensor tensor{dtype_of<T>(), std::move(shape), {}};
  if (static_cast<size_t>(tensor.count()) != values.size()) {
    throw std::invalid_argument(
        fmt::format("{} values for a tensor of shape {}", values.size(), in_words(tensor.shape)));
  }
  tensor.data.resize(values.size_bytes());
  if (!values.empty()) std::memcpy(tensor.data.data(), values.data(), values.size_bytes());
  return tensor;
}

const Tensor& SafetensorsFile::at(const std::string& name) const {
  const auto found = tensors.find(name);
  if (found == tensors.end()) {
    throw InputError(path.string(), fmt::format("tensor \"{}\"", name), "a tensor of this name", "none",
                     "The file may come from another program or version.");
  }
  return found->second;
}

template <typename T>
std::vector<T> SafetensorsFile::values(const std::string& name, const std::vector<int64_t>& shape) const {
  const Tensor& tensor = at(name);
  if (tensor.shape != shape) {
    throw InputError(path.string(), fmt::format("tensor \"{}\": shape", name), in_words(shape), in_words(tensor.shape));
  }
  try {
    return tensor.as<T>();
  } catch (const InputError& error) {
    throw InputError(fmt::format("{}: \"{}\": {}", path.string(), name, error.what()));
  }
}

#define ARAH_INSTANTIATE(T)                                                        \
  template std::vector<T> Tensor::as<T>() const;                                   \
  template Tensor Tensor::from<T>(std::vector<int64_t> shape, std::span<const T>); \
  template std::vector<T> SafetensorsFile::values<T>(const std::string& name, const std::vector<int64_t>&) const;
ARAH_INSTANTIATE(float)
ARAH_INSTANTIATE(double)
ARAH_INSTANTIATE(int32_t)
ARAH_INSTANTIATE(int64_t)
ARAH_INSTANTIATE(uint8_t)
#undef ARAH_INSTANTIATE

SafetensorsFile read_safetensors(const std::filesystem::path& path) {
  const std::string file = path.string();
  std::error_code error;
  if (!std::filesystem::is_regular_file(path, error)) {
    throw InputError(file, "", "a safetensors file", error ? error.message() : "no such file");
  }
  std::ifstream stream(path, std::ios::binary);
  const uint64_t file_size = std::filesystem::file_size(path, error);
  if (!stream || error)
    throw InputError(file, "", "a readable file", "one that cannot be opened", "Check its permissions.");
  auto read = [&](void* target, uint64_t size, const char* field) {
    stream.read(static_cast<char*>(target), static_cast<std::streamsize>(size));
    if (static_cast<uint64_t>(stream.gcount()) != size) {
      throw InputError(file, field, fmt::format("{} bytes", size), fmt::format("{}", stream.gcount()), kDamaged);
    }
  };

  uint64_t header_size = 0;
  if (file_size < sizeof header_size) {
    throw InputError(file, "header length", "8 bytes", fmt::format("a file of {}", file_size), kDamaged);
  }
  read(&header_size, sizeof header_size, "header length");
  const uint64_t largest = std::min(kLargestHeader, file_size - sizeof header_size);
  if (header_size > largest) {
    throw InputError(file, "header length", fmt::format("at most {}", largest), fmt::format("{}", header_size),
                     kDamaged);
  }
  std::string text(header_size, '\0');
  read(text.data(), header_size, "header");
  const uint64_t data_size = file_size - sizeof header_size - header_size;

  SafetensorsFile result;
  result.path = path;
  const json header = parse_header(file, text);
  std::vector<Entry> entries;
  for (const auto& [name, value] : header.items()) {
    if (name != kMetadataName) {
      entries.push_back(parse_entry(file, name, value, data_size));
      continue;
    }
    if (!value.is_object()) throw InputError(file, kMetadataName, "an object of strings", value.type_name(), kDamaged);
    for (const auto& [key, item] : value.items()) {
      if (!item.is_string()) {
        throw InputError(file, fmt::format("{}: \"{}\"", kMetadataName, key), "a string", item.type_name(), kDamaged);
      }
      result.metadata.emplace(key, item.get<std::string>());
    }
  }
  check_ranges(file, entries, data_size);
  // Files of other programs have none.
  std::optional<std::string> stated;
  if (auto node = result.metadata.extract(kChecksumName)) stated = std::move(node.mapped());
  if (const size_t place = checksum_place(text, stated.value_or("")); place != std::string::npos) text.replace(place, stated->size(), kNoChecksum);
  Checksum checksum;
  checksum.add(&header_size, sizeof header_size);
  checksum.add(text.data(), text.size());
  for (Entry& entry : entries) {
    Tensor tensor{std::move(entry.dtype), std::move(entry.shape), std::vector<std::byte>(entry.end - entry.begin)};
    read(tensor.data.data(), tensor.data.size(), entry.name.c_str());
    if (stated) checksum.add(tensor.data.data(), tensor.data.size());
    result.tensors.emplace(std::move(entry.name), std::move(tensor));
  }
  if (stated && checksum.text() != *stated) {
    throw InputError(file, fmt::format("{}: \"{}\"", kMetadataName, kChecksumName), fmt::format("{}, of what the file holds", checksum.text()), *stated,
                     "The file is damaged, or another program changed it: copy it again, or leave that entry out where a change was wanted.");
  }
  return result;
}

void write_safetensors(const std::filesystem::path& path, const SafetensorsFile& file) {
  struct Item {
    const std::string* name;
    const Tensor* tensor;
    size_t element;
  };
  std::vector<Item> items;
  for (const auto& [name, tensor] : file.tensors) {
    const auto size = element_size(tensor.dtype);
    const auto count = product(tensor.shape);
    if (name == kMetadataName || !size || !count || tensor.data.size() / *size != static_cast<uint64_t>(*count) ||
        tensor.data.size() % *size != 0) {
      throw std::invalid_argument(fmt::format("cannot store tensor \"{}\": dtype {}, shape {}, {} bytes", name,
                                              tensor.dtype, in_words(tensor.shape), tensor.data.size()));
    }
    items.push_back({&name, &tensor, *size});
  }
  std::stable_sort(items.begin(), items.end(), [](const Item& a, const Item& b) { return a.element > b.element; });

  json header = json::object();
  header[kMetadataName] = file.metadata;
  header[kMetadataName][kChecksumName] = kNoChecksum;
  uint64_t offset = 0;
  for (const Item& item : items) {
    const uint64_t end = offset + item.tensor->data.size();
    header[*item.name] = {
        {"dtype", item.tensor->dtype}, {"shape", item.tensor->shape}, {"data_offsets", {offset, end}}};
    offset = end;
  }
  std::string text;
  try {
    text = header.dump();
  } catch (const json::exception& error) {
    throw std::invalid_argument(
        fmt::format("{}: a name or a metadata value is no UTF-8: {}", path.string(), error.what()));
  }
  text.resize((text.size() + 7) / 8 * 8, ' ');
  if (text.size() > kLargestHeader) {
    throw std::invalid_argument(
        fmt::format("{}: the header would have {} bytes, more than {}", path.string(), text.size(), kLargestHeader));
  }

  const std::filesystem::path folder = path.has_parent_path() ? path.parent_path() : ".";
  if (std::error_code error; !std::filesystem::is_directory(folder, error)) {
    throw InputError(path.string(), "", "an existing folder", folder.string(), "Create it or choose another one.");
  }
  const uint64_t header_size = text.size();
  std::vector<uint8_t> bytes(sizeof header_size + header_size + offset);
  uint8_t* next = bytes.data();
  const auto put = [&next](const void* data, size_t size) {
    if (size > 0) std::memcpy(next, data, size);
    next += size;
  };
  put(&header_size, sizeof header_size);
  put(text.data(), text.size());
  for (const Item& item : items) put(item.tensor->data.data(), item.tensor->data.size());
  Checksum checksum;
  checksum.add(bytes.data(), bytes.size());
  std::memcpy(bytes.data() + sizeof header_size + checksum_place(text, kNoChecksum), checksum.text().data(), std::strlen(kNoChecksum));
  write_file_safely(path, std::span<const uint8_t>(bytes));
}

}  // namespace arah

#include "host/body/npy.h"

#include <algorithm>
#include <charconv>

#include "host/body/mapped_file.h"
#include "host/body/pickle.h"
#include "host/input_error.h"

namespace arah {
namespace {

constexpr std::string_view kMagic = "\x93NUMPY";
constexpr std::size_t kMostAxes = 32;             // NumPy's own limit
constexpr std::size_t kLongestHeader = 1 << 16;   // bytes

// Reads the header's text, a Python dictionary of three entries: {'descr': '<f8', 'fortran_order': False, 'shape': (3, 4), }
class HeaderText {
 public:
  HeaderText(std::string_view text, const std::string& where) : text_(text), where_(where) {}

  NpyHeader read() {
    NpyHeader header;
    unsigned seen = 0;
    expect('{');
    while (!take('}')) {
      const std::string_view key = quoted();
      expect(':');
      if (key == "descr") {
        skip_space();
        if (at_ < text_.size() && text_[at_] == '[') fail("elements of one kind", "a structure of several");
        header.type = element_type(quoted(), where_, "header");
        seen |= 1;
      } else if (key == "fortran_order") {
        header.fortran_order = truth();
        seen |= 2;
      } else if (key == "shape") {
        header.shape = shape();
        seen |= 4;
      } else {
        fail("descr, fortran_order and shape", "'" + std::string(key.substr(0, 40)) + "'");
      }
      if (!take(',')) {
        expect('}');
        break;
      }
    }
    if (seen != 7) fail("descr, fortran_order and shape", "a header that lacks one");
    return header;
  }

 private:
  [[noreturn]] void fail(const std::string& expected, const std::string& found) const {
    throw InputError(where_, "header", expected, found);
  }
  void skip_space() {
    while (at_ < text_.size() && (text_[at_] == ' ' || text_[at_] == '\n')) ++at_;
  }
  bool take(char letter) {
    skip_space();
    if (at_ >= text_.size() || text_[at_] != letter) return false;
    ++at_;
    return true;
  }
  void expect(char letter) {
    if (!take(letter)) fail(fmt::format("'{}' at letter {}", letter, at_), "something else");
  }
  std::string_view quoted() {
    const char quote = take('"') ? '"' : '\'';
    if (quote == '\'') expect('\'');
    const std::size_t end = text_.find(quote, at_);
    if (end == text_.npos) fail("a text that ends", "none");
    const std::string_view content = text_.substr(at_, end - at_);
    at_ = end + 1;
    return content;
  }
  bool truth() {
    skip_space();
    for (const std::string_view word : {"True", "False"}) {
      if (!text_.substr(at_).starts_with(word)) continue;
      at_ += word.size();
      return word == "True";
    }
    fail("True or False", "something else");
  }
  std::vector<std::size_t> shape() {
    std::vector<std::size_t> lengths;
    expect('(');
    while (!take(')')) {
      std::size_t length = 0;
      skip_space();
      const auto [stop, error] = std::from_chars(text_.data() + at_, text_.data() + text_.size(), length);
      if (error != std::errc() || lengths.size() == kMostAxes) fail("lengths of at most 32 axes", "something else");
      at_ = static_cast<std::size_t>(stop - text_.data());
      take('L');  // Python 2's long integers
      lengths.push_back(length);
      if (!take(',')) {
        expect(')');
        break;
      }
    }
    return lengths;
  }

  std::string_view text_;
  const std::string& where_;
  std::size_t at_ = 0;
};

}  // namespace

std::size_t checked_array_bytes(const std::vector<std::size_t>& shape, std::size_t size, const std::string& where,
                                const std::string& field) {
  constexpr std::size_t kMost = std::size_t{1} << 48;
  std::size_t bytes = std::max<std::size_t>(size, 1);
  bool empty = false;
  for (const std::size_t length : shape) {
    empty = empty || length == 0;
    if (length > kMost / bytes) throw InputError(where, field, "an array that fits into a file", "a larger one");
    bytes *= std::max<std::size_t>(length, 1);
  }
  return empty || size == 0 ? 0 : bytes;
}

std::size_t NpyHeader::data_bytes() const { return checked_array_bytes(shape, type.size, "", "shape"); }

NpyHeader read_npy_header(std::string_view bytes, const std::string& where) {
  if (!bytes.starts_with(kMagic) || bytes.size() < 10) {
    throw InputError(where, "", "a NumPy array (.npy)", bytes.empty() ? "an empty file" : "something else");
  }
  const auto byte = [&](std::size_t at) { return static_cast<std::size_t>(static_cast<unsigned char>(bytes[at])); };
  const std::size_t version = byte(6);
  if (version < 1 || version > 3) throw InputError(where, "version", "1 to 3", fmt::format("{}", version));
  std::size_t start = 10, length = byte(8) | byte(9) << 8;
  if (version > 1) {
    start = 12;
    if (bytes.size() >= start) length |= byte(10) << 16 | byte(11) << 24;
  }
  if (length > kLongestHeader || bytes.size() < start || bytes.size() - start < length) {
    throw InputError(where, "header", "a whole header", fmt::format("a file of {} bytes", bytes.size()), "Copy it again.");
  }
  NpyHeader header = HeaderText(bytes.substr(start, length), where).read();
  header.length = start + length;
  checked_array_bytes(header.shape, header.type.size, where, "shape");
  return header;
}

PythonData parse_npy(std::string_view bytes, const std::string& where) {
  const NpyHeader header = read_npy_header(bytes, where);
  const std::string_view rest = bytes.substr(header.length);
  if (header.type.kind == 'O') {
    PythonData data = parse_pickle(rest, where);
    const auto* array = std::get_if<std::unique_ptr<PythonArray>>(&data.root->content);
    if (array && (*array)->type.kind == 'O' && (*array)->shape.empty()) data.root = (*array)->items[0];
    return data;
  }
  if (rest.size() != header.data_bytes()) {
    throw InputError(where, "", fmt::format("{} bytes of elements", header.data_bytes()), fmt::format("{}", rest.size()),
                     rest.size() < header.data_bytes() ? "Copy it again." : "");
  }
  PythonData data;
  auto array = std::make_unique<PythonArray>();
  array->type = header.type;
  array->fortran_order = header.fortran_order;
  array->shape = header.shape;
  array->data = rest;
  data.values.emplace_back().content = std::move(array);
  data.root = &data.values.back();
  return data;
}

PythonData read_npy(const std::filesystem::path& path) {
  const auto file = std::make_shared<const MappedFile>(path);
  PythonData data = parse_npy(file->bytes(), path.string());
  data.file = file;
  return data;
}

}  // namespace arah

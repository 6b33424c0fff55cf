// Writes small .npy, .npz and pickle files as Python does, so that tests make the datasets that they read.
#pragma once

#include <zlib.h>

#include <cstdint>
#include <cstring>
#include <string>
#include <utility>
#include <vector>

namespace arah::python {

template <typename Number>
std::string raw(const std::vector<Number>& values) {
  std::string bytes(values.size() * sizeof(Number), '\0');
  if (!values.empty()) std::memcpy(bytes.data(), values.data(), bytes.size());
  return bytes;
}
inline std::string little(std::uint64_t value, int bytes) {
  std::string text;
  for (int i = 0; i < bytes; ++i) text += static_cast<char>(i < 8 ? value >> (8 * i) : 0);
  return text;
}
inline std::string tuple_text(const std::vector<std::size_t>& shape) {
  std::string text = "(";
  for (const std::size_t length : shape) text += std::to_string(length) + ", ";
  return text + ")";
}

// --- .npy

inline std::string npy(const std::string& type, const std::vector<std::size_t>& shape, const std::string& elements,
                       bool fortran = false, int version = 1) {
  std::string header = "{'descr': '" + type + "', 'fortran_order': " + (fortran ? "True" : "False") +
                       ", 'shape': " + tuple_text(shape) + ", }";
  header.resize((header.size() / 64 + 1) * 64, ' ');
  header.back() = '\n';
  return "\x93NUMPY" + std::string(1, static_cast<char>(version)) + '\0' +
         little(header.size(), version == 1 ? 2 : 4) + header + elements;
}
inline std::string npy(const std::vector<std::size_t>& shape, const std::vector<double>& values) {
  return npy("<f8", shape, raw(values));
}

// --- pickles (protocol 4). Each function gives the instructions that leave one value on the stack.

inline std::string text(const std::string& letters) { return "X" + little(letters.size(), 4) + letters; }
inline std::string bytes(const std::string& content) { return "B" + little(content.size(), 4) + content; }
inline std::string integer(std::int64_t value) { return "\x8a\x08" + little(static_cast<std::uint64_t>(value), 8); }
inline std::string real(double value) {
  std::string stored = raw(std::vector<double>{value});
  return "G" + std::string(stored.rbegin(), stored.rend());
}
inline std::string list(const std::vector<std::string>& items) {
  std::string all = "](";
  for (const std::string& item : items) all += item;
  return all + "e";
}
inline std::string tuple(const std::vector<std::string>& items) {
  std::string all = "(";
  for (const std::string& item : items) all += item;
  return all + "t";
}
inline std::string dictionary(const std::vector<std::pair<std::string, std::string>>& items) {
  std::string all = "}(";
  for (const auto& [key, value] : items) all += text(key) + value;
  return all + "u";
}
inline std::string name(const std::string& module, const std::string& word) { return "c" + module + "\n" + word + "\n"; }
inline std::string call(const std::string& callable, const std::vector<std::string>& arguments) {
  return callable + tuple(arguments) + "R";
}
// An object of `type` whose state is `state`, as pickles hold scipy's and chumpy's.
inline std::string instance(const std::string& module, const std::string& type, const std::string& state) {
  return name(module, type) + ")\x81" + state + "b";
}
inline std::string element_type(const std::string& type, const std::string& order = "<") {
  return call(name("numpy", "dtype"), {text(type), "\x89", "\x88"}) +
         tuple({integer(3), text(order), "N", "N", "N", integer(-1), integer(-1), integer(0)}) + "b";
}
inline std::string shape_of(const std::vector<std::size_t>& shape) {
  std::vector<std::string> lengths;
  for (const std::size_t length : shape) lengths.push_back(integer(static_cast<std::int64_t>(length)));
  return tuple(lengths);
}
inline std::string array(const std::string& type, const std::vector<std::size_t>& shape, const std::string& elements) {
  return call(name("numpy.core.multiarray", "_reconstruct"), {name("numpy", "ndarray"), tuple({integer(0)}), bytes("b")}) +
         tuple({integer(1), shape_of(shape), element_type(type), "\x89", elements}) + "b";
}
inline std::string array(const std::vector<std::size_t>& shape, const std::vector<double>& values) {
  return array("f8", shape, bytes(raw(values)));
}
// A file of one value; as np.save writes one that is no array.
inline std::string pickle(const std::string& value) { return "\x80\x04" + value + "."; }
inline std::string npy_of_value(const std::string& value) {
  return npy("|O", {}, pickle(array("O8", {}, list({value}))));
}

// --- .npz

struct Member {
  std::string name, content;
  bool deflated = true;
  std::int64_t claimed_size = -1;  // instead of the true one
};

inline std::string deflated(const std::string& content) {
  z_stream stream{};
  deflateInit2(&stream, Z_BEST_COMPRESSION, Z_DEFLATED, -MAX_WBITS, 9, Z_DEFAULT_STRATEGY);
  std::string packed(compressBound(content.size()) + 64, '\0');
  stream.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(content.data()));
  stream.avail_in = static_cast<uInt>(content.size());
  stream.next_out = reinterpret_cast<Bytef*>(packed.data());
  stream.avail_out = static_cast<uInt>(packed.size());
  deflate(&stream, Z_FINISH);
  packed.resize(stream.total_out);
  deflateEnd(&stream);
  return packed;
}

inline std::string zip(const std::vector<Member>& members) {
  std::string file, contents;
  for (const Member& member : members) {
    const std::string packed = member.deflated ? deflated(member.content) : member.content;
    const std::uint64_t size = member.claimed_size < 0 ? member.content.size() : static_cast<std::uint64_t>(member.claimed_size);
    const std::uint64_t checksum = crc32_z(0, reinterpret_cast<const Bytef*>(member.content.data()), member.content.size());
    const std::string common = little(20, 2) + little(0, 2) + little(member.deflated ? 8 : 0, 2) + little(0, 4) +
                               little(checksum, 4) + little(packed.size(), 4) + little(size, 4) + little(member.name.size(), 2);
    contents += "PK\1\2" + little(20, 2) + common + little(0, 12) + little(file.size(), 4) + member.name;
    file += "PK\3\4" + common + little(0, 2) + member.name + packed;
  }
  const std::uint64_t start = file.size();
  return file + contents + "PK\5\6" + little(0, 4) + little(members.size(), 2) + little(members.size(), 2) +
         little(contents.size(), 4) + little(start, 4) + little(0, 2);
}
// As np.savez does: each array in a member of its name.
inline std::string npz(const std::vector<std::pair<std::string, std::string>>& arrays, bool deflate_them = true) {
  std::vector<Member> members;
  for (const auto& [array_name, content] : arrays) members.push_back({array_name + ".npy", content, deflate_them});
  return zip(members);
}

}  // namespace arah::python

#include "host/body/npz.h"

#include <zlib.h>

#include <algorithm>

#include "host/body/npy.h"
#include "host/body/pickle.h"
#include "host/input_error.h"

namespace arah {
namespace {

constexpr std::size_t kEndRecord = 22, kCentralHeader = 46, kLocalHeader = 30;  // bytes of zip's records
constexpr std::size_t kMostMembers = 10'000;
constexpr std::size_t kSmallMember = 16'000'000;  // bytes
constexpr std::size_t kHeaderRoom = 1 << 12;      // bytes of a member in which its .npy header is looked for first

std::uint64_t little_endian(std::string_view bytes, std::size_t at, std::size_t count) {
  std::uint64_t value = 0;
  for (std::size_t i = count; i-- > 0;) value = value << 8 | static_cast<unsigned char>(bytes[at + i]);
  return value;
}

// The first `size` bytes of what `packed` inflates to; fewer where it ends before.
std::string inflated(std::string_view packed, std::size_t size, const std::string& where) {
  std::string bytes(size, '\0');
  z_stream stream{};
  if (inflateInit2(&stream, -MAX_WBITS) != Z_OK) throw std::runtime_error("zlib cannot be started");
  std::size_t read = 0, written = 0;
  int state = Z_OK;
  while (state == Z_OK && written < size) {
    stream.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(packed.data() + read));
    stream.avail_in = static_cast<uInt>(std::min<std::size_t>(packed.size() - read, 1 << 30));
    stream.next_out = reinterpret_cast<Bytef*>(bytes.data() + written);
    stream.avail_out = static_cast<uInt>(std::min<std::size_t>(size - written, 1 << 30));
    const uInt in = stream.avail_in, out = stream.avail_out;
    state = inflate(&stream, Z_NO_FLUSH);
    read += in - stream.avail_in;
    written += out - stream.avail_out;
    if (state == Z_BUF_ERROR) break;  // the packed bytes end too early
  }
  inflateEnd(&stream);
  if (state != Z_OK && state != Z_STREAM_END && state != Z_BUF_ERROR) {
    throw InputError(where, "", "deflated data", "damaged data", "Copy it again.");
  }
  bytes.resize(written);
  return bytes;
}

}  // namespace

NpzFile::NpzFile(const std::filesystem::path& path) : where_(path.string()), file_(std::make_shared<const MappedFile>(path)) {
  const std::string_view bytes = file_->bytes();
  const auto broken = [&](const std::string& found) {
    return InputError(where_, "", "a whole zip archive (.npz)", found, "Copy it again.");
  };
  if (!bytes.starts_with("PK") || bytes.size() < kEndRecord) {
    throw InputError(where_, "", "a zip archive (.npz)", bytes.empty() ? "an empty file" : "something else");
  }
  // The record at the end may be followed by a comment of up to 65,535 bytes.
  using namespace std::string_view_literals;
  const std::size_t end = bytes.rfind("PK\5\6"sv);
  if (end == bytes.npos || bytes.size() - end < kEndRecord || bytes.size() - end > kEndRecord + 65'535) {
    throw broken(fmt::format("none that ends within {} bytes", bytes.size()));
  }
  const std::size_t count = little_endian(bytes, end + 10, 2);
  std::size_t at = little_endian(bytes, end + 16, 4);
  if (count > kMostMembers) throw broken(fmt::format("{} members", count));
  for (std::size_t i = 0; i < count; ++i) {
    if (at > end || end - at < kCentralHeader || bytes.substr(at, 4) != "PK\1\2"sv) throw broken("a damaged list of contents");
    const std::size_t name_length = little_endian(bytes, at + 28, 2), extra_length = little_endian(bytes, at + 30, 2);
    const std::size_t length = kCentralHeader + name_length + extra_length + little_endian(bytes, at + 32, 2);
    if (end - at < length) throw broken("a damaged list of contents");
    std::string name(bytes.substr(at + kCentralHeader, name_length));
    if (name.ends_with(".npy")) name.resize(name.size() - 4);
    std::replace_if(name.begin(), name.end(), [](char letter) { return letter < ' ' || letter > '~'; }, '?');
    Member member;
    const std::uint64_t flags = little_endian(bytes, at + 8, 2), method = little_endian(bytes, at + 10, 2);
    member.deflated = method == Z_DEFLATED;
    member.checksum = static_cast<std::uint32_t>(little_endian(bytes, at + 16, 4));
    member.packed = little_endian(bytes, at + 20, 4);
    member.size = little_endian(bytes, at + 24, 4);
    member.offset = little_endian(bytes, at + 42, 4);
    if (flags & 1) throw InputError(where_, name, "a member that is not encrypted", "an encrypted one");
    if (method != 0 && method != Z_DEFLATED) throw InputError(where_, name, "a stored or deflated member", fmt::format("method {}", method));
    if (member.offset > bytes.size() || bytes.size() - member.offset < kLocalHeader || member.packed > bytes.size()) {
      throw broken(fmt::format("member '{}' outside of it", name));
    }
    if (!members_.emplace(name, member).second) throw InputError(where_, name, "each member once", "this one twice");
    at += length;
  }
}

std::vector<std::string> NpzFile::names() const {
  std::vector<std::string> names;
  for (const auto& [name, member] : members_) names.push_back(name);
  return names;
}

std::string_view NpzFile::packed_bytes(const Member& member, const std::string& where) const {
  const std::string_view bytes = file_->bytes();
  const std::size_t start = member.offset + kLocalHeader + little_endian(bytes, member.offset + 26, 2) + little_endian(bytes, member.offset + 28, 2);
  if (!bytes.substr(member.offset).starts_with("PK\3\4") || start > bytes.size() || bytes.size() - start < member.packed) {
    throw InputError(where, "", "a whole member", "one that lies outside of the file", "Copy it again.");
  }
  return bytes.substr(start, member.packed);
}

PythonData NpzFile::read(const std::string& name) const {
  const auto found = members_.find(name);
  if (found == members_.end()) throw InputError(where_, name, "this array", "none");
  const Member& member = found->second;
  const std::string where = where_ + " " + name;
  const std::string_view packed = packed_bytes(member, where);
  // The array's own header is looked at before the rest is inflated, so that a size that is claimed costs nothing.
  const std::size_t first = std::min(member.size, kHeaderRoom);
  std::string start;
  if (member.deflated) start = inflated(packed, first, where);
  const NpyHeader header = read_npy_header(member.deflated ? std::string_view(start) : packed, where);
  if (header.type.kind == 'O' ? member.size > kMostPickleOwnBytes : member.size != header.length + header.data_bytes()) {
    throw InputError(where, "", fmt::format("{} bytes, as its header says", header.length + header.data_bytes()), fmt::format("{}", member.size));
  }
  inflated_ += member.deflated ? member.size : 0;
  if (inflated_ > kMostNpzBytes) throw InputError(where, "", fmt::format("at most {} bytes inflated", kMostNpzBytes), "more");
  if (member.deflated && member.size > kSmallMember && member.size / kMostNpzGrowth > member.packed) {
    throw InputError(where, "", fmt::format("data that deflates to no less than a {}th", kMostNpzGrowth),
                     fmt::format("{} bytes in {}", member.size, member.packed), "Save it without compression if it is meant.");
  }
  auto content = std::make_shared<std::string>();
  if (member.deflated) *content = inflated(packed, member.size, where);
  const std::string_view bytes = member.deflated ? std::string_view(*content) : packed;
  if (bytes.size() != member.size) throw InputError(where, "", fmt::format("{} bytes", member.size), fmt::format("{}", bytes.size()), "Copy it again.");
  if (crc32_z(0, reinterpret_cast<const Bytef*>(bytes.data()), bytes.size()) != member.checksum) {
    throw InputError(where, "", "data that its checksum fits", "damaged data", "Copy it again.");
  }
  PythonData data = parse_npy(bytes, where);
  if (member.deflated) data.file = content;
  else data.file = file_;
  return data;
}

}  // namespace arah

#include "host/capture/hdf5_file.h"

#include <fmt/ranges.h>
#include <hdf5.h>
#include <zlib.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <fstream>
#include <mutex>
#include <utility>

#include "host/capture/lzf.h"
#include "host/input_error.h"

namespace arah {

// A handle of the library's, closed with its own function.
class Hdf5Handle {
 public:
  using Close = herr_t (*)(hid_t);
  Hdf5Handle() = default;
  Hdf5Handle(hid_t id, Close close) : id_(id), close_(close) {}
  Hdf5Handle(Hdf5Handle&& other) noexcept : id_(std::exchange(other.id_, -1)), close_(other.close_) {}
  Hdf5Handle& operator=(Hdf5Handle&& other) noexcept {
    std::swap(id_, other.id_);
    std::swap(close_, other.close_);
    return *this;
  }
  ~Hdf5Handle() {
    if (id_ >= 0) close_(id_);
  }
  operator hid_t() const { return id_; }

 private:
  hid_t id_ = -1;
  Close close_ = nullptr;
};

struct Hdf5Array {
  Hdf5Handle data, type;
  std::vector<hsize_t> shape;
  // Where it is stored in chunks: their shape, and the filters that made them, in that order.
  std::vector<hsize_t> chunk;
  std::vector<H5Z_filter_t> filters;
};

// The file as it is, for chunks.
struct Hdf5Bytes {
  std::ifstream stream;
  std::uintmax_t size = 0;
};

namespace {

constexpr H5Z_filter_t kLzfFilter = 32000;  // as h5py registered it

// The library speaks through its results alone, for this thread, and loads no code for filters that it lacks.
void quiet_hdf5() {
  static std::once_flag once;
  std::call_once(once, [] {
    H5open();
    H5PLset_loading_state(0);
  });
  H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr);
}

// The innermost of the library's reasons for what failed last.
std::string hdf5_reason() {
  std::string reason;
  const auto take = [](unsigned, const H5E_error2_t* error, void* text) -> herr_t {
    if (auto& first = *static_cast<std::string*>(text); first.empty() && error->desc) first = error->desc;
    return 0;
  };
  H5Ewalk2(H5E_DEFAULT, H5E_WALK_UPWARD, take, &reason);
  H5Eclear2(H5E_DEFAULT);
  std::replace(reason.begin(), reason.end(), '\n', ' ');
  return reason.empty() ? "something else" : "HDF5 says: " + reason.substr(0, 200);
}

std::string shape_text(const std::vector<hsize_t>& shape) { return shape.empty() ? "a single value" : fmt::format("{}", fmt::join(shape, "x")); }

// How the array is stored: in this file, in chunks of a bounded size, by filters that are undone here.
void read_storage(hid_t properties, Hdf5Array& array, const std::string& where, const std::string& name) {
  const H5D_layout_t layout = H5Pget_layout(properties);
  if ((layout != H5D_COMPACT && layout != H5D_CONTIGUOUS && layout != H5D_CHUNKED) || H5Pget_external_count(properties) != 0) {
    throw InputError(where, name, "an array that lies in the file itself", "one that refers to other files");
  }
  if (layout != H5D_CHUNKED) return;
  array.chunk.resize(array.shape.size(), 0);
  double bytes = static_cast<double>(H5Tget_size(array.type));
  const int axes = H5Pget_chunk(properties, static_cast<int>(array.chunk.size()), array.chunk.data());
  for (const hsize_t length : array.chunk) bytes *= static_cast<double>(length);
  if (axes != static_cast<int>(array.chunk.size()) || !(bytes >= 1 && bytes <= static_cast<double>(kMostHdf5ChunkBytes))) {
    throw InputError(where, name, fmt::format("chunks of at most {} bytes", kMostHdf5ChunkBytes), shape_text(array.chunk));
  }
  const int filters = H5Pget_nfilters(properties);
  for (int f = 0; f < filters; ++f) {
    unsigned flags = 0;
    std::size_t count = 0;
    char words[64] = {};
    const H5Z_filter_t filter = H5Pget_filter2(properties, static_cast<unsigned>(f), &flags, &count, nullptr, sizeof words, words, nullptr);
    if (filter != kLzfFilter && filter != H5Z_FILTER_DEFLATE && filter != H5Z_FILTER_SHUFFLE) {
      throw InputError(where, name, "data that is plain or compressed by deflate (gzip) or LZF", fmt::format("filter {} '{:.40}'", filter, words), "h5repack -f GZIP=4 rewrites it.");
    }
    array.filters.push_back(filter);
  }
}

Hdf5Array open_array(hid_t file, const std::string& where, const std::string& name, const std::vector<long>& expected) {
  H5L_info_t link{};
  if (H5Lexists(file, name.c_str(), H5P_DEFAULT) <= 0) throw InputError(where, name, "this array", "none");
  if (H5Lget_info(file, name.c_str(), &link, H5P_DEFAULT) < 0 || link.type != H5L_TYPE_HARD) {
    throw InputError(where, name, "an array that lies in the file itself", "a link");
  }
  Hdf5Array array;
  array.data = Hdf5Handle(H5Dopen2(file, name.c_str(), H5P_DEFAULT), H5Dclose);
  if (array.data < 0) throw InputError(where, name, "an array", hdf5_reason());
  array.type = Hdf5Handle(H5Dget_type(array.data), H5Tclose);
  const Hdf5Handle space(H5Dget_space(array.data), H5Sclose), properties(H5Dget_create_plist(array.data), H5Pclose);
  const int rank = space < 0 ? -1 : H5Sget_simple_extent_ndims(space);
  if (array.type < 0 || properties < 0 || rank < 0) throw InputError(where, name, "an array", hdf5_reason());
  array.shape.resize(static_cast<std::size_t>(rank));
  if (rank > 0) H5Sget_simple_extent_dims(space, array.shape.data(), nullptr);
  bool fits = array.shape.size() == expected.size();
  std::vector<std::string> axes;
  for (std::size_t a = 0; a < expected.size(); ++a) {
    fits = fits && (expected[a] < 0 || array.shape[a] == static_cast<hsize_t>(expected[a]));
    axes.push_back(expected[a] < 0 ? "N" : fmt::format("{}", expected[a]));
  }
  if (!fits) throw InputError(where, name, fmt::format("an array of {}", fmt::join(axes, "x")), shape_text(array.shape));
  read_storage(properties, array, where, name);
  return array;
}

// What a filter made of `size` bytes, made into them again; empty where it is not so many.
std::vector<std::uint8_t> undone(H5Z_filter_t filter, std::vector<std::uint8_t> bytes, std::size_t size, std::size_t element_bytes) {
  if (filter == kLzfFilter) return unpack_lzf(bytes, size);
  std::vector<std::uint8_t> plain(size);
  if (filter == H5Z_FILTER_DEFLATE) {
    uLongf given = size;
    if (uncompress(plain.data(), &given, bytes.data(), bytes.size()) != Z_OK || given != size) return {};
    return plain;
  }
  if (bytes.size() != size) return {};
  const std::size_t count = size / element_bytes;  // shuffled: the first bytes of all elements, then the second ones, …
  for (std::size_t b = 0; b < element_bytes; ++b) {
    for (std::size_t i = 0; i < count; ++i) plain[i * element_bytes + b] = bytes[b * count + i];
  }
  return plain;
}

// The chunk that begins at `place`, as plain elements; empty where none was ever written. The library says where it lies; its
// own reading of chunks trusts that filters give as much as a chunk has, and in a damaged file two of its answers may differ.
std::vector<std::uint8_t> read_chunk(const Hdf5Array& array, Hdf5Bytes& file, const hsize_t* place, std::size_t size, const std::string& where, const std::string& field) {
  hsize_t stored = 0;
  haddr_t address = HADDR_UNDEF;
  unsigned skipped = 0;  // filters that were not applied to this chunk
  if (H5Dget_chunk_info_by_coord(array.data, place, &skipped, &address, &stored) < 0) throw InputError(where, field, "a chunk that can be read", hdf5_reason(), "Copy it again.");
  if (address == HADDR_UNDEF) return {};
  // Deflate and LZF add a little to what they cannot compress.
  if (stored > 2 * size + 64) throw InputError(where, field, fmt::format("a chunk of at most {} bytes", 2 * size + 64), fmt::format("{}", stored));
  if (address > file.size || stored > file.size - address) throw InputError(where, field, "a chunk within the file", fmt::format("one of {} bytes at {} of {}", stored, address, file.size), "Copy it again.");
  std::vector<std::uint8_t> bytes(stored);
  file.stream.clear();
  file.stream.seekg(static_cast<std::streamoff>(address));
  if (!file.stream.read(reinterpret_cast<char*>(bytes.data()), static_cast<std::streamsize>(stored))) throw InputError(where, field, "a chunk that can be read", "an error of the disk");
  for (std::size_t f = array.filters.size(); f-- > 0;) {
    if (f >= 32 || (skipped >> f & 1) == 0) bytes = undone(array.filters[f], std::move(bytes), size, H5Tget_size(array.type));
  }
  if (bytes.size() != size) throw InputError(where, field, fmt::format("a chunk of {} bytes", size), "one that is damaged", "Copy it again.");
  return bytes;
}

// Rows `first` to `first` + `count` of an array in chunks with up to three axes, `first` being where chunks begin. What was never
// written is 0.
void read_rows(const Hdf5Array& array, Hdf5Bytes& file, std::size_t first, std::size_t count, std::uint8_t* out, const std::string& where, const std::string& field) {
  const std::size_t element = H5Tget_size(array.type);
  std::array<std::size_t, 3> shape{1, 1, 1}, chunk{1, 1, 1}, at{};
  std::copy(array.shape.begin(), array.shape.end(), shape.begin());
  std::copy(array.chunk.begin(), array.chunk.end(), chunk.begin());
  std::memset(out, 0, count * shape[1] * shape[2] * element);
  for (at[0] = first; at[0] < first + count; at[0] += chunk[0]) {
    for (at[1] = 0; at[1] < shape[1]; at[1] += chunk[1]) {
      for (at[2] = 0; at[2] < shape[2]; at[2] += chunk[2]) {
        const hsize_t place[3] = {at[0], at[1], at[2]};
        const std::vector<std::uint8_t> bytes = read_chunk(array, file, place, chunk[0] * chunk[1] * chunk[2] * element, where, field);
        if (bytes.empty()) continue;
        const std::size_t length = std::min(chunk[2], shape[2] - at[2]) * element;
        for (std::size_t i = at[0]; i < std::min(at[0] + chunk[0], first + count); ++i) {
          for (std::size_t j = at[1]; j < std::min(at[1] + chunk[1], shape[1]); ++j) {
            const std::size_t from = ((i - at[0]) * chunk[1] + j - at[1]) * chunk[2] * element;
            std::memcpy(out + (((i - first) * shape[1] + j) * shape[2] + at[2]) * element, bytes.data() + from, length);
          }
        }
      }
    }
  }
}

}  // namespace

struct Hdf5File::Handles {
  Hdf5Handle file;
  Hdf5Bytes bytes;
  Hdf5Array frames;
  std::string frames_name;
  // Frames whose chunks were read last.
  std::vector<std::uint8_t> rows;
  std::size_t first_row = 0, row_count = 0;
};

Hdf5File::Hdf5File(const std::filesystem::path& path) : where_(path.string()), handles_(std::make_unique<Handles>()) {
  quiet_hdf5();
  if (!std::filesystem::is_regular_file(path)) throw InputError(where_, "", "an HDF5 file", "no file");
  const Hdf5Handle access(H5Pcreate(H5P_FILE_ACCESS), H5Pclose);
  H5Pset_file_locking(access, false, true);  // disks of networks may have no locks, and nothing is written here
  handles_->file = Hdf5Handle(H5Fopen(path.c_str(), H5F_ACC_RDONLY, access), H5Fclose);
  if (handles_->file < 0) throw InputError(where_, "", "an HDF5 file", hdf5_reason(), "Copy it again if it is one.");
  // Where chunks lie is counted from behind what others put before the data.
  const Hdf5Handle creation(H5Fget_create_plist(handles_->file), H5Pclose);
  hsize_t before = 0;
  if (H5Pget_userblock(creation, &before) < 0 || before != 0) throw InputError(where_, "", "a file that begins with HDF5's signature", fmt::format("{} bytes before it", before), "h5unjam removes them.");
  handles_->bytes.stream.open(path, std::ios::binary);
  handles_->bytes.size = std::filesystem::file_size(path);
}

Hdf5File::~Hdf5File() = default;

std::vector<double> Hdf5File::numbers(const std::string& name, const std::vector<long>& shape) const {
  quiet_hdf5();
  const Hdf5Array array = open_array(handles_->file, where_, name, shape);
  const H5T_class_t kind = H5Tget_class(array.type);
  if ((kind != H5T_INTEGER && kind != H5T_FLOAT) || H5Tget_size(array.type) > 8) throw InputError(where_, name, "numbers of at most 8 bytes", "elements of another type");
  std::size_t count = 1;
  for (const hsize_t length : array.shape) {
    if (length > kMostHdf5Numbers || count * length > kMostHdf5Numbers) {
      throw InputError(where_, name, fmt::format("at most {} numbers", kMostHdf5Numbers), shape_text(array.shape));
    }
    count *= length;
  }
  std::vector<double> numbers(count, 0.0);
  if (count > 0 && !array.chunk.empty()) {
    read_rows(array, handles_->bytes, 0, array.shape[0], reinterpret_cast<std::uint8_t*>(numbers.data()), where_, name);
    if (H5Tconvert(array.type, H5T_NATIVE_DOUBLE, count, numbers.data(), nullptr, H5P_DEFAULT) < 0) throw InputError(where_, name, "numbers", hdf5_reason());
  } else if (H5Dread(array.data, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, numbers.data()) < 0) {
    throw InputError(where_, name, "an array that can be read", hdf5_reason(), "Copy it again.");
  }
  for (const double number : numbers) {
    if (!std::isfinite(number)) throw InputError(where_, name, "finite numbers", fmt::format("{}", number));
  }
  return numbers;
}

Hdf5File::Frames Hdf5File::open_frames(const std::string& name, int largest) {
  quiet_hdf5();
  Hdf5Array array = open_array(handles_->file, where_, name, {-1, -1, -1});
  // Whole numbers; h5py's truth values are named ones.
  const H5T_class_t kind = H5Tget_class(array.type);
  if ((kind != H5T_INTEGER && kind != H5T_ENUM) || H5Tget_size(array.type) != 1) throw InputError(where_, name, "whole numbers of one byte", "elements of another type");
  const std::vector<hsize_t> shape = array.shape;
  const auto most = static_cast<hsize_t>(largest);
  if (shape[0] > kMostHdf5Frames || shape[1] < 1 || shape[2] < 1 || shape[1] > most || shape[2] > most) {
    throw InputError(where_, name, fmt::format("at most {} frames of 1 to {} pixels each way", kMostHdf5Frames, largest), shape_text(shape));
  }
  if (!array.chunk.empty()) {
    // Chunks hold several frames, which are all kept while the frames are read one by one.
    const double bytes = static_cast<double>(std::min(array.chunk[0], shape[0])) * static_cast<double>(shape[1] * shape[2]);
    if (bytes > static_cast<double>(kMostHdf5RowBytes)) throw InputError(where_, name, fmt::format("frames that are stored together of at most {} bytes", kMostHdf5RowBytes), fmt::format("{:.0f}", bytes));
  }
  handles_->row_count = 0;
  handles_->frames = std::move(array);
  handles_->frames_name = name;
  return {shape[0], static_cast<int>(shape[1]), static_cast<int>(shape[2])};
}

void Hdf5File::frame(std::size_t number, std::span<std::uint8_t> pixels) const {
  quiet_hdf5();
  const Hdf5Array& array = handles_->frames;
  const std::string field = fmt::format("{} frame {}", handles_->frames_name, number);
  const hsize_t start[3] = {number, 0, 0}, count[3] = {1, array.shape.at(1), array.shape.at(2)};
  if (number >= array.shape[0] || pixels.size() != count[1] * count[2]) throw std::invalid_argument(fmt::format("{}: no such frame, or a buffer of another size", field));
  if (!array.chunk.empty()) {
    Handles& kept = *handles_;
    if (number < kept.first_row || number >= kept.first_row + kept.row_count) {
      kept.row_count = 0;  // where the next line throws
      const std::size_t first = number / array.chunk[0] * array.chunk[0], rows = std::min<std::size_t>(array.chunk[0], array.shape[0] - first);
      kept.rows.resize(rows * pixels.size());
      read_rows(array, kept.bytes, first, rows, kept.rows.data(), where_, field);
      kept.first_row = first;
      kept.row_count = rows;
    }
    std::copy_n(kept.rows.begin() + static_cast<std::ptrdiff_t>((number - kept.first_row) * pixels.size()), pixels.size(), pixels.begin());
    return;
  }
  const Hdf5Handle space(H5Dget_space(array.data), H5Sclose), memory(H5Screate_simple(2, count + 1, nullptr), H5Sclose);
  if (H5Sselect_hyperslab(space, H5S_SELECT_SET, start, nullptr, count, nullptr) < 0 ||
      H5Dread(array.data, array.type, memory, space, H5P_DEFAULT, pixels.data()) < 0) {
    throw InputError(where_, field, "a frame that can be read", hdf5_reason(), "Copy it again.");
  }
}

}  // namespace arah

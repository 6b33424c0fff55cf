#include "host/capture/hdf5_file.h"

#include <fmt/ranges.h>
#include <hdf5.h>

#include <algorithm>
#include <cmath>
#include <cstring>
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
};

namespace {

constexpr H5Z_filter_t kLzfFilter = 32000;  // as h5py registered it
constexpr std::size_t kLzfChunkBytes = 2;   // which of its numbers is the plain size of a chunk
constexpr std::size_t kMostCacheBytes = 256'000'000;
constexpr hsize_t kCacheSlots = 12421;  // a prime well above the chunks of a frame

// h5py's filter. It packs nothing, which leaves chunks of an optional filter plain. HDF5 takes a chunk to have its full size
// whatever a filter gives, so exactly that is given.
std::size_t lzf_filter(unsigned flags, std::size_t count, const unsigned numbers[], std::size_t packed, std::size_t* size, void** buffer) {
  if (!(flags & H5Z_FLAG_REVERSE) || count <= kLzfChunkBytes) return 0;
  const std::size_t plain = numbers[kLzfChunkBytes];
  if (plain == 0 || plain > kMostHdf5ChunkBytes) return 0;
  try {
    const std::vector<std::uint8_t> bytes = unpack_lzf({static_cast<const std::uint8_t*>(*buffer), packed}, plain);
    if (bytes.size() != plain) return 0;
    void* unpacked = H5allocate_memory(plain, false);
    if (!unpacked) return 0;
    std::memcpy(unpacked, bytes.data(), plain);
    H5free_memory(*buffer);
    *buffer = unpacked;
    *size = plain;
    return plain;
  } catch (const std::bad_alloc&) {
    return 0;  // the library is C
  }
}

// The library speaks through its results alone, for this thread, and loads no code for filters that it lacks.
void quiet_hdf5() {
  static std::once_flag once;
  std::call_once(once, [] {
    H5open();
    H5PLset_loading_state(0);
    const H5Z_class2_t lzf{H5Z_CLASS_T_VERS, kLzfFilter, 1, 1, "lzf", nullptr, nullptr, lzf_filter};
    H5Zregister(&lzf);
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

// How the array is stored: in this file, in pieces of a bounded size, by filters that are known here.
void check_storage(hid_t properties, std::size_t element_bytes, std::size_t rank, const std::string& where, const std::string& name) {
  const H5D_layout_t layout = H5Pget_layout(properties);
  if ((layout != H5D_COMPACT && layout != H5D_CONTIGUOUS && layout != H5D_CHUNKED) || H5Pget_external_count(properties) != 0) {
    throw InputError(where, name, "an array that lies in the file itself", "one that refers to other files");
  }
  if (layout != H5D_CHUNKED) return;
  std::vector<hsize_t> chunk(rank, 0);
  double bytes = static_cast<double>(element_bytes);
  const int axes = H5Pget_chunk(properties, static_cast<int>(rank), chunk.data());
  for (const hsize_t length : chunk) bytes *= static_cast<double>(length);
  if (axes != static_cast<int>(rank) || !(bytes >= 1 && bytes <= static_cast<double>(kMostHdf5ChunkBytes))) {
    throw InputError(where, name, fmt::format("chunks of at most {} bytes", kMostHdf5ChunkBytes), shape_text(chunk));
  }
  const int filters = H5Pget_nfilters(properties);
  for (int f = 0; f < filters; ++f) {
    unsigned flags = 0, numbers[8] = {};
    std::size_t count = 8;
    char words[64] = {};
    const H5Z_filter_t filter = H5Pget_filter2(properties, static_cast<unsigned>(f), &flags, &count, numbers, sizeof words, words, nullptr);
    const bool lzf = filter == kLzfFilter;
    if (lzf && (count <= kLzfChunkBytes || numbers[kLzfChunkBytes] != bytes)) {
      throw InputError(where, name, fmt::format("chunks of {} bytes under LZF", bytes), fmt::format("{}", numbers[kLzfChunkBytes]));
    }
    if (!lzf && filter != H5Z_FILTER_DEFLATE && filter != H5Z_FILTER_SHUFFLE && filter != H5Z_FILTER_FLETCHER32) {
      throw InputError(where, name, "data that is plain or compressed by deflate (gzip) or LZF", fmt::format("filter {} '{:.40}'", filter, words), "h5repack -f GZIP=4 rewrites it.");
    }
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
  check_storage(properties, H5Tget_size(array.type), array.shape.size(), where, name);
  return array;
}

}  // namespace

struct Hdf5File::Handles {
  Hdf5Handle file;
  Hdf5Array frames;
  std::string frames_name;
};

Hdf5File::Hdf5File(const std::filesystem::path& path) : where_(path.string()), handles_(std::make_unique<Handles>()) {
  quiet_hdf5();
  if (!std::filesystem::is_regular_file(path)) throw InputError(where_, "", "an HDF5 file", "no file");
  const Hdf5Handle access(H5Pcreate(H5P_FILE_ACCESS), H5Pclose);
  H5Pset_file_locking(access, false, true);  // disks of networks may have no locks, and nothing is written here
  handles_->file = Hdf5Handle(H5Fopen(path.c_str(), H5F_ACC_RDONLY, access), H5Fclose);
  if (handles_->file < 0) throw InputError(where_, "", "an HDF5 file", hdf5_reason(), "Copy it again if it is one.");
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
  if (H5Dread(array.data, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, numbers.data()) < 0) throw InputError(where_, name, "an array that can be read", hdf5_reason(), "Copy it again.");
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
  // Chunks hold several frames; those that a frame lies in are kept for the next ones.
  const Hdf5Handle access(H5Pcreate(H5P_DATASET_ACCESS), H5Pclose), properties(H5Dget_create_plist(array.data), H5Pclose);
  if (H5Pget_layout(properties) == H5D_CHUNKED) {
    hsize_t chunk[3] = {1, 1, 1};
    H5Pget_chunk(properties, 3, chunk);
    std::size_t bytes = chunk[0];
    for (int a = 1; a < 3; ++a) bytes *= (shape[static_cast<std::size_t>(a)] + chunk[a] - 1) / chunk[a] * chunk[a];
    H5Pset_chunk_cache(access, kCacheSlots, std::clamp(bytes, std::size_t{1} << 20, kMostCacheBytes), 1.0);
    array.data = Hdf5Handle(H5Dopen2(handles_->file, name.c_str(), access), H5Dclose);
    if (array.data < 0) throw InputError(where_, name, "an array", hdf5_reason());
  }
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
  const Hdf5Handle space(H5Dget_space(array.data), H5Sclose), memory(H5Screate_simple(2, count + 1, nullptr), H5Sclose);
  if (H5Sselect_hyperslab(space, H5S_SELECT_SET, start, nullptr, count, nullptr) < 0 ||
      H5Dread(array.data, array.type, memory, space, H5P_DEFAULT, pixels.data()) < 0) {
    throw InputError(where_, field, "a frame that can be read", hdf5_reason(), "Copy it again.");
  }
}

}  // namespace arah

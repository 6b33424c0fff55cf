#include "host/avatar/avatar_file.h"

#include <charconv>
#include <cmath>
#include <glm/mat3x3.hpp>
#include <glm/matrix.hpp>
#include <set>

#include "host/body/json_fields.h"

namespace arah {
namespace {

constexpr const char* kFormatKey = "arah_avatar";
constexpr const char* kFormat = "1";
constexpr const char* kTemplate = "template.glb";
constexpr const char* kCanonical = "canonical.rest_to_canonical";
constexpr double kRigid =
    1e-9;  // entries of RᵀR − I; the transforms are products of exact rotations in double precision
constexpr int kMostNodes = 1 << 16;

template <typename Vector>
nlohmann::json list(const Vector& v) {
  return {v.x, v.y, v.z};
}

// The metadata of one file, read with the errors that its fields need.
class Metadata {
 public:
  explicit Metadata(const SafetensorsFile& file) : file_(file), where_(file.path.string()) {}

  const std::string& text(const char* key) const {
    const auto found = file_.metadata.find(key);
    if (found == file_.metadata.end()) throw InputError(where_, field(key), "this field", "none");
    return found->second;
  }

  nlohmann::json json(const char* key) const {
    return parse_json(text(key), where_, field(key));
  }

  uint64_t number(const char* key) const {
    const std::string& digits = text(key);
    uint64_t value = 0;
    const auto [end, error] = std::from_chars(digits.data(), digits.data() + digits.size(), value);
    if (error != std::errc() || end != digits.data() + digits.size()) {
      throw InputError(where_, field(key), "a whole number below 2^64", "'" + digits.substr(0, 40) + "'");
    }
    return value;
  }

  const std::string& where() const { return where_; }
  static std::string field(const std::string& key) { return "metadata " + key; }

 private:
  const SafetensorsFile& file_;
  std::string where_;
};

CubeNormalization read_cube(const Metadata& metadata) {
  const nlohmann::json json = metadata.json("cube");
  const std::string field = metadata.field("cube");
  CubeNormalization cube;
  cube.center = json_vector(json_member(json, "center", metadata.where(), field), metadata.where(), field + " center");
  cube.cmin = json_number(json_member(json, "cmin", metadata.where(), field), metadata.where(), field + " cmin");
  cube.cmax = json_number(json_member(json, "cmax", metadata.where(), field), metadata.where(), field + " cmax");
  if (!(cube.cmax > cube.cmin)) {
    throw InputError(metadata.where(), field, "cmin below cmax", fmt::format("{} and {}", cube.cmin, cube.cmax));
  }
  return cube;
}

std::vector<int> read_latent_frames(const Metadata& metadata, const AvatarSpec& spec) {
  const nlohmann::json json = metadata.json("latent_frames");
  const std::string field = metadata.field("latent_frames");
  std::vector<int> frames;
  for (const auto& item : json_list(json, -1, metadata.where(), field)) {
    frames.push_back(json_integer(item, 0, std::numeric_limits<int>::max(), metadata.where(), field));
  }
  if (std::set<int>(frames.begin(), frames.end()).size() != frames.size()) {
    throw InputError(metadata.where(), field, "distinct frame numbers", "one twice");
  }
  if (frames.empty() != (spec.latent_size == 0)) {
    throw InputError(metadata.where(), field,
                     spec.latent_size == 0 ? "an empty list, because latent_size is 0" : "at least one frame",
                     fmt::format("{}", frames.size()));
  }
  return frames;
}

GridExtent read_grid(const Metadata& metadata, const AvatarSpec& spec) {
  const nlohmann::json json = metadata.json("grid");
  const std::string& where = metadata.where();
  const std::string field = metadata.field("grid");
  GridExtent grid;
  grid.lower = glm::vec3(json_vector(json_member(json, "lower", where, field), where, field + " lower"));
  grid.upper = glm::vec3(json_vector(json_member(json, "upper", where, field), where, field + " upper"));
  const auto& levels = json_list(json_member(json, "nodes", where, field), static_cast<long>(spec.grid_cells.size()),
                                 where, field + " nodes");
  for (const auto& level : levels) {
    json_list(level, 3, where, field + " nodes");
    glm::uvec3 nodes;
    for (int axis = 0; axis < 3; ++axis) {
      nodes[axis] = static_cast<uint32_t>(
          json_integer(level[static_cast<std::size_t>(axis)], 2, kMostNodes, where, field + " nodes"));
    }
    grid.nodes.push_back(nodes);
  }
  for (int axis = 0; axis < 3 && !grid.nodes.empty(); ++axis) {
    if (!(grid.lower[axis] < grid.upper[axis])) {
      throw InputError(where, field, "lower below upper on every axis",
                       fmt::format("{} and {} on axis {}", grid.lower[axis], grid.upper[axis], axis));
    }
  }
  return grid;
}

BodyTemplate read_template(const SafetensorsFile& file, const std::string& where) {
  const Tensor& glb = file.at(kTemplate);
  if (glb.dtype != "U8") throw InputError(where, fmt::format("tensor \"{}\"", kTemplate), "bytes (U8)", glb.dtype);
  return read_body_template_bytes(glb.data, where + ": " + kTemplate);
}

CanonicalPose read_canonical(const SafetensorsFile& file, std::size_t joints, const std::string& where) {
  const std::vector<double> values = file.values<double>(kCanonical, {static_cast<int64_t>(joints), 4, 4});
  CanonicalPose canonical;
  for (std::size_t j = 0; j < joints; ++j) {
    glm::dmat4 matrix;
    for (int row = 0; row < 4; ++row) {
      for (int column = 0; column < 4; ++column) {
        matrix[column][row] = values[16 * j + static_cast<std::size_t>(4 * row + column)];
      }
    }
    const glm::dmat3 rotation(matrix);
    const glm::dmat3 product = glm::transpose(rotation) * rotation;
    double error = glm::determinant(rotation) > 0 ? 0.0 : 2.0;
    bool finite = true;
    for (int c = 0; c < 4; ++c) {
      for (int r = 0; r < 4; ++r) finite = finite && std::isfinite(matrix[c][r]);
      error = std::max(error, std::abs(matrix[c][3] - (c == 3 ? 1.0 : 0.0)));
      for (int r = 0; c < 3 && r < 3; ++r) error = std::max(error, std::abs(product[c][r] - (c == r ? 1.0 : 0.0)));
    }
    if (!finite || !(error <= kRigid)) {
      throw InputError(where, fmt::format("tensor \"{}\": joint {}", kCanonical, j), "a rotation and a translation",
                       finite ? fmt::format("a matrix that is off by {:.3g}", error) : "numbers that are not finite");
    }
    canonical.rest_to_canonical.push_back(matrix);
  }
  return canonical;
}

// All slots' tensors, checked before the buffer that holds them is made: a forged spec cannot ask for more memory than
// the file has data.
std::vector<float> read_parameters(const SafetensorsFile& file, const ParameterLayout& layout,
                                   const std::string& where) {
  for (const TensorSlot& slot : layout.slots) {
    const Tensor& tensor = file.at(slot.name);
    const std::string field = fmt::format("tensor \"{}\"", slot.name);
    if (tensor.dtype != "F32") throw InputError(where, field + ": dtype", "F32", tensor.dtype);
    if (tensor.shape != slot.shape) {
      throw InputError(where, field + ": shape", fmt::format("[{}]", fmt::join(slot.shape, ", ")),
                       fmt::format("[{}]", fmt::join(tensor.shape, ", ")));
    }
  }
  std::vector<float> parameters(layout.floats, 0.0f);
  for (const TensorSlot& slot : layout.slots) {
    const std::vector<std::byte>& data = file.at(slot.name).data;
    std::memcpy(parameters.data() + slot.offset, data.data(), data.size());
  }
  return parameters;
}

}  // namespace

SafetensorsFile avatar_tensors(const Avatar& avatar) {
  check_finite(avatar);
  SafetensorsFile file;
  for (const TensorSlot& slot : avatar.layout.slots) {
    file.tensors[slot.name] = Tensor::from<float>(slot.shape, avatar.tensor(slot.name));
  }
  file.tensors[kTemplate] = {"U8", {static_cast<int64_t>(avatar.body.glb.size())}, avatar.body.glb};
  std::vector<double> canonical;
  for (const glm::dmat4& matrix : avatar.canonical.rest_to_canonical) {
    for (int row = 0; row < 4; ++row) {
      for (int column = 0; column < 4; ++column) canonical.push_back(matrix[column][row]);
    }
  }
  file.tensors[kCanonical] =
      Tensor::from<double>({static_cast<int64_t>(avatar.canonical.rest_to_canonical.size()), 4, 4}, canonical);
  put_shape(file, avatar.body);
  put_refined_poses(file, avatar.refined);

  nlohmann::json nodes = nlohmann::json::array();
  for (const glm::uvec3& level : avatar.grid.nodes) nodes.push_back(list(level));
  file.metadata = {
      {kFormatKey, kFormat},
      {"version", avatar.version},
      {"spec", spec_to_json(avatar.spec)},
      {"settings", avatar.settings},
      {"seed", std::to_string(avatar.seed)},
      {"steps", std::to_string(avatar.steps)},
      {"latent_frames", nlohmann::json(avatar.latent_frames).dump()},
      {"cube",
       nlohmann::json{{"center", list(avatar.cube.center)}, {"cmin", avatar.cube.cmin}, {"cmax", avatar.cube.cmax}}
           .dump()},
      {"grid",
       nlohmann::json{{"lower", list(avatar.grid.lower)}, {"upper", list(avatar.grid.upper)}, {"nodes", nodes}}.dump()},
  };
  if (avatar.body.shape.size() > 0) file.metadata["shape_names"] = nlohmann::json(avatar.body.shape.names).dump();
  return file;
}

Avatar avatar_from_tensors(const SafetensorsFile& file) {
  const Metadata metadata(file);
  const std::string& where = metadata.where();
  const auto format = file.metadata.find(kFormatKey);
  if (format == file.metadata.end()) {
    throw InputError(where, "", "an avatar", "a safetensors file of another kind", "'arah train' makes avatars.");
  }
  if (format->second != kFormat) {
    throw InputError(where, metadata.field(kFormatKey), fmt::format("format {}", kFormat), "'" + format->second + "'",
                     "A newer program wrote this file.");
  }
  Avatar avatar;
  avatar.version = metadata.text("version");
  avatar.spec = spec_from_json(metadata.text("spec"), where + ": spec");
  if (!metadata.json("settings").is_object()) throw InputError(where, metadata.field("settings"), "an object", metadata.text("settings").substr(0, 60));
  avatar.settings = metadata.text("settings");
  avatar.seed = metadata.number("seed");
  avatar.steps = metadata.number("steps");
  avatar.latent_frames = read_latent_frames(metadata, avatar.spec);
  avatar.cube = read_cube(metadata);
  check_extent(avatar.cube, where);
  avatar.grid = read_grid(metadata, avatar.spec);
  avatar.body = read_template(file, where);
  read_shape(file, &avatar.body);
  avatar.canonical = read_canonical(file, avatar.body.skeleton.size(), where);
  avatar.refined = read_refined_poses(file, avatar.body);
  avatar.layout = make_parameter_layout(avatar.spec, avatar.body.skeleton, avatar.latent_frames.size(), avatar.grid);
  avatar.parameters = read_parameters(file, avatar.layout, where);
  try {
    check_finite(avatar);
  } catch (const std::runtime_error& error) {
    throw InputError(where + ": " + error.what());
  }
  if (!(avatar.tensor("b")[0] > 0.0f)) {
    throw InputError(where, "tensor \"b\"", "a number above 0", fmt::format("{}", avatar.tensor("b")[0]));
  }
  return avatar;
}

void save_avatar(const std::filesystem::path& path, const Avatar& avatar) {
  write_safetensors(path, avatar_tensors(avatar));
}

Avatar load_avatar(const std::filesystem::path& path) {
  return avatar_from_tensors(read_safetensors(path));
}

}  // namespace arah

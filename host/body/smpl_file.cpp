#include "host/body/smpl_file.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <glm/geometric.hpp>
#include <map>
#include <numeric>
#include <optional>

#include "host/body/npz.h"
#include "host/body/pickle.h"
#include "host/body/pose.h"
#include "host/body/smpl_joints.h"
#include "host/input_error.h"

namespace arah {
namespace {

constexpr double kNoParent = 4294967295.0;  // 2^32 − 1, or −1 where the table is signed
constexpr std::size_t kMostVertices = 200'000, kMostFaces = 400'000;  // SMPL-X has 10,475 and 20,908
constexpr std::size_t kMeasuredPoses = 20;

// The fields of either kind of file. Chumpy's arrays count as the arrays in them.
class SmplFields {
 public:
  explicit SmplFields(const std::filesystem::path& path) : where_(path.string()) {
    if (path.extension() == ".npz") archive_.emplace(path);
    else pickle_ = read_pickle(path);
  }
  const std::string& where() const { return where_; }
  bool has(const std::string& name) const { return archive_ ? archive_->has(name) : python_find(*pickle_.root, name) != nullptr; }
  const PythonValue& get(const std::string& name) {
    const PythonValue* value = nullptr;
    if (archive_) {
      if (!read_.contains(name)) read_.emplace(name, archive_->read(name));
      value = read_.at(name).root;
    } else {
      value = &python_member(*pickle_.root, name, where_, "");
    }
    if (std::holds_alternative<PythonObject>(value->content)) {
      if (const PythonValue* plain = python_find(*value, "x")) return *plain;
    }
    return *value;
  }
  const PythonArray& array(const std::string& name, const std::vector<long>& shape) { return python_array(get(name), shape, where_, name); }
  // Frees what an archive's array takes.
  void drop(const std::string& name) { read_.erase(name); }

 private:
  std::string where_;
  std::optional<NpzFile> archive_;
  std::map<std::string, PythonData> read_;
  PythonData pickle_;
};

double finite_number(const PythonArray& array, std::size_t place, const std::string& where, const char* name) {
  const double number = array.number(place);
  if (!std::isfinite(number)) throw InputError(where, name, "finite numbers", fmt::format("{}", number));
  return number;
}

using Field = std::vector<glm::dvec3>;  // of vertices or of joints

Field read_rest_vertices(SmplFields& file) {
  const PythonArray& rest = file.array("v_template", {-1, 3});
  const std::size_t count = rest.shape[0];
  if (count == 0 || count > kMostVertices) throw InputError(file.where(), "v_template", fmt::format("1 to {} vertices", kMostVertices), fmt::format("{}", count));
  Field vertices(count);
  for (std::size_t i = 0; i < 3 * count; ++i) vertices[i / 3][static_cast<int>(i % 3)] = finite_number(rest, i, file.where(), "v_template");
  return vertices;
}

// The first directions of the shape, as many as are kept or have a beta. [B][V]
std::vector<Field> read_shape_directions(SmplFields& file, std::size_t vertices, std::size_t betas) {
  if (betas == 0 && !file.has("shapedirs")) return {};
  const PythonArray& stored = file.array("shapedirs", {static_cast<long>(vertices), 3, -1});
  const std::size_t known = stored.shape[2];
  if (betas > known) throw InputError(file.where(), "shapedirs", fmt::format("a direction for each of {} betas", betas), fmt::format("{}", known));
  std::vector<Field> directions(std::max(betas, std::min(known, kSmplShapes)), Field(vertices));
  for (std::size_t i = 0; i < 3 * vertices; ++i) {
    for (std::size_t b = 0; b < directions.size(); ++b) {
      directions[b][i / 3][static_cast<int>(i % 3)] = finite_number(stored, i * known + b, file.where(), "shapedirs");
    }
  }
  file.drop("shapedirs");
  return directions;
}

// J_regressor: joints are sums of vertices. From a matrix as it is or one of scipy's sparse ones (by columns or by rows).
class JointRegressor {
 public:
  JointRegressor(SmplFields& file, std::size_t joints, std::size_t vertices) : joints_(joints) {
    constexpr const char* kName = "J_regressor";
    const PythonValue& stored = file.get(kName);
    const std::string& where = file.where();
    const auto* sparse = std::get_if<PythonObject>(&stored.content);
    if (!sparse) {
      const PythonArray& matrix = file.array(kName, {static_cast<long>(joints), static_cast<long>(vertices)});
      for (std::size_t j = 0; j < joints; ++j) {
        for (std::size_t v = 0; v < vertices; ++v) add(j, v, finite_number(matrix, j * vertices + v, where, kName));
      }
      return;
    }
    const bool by_rows = sparse->type.ends_with("csr_matrix");
    const char* shape_name = python_find(stored, "_shape") ? "_shape" : "shape";
    const std::vector<double> shape = python_numbers(python_member(stored, shape_name, where, kName), 2, where, "J_regressor shape");
    if (shape[0] != static_cast<double>(joints) || shape[1] != static_cast<double>(vertices)) {
      throw InputError(where, kName, fmt::format("a matrix of {}x{}", joints, vertices), fmt::format("{}x{}", shape[0], shape[1]));
    }
    const std::size_t outer = by_rows ? joints : vertices, inner = by_rows ? vertices : joints;
    const std::vector<double> values = python_numbers(python_member(stored, "data", where, kName), -1, where, "J_regressor data");
    const std::vector<double> indices = python_numbers(python_member(stored, "indices", where, kName), static_cast<long>(values.size()), where, "J_regressor indices");
    const std::vector<double> starts = python_numbers(python_member(stored, "indptr", where, kName), static_cast<long>(outer + 1), where, "J_regressor indptr");
    for (std::size_t o = 0; o < outer; ++o) {
      if (!(starts[o] >= 0 && starts[o] <= starts[o + 1] && starts[o + 1] <= static_cast<double>(values.size()))) {
        throw InputError(where, "J_regressor indptr", "places in ascending order", fmt::format("{} and {}", starts[o], starts[o + 1]));
      }
      for (auto k = static_cast<std::size_t>(starts[o]); k < static_cast<std::size_t>(starts[o + 1]); ++k) {
        if (!(indices[k] >= 0 && indices[k] < static_cast<double>(inner))) {
          throw InputError(where, "J_regressor indices", fmt::format("0 to {}", inner - 1), fmt::format("{}", indices[k]));
        }
        const auto i = static_cast<std::size_t>(indices[k]);
        add(by_rows ? o : i, by_rows ? i : o, values[k]);
      }
    }
  }

  // Σ_v weight[j][v] · vertices[v]
  Field operator()(const Field& vertices) const {
    Field joints(joints_, glm::dvec3(0.0));
    for (const Entry& entry : entries_) joints[entry.joint] += entry.weight * vertices[entry.vertex];
    return joints;
  }

 private:
  struct Entry {
    std::size_t joint, vertex;
    double weight;
  };
  void add(std::size_t joint, std::size_t vertex, double weight) {
    if (weight != 0.0) entries_.push_back({joint, vertex, weight});
  }

  std::size_t joints_;
  std::vector<Entry> entries_;
};

// Without places of the joints.
Skeleton read_smpl_tree(SmplFields& file) {
  const PythonArray& table = file.array("kintree_table", {2, -1});
  const std::size_t count = table.shape[1];
  Skeleton skeleton;
  skeleton.names = smpl_joint_names(count, file.where());
  for (std::size_t j = 0; j < count; ++j) {
    const double parent = table.number(j);
    const bool root = parent == kNoParent || parent == -1.0;
    if (!root && !(parent >= 0 && parent < static_cast<double>(count))) {
      throw InputError(file.where(), "kintree_table", fmt::format("parents below {}", count), fmt::format("{}", parent));
    }
    skeleton.parents.push_back(root ? -1 : static_cast<int>(parent));
  }
  skeleton.rest_joints.assign(count, glm::dvec3(0.0));
  validate_skeleton(skeleton, file.where());
  return skeleton;
}

// R_1 − I, R_2 − I, … row by row: what SMPL's pose blend shapes are linear in.
std::vector<double> pose_feature(const std::vector<glm::dvec3>& pose) {
  std::vector<double> feature;
  for (std::size_t j = 1; j < pose.size(); ++j) {
    const glm::dmat3 turn = rotation_from_axis_angle(pose[j]) - glm::dmat3(1.0);
    for (int row = 0; row < 3; ++row)
      for (int column = 0; column < 3; ++column) feature.push_back(turn[column][row]);
  }
  return feature;
}

// What the pose blend shapes add to the mesh at rest on average over the poses, and what they add to that in single ones. [V]
Field mean_pose_offsets(SmplFields& file, std::size_t vertices, std::span<const std::vector<glm::dvec3>> poses, std::string& note) {
  std::vector<std::vector<double>> features;
  for (const std::vector<glm::dvec3>& pose : poses) features.push_back(pose_feature(pose));
  const std::size_t length = features[0].size();
  std::vector<double> mean(length, 0.0);
  for (const std::vector<double>& feature : features) {
    for (std::size_t k = 0; k < length; ++k) mean[k] += feature[k] / static_cast<double>(features.size());
  }
  const PythonArray& stored = file.array("posedirs", {static_cast<long>(vertices), 3, static_cast<long>(length)});
  // Of many poses some are measured, evenly.
  const std::size_t measured = std::min(features.size(), kMeasuredPoses);
  Field offsets(vertices, glm::dvec3(0.0));
  double sum_mean = 0, sum_left = 0, most_left = 0;
  std::vector<double> row(length);
  for (std::size_t v = 0; v < vertices; ++v) {
    std::vector<glm::dvec3> left(measured, glm::dvec3(0.0));
    for (int axis = 0; axis < 3; ++axis) {
      for (std::size_t k = 0; k < length; ++k) row[k] = finite_number(stored, (3 * v + static_cast<std::size_t>(axis)) * length + k, file.where(), "posedirs");
      offsets[v][axis] = std::inner_product(row.begin(), row.end(), mean.begin(), 0.0);
      for (std::size_t m = 0; m < measured; ++m) {
        left[m][axis] = std::inner_product(row.begin(), row.end(), features[m * features.size() / measured].begin(), -offsets[v][axis]);
      }
    }
    sum_mean += glm::length(offsets[v]);
    for (const glm::dvec3& offset : left) {
      sum_left += glm::length(offset);
      most_left = std::max(most_left, glm::length(offset));
    }
  }
  file.drop("posedirs");
  const auto count = static_cast<double>(vertices);
  note = fmt::format("Pose blend shapes: the mesh at rest has their mean over {} poses, {:.1f} mm at a vertex on average. What single poses add, {:.1f} mm on average and {:.1f} mm at most, "
                     "is left out: the rig moves by linear skinning alone.",
                     poses.size(), 1e3 * sum_mean / count, 1e3 * sum_left / (count * static_cast<double>(measured)), 1e3 * most_left);
  return offsets;
}

// The four largest of each vertex's weights; what the others held is told.
void read_smpl_weights(SmplFields& file, SmplBody& result) {
  const std::size_t vertices = result.body.vertices.size(), joints = result.body.skeleton.size();
  const PythonArray& weights = file.array("weights", {static_cast<long>(vertices), static_cast<long>(joints)});
  double largest = 0, sum_left_out = 0;
  std::size_t changed = 0;
  for (std::size_t v = 0; v < vertices; ++v) {
    std::vector<std::pair<double, std::size_t>> all;
    double sum = 0;
    for (std::size_t j = 0; j < joints; ++j) {
      const double weight = finite_number(weights, v * joints + j, file.where(), "weights");
      if (weight < 0) throw InputError(file.where(), "weights", "weights of 0 and more", fmt::format("{} at vertex {}", weight, v));
      if (weight > 0) all.emplace_back(weight, j);
      sum += weight;
    }
    if (!(sum > 0)) throw InputError(file.where(), "weights", "a joint that moves each vertex", fmt::format("none at vertex {}", v));
    std::stable_sort(all.begin(), all.end(), [](const auto& a, const auto& b) { return a.first > b.first; });
    double kept = 0;
    for (std::size_t k = 0; k < std::min<std::size_t>(4, all.size()); ++k) kept += all[k].first;
    glm::u8vec4 own_joints(0);
    glm::vec4 own_weights(0.0f);
    for (std::size_t k = 0; k < std::min<std::size_t>(4, all.size()); ++k) {
      own_joints[static_cast<int>(k)] = static_cast<glm::u8>(all[k].second);
      own_weights[static_cast<int>(k)] = static_cast<float>(all[k].first / kept);
    }
    result.body.joints.push_back(own_joints);
    result.body.weights.push_back(own_weights);
    if (all.size() <= 4) continue;
    ++changed;
    sum_left_out += 1 - kept / sum;
    largest = std::max(largest, 1 - kept / sum);
  }
  if (changed > 0) {
    result.notes.push_back(fmt::format("{} of {} vertices have more than four joints: the smallest weights are left out, {:.2f} % on average of them, {:.1f} % at most.", changed,
                                       vertices, 100 * sum_left_out / static_cast<double>(changed), 100 * largest));
  }
}

}  // namespace

bool is_smpl_file(const std::filesystem::path& path) { return path.extension() == ".npz" || path.extension() == ".pkl"; }

SmplBody read_smpl_body(const std::filesystem::path& path, std::span<const double> betas, std::span<const std::vector<glm::dvec3>> poses) {
  while (!betas.empty() && betas.back() == 0.0) betas = betas.first(betas.size() - 1);
  SmplFields file(path);
  SmplBody result;
  Field vertices = read_rest_vertices(file);
  std::vector<Field> directions = read_shape_directions(file, vertices.size(), betas.size());
  for (std::size_t b = kSmplShapes; b < betas.size(); ++b) {
    for (std::size_t v = 0; v < vertices.size(); ++v) vertices[v] += betas[b] * directions[b][v];
  }
  if (directions.size() > kSmplShapes) directions.resize(kSmplShapes);
  result.body.skeleton = read_smpl_tree(file);
  const JointRegressor joints_of(file, result.body.skeleton.size(), vertices.size());
  result.body.skeleton.rest_joints = joints_of(vertices);
  std::string pose_note;
  if (file.has("posedirs")) {
    pose_note = "Pose blend shapes are left out: the rig moves by linear skinning alone.";
    const auto of_model = [&](const std::vector<glm::dvec3>& pose) { return pose.size() == result.body.skeleton.size(); };
    if (!poses.empty() && std::all_of(poses.begin(), poses.end(), of_model)) {
      const Field offsets = mean_pose_offsets(file, vertices.size(), poses, pose_note);
      for (std::size_t v = 0; v < vertices.size(); ++v) vertices[v] += offsets[v];
    }
  }
  result.body.vertices.assign(vertices.begin(), vertices.end());
  ShapeSpace& shape = result.body.shape;
  for (const Field& direction : directions) {
    shape.names.push_back(fmt::format("beta_{}", shape.size()));
    shape.vertex_offsets.emplace_back(direction.begin(), direction.end());
    shape.joint_offsets.push_back(joints_of(direction));
  }
  if (!directions.empty()) {
    shape.base_vertices = result.body.vertices;
    shape.base_joints = result.body.skeleton.rest_joints;
    shape.beta.assign(directions.size(), 0.0);
    std::vector<double> beta(betas.begin(), betas.begin() + static_cast<std::ptrdiff_t>(std::min(betas.size(), directions.size())));
    beta.resize(directions.size(), 0.0);
    set_shape(result.body, beta);
  }
  read_smpl_weights(file, result);
  const PythonArray& faces = file.array("f", {-1, 3});
  if (faces.shape[0] > kMostFaces) throw InputError(path.string(), "f", fmt::format("at most {} faces", kMostFaces), fmt::format("{}", faces.shape[0]));
  for (std::size_t i = 0; i < faces.shape[0]; ++i) {
    glm::uvec3 triangle;
    for (int k = 0; k < 3; ++k) {
      const double index = faces.number(3 * i + static_cast<std::size_t>(k));
      if (!(index >= 0 && index < static_cast<double>(vertices.size()))) {
        throw InputError(path.string(), "f", fmt::format("vertices below {}", vertices.size()), fmt::format("{} in face {}", index, i));
      }
      triangle[k] = static_cast<unsigned>(index);
    }
    result.body.triangles.push_back(triangle);
  }
  if (!pose_note.empty()) result.notes.push_back(pose_note);
  // Reading it back checks the rig as every other one. SMPL's files lack normals, which are computed there; they are those of the
  // mesh without targets, so that is read first: the file's normals shall be those of the shape that it opens in.
  result.body.normals.resize(vertices.size(), glm::vec3(0.0f));
  BodyTemplate plain = result.body;
  plain.shape = {};
  result.body.normals = read_body_template_bytes(body_template_glb(plain), path.string()).normals;
  result.body = read_body_template_bytes(body_template_glb(result.body), path.string());
  result.body.glb = body_template_glb(result.body);
  return result;
}

}  // namespace arah

#include "host/body/smpl_file.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <optional>

#include "host/body/npz.h"
#include "host/body/pickle.h"
#include "host/body/smpl_joints.h"
#include "host/input_error.h"

namespace arah {
namespace {

constexpr double kNoParent = 4294967295.0;  // 2^32 − 1, or −1 where the table is signed
constexpr std::size_t kMostVertices = 200'000, kMostFaces = 400'000;  // SMPL-X has 10,475 and 20,908

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

std::vector<glm::dvec3> shaped_vertices(SmplFields& file, std::span<const double> betas) {
  const PythonArray& rest = file.array("v_template", {-1, 3});
  const std::size_t count = rest.shape[0];
  if (count == 0 || count > kMostVertices) throw InputError(file.where(), "v_template", fmt::format("1 to {} vertices", kMostVertices), fmt::format("{}", count));
  std::vector<glm::dvec3> vertices(count);
  for (std::size_t i = 0; i < 3 * count; ++i) vertices[i / 3][static_cast<int>(i % 3)] = finite_number(rest, i, file.where(), "v_template");
  while (!betas.empty() && betas.back() == 0.0) betas = betas.first(betas.size() - 1);
  if (betas.empty()) return vertices;
  const PythonArray& directions = file.array("shapedirs", {static_cast<long>(count), 3, -1});
  const std::size_t known = directions.shape[2];
  if (betas.size() > known) throw InputError(file.where(), "shapedirs", fmt::format("a direction for each of {} betas", betas.size()), fmt::format("{}", known));
  for (std::size_t i = 0; i < 3 * count; ++i) {
    for (std::size_t b = 0; b < betas.size(); ++b) {
      vertices[i / 3][static_cast<int>(i % 3)] += betas[b] * finite_number(directions, i * known + b, file.where(), "shapedirs");
    }
  }
  file.drop("shapedirs");
  return vertices;
}

// Σ_v regressor[j][v] · vertex v, from a matrix as it is or one of scipy's sparse ones (by columns or by rows).
std::vector<glm::dvec3> regressed_joints(SmplFields& file, const std::vector<glm::dvec3>& vertices, std::size_t count) {
  constexpr const char* kName = "J_regressor";
  const PythonValue& stored = file.get(kName);
  const std::string& where = file.where();
  std::vector<glm::dvec3> joints(count, glm::dvec3(0.0));
  const auto* sparse = std::get_if<PythonObject>(&stored.content);
  if (!sparse) {
    const PythonArray& matrix = file.array(kName, {static_cast<long>(count), static_cast<long>(vertices.size())});
    for (std::size_t j = 0; j < count; ++j) {
      for (std::size_t v = 0; v < vertices.size(); ++v) joints[j] += finite_number(matrix, j * vertices.size() + v, where, kName) * vertices[v];
    }
    return joints;
  }
  const bool by_rows = sparse->type.ends_with("csr_matrix");
  const char* shape_name = python_find(stored, "_shape") ? "_shape" : "shape";
  const std::vector<double> shape = python_numbers(python_member(stored, shape_name, where, kName), 2, where, "J_regressor shape");
  if (shape[0] != static_cast<double>(count) || shape[1] != static_cast<double>(vertices.size())) {
    throw InputError(where, kName, fmt::format("a matrix of {}x{}", count, vertices.size()), fmt::format("{}x{}", shape[0], shape[1]));
  }
  const std::size_t outer = by_rows ? count : vertices.size(), inner = by_rows ? vertices.size() : count;
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
      joints[by_rows ? o : i] += values[k] * vertices[by_rows ? i : o];
    }
  }
  return joints;
}

Skeleton read_smpl_skeleton(SmplFields& file, const std::vector<glm::dvec3>& vertices) {
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
  skeleton.rest_joints = regressed_joints(file, vertices, count);
  validate_skeleton(skeleton, file.where());
  return skeleton;
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

SmplBody read_smpl_body(const std::filesystem::path& path, std::span<const double> betas) {
  SmplFields file(path);
  SmplBody result;
  const std::vector<glm::dvec3> vertices = shaped_vertices(file, betas);
  result.body.vertices.assign(vertices.begin(), vertices.end());
  result.body.skeleton = read_smpl_skeleton(file, vertices);
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
  if (file.has("posedirs")) result.notes.push_back("Pose blend shapes are left out: the rig moves by linear skinning alone.");
  // Reading it back checks the rig as every other one, and computes the normals, which SMPL's files lack.
  result.body.normals.resize(vertices.size(), glm::vec3(0.0f));
  result.body = read_body_template_bytes(body_template_glb(result.body), path.string());
  result.body.glb = body_template_glb(result.body);
  return result;
}

}  // namespace arah

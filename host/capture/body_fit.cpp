// Bodies that EasyMocap fitted to frames.
#include <glm/mat3x3.hpp>

#include "host/body/json_fields.h"
#include "host/body/npy.h"
#include "host/capture/dataset.h"
#include "host/input_error.h"

namespace arah {
namespace {

constexpr std::size_t kPosesWithoutRoot = 69;  // of SMPL, in EasyMocap's later files

std::vector<glm::dvec3> as_vectors(const std::vector<double>& numbers, const std::string& where, const std::string& field) {
  if (numbers.empty() || numbers.size() % 3 != 0) throw InputError(where, field, "three numbers a joint", fmt::format("{} numbers", numbers.size()));
  std::vector<glm::dvec3> vectors;
  for (std::size_t i = 0; i < numbers.size(); i += 3) vectors.emplace_back(numbers[i], numbers[i + 1], numbers[i + 2]);
  return vectors;
}

// numbers(name): all numbers of that field.
template <typename Numbers>
BodyFit body_fit(const std::string& where, bool has_shapes, const Numbers& numbers) {
  const auto vector = [&](const char* name) {
    const std::vector<double> three = numbers(name);
    if (three.size() != 3) throw InputError(where, name, "3 numbers", fmt::format("{}", three.size()));
    return as_vectors(three, where, name)[0];
  };
  BodyFit fit;
  std::vector<double> poses = numbers("poses");
  if (poses.size() == kPosesWithoutRoot) poses.insert(poses.begin(), 3, 0.0);
  fit.poses = as_vectors(poses, where, "poses");
  fit.Rh = vector("Rh");
  fit.Th = vector("Th");
  if (has_shapes) fit.shapes = numbers("shapes");
  return fit;
}

// Numbers of a list, or of lists in it.
std::vector<double> json_numbers(const nlohmann::json& value, const std::string& where, const std::string& field) {
  std::vector<double> numbers;
  for (const nlohmann::json& row : json_list(value, -1, where, field)) {
    if (row.is_array()) {
      for (const nlohmann::json& number : row) numbers.push_back(json_number(number, where, field));
    } else {
      numbers.push_back(json_number(row, where, field));
    }
  }
  return numbers;
}

const nlohmann::json& lowest_person(const nlohmann::json& file, const std::string& where) {
  const nlohmann::json& people = json_list(file.is_object() ? json_member(file, "annots", where, "") : file, -1, where, "people");
  const nlohmann::json* lowest = nullptr;
  double lowest_id = 0;
  for (const nlohmann::json& person : people) {
    if (!person.is_object()) throw InputError(where, "people", "a fit for each", json_excerpt(person));
    const double id = person.contains("id") ? json_number(person["id"], where, "id") : 0.0;
    if (lowest && id >= lowest_id) continue;
    lowest = &person;
    lowest_id = id;
  }
  if (!lowest) throw InputError(where, "people", "at least one", "none");
  return *lowest;
}

}  // namespace

BodyFit read_body_fit(const std::filesystem::path& path) {
  const std::string where = path.string();
  if (path.extension() == ".json") {
    const nlohmann::json file = read_json(path);
    const nlohmann::json& person = lowest_person(file, where);
    return body_fit(where, person.contains("shapes"), [&](const char* name) { return json_numbers(json_member(person, name, where, ""), where, name); });
  }
  const PythonData data = read_npy(path);
  const auto numbers = [&](const char* name) { return python_numbers(python_member(*data.root, name, where, ""), -1, where, name); };
  return body_fit(where, python_find(*data.root, "shapes") != nullptr, numbers);
}

bool has_fit(const DatasetFrame& frame) { return frame.fitted || std::filesystem::is_regular_file(frame.fit); }

BodyFit fit_of(const DatasetFrame& frame) { return frame.fitted ? *frame.fitted : read_body_fit(frame.fit); }

Pose pose_of_fit(const BodyFit& fit, const glm::dvec3& root_rest) {
  const glm::dmat3 turn = rotation_from_axis_angle(fit.Rh);
  Pose pose;
  pose.theta = fit.poses;
  // Exactly Rh where the root has no rotation of its own, as is usual.
  pose.theta.at(0) = fit.poses[0] == glm::dvec3(0.0) ? fit.Rh : axis_angle_from_rotation(turn * rotation_from_axis_angle(fit.poses[0]));
  pose.root_position = turn * root_rest + fit.Th;
  return pose;
}

}  // namespace arah

// Bodies that EasyMocap fitted to frames.
#include <glm/mat3x3.hpp>

#include "host/body/npy.h"
#include "host/capture/dataset.h"
#include "host/input_error.h"

namespace arah {
namespace {

std::vector<glm::dvec3> as_vectors(const std::vector<double>& numbers, const std::string& where, const std::string& field) {
  if (numbers.empty() || numbers.size() % 3 != 0) throw InputError(where, field, "three numbers a joint", fmt::format("{} numbers", numbers.size()));
  std::vector<glm::dvec3> vectors;
  for (std::size_t i = 0; i < numbers.size(); i += 3) vectors.emplace_back(numbers[i], numbers[i + 1], numbers[i + 2]);
  return vectors;
}

}  // namespace

BodyFit read_body_fit(const std::filesystem::path& path) {
  const std::string where = path.string();
  const PythonData data = read_npy(path);
  const auto numbers = [&](const char* name, long count) { return python_numbers(python_member(*data.root, name, where, ""), count, where, name); };
  BodyFit fit;
  fit.poses = as_vectors(numbers("poses", -1), where, "poses");
  fit.Rh = as_vectors(numbers("Rh", 3), where, "Rh")[0];
  fit.Th = as_vectors(numbers("Th", 3), where, "Th")[0];
  if (python_find(*data.root, "shapes")) fit.shapes = numbers("shapes", -1);
  return fit;
}

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

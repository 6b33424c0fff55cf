#include "host/rendering/distance_slice.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <glm/matrix.hpp>
#include <stdexcept>

#include "host/rendering/rendering_stopped.h"

namespace arah {

SlicePlane plane_facing(const Camera& camera, const glm::dvec3& point) {
  const double depth = camera.to_camera(point).z;
  if (!(depth > 0)) throw std::invalid_argument(fmt::format("a plane {} m behind the camera", -depth));
  const glm::dmat3 to_world = glm::transpose(camera.R) * glm::inverse(camera.K) * depth;
  return {camera.center() + to_world * glm::dvec3(-0.5, -0.5, 1), to_world * glm::dvec3(camera.width, 0, 0), to_world * glm::dvec3(0, camera.height, 0)};
}

DistanceSlice distance_slice(Device& device, Commands& commands, FrameOnDevice& frame, RaySamples& samples, Field& field, const RootFindingSettings& search, double metres_per_unit, const SlicePlane& plane, int width, int height,
                             const std::function<bool(double)>& progress) {
  if (width < 1 || height < 1) throw std::invalid_argument(fmt::format("a slice of {} x {} pixels", width, height));
  DistanceSlice slice{width, height, {}, {}};
  const auto columns = static_cast<size_t>(width), pixels = columns * static_cast<size_t>(height);
  const glm::dvec3 root(frame.root_translation()[0], frame.root_translation()[1], frame.root_translation()[2]);
  const uint32_t at_a_time = std::min(samples.root_finder().capacity(), field.capacity());
  for (size_t first = 0; first < pixels; first += at_a_time) {
    if (progress && !progress(double(first) / double(pixels))) throw RenderingStopped();
    const auto count = static_cast<uint32_t>(std::min<size_t>(at_a_time, pixels - first));
    std::vector<std::array<float, 4>> rows(padded_points(count), {0, 0, 0, 0});
    for (size_t i = 0; i < count; ++i) {
      const glm::vec3 point(plane.at(double((first + i) % columns), double((first + i) / columns), width, height) - root);
      rows[i] = {point.x, point.y, point.z, 1};
    }
    device.upload(samples.points(), rows);
    const RootFindingCounts of_pictures = samples.root_finder().counts();
    samples.root_finder().solve(commands, frame, count, samples.points(), samples.canonical(), search);
    samples.root_finder().restore_counts(of_pictures);
    const Matrix sdf = field.record_distances(commands, frame.constants(), samples.canonical(), count, false);
    commands.submit_and_wait();
    const auto values = device.download<float>(sdf.slice.elements(0, uint64_t(count) * sdf.stride));
    const auto places = device.download<std::array<float, 4>>(samples.canonical().sub(0, count * 16ull));
    for (size_t i = 0; i < count; ++i) {
      const bool found = places[i][3] > 0;
      slice.found.push_back(found);
      slice.distances.push_back(found ? static_cast<float>(metres_per_unit * double{values[i * sdf.stride + sdf.column]}) : 0.0f);
    }
  }
  return slice;
}

}  // namespace arah

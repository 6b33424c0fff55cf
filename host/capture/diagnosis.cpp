#include "host/capture/diagnosis.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <glm/geometric.hpp>
#include <glm/matrix.hpp>
#include <map>
#include <optional>
#include <set>
#include <tuple>

#include "host/capture/software_renderer.h"

namespace arah {
namespace {

constexpr int kMostShift = 8;           // frames
constexpr std::size_t kFirstLook = 8;   // pictures by which corrections are ranked before all are looked at
constexpr std::size_t kRanked = 6;      // corrections that all pictures are tried with

// A mistake undone. What is empty leaves its part as it is.
struct Correction {
  std::string cause, undone;
  std::function<Camera(const Camera&)> camera{};
  std::function<Pose(const Pose&)> pose{};
  int shift = 0;  // frames of the motion by which the pose comes after the picture
  bool inverts_mask = false, mirrors_picture = false;
};

glm::dmat3 mirrored_axis(int axis) {
  glm::dmat3 m(1.0);
  m[axis][axis] = -1.0;
  return m;
}

// The body in a world of other axes, which may be of the other hand: then it is mirrored in itself too, left to right, as its
// rest pose is in such a world.
Pose in_axes(const Pose& pose, const glm::dmat3& axes) {
  const bool other_hand = glm::determinant(axes) < 0.0;
  const glm::dmat3 own = other_hand ? mirrored_axis(0) : glm::dmat3(1.0);
  Pose result = pose;
  result.root_position = axes * pose.root_position;
  for (std::size_t j = 0; j < pose.theta.size(); ++j) {
    const glm::dmat3 rotation = rotation_from_axis_angle(pose.theta[j]);
    result.theta[j] = axis_angle_from_rotation((j == 0 ? axes : own) * rotation * own);
  }
  return result;
}

// "x, z, -y": what the axes of the motion's world are in the cameras'.
std::string axes_text(const glm::dmat3& axes) {
  std::string text;
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 3; ++column) {
      if (axes[column][row] != 0.0) text += fmt::format("{}{}{}", text.empty() ? "" : ", ", axes[column][row] < 0.0 ? "-" : "", "xyz"[column]);
    }
  }
  return text;
}

Camera with_scaled_intrinsics(Camera camera, double factor) {
  camera.K[0][0] *= factor;
  camera.K[1][0] *= factor;
  camera.K[1][1] *= factor;
  camera.K[2][0] = (camera.K[2][0] + 0.5) * factor - 0.5;
  camera.K[2][1] = (camera.K[2][1] + 0.5) * factor - 0.5;
  return camera;
}

void add_lengths(std::vector<Correction>& list) {
  for (const auto& [unit, metres] : {std::pair{"millimetres", 1e-3}, std::pair{"centimetres", 1e-2}}) {
    const auto nearer = [metres = metres](const Camera& from) {
      Camera camera = from;
      camera.T *= metres;
      return camera;
    };
    const auto smaller = [metres = metres](const Pose& from) {
      Pose pose = from;
      pose.root_position *= metres;
      return pose;
    };
    list.push_back({fmt::format("T of cameras.json is in {}, where metres belong", unit), fmt::format("T times {}", metres), nearer});
    list.push_back({fmt::format("root positions of the motion are in {}, where metres belong", unit), fmt::format("root positions times {}", metres), {}, smaller});
    list.push_back({fmt::format("T of cameras.json and the motion's root positions are in {}, where metres belong", unit), fmt::format("both times {}", metres), nearer, smaller});
  }
}

void add_extrinsics(std::vector<Correction>& list) {
  const auto add = [&](const std::string& cause, const std::string& undone, const std::function<void(Camera&)>& undo) {
    list.push_back({cause, undone, [undo](const Camera& from) {
                      Camera camera = from;
                      undo(camera);
                      return camera;
                    }});
  };
  const std::function<void(Camera&)> transpose = [](Camera& camera) { camera.R = glm::transpose(camera.R); };
  const std::function<void(Camera&)> from_place = [](Camera& camera) { camera.T = -(camera.R * camera.T); };
  const std::function<void(Camera&)> invert = [=](Camera& camera) {
    transpose(camera);
    from_place(camera);
  };
  // OpenGL's camera looks along -z, its y goes up.
  const std::function<void(Camera&)> turn_over = [](Camera& camera) {
    const glm::dmat3 flip(1, 0, 0, 0, -1, 0, 0, 0, -1);
    camera.R = flip * camera.R;
    camera.T = flip * camera.T;
  };
  const std::string opengl = "the cameras have OpenGL's axes (y up, looking along -z), where OpenCV's belong (y down, looking along z)";
  const std::string turned = "the cameras' y and z turned over";
  add(opengl, turned, turn_over);
  for (const auto& [cause, undone, undo] : {std::tuple{"R of cameras.json is transposed: it goes from the camera to the world, where world to camera belongs", "R transposed", transpose},
                                            std::tuple{"T of cameras.json is the camera's place in the world, where -R times that place belongs", "T = -R times that place", from_place},
                                            std::tuple{"R and T of cameras.json go from the camera to the world, where world to camera belongs", "both inverted", invert}}) {
    add(cause, undone, undo);
    add(fmt::format("{}; and {}", cause, opengl), fmt::format("{} and {}", undone, turned), [undo = undo, turn_over](Camera& camera) {  // a binding by its own name is C++20, which Clang 14 does not know
      undo(camera);
      turn_over(camera);
    });
  }
}

// The 47 other ways in which the motion's axes may lie in the cameras' world.
void add_world_axes(std::vector<Correction>& list) {
  std::array<int, 3> order{0, 1, 2};
  do {
    for (int signs = 0; signs < 8; ++signs) {
      glm::dmat3 axes(0.0);
      for (int row = 0; row < 3; ++row) axes[order[static_cast<std::size_t>(row)]][row] = signs >> row & 1 ? -1.0 : 1.0;
      if (axes == glm::dmat3(1.0)) continue;
      std::string cause = glm::determinant(axes) < 0.0 ? "the motion's world is of the other hand than the cameras' (mirrored)" : "the motion's world has other axes than the cameras'";
      if (axes[1][2] == 1.0) cause += ": the motion has +Y up and the cameras +Z";
      if (axes[2][1] == 1.0) cause += ": the motion has +Z up and the cameras +Y";
      list.push_back({cause, fmt::format("the motion's ({}) for the cameras' (x, y, z)", axes_text(axes)), {}, [axes](const Pose& pose) { return in_axes(pose, axes); }});
    }
  } while (std::next_permutation(order.begin(), order.end()));
}

// Calibrations of left-handed programs: world and camera are both mirrored, so that R is a rotation.
void add_other_hands(std::vector<Correction>& list) {
  for (int own = 0; own < 2; ++own) {
    for (int world = 0; world < 3; ++world) {
      list.push_back({"R and T of cameras.json are of a left-handed world and camera, where right-handed ones belong",
                      fmt::format("{} of the cameras and {} of their world mirrored", "xyz"[own], "xyz"[world]), [own, world](const Camera& from) {
                        Camera camera = from;
                        camera.R = mirrored_axis(own) * camera.R * mirrored_axis(world);
                        camera.T = mirrored_axis(own) * camera.T;
                        return camera;
                      }});
    }
  }
}

void add_pictures(std::vector<Correction>& list, const std::vector<Camera>& cameras) {
  Correction mirrored{"the pictures are mirrored, left to right", "pictures mirrored", {}, {}};
  mirrored.mirrors_picture = true;
  list.push_back(mirrored);
  Correction inverted{"the masks are inverted: alpha is 1 beside the person, where it is 1 on the person", "masks inverted", {}, {}};
  inverted.inverts_mask = true;
  list.push_back(inverted);
  // Principal points lie near the middle, so they tell the size that K is for.
  double size = 0.0;
  for (const Camera& camera : cameras) size += (2.0 * camera.K[2][0] + 1.0) / camera.width / static_cast<double>(cameras.size());
  std::vector<double> factors{0.25, 0.5, 2.0 / 3.0, 1.5, 2.0, 4.0};
  if (size > 0.02 && std::abs(std::log(size)) > 0.1) factors.push_back(1.0 / size);
  for (const double factor : factors) {
    list.push_back({fmt::format("K of cameras.json is for pictures {:.3g} times as wide as these", 1.0 / factor), fmt::format("K times {:.3g}", factor),
                    [factor](const Camera& camera) { return with_scaled_intrinsics(camera, factor); }});
  }
}

void add_shifts(std::vector<Correction>& list) {
  for (int by = 1; by <= kMostShift; ++by) {
    for (const int shift : {by, -by}) {
      const std::string frames = fmt::format("{} frame{}", by, by == 1 ? "" : "s");
      Correction correction{fmt::format("pictures and poses are out of step: a picture shows the pose {} {} its own", frames, shift > 0 ? "after" : "before"),
                            fmt::format("poses from {} {}", frames, shift > 0 ? "later" : "earlier"), {}, {}};
      correction.shift = shift;
      list.push_back(correction);
    }
  }
}

Agreement agreement_of(const Camera& camera, const PixelMask& mask, std::span<const glm::vec3> vertices, std::span<const glm::uvec3> triangles) {
  const auto in_mask = [&](int u, int v) { return mask.inside[static_cast<std::size_t>(v) * static_cast<std::size_t>(mask.width) + static_cast<std::size_t>(u)] != 0; };
  std::size_t inside = 0;
  for (const glm::vec3& vertex : vertices) {
    if (!(camera.to_camera(glm::dvec3(vertex)).z > 0.0)) continue;
    const glm::dvec2 pixel = camera.project(glm::dvec3(vertex));
    if (!(pixel.x > -0.5 && pixel.y > -0.5 && pixel.x < mask.width - 0.5 && pixel.y < mask.height - 0.5)) continue;
    const int u = static_cast<int>(std::lround(pixel.x)), v = static_cast<int>(std::lround(pixel.y));
    bool found = false;
    for (int y = std::max(0, v - 1); !found && y <= std::min(mask.height - 1, v + 1); ++y) {
      for (int x = std::max(0, u - 1); !found && x <= std::min(mask.width - 1, u + 1); ++x) found = in_mask(x, y);
    }
    inside += found ? 1 : 0;
  }
  const std::vector<VisiblePlace> places = visible_places(camera, vertices, triangles);
  std::size_t both = 0, either = 0;
  for (std::size_t i = 0; i < places.size(); ++i) {
    const bool body = places[i].triangle != VisiblePlace::no_triangle, masked = mask.inside[i] != 0;
    both += body && masked ? 1 : 0;
    either += body || masked ? 1 : 0;
  }
  return {static_cast<double>(inside) / static_cast<double>(std::max<std::size_t>(1, vertices.size())), static_cast<double>(both) / static_cast<double>(std::max<std::size_t>(1, either))};
}

PixelMask changed(const PixelMask& mask, const Correction& correction) {
  PixelMask result = mask;
  for (std::uint8_t& pixel : result.inside) pixel = static_cast<std::uint8_t>((pixel != 0) != correction.inverts_mask);
  if (!correction.mirrors_picture) return result;
  for (auto row = result.inside.begin(); row != result.inside.end(); row += mask.width) std::reverse(row, row + mask.width);
  return result;
}

// The template in the motions' poses, each put together once.
class PosedBodies {
 public:
  explicit PosedBodies(const Capture& capture) : capture_(capture) {}

  const std::vector<glm::vec3>& as_stated(const std::string& split, std::size_t frame) {
    if (posed_.size() > kMostKept) posed_.clear();
    std::vector<glm::vec3>& vertices = posed_[{split, frame}];
    if (vertices.empty()) vertices = posed_vertices(capture_.body_template, capture_.motions.at(split).frames[frame].pose);
    return vertices;
  }

 private:
  static constexpr std::size_t kMostKept = 256;
  const Capture& capture_;
  std::map<std::pair<std::string, std::size_t>, std::vector<glm::vec3>> posed_;
};

// With the correction, one for each mask; none where the motion has no frame so far off.
std::vector<std::optional<Agreement>> corrected(const Capture& capture, PosedBodies& bodies, const std::vector<const SeenMask*>& masks, const Correction& correction) {
  std::vector<std::optional<Agreement>> result;
  for (const SeenMask* seen : masks) {
    const std::vector<MotionFrame>& frames = capture.motions.at(seen->split).frames;
    const auto frame = static_cast<std::ptrdiff_t>(seen->frame) + correction.shift;
    if (frame < 0 || frame >= static_cast<std::ptrdiff_t>(frames.size())) {
      result.emplace_back();
      continue;
    }
    const auto number = static_cast<std::size_t>(frame);
    std::vector<glm::vec3> moved;
    if (correction.pose) moved = posed_vertices(capture.body_template, correction.pose(frames[number].pose));
    const Camera& stated = capture.cameras[seen->camera];
    const Camera camera = (correction.camera ? correction.camera(stated) : stated).scaled(seen->mask.width);
    result.push_back(agreement_of(camera, changed(seen->mask, correction), correction.pose ? moved : bodies.as_stated(seen->split, number), capture.body_template.triangles));
  }
  return result;
}

// Of the pictures that have both.
struct Comparison {
  Agreement before, after;
  std::size_t pictures = 0, better = 0, worse = 0;

  double gain() const { return after.overlap - before.overlap; }
  bool helps(std::size_t of) const {
    const bool fits = after.inside >= 0.9 && after.overlap >= 0.4;
    const bool gains = gain() >= 0.05 && 1.0 - after.overlap <= 0.75 * (1.0 - before.overlap);
    return fits && gains && 2 * pictures >= of && 10 * better >= 7 * pictures && 10 * worse <= pictures;
  }
};

Comparison compare(const std::vector<Agreement>& before, const std::vector<std::optional<Agreement>>& after) {
  Comparison result;
  for (std::size_t i = 0; i < before.size(); ++i) {
    if (!after[i]) continue;
    ++result.pictures;
    result.before.inside += before[i].inside;
    result.before.overlap += before[i].overlap;
    result.after.inside += after[i]->inside;
    result.after.overlap += after[i]->overlap;
    result.better += after[i]->overlap > before[i].overlap ? 1 : 0;
    result.worse += after[i]->overlap < before[i].overlap - 0.1 ? 1 : 0;
  }
  const double scale = 1.0 / static_cast<double>(std::max<std::size_t>(1, result.pictures));
  for (double* sum : {&result.before.inside, &result.before.overlap, &result.after.inside, &result.after.overlap}) *sum *= scale;
  return result;
}

struct SeenMasks {
  std::vector<const SeenMask*> masks;
  std::vector<Agreement> before;

  SeenMasks evenly(std::size_t most) const {
    if (masks.size() <= most) return *this;
    SeenMasks some;
    for (std::size_t i = 0; i < most; ++i) {
      const std::size_t at = i * masks.size() / most;
      some.masks.push_back(masks[at]);
      some.before.push_back(before[at]);
    }
    return some;
  }
  // A view of a split by a camera whose template does not lie in its masks.
  bool off() const {
    std::map<std::pair<std::string, std::size_t>, std::array<double, 3>> views;
    for (std::size_t i = 0; i < masks.size(); ++i) {
      std::array<double, 3>& sums = views[{masks[i]->split, masks[i]->camera}];
      sums[0] += before[i].inside;
      sums[1] += before[i].overlap;
      sums[2] += 1.0;
    }
    return std::any_of(views.begin(), views.end(), [](const auto& view) { return view.second[0] < 0.98 * view.second[2] || view.second[1] < 0.5 * view.second[2]; });
  }
};

std::optional<Diagnosis> diagnose_these(const Capture& capture, PosedBodies& bodies, const SeenMasks& seen, const std::vector<Correction>& corrections, const std::string& of) {
  const bool off = seen.off();
  const SeenMasks some = seen.evenly(kFirstLook);
  std::vector<std::pair<double, std::size_t>> ranking;  // loss, correction
  for (std::size_t c = 0; c < corrections.size(); ++c) {
    if (!off && corrections[c].shift == 0) continue;  // a step too many or too few leaves most of the body in the masks
    const Comparison comparison = compare(some.before, corrected(capture, bodies, some.masks, corrections[c]));
    if (comparison.pictures > 0) ranking.emplace_back(-comparison.gain(), c);
  }
  std::stable_sort(ranking.begin(), ranking.end());
  if (ranking.size() > kRanked) ranking.resize(kRanked);
  std::sort(ranking.begin(), ranking.end(), [](const auto& a, const auto& b) { return a.second < b.second; });
  std::optional<Diagnosis> best;
  for (const auto& [loss, c] : ranking) {
    const Comparison comparison = compare(seen.before, corrected(capture, bodies, seen.masks, corrections[c]));
    // Of two that are as good the usual one, which comes first.
    if (!comparison.helps(seen.masks.size()) || (best && comparison.after.overlap < best->after.overlap + 0.005)) continue;
    best = Diagnosis{of, corrections[c].cause, corrections[c].undone, comparison.before, comparison.after, "", {}};
  }
  return best;
}

}  // namespace

std::vector<Agreement> agreements(const Capture& capture, std::span<const SeenMask> masks) {
  std::vector<const SeenMask*> all;
  for (const SeenMask& seen : masks) all.push_back(&seen);
  std::vector<Agreement> result;
  PosedBodies bodies(capture);
  for (const std::optional<Agreement>& agreement : corrected(capture, bodies, all, {})) result.push_back(*agreement);
  return result;
}

std::vector<Diagnosis> diagnose(const Capture& capture, std::span<const SeenMask> masks, std::span<const Agreement> before) {
  std::vector<Correction> all;
  add_extrinsics(all);
  add_lengths(all);
  add_pictures(all, capture.cameras);
  add_shifts(all);
  add_other_hands(all);
  add_world_axes(all);
  std::vector<Correction> of_a_camera;
  std::copy_if(all.begin(), all.end(), std::back_inserter(of_a_camera), [](const Correction& correction) { return !correction.pose; });

  const auto chosen = [&](const auto& wanted) {
    SeenMasks seen;
    for (std::size_t i = 0; i < masks.size(); ++i) {
      if (!wanted(masks[i])) continue;
      seen.masks.push_back(&masks[i]);
      seen.before.push_back(before[i]);
    }
    return seen;
  };
  if (masks.empty()) return {};
  PosedBodies bodies(capture);
  if (const auto found = diagnose_these(capture, bodies, chosen([](const SeenMask&) { return true; }), all, "all pictures")) return {*found};
  std::vector<Diagnosis> result;
  std::set<std::string> splits, explained;
  std::set<std::size_t> cameras;
  for (const SeenMask& seen : masks) splits.insert(seen.split), cameras.insert(seen.camera);
  for (const std::string& split : splits) {
    if (splits.size() == 1) break;
    if (const auto found = diagnose_these(capture, bodies, chosen([&](const SeenMask& seen) { return seen.split == split; }), all, "split " + split)) {
      result.push_back(*found);
      result.back().split = split;
      explained.insert(split);
    }
  }
  std::map<std::string, std::pair<std::size_t, double>> of_cause;  // its diagnosis, and of how many cameras
  for (const std::size_t camera : cameras) {
    const SeenMasks seen = chosen([&](const SeenMask& mask) { return mask.camera == camera && !explained.contains(mask.split); });
    if (seen.masks.empty() || cameras.size() == 1) continue;
    const std::string& name = capture.cameras[camera].name;
    const auto found = diagnose_these(capture, bodies, seen, of_a_camera, "camera " + name);
    if (!found) continue;
    const auto [place, first] = of_cause.try_emplace(found->cause, result.size(), 1.0);
    if (first) {
      result.push_back(*found);
      result.back().cameras.push_back(camera);
      continue;
    }
    Diagnosis& same = result[place->second.first];
    same.cameras.push_back(camera);
    const double count = ++place->second.second;
    same.of += ", " + name;
    for (const auto& [mean, value] : {std::pair{&same.before, &found->before}, std::pair{&same.after, &found->after}}) {
      mean->inside += (value->inside - mean->inside) / count;
      mean->overlap += (value->overlap - mean->overlap) / count;
    }
  }
  return result;
}

bool Diagnosis::covers(const std::string& of_split, std::size_t camera) const {
  return (split.empty() || split == of_split) && (cameras.empty() || std::find(cameras.begin(), cameras.end(), camera) != cameras.end());
}

std::string describe(const Diagnosis& diagnosis) {
  return fmt::format("{}: {}. As it is, {:.0f} % of the template lies in the masks and their silhouettes overlap by {:.0f} %; with {}, {:.0f} % and {:.0f} %", diagnosis.of, diagnosis.cause,
                     100.0 * diagnosis.before.inside, 100.0 * diagnosis.before.overlap, diagnosis.undone, 100.0 * diagnosis.after.inside, 100.0 * diagnosis.after.overlap);
}

}  // namespace arah

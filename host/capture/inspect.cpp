#include "host/capture/inspect.h"

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <glm/gtc/constants.hpp>
#include <iterator>
#include <map>
#include <set>

#include "host/body/canonical.h"
#include "host/body/gltf_motion.h"
#include "host/body/motion_file.h"
#include "host/capture/diagnosis.h"
#include "host/input_error.h"

namespace arah {
namespace {

constexpr int kWidth = 512;  // columns at which coverage is measured: the mask grows by 3 of these pixels
constexpr int kGrowth = 3;   // pixels
constexpr double kLowCoverage = 0.98;
constexpr double kLowOverlap = 0.1;  // less than that no clothes explain

template <typename... Args>
void line(std::string* report, fmt::format_string<Args...> format, Args&&... args) {
  fmt::format_to(std::back_inserter(*report), format, std::forward<Args>(args)...);
  report->push_back('\n');
}

// Frame numbers as ranges: "0-59, 61".
std::string ranges(std::vector<int> numbers) {
  std::sort(numbers.begin(), numbers.end());
  std::string text;
  for (std::size_t i = 0; i < numbers.size();) {
    std::size_t end = i;
    while (end + 1 < numbers.size() && numbers[end + 1] == numbers[end] + 1) ++end;
    if (!text.empty()) text += ", ";
    text += end == i ? fmt::format("{}", numbers[i]) : fmt::format("{}-{}", numbers[i], numbers[end]);
    i = end + 1;
  }
  return text;
}

// Edges that do not have one triangle on each side. Vertices at one position count as one: files split them at seams.
std::size_t open_edges(const BodyTemplate& body) {
  std::map<std::array<float, 3>, unsigned> first_at;
  std::vector<unsigned> merged(body.vertices.size());
  for (std::size_t i = 0; i < merged.size(); ++i) {
    const glm::vec3& v = body.vertices[i];
    merged[i] = first_at.try_emplace({v.x, v.y, v.z}, static_cast<unsigned>(i)).first->second;
  }
  std::map<std::pair<unsigned, unsigned>, int> balance;  // passages from low to high, minus those back
  for (const glm::uvec3& triangle : body.triangles) {
    for (int k = 0; k < 3; ++k) {
      const unsigned a = merged[triangle[k]], b = merged[triangle[(k + 1) % 3]];
      if (a != b) balance[std::minmax(a, b)] += a < b ? 1 : -1;
    }
  }
  return static_cast<std::size_t>(
      std::count_if(balance.begin(), balance.end(), [](const auto& edge) { return edge.second != 0; }));
}

// The share of vertices that project into the mask (alpha >= 0.5) grown by kGrowth pixels; those beside the picture or
// behind the camera do not count. A negative share means that none is in view.
double coverage(const Camera& camera, const Image& image, const std::vector<glm::vec3>& vertices) {
  std::size_t seen = 0, covered = 0;
  for (const glm::vec3& vertex : vertices) {
    if (!(camera.to_camera(glm::dvec3(vertex)).z > 0.0)) continue;
    const glm::dvec2 pixel = camera.project(glm::dvec3(vertex));
    if (!(pixel.x > -0.5 && pixel.y > -0.5 && pixel.x < image.width - 0.5 && pixel.y < image.height - 0.5)) continue;
    ++seen;
    const int u = static_cast<int>(std::lround(pixel.x)), v = static_cast<int>(std::lround(pixel.y));
    bool inside = false;
    for (int y = std::max(0, v - kGrowth); !inside && y <= std::min(image.height - 1, v + kGrowth); ++y) {
      for (int x = std::max(0, u - kGrowth); !inside && x <= std::min(image.width - 1, u + kGrowth); ++x) {
        const int at = y * image.width + x;
        inside = image.rgba[static_cast<std::size_t>(4 * at + 3)] >= 0.5f;
      }
    }
    covered += inside ? 1 : 0;
  }
  return seen == 0 ? -1.0 : static_cast<double>(covered) / static_cast<double>(seen);
}

// alpha >= 0.5, in at most kDiagnosisWidth columns.
PixelMask mask_of(const Image& image) {
  const Image small = image.width > kDiagnosisWidth ? reduced(image, kDiagnosisWidth) : image;
  PixelMask mask{small.width, small.height, {}};
  for (std::size_t p = 3; p < small.rgba.size(); p += 4) mask.inside.push_back(small.rgba[p] >= 0.5f ? 1 : 0);
  return mask;
}

// The pictures of one split from one camera: how many, which are missing, and how well the body fits the masks, which are kept.
InspectedView inspect_view(const Capture& capture, const std::string& split, std::size_t camera, int images, std::vector<SeenMask>* masks, std::vector<Agreement>* fits, std::string* report) {
  const Motion& motion = capture.motions.at(split);
  const std::string& name = capture.cameras[camera].name;
  const std::vector<int> frames = frames_with_images(capture, split, camera);
  InspectedView result;
  result.split = split;
  result.camera = camera;
  if (frames.empty()) {
    line(report, "  {} {}: no pictures", split, name);
    return result;
  }
  const Camera view = capture.cameras[camera].scaled(std::min(kWidth, capture.cameras[camera].width));
  const std::size_t count = std::min(frames.size(), static_cast<std::size_t>(std::max(0, images)));
  const std::size_t first_mask = masks->size();
  result.frame = frames[0];
  result.least = 1.0;
  std::vector<int> empty, full;
  std::string unreadable;
  for (std::size_t i = 0; i < count; ++i) {
    const int frame = frames[count == 1 ? 0 : i * (frames.size() - 1) / (count - 1)];
    Image image;
    try {
      image = load_image(capture, split, camera, frame, view.width);
    } catch (const InputError& error) {
      line(&unreadable, "warning: {}", error.what());
      continue;
    }
    std::size_t inside = 0;
    for (std::size_t p = 3; p < image.rgba.size(); p += 4) inside += image.rgba[p] >= 0.5f ? 1 : 0;
    if (inside == 0 || 4 * inside == image.rgba.size()) {
      (inside == 0 ? empty : full).push_back(frame);
      continue;
    }
    const MotionFrame* of_motion = find_frame(motion, frame);
    masks->push_back({split, static_cast<std::size_t>(of_motion - motion.frames.data()), camera, mask_of(image)});
    const double share = coverage(view, image, posed_vertices(capture.body_template, of_motion->pose));
    if (share < 0.0) {
      result.out_of_view.push_back(frame);
      continue;
    }
    ++result.measured;
    result.inside += share;
    if (share < result.least) {
      result.least = share;
      result.frame = frame;
    }
  }
  std::string text =
      fmt::format("  {} {}: {} of {} frames have pictures", split, name, frames.size(), motion.frames.size());
  const std::vector<Agreement> fit = agreements(capture, std::span(*masks).subspan(first_mask));
  fits->insert(fits->end(), fit.begin(), fit.end());
  if (result.measured > 0) {
    result.inside /= result.measured;
    for (const Agreement& agreement : fit) result.overlap += agreement.overlap / static_cast<double>(fit.size());
    text += fmt::format("; template inside the mask: mean {:.2f} %, least {:.2f} % (frame {}), {} measured; silhouettes overlap by {:.0f} %",
                        100.0 * result.inside, 100.0 * result.least, result.frame, result.measured, 100.0 * result.overlap);
  }
  line(report, "{}{}", text, unreadable.empty() ? "" : "\n" + unreadable.substr(0, unreadable.size() - 1));
  if (!empty.empty()) line(report, "warning: {} {}: empty masks in frames {}", split, name, ranges(empty));
  if (!full.empty()) {
    line(report, "warning: {} {}: masks that fill the whole picture in frames {}: is the person cut out?", split, name, ranges(full));
  }
  return result;
}

// What explains a bad fit, and which views fit badly where nothing does.
void inspect_fit(const Capture& capture, const std::vector<InspectedView>& views, const std::vector<SeenMask>& masks, const std::vector<Agreement>& fits, std::string* report) {
  const std::vector<Diagnosis> found = diagnose(capture, masks, fits);
  for (const Diagnosis& diagnosis : found) line(report, "warning: {}", describe(diagnosis));
  for (const InspectedView& view : views) {
    if (std::any_of(found.begin(), found.end(), [&](const Diagnosis& diagnosis) { return diagnosis.covers(view.split, view.camera); })) continue;
    const std::string& name = capture.cameras[view.camera].name;
    if (!view.out_of_view.empty()) {
      line(report, "warning: {} {}: the posed template is outside the picture in frames {}", view.split, name,
           ranges(view.out_of_view));
    }
    if (view.measured == 0) continue;
    if (view.inside < kLowCoverage) {
      line(report, "warning: {} {}: only {:.1f} % of the template falls into the masks: calibration, poses or masks are off", view.split, name, 100.0 * view.inside);
    } else if (view.overlap < kLowOverlap) {
      line(report, "warning: {} {}: the template covers little of the masks, silhouettes overlap by {:.0f} %: calibration, poses or masks are off", view.split, name, 100.0 * view.overlap);
    }
  }
}

}  // namespace

std::string inspect_template(const BodyTemplate& body) {
  std::string report;
  line(&report, "template: {} vertices, {} triangles, {} joints", body.vertices.size(), body.triangles.size(),
       body.skeleton.size());
  glm::vec3 least = body.vertices.at(0), greatest = least;
  for (const glm::vec3& v : body.vertices) {
    least = glm::min(least, v);
    greatest = glm::max(greatest, v);
  }
  const glm::vec3 size = greatest - least;
  line(&report, "  size {:.3f} x {:.3f} x {:.3f} m (x, y up, z)", size.x, size.y, size.z);
  if (size.y < 0.2f || size.y > 5.0f) line(&report, "warning: a body {:.3g} m high: is the unit metres?", size.y);
  if (size.y < size.z) line(&report, "warning: the body is deeper than high: is +Y up?");
  const CanonicalPose canonical = make_canonical_pose(body.skeleton);
  const int hip = find_joint(body.skeleton, "left_hip");
  if (has_smpl_legs(body.skeleton)) {
    const glm::dmat4& v = canonical.rest_to_canonical[static_cast<std::size_t>(hip)];
    line(&report, "  rig: SMPL's leg names; canonical pose turns the left leg outward by {:.1f} degrees",
         glm::degrees(std::atan2(v[0][1], v[0][0])));
  } else {
    line(&report, "  rig: not SMPL's; the canonical pose is the rest pose");
  }
  const CubeNormalization cube = cube_normalization(canonical_vertices(body, canonical));
  line(&report, "  canonical cube: center ({:.3f}, {:.3f}, {:.3f}) m, {:.4f} m to a unit", cube.center.x, cube.center.y,
       cube.center.z, cube.metres_per_unit());
  const std::size_t open = open_edges(body);
  if (open > 0) line(&report, "warning: the mesh is not closed: {} open edges; inside and outside are uncertain", open);
  std::vector<bool> used(body.skeleton.size(), false);
  for (std::size_t i = 0; i < body.vertices.size(); ++i) {
    for (int k = 0; k < 4; ++k) {
      if (body.weights[i][k] > 0.0f) used[body.joints[i][k]] = true;
    }
  }
  for (std::size_t j = 0; j < used.size(); ++j) {
    if (!used[j]) line(&report, "  joint '{}' moves no vertex", body.skeleton.names[j]);
  }
  const auto farthest = [](const auto& offsets) {
    double most = 0.0;
    for (const auto& offset : offsets) most = std::max(most, 1000.0 * glm::length(glm::dvec3(offset)));
    return most;
  };
  const ShapeSpace& shape = body.shape;
  for (std::size_t b = 0; b < shape.size(); ++b) {
    line(&report, "  shape '{}': a unit moves vertices by up to {:.1f} mm, rest joints by up to {:.1f} mm; {:g} here", shape.names[b],
         farthest(shape.vertex_offsets[b]), farthest(shape.joint_offsets[b]), shape.beta[b]);
  }
  if (!shape.ignored.empty()) line(&report, "  shape: {}", shape.ignored);
  return report;
}

namespace {

// Joints as they are found by their names, and those that are not.
std::string inspect_motion_file(const MotionFile& file) {
  std::string report, unknown;
  const Motion& motion = file.motion;
  line(&report, "{}: {} frames{}, {} joints", file.format, motion.frames.size(),
       motion.frames_per_second > 0 ? fmt::format(" at {:.4g} a second", motion.frames_per_second) : "", motion.skeleton.size());
  const std::vector<NamedJoint> names = smpl_names(motion.skeleton);
  for (const NamedJoint& named : names) line(&report, "  {:<16} {}", named.name, motion.skeleton.names[static_cast<std::size_t>(named.joint)]);
  for (std::size_t j = 0; j < motion.skeleton.size(); ++j) {
    if (std::any_of(names.begin(), names.end(), [&](const NamedJoint& named) { return named.joint == static_cast<int>(j); })) continue;
    unknown += (unknown.empty() ? "" : ", ") + motion.skeleton.names[j];
  }
  if (!unknown.empty()) line(&report, "  of other names: {}", unknown);
  glm::dvec3 least = motion.frames.at(0).pose.root_position, greatest = least;
  for (const MotionFrame& frame : motion.frames) {
    least = glm::min(least, frame.pose.root_position);
    greatest = glm::max(greatest, frame.pose.root_position);
  }
  line(&report, "  root moves through {:.4g} x {:.4g} x {:.4g} {}, +Z up", greatest.x - least.x, greatest.y - least.y, greatest.z - least.z,
       file.format == "BVH" ? "of the file's units" : "m");
  for (const std::string& note : file.notes) line(&report, "note: {}", note);
  return report;
}

}  // namespace

std::string inspect_motion(const Motion& motion) {
  std::string report;
  std::vector<int> numbers;
  for (const MotionFrame& frame : motion.frames) numbers.push_back(frame.number);
  line(&report, "motion '{}': {} frames ({}){}, {} joints", motion.split, motion.frames.size(), ranges(numbers),
       motion.frames_per_second > 0 ? fmt::format(" at {:.4g} a second", motion.frames_per_second) : "", motion.skeleton.size());
  double largest = 0.0;
  glm::dvec3 least = motion.frames.at(0).pose.root_position, greatest = least;
  for (const MotionFrame& frame : motion.frames) {
    least = glm::min(least, frame.pose.root_position);
    greatest = glm::max(greatest, frame.pose.root_position);
    for (const glm::dvec3& theta : frame.pose.theta) largest = std::max(largest, glm::length(theta));
  }
  line(&report, "  root moves through {:.2f} x {:.2f} x {:.2f} m; largest rotation {:.0f} degrees",
       greatest.x - least.x, greatest.y - least.y, greatest.z - least.z, glm::degrees(largest));
  if (largest > 2.0 * glm::pi<double>() + 1e-6) {
    line(&report, "warning: a rotation of {:.0f} degrees: are the angles radians?", glm::degrees(largest));
  }
  if (glm::length(greatest - least) > 100.0) line(&report, "warning: the root moves very far: is the unit metres?");
  return report;
}

CaptureInspection examine_capture(const Capture& capture, int images_per_camera) {
  CaptureInspection result;
  std::string& report = result.report;
  std::vector<SeenMask> masks;
  std::vector<Agreement> fits;
  line(&report, "capture {}: {} cameras, {} splits", capture.path.string(), capture.cameras.size(),
       capture.motions.size());
  report += inspect_template(capture.body_template);
  for (const auto& [split, motion] : capture.motions) report += inspect_motion(motion);
  std::size_t training = 0;
  for (const Camera& camera : capture.cameras) {
    const glm::dvec3 center = camera.center();
    line(&report, "camera {} ({}): {}x{}, focal length {:.1f} px, at ({:.2f}, {:.2f}, {:.2f}) m{}", camera.name,
         camera.role, camera.width, camera.height, camera.K[0][0], center.x, center.y, center.z,
         camera.distorted() ? ", pictures are distorted" : "");
    training += camera.role == "train" ? 1 : 0;
  }
  if (training == 0) line(&report, "warning: no camera has the role 'train'");
  line(&report, "pictures:");
  for (const auto& [split, motion] : capture.motions) {
    std::vector<int> without;
    for (const MotionFrame& frame : motion.frames) {
      bool any = false;
      for (std::size_t c = 0; !any && c < capture.cameras.size(); ++c) {
        any = std::filesystem::is_regular_file(image_path(capture, split, c, frame.number));
      }
      if (!any) without.push_back(frame.number);
    }
    if (!without.empty()) line(&report, "warning: {}: frames without a picture: {}", split, ranges(without));
    // A training camera should see every training frame; held-out ones may see a few.
    for (std::size_t c = 0; c < capture.cameras.size(); ++c) {
      result.views.push_back(inspect_view(capture, split, c, images_per_camera, &masks, &fits, &report));
      if (split != "train" || capture.cameras[c].role != "train") continue;
      const std::vector<int> present = frames_with_images(capture, split, c);
      const std::set<int> found(present.begin(), present.end());
      std::vector<int> missing;
      for (const MotionFrame& frame : motion.frames) {
        if (!found.contains(frame.number)) missing.push_back(frame.number);
      }
      if (!missing.empty()) {
        line(&report, "warning: {} {}: no picture of frames {}", split, capture.cameras[c].name, ranges(missing));
      }
    }
  }
  inspect_fit(capture, result.views, masks, fits, &report);
  return result;
}

std::vector<std::string> CaptureInspection::warnings() const {
  constexpr std::string_view kWord = "warning: ";
  std::vector<std::string> found;
  for (std::size_t at = 0; at < report.size();) {
    const std::size_t end = std::min(report.find('\n', at), report.size());
    const std::string text = report.substr(at, end - at);
    if (text.starts_with(kWord)) found.push_back(text.substr(kWord.size()));
    at = end + 1;
  }
  return found;
}

std::string inspect_capture(const Capture& capture, int images_per_camera) {
  return examine_capture(capture, images_per_camera).report;
}

namespace {

// A template, its animations, or both.
std::string inspect_gltf(const std::filesystem::path& path) {
  const std::vector<std::string> animations = gltf_animation_names(path);
  if (animations.empty()) return inspect_template(read_body_template(path));
  std::string report;
  try {
    report = inspect_template(read_body_template(path));
  } catch (const InputError& error) {
    line(&report, "no template: {}", error.what());
  }
  for (const std::string& animation : animations) {
    try {
      report += inspect_motion_file(read_motion_file(path, animation));
    } catch (const InputError& error) {
      line(&report, "no motion: {}", error.what());
    }
  }
  return report;
}

}  // namespace

std::string inspect(const std::filesystem::path& path) {
  if (std::filesystem::is_directory(path)) return inspect_capture(open_capture(path));
  if (!std::filesystem::exists(path)) throw InputError(path.string(), "", "a file or a folder", "nothing of this name");
  const std::string extension = path.extension().string();
  if (extension == ".glb" || extension == ".gltf") return inspect_gltf(path);
  if (path.filename() == "cameras.json") {
    std::string report;
    for (const Camera& camera : read_cameras(path)) {
      line(&report, "camera {} ({}): {}x{}, focal length {:.1f} px", camera.name, camera.role, camera.width,
           camera.height, camera.K[0][0]);
    }
    return report;
  }
  if (extension == ".json") return inspect_motion(read_motion(path));
  if (is_foreign_motion(path)) return inspect_motion_file(read_motion_file(path));
  throw InputError(path.string(), "", "a capture's folder, a motion (.json, .bvh, .glb, .gltf, .npz, .pkl) or a template (.glb, .gltf)",
                   "a file ending in '" + extension + "'");
}

}  // namespace arah

#include "host/capture/body_family.h"

#include <algorithm>
#include <atomic>
#include <exception>
#include <glm/matrix.hpp>
#include <mutex>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <thread>

#include "host/body/json_fields.h"
#include "host/capture/implicit_surface.h"
#include "host/capture/synthetic_motion.h"
#include "host/input_error.h"

namespace arah {

namespace {

constexpr double kPoseLag = 1.0 / 30.0;    // s, over which the velocity that clothes lag behind is taken
constexpr double kLeastDeterminant = 0.1;  // of a blended transform that is still undone

// Throws InputError naming `name` where its joints are not those of `first`.
void require_same_joints(const FamilyMember& first, const FamilyMember& member) {
  const Skeleton &expected = first.figure.body.skeleton, &found = member.figure.body.skeleton;
  const std::string advice = "All bodies of a family hang on the same tree of joints.";
  if (found.size() != expected.size())
    throw InputError(member.name, "joints", fmt::format("{} as in {}", expected.size(), first.name), fmt::format("{}", found.size()), advice);
  for (std::size_t j = 0; j < expected.size(); ++j) {
    const std::string field = fmt::format("joint {}", j);
    if (found.names[j] != expected.names[j])
      throw InputError(member.name, field, fmt::format("'{}' as in {}", expected.names[j], first.name), fmt::format("'{}'", found.names[j]), advice);
    if (found.parents[j] != expected.parents[j])
      throw InputError(member.name, fmt::format("{} ('{}')", field, found.names[j]), fmt::format("parent {} as in {}", expected.parents[j], first.name),
                       fmt::format("{}", found.parents[j]), advice);
  }
}

glm::dmat4 blended(const std::vector<glm::dmat4>& transforms, const glm::u8vec4& joints, const glm::vec4& weights) {
  glm::dmat4 sum(0.0);
  for (int k = 0; k < 4; ++k)
    if (weights[k] > 0) sum += static_cast<double>(weights[k]) * transforms[joints[k]];
  return sum;
}

// Of a member's pose, s.
double pose_time(const BodyFamily& family, std::size_t member, std::size_t pose, std::size_t poses, double shift) {
  return kSyntheticMotionSeconds * ((static_cast<double>(pose) + shift + static_cast<double>(member) / static_cast<double>(family.members.size())) / static_cast<double>(poses));
}

// Triangles none of whose corners is left out; normals of all.
CanonicalSurface visible_surface(const ClothedFigure& figure, std::vector<glm::dvec3> vertices, const std::vector<bool>& left_out) {
  CanonicalSurface surface;
  surface.normals = vertex_normals(vertices, figure.triangles);
  surface.vertices = std::move(vertices);
  const auto visible = [&](std::uint32_t i) { return !left_out[i] && figure.under_cloth[i] == 0; };
  for (const glm::uvec3& t : figure.triangles)
    if (visible(t.x) && visible(t.y) && visible(t.z)) surface.triangles.push_back(t);
  return surface;
}

}  // namespace

BodyFamily generated_family(std::size_t bodies, std::uint64_t first_seed, const std::function<bool(std::size_t)>& progress, const std::optional<RestingArms>& arms) {
  if (bodies == 0) throw InputError("family", "bodies", "at least 1", "0");
  BodyFamily family;
  family.members.resize(bodies);
  std::atomic<std::size_t> next{0};
  std::mutex mutex;
  std::exception_ptr error;
  std::size_t made = 0;
  const auto work = [&] {
    for (std::size_t i = next++; i < bodies; i = next++) {
      try {
        const std::uint64_t seed = first_seed + i;
        family.members[i] = {fmt::format("body {}", seed), make_clothed_figure(0, varied_figure(seed))};
        if (arms) rest_with(family.members[i].figure, *arms);
        const std::lock_guard lock(mutex);
        if (progress && !progress(++made)) throw std::runtime_error("stopped");
      } catch (...) {
        const std::lock_guard lock(mutex);
        if (!error) error = std::current_exception();
        next = bodies;
      }
    }
  };
  {
    std::vector<std::jthread> threads;
    for (std::size_t k = 1; k < std::min<std::size_t>(bodies, std::max(1u, std::thread::hardware_concurrency())); ++k) threads.emplace_back(work);
    work();
  }
  if (error) std::rethrow_exception(error);
  nlohmann::ordered_json description{{"kind", "generated"}, {"bodies", bodies}, {"first_seed", first_seed}};
  if (arms)
    for (const auto& side : arms->bones)
      for (const glm::dvec3& bone : side) description["arms"].push_back({bone.x, bone.y, bone.z});
  family.description = description.dump();
  return family;
}

std::optional<RestingArms> described_arms(const std::string& description) {
  const std::string where = "the bodies that the file began with";
  const auto parsed = parse_json(description, where);
  if (!parsed.contains("arms")) return {};
  RestingArms arms;
  const auto& bones = json_list(parsed["arms"], 6, where, "arms");
  for (std::size_t i = 0; i < 6; ++i) arms.bones[i / 3][i % 3] = json_vector(bones[i], where, fmt::format("arms[{}]", i));
  return arms;
}

BodyFamily family_from_folder(const std::filesystem::path& folder) {
  if (!std::filesystem::is_directory(folder)) throw InputError(folder.string(), "", "a folder of .glb or .gltf bodies", "no such folder");
  std::vector<std::filesystem::path> files;
  for (const auto& entry : std::filesystem::directory_iterator(folder))
    if (entry.is_regular_file() && (entry.path().extension() == ".glb" || entry.path().extension() == ".gltf")) files.push_back(entry.path());
  if (files.empty()) throw InputError(folder.string(), "", "skinned bodies, .glb or .gltf", "none");
  std::sort(files.begin(), files.end());
  BodyFamily family;
  std::vector<std::string> names;
  for (const auto& file : files) {
    family.members.push_back({file.string(), undressed_rig(read_body_template(file))});
    names.push_back(file.filename().string());
    require_same_joints(family.members.front(), family.members.back());
  }
  family.description = nlohmann::ordered_json{{"kind", "folder"}, {"files", names}}.dump();
  return family;
}

CanonicalSurface canonical_surface(const ClothedFigure& figure, const CanonicalPose& canonical) {
  std::vector<glm::dvec3> vertices;
  for (std::size_t i = 0; i < figure.rest.size(); ++i)
    vertices.emplace_back(blended(canonical.rest_to_canonical, figure.joints[i], figure.weights[i]) * glm::dvec4(figure.rest[i], 1.0));
  return visible_surface(figure, std::move(vertices), std::vector<bool>(figure.rest.size(), false));
}

CanonicalSurface canonical_surface(const ClothedFigure& figure, const CanonicalPose& canonical, const Pose& pose, const Pose& previous_pose, double seconds) {
  const Skeleton& skeleton = figure.body.skeleton;
  const PosedSurface posed = pose_surface(figure, pose, previous_pose, seconds);
  const std::vector<glm::dmat4> transforms = bone_transforms(skeleton, canonical, pose);
  const glm::dvec3 translation = root_translation(skeleton, pose);
  std::vector<glm::dvec3> vertices;
  std::vector<bool> flattened;
  for (std::size_t i = 0; i < posed.positions.size(); ++i) {
    const glm::dmat4 transform = blended(transforms, figure.joints[i], figure.weights[i]);
    flattened.push_back(!(glm::determinant(transform) > kLeastDeterminant));
    const glm::dvec3 place = glm::dvec3(posed.positions[i]) - translation;
    vertices.push_back(flattened.back() ? place : glm::dvec3(glm::inverse(transform) * glm::dvec4(place, 1.0)));
  }
  return visible_surface(figure, std::move(vertices), flattened);
}

std::vector<Pose> member_poses(const BodyFamily& family, std::size_t member, std::size_t poses, std::uint64_t seed, double shift) {
  std::vector<Pose> all;
  for (std::size_t p = 0; p < poses; ++p) all.push_back(synthetic_pose(family.members[member].figure, SyntheticSplit::kTrain, pose_time(family, member, p, poses, shift), seed));
  return all;
}

std::vector<FamilyScan> family_scans(const BodyFamily& family, std::size_t poses, std::uint64_t seed, double shift) {
  std::vector<FamilyScan> scans;
  for (std::size_t m = 0; m < family.members.size(); ++m) {
    const ClothedFigure& figure = family.members[m].figure;
    const CanonicalPose canonical = make_canonical_pose(figure.body.skeleton);
    if (std::all_of(figure.looseness.begin(), figure.looseness.end(), [](float loose) { return loose <= 0; })) {
      scans.push_back({m, rest_pose(figure.body.skeleton), canonical_surface(figure, canonical)});
      continue;
    }
    for (std::size_t p = 0; p < poses; ++p) {
      const double at = pose_time(family, m, p, poses, shift);
      const Pose pose = synthetic_pose(figure, SyntheticSplit::kTrain, at, seed), before = synthetic_pose(figure, SyntheticSplit::kTrain, at - kPoseLag, seed);
      scans.push_back({m, pose, canonical_surface(figure, canonical, pose, before, kPoseLag)});
    }
  }
  return scans;
}

}  // namespace arah

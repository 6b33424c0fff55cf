#include "host/capture/figure_anatomy.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <utility>

namespace arah {

namespace {

// Indices of SMPL's joints; the right one of a pair follows the left one.
enum Joint {
  kPelvis = 0,
  kHip = 1,
  kSpine1 = 3,
  kKnee = 4,
  kSpine2 = 6,
  kAnkle = 7,
  kSpine3 = 9,
  kFoot = 10,
  kNeck = 12,
  kCollar = 13,
  kHead = 15,
  kShoulder = 16,
  kElbow = 18,
  kWrist = 20,
  kHand = 22
};

Skeleton rest_skeleton() {
  Skeleton skeleton;
  skeleton.names = {"pelvis",     "left_hip",    "right_hip",    "spine1",      "left_knee",     "right_knee",
                    "spine2",     "left_ankle",  "right_ankle",  "spine3",      "left_foot",     "right_foot",
                    "neck",       "left_collar", "right_collar", "head",        "left_shoulder", "right_shoulder",
                    "left_elbow", "right_elbow", "left_wrist",   "right_wrist", "left_hand",     "right_hand"};
  skeleton.parents = {-1, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 9, 9, 12, 13, 14, 16, 17, 18, 19, 20, 21};
  skeleton.rest_joints.resize(skeleton.names.size());
  const auto set = [&](int joint, const glm::dvec3& p) { skeleton.rest_joints[joint] = p; };
  const auto set_pair = [&](int joint, const glm::dvec3& p) {
    set(joint, p);
    set(joint + 1, {-p.x, p.y, p.z});
  };
  set(kPelvis, {0, 0.93, -0.01});
  set(kSpine1, {0, 1.03, -0.02});
  set(kSpine2, {0, 1.14, -0.02});
  set(kSpine3, {0, 1.24, -0.015});
  set(kNeck, {0, 1.44, -0.025});
  set(kHead, {0, 1.54, 0.0});
  set_pair(kHip, {0.088, 0.875, -0.005});
  set_pair(kKnee, {0.108, 0.48, 0.0});
  set_pair(kAnkle, {0.118, 0.085, -0.03});
  set_pair(kFoot, {0.126, 0.035, 0.085});
  set_pair(kCollar, {0.06, 1.375, -0.02});
  set_pair(kShoulder, {0.18, 1.385, -0.025});
  set_pair(kElbow, {0.435, 1.385, -0.03});
  set_pair(kWrist, {0.68, 1.385, -0.02});
  set_pair(kHand, {0.765, 1.385, -0.018});
  return skeleton;
}

bool in_the_middle(int joint) {
  return joint == kPelvis || joint == kSpine1 || joint == kSpine2 || joint == kSpine3 || joint == kNeck ||
         joint == kHead;
}

class MuscleList {
 public:
  std::vector<Muscle> muscles;

  Muscle& centre(int joint, glm::dvec3 a, glm::dvec3 b, double ra, double rb, double blend,
                 glm::dvec3 stretch = glm::dvec3(1)) {
    muscles.push_back({.shape = {a, b, ra, rb, stretch}, .joint = joint, .blend = blend});
    return muscles.back();
  }

  // A muscle on the left and its mirror image on the right; `dress` sets the garment flags of both.
  template <typename Dress>
  void pair(int joint, glm::dvec3 a, glm::dvec3 b, double ra, double rb, double blend, glm::dvec3 stretch, bool leg,
            Dress dress) {
    Muscle muscle{
        .shape = {a, b, ra, rb, stretch}, .joint = joint, .limb = leg ? Limb::kLeftLeg : Limb::kTrunk, .blend = blend};
    dress(muscle);
    muscles.push_back(muscle);
    muscle.shape.a.x = -a.x;
    muscle.shape.b.x = -b.x;
    muscle.joint = joint + (in_the_middle(joint) ? 0 : 1);
    if (leg) muscle.limb = Limb::kRightLeg;
    muscles.push_back(muscle);
  }
};

std::vector<Muscle> build_muscles() {
  MuscleList list;
  const glm::dvec3 round(1);
  const auto bare = [](Muscle&) {};
  const auto shirt = [](Muscle& m) { m.shirt = true; };
  const auto both = [](Muscle& m) { m.shirt = m.shorts = true; };
  const auto shoe = [](Muscle& m) { m.shoe = true; };

  both(list.centre(kPelvis, {-0.068, 0.925, -0.01}, {0.068, 0.925, -0.01}, 0.102, 0.102, 0.03, {1, 1, 0.98}));
  both(list.centre(kSpine1, {-0.05, 1.045, -0.002}, {0.05, 1.045, -0.002}, 0.094, 0.094, 0.06, {1, 1, 0.95}));
  shirt(list.centre(kSpine2, {-0.06, 1.155, 0.0}, {0.06, 1.155, 0.0}, 0.092, 0.092, 0.06, {1, 1, 1.0}));
  shirt(list.centre(kSpine3, {-0.075, 1.275, 0.0}, {0.075, 1.275, 0.0}, 0.096, 0.096, 0.06, {1, 1, 1.05}));
  shirt(list.centre(kSpine3, {-0.09, 1.365, -0.018}, {0.09, 1.365, -0.018}, 0.062, 0.062, 0.05));
  list.pair(kSpine3, {0.06, 1.29, 0.045}, {0.085, 1.30, 0.04}, 0.055, 0.05, 0.05, {1, 0.9, 0.9}, false, shirt);
  list.pair(kPelvis, {0.07, 0.885, -0.06}, {0.075, 0.875, -0.055}, 0.078, 0.078, 0.04, round, false, both);
  list.pair(kCollar, {0.03, 1.395, -0.015}, {0.15, 1.395, -0.02}, 0.05, 0.05, 0.04, round, false, shirt);
  list.pair(kCollar, {0.02, 1.45, -0.035}, {0.15, 1.405, -0.03}, 0.042, 0.042, 0.05, round, false, shirt);
  list.pair(kShoulder, {0.185, 1.385, -0.025}, {0.215, 1.387, -0.025}, 0.061, 0.058, 0.04, round, false, shirt);
  list.pair(kShoulder, {0.20, 1.385, -0.025}, {0.435, 1.385, -0.03}, 0.052, 0.040, 0.03, round, false, shirt);
  list.pair(kElbow, {0.435, 1.385, -0.03}, {0.67, 1.385, -0.02}, 0.040, 0.027, 0.03, round, false, bare);
  list.pair(kElbow, {0.50, 1.385, -0.026}, {0.54, 1.385, -0.024}, 0.043, 0.040, 0.03, round, false, bare);
  list.pair(kWrist, {0.695, 1.385, -0.02}, {0.76, 1.385, -0.02}, 0.036, 0.044, 0.02, {1, 0.42, 1}, false, bare);
  list.pair(kWrist, {0.705, 1.380, 0.008}, {0.765, 1.372, 0.048}, 0.016, 0.011, 0.012, round, false, bare);
  list.pair(kHand, {0.775, 1.385, -0.02}, {0.835, 1.382, -0.02}, 0.040, 0.033, 0.015, {1, 0.38, 1}, false, bare);

  list.centre(kNeck, {0, 1.42, -0.03}, {0, 1.55, -0.005}, 0.056, 0.054, 0.03);
  list.centre(kHead, {0, 1.645, -0.002}, {0, 1.645, -0.002}, 1.0, 1.0, 0.03, {0.074, 0.095, 0.096}).hair = true;
  list.centre(kHead, {0, 1.590, 0.035}, {0, 1.585, 0.035}, 1.0, 1.0, 0.04, {0.056, 0.062, 0.060}).hair = true;
  list.centre(kHead, {0, 1.562, 0.062}, {0, 1.562, 0.062}, 0.022, 0.022, 0.04);
  list.centre(kHead, {0, 1.640, 0.092}, {0, 1.605, 0.106}, 0.009, 0.014, 0.014);
  list.pair(kHead, {0.076, 1.625, -0.008}, {0.076, 1.625, -0.008}, 1.0, 1.0, 0.01, {0.012, 0.032, 0.020}, false, bare);

  const auto shorts = [](Muscle& m) { m.shirt = m.shorts = true; };
  list.pair(kHip, {0.093, 0.875, -0.005}, {0.108, 0.50, 0.0}, 0.086, 0.054, 0.05, round, true, shorts);
  list.pair(kHip, {0.105, 0.70, 0.012}, {0.108, 0.62, 0.012}, 0.066, 0.060, 0.05, round, true, shorts);
  list.pair(kKnee, {0.108, 0.49, 0.002}, {0.118, 0.10, -0.03}, 0.051, 0.036, 0.04, round, true, bare);
  list.pair(kKnee, {0.112, 0.38, -0.028}, {0.114, 0.32, -0.03}, 0.048, 0.044, 0.04, {1, 1.2, 1}, true, bare);
  list.pair(kAnkle, {0.118, 0.105, -0.032}, {0.118, 0.045, -0.045}, 0.036, 0.034, 0.03, round, true, shoe);
  list.pair(kAnkle, {0.119, 0.065, -0.02}, {0.126, 0.040, 0.075}, 0.036, 0.032, 0.03, round, true, shoe);
  list.pair(kFoot, {0.127, 0.036, 0.085}, {0.129, 0.030, 0.135}, 0.036, 0.030, 0.03, {1.1, 0.8, 1}, true, shoe);
  return std::move(list.muscles);
}

bool in_an_arm(int joint) {
  return joint >= kShoulder;
}
bool in_a_leg(int joint) {
  return joint == kHip || joint == kHip + 1 || joint == kKnee || joint == kKnee + 1;
}

// Of the average build and clothes to `variation`; defaults leave every bit.
void vary_anatomy(Anatomy& anatomy, const FigureVariation& variation) {
  const Build& build = variation.build;
  const Wardrobe& clothes = variation.clothes;
  const Stretch stretch(build);
  for (glm::dvec3& joint : anatomy.skeleton.rest_joints) joint = build.height * stretch.from_average(joint);
  for (Muscle& muscle : anatomy.muscles) {
    TaperedCapsule& shape = muscle.shape;
    shape.a = build.height * stretch.from_average(shape.a);
    shape.b = build.height * stretch.from_average(shape.b);
    const bool trunk = !in_an_arm(muscle.joint) && !in_a_leg(muscle.joint) && muscle.shirt;
    const double girth = in_an_arm(muscle.joint)  ? build.arm_girth
                         : in_a_leg(muscle.joint) ? build.leg_girth
                         : trunk                  ? build.trunk_girth
                                                  : 1.0;
    shape.radius_a *= build.height * girth;
    shape.radius_b *= build.height * girth;
    if (clothes.shorts_hem < 0.45 && (muscle.joint == kKnee || muscle.joint == kKnee + 1)) muscle.shorts = true;
    if (clothes.sleeve_end > 0.40 && (muscle.joint == kElbow || muscle.joint == kElbow + 1)) muscle.shirt = true;
  }
}

}  // namespace

Anatomy make_anatomy(std::uint64_t seed, const FigureVariation& variation) {
  Anatomy anatomy{rest_skeleton(), build_muscles()};
  vary_anatomy(anatomy, variation);
  if (seed == 0) return anatomy;
  std::mt19937_64 random(seed);
  const auto vary = [&](double range) {
    return 1.0 + range * (2.0 * static_cast<double>(random() >> 11) * 0x1p-53 - 1.0);
  };
  const double height = vary(0.03), girth = vary(0.05);
  for (glm::dvec3& joint : anatomy.skeleton.rest_joints) joint *= height;
  for (Muscle& muscle : anatomy.muscles) {
    TaperedCapsule& shape = muscle.shape;
    shape.a *= height;
    shape.b *= height;
    const double factor = muscle.hair || muscle.shoe ? height : height * girth;
    shape.radius_a *= factor;
    shape.radius_b *= factor;
  }
  return anatomy;
}

ImplicitField muscle_union(const std::vector<Muscle>& muscles, double blend_factor) {
  struct Part {
    TaperedCapsule shape;
    int limb;
    double blend;
    glm::dvec3 center;  // of a ball around it
    double radius;
  };
  std::vector<Part> parts;
  for (const Muscle& muscle : muscles) {
    const TaperedCapsule& shape = muscle.shape;
    const double widest = std::max({shape.stretch.x, shape.stretch.y, shape.stretch.z});
    parts.push_back({shape, static_cast<int>(muscle.limb), blend_factor * muscle.blend, 0.5 * (shape.a + shape.b),
                     0.5 * glm::distance(shape.a, shape.b) + widest * std::max(shape.radius_a, shape.radius_b)});
  }
  return [parts = std::move(parts), blend_factor](const glm::dvec3& p) {
    const double far = 1e3;
    double limb[3] = {far, far, far};
    for (const Part& part : parts) {
      double& value = limb[part.limb];
      // Further away than the blend reaches, a muscle changes nothing.
      if (glm::distance(p, part.center) - part.radius >= value + part.blend) continue;
      value = smooth_minimum(value, signed_distance(part.shape, p), part.blend);
    }
    const double trunk_blend = 0.05 * blend_factor;
    const double left = smooth_minimum(limb[0], limb[1], trunk_blend),
                 right = smooth_minimum(limb[0], limb[2], trunk_blend);
    return smooth_minimum(left, right, 0.006);
  };
}

Box bounds(const std::vector<Muscle>& muscles, double margin) {
  Box box{glm::dvec3(std::numeric_limits<double>::max()), glm::dvec3(std::numeric_limits<double>::lowest())};
  for (const Muscle& muscle : muscles) {
    const TaperedCapsule& shape = muscle.shape;
    const glm::dvec3 reach = std::max(shape.radius_a, shape.radius_b) * shape.stretch + margin;
    box.low = glm::min(box.low, glm::min(shape.a, shape.b) - reach);
    box.high = glm::max(box.high, glm::max(shape.a, shape.b) + reach);
  }
  return box;
}

void diffuse_weights(std::vector<std::vector<float>>& weights,
                     const std::vector<std::vector<std::uint32_t>>& neighbours, int rounds) {
  std::vector<std::vector<float>> next = weights;
  for (int round = 0; round < rounds; ++round) {
    for (std::size_t i = 0; i < weights.size(); ++i) {
      if (neighbours[i].empty()) continue;
      const float share = 0.7f / static_cast<float>(neighbours[i].size());
      for (std::size_t b = 0; b < weights[i].size(); ++b) {
        float sum = 0;
        for (const std::uint32_t j : neighbours[i]) sum += weights[j][b];
        next[i][b] = 0.3f * weights[i][b] + share * sum;
      }
    }
    std::swap(weights, next);
  }
}

void keep_four(const std::vector<std::vector<float>>& weights, std::vector<glm::u8vec4>& joints,
               std::vector<glm::vec4>& kept) {
  joints.assign(weights.size(), glm::u8vec4(0));
  kept.assign(weights.size(), glm::vec4(0));
  for (std::size_t i = 0; i < weights.size(); ++i) {
    std::vector<float> left = weights[i];
    float sum = 0;
    for (int k = 0; k < 4 && k < static_cast<int>(left.size()); ++k) {
      const auto largest = std::max_element(left.begin(), left.end());
      if (*largest <= 1e-3f) break;
      joints[i][k] = static_cast<std::uint8_t>(largest - left.begin());
      kept[i][k] = *largest;
      sum += *largest;
      *largest = 0;
    }
    kept[i] /= sum;
  }
}

BodyTemplate make_body(const Anatomy& anatomy) {
  const Box box = bounds(anatomy.muscles, 0.04);
  const TriangleMesh mesh = mesh_zero_set(muscle_union(anatomy.muscles, 1.0), box.low, box.high, 0.0135);
  const auto neighbours = vertex_neighbours(mesh.vertices.size(), mesh.triangles);
  std::vector<std::vector<float>> weights(mesh.vertices.size(), std::vector<float>(anatomy.skeleton.size(), 0.0f));
  for (std::size_t i = 0; i < mesh.vertices.size(); ++i) {
    double nearest = std::numeric_limits<double>::max();
    int joint = 0;
    for (const Muscle& muscle : anatomy.muscles) {
      const double distance = signed_distance(muscle.shape, mesh.vertices[i]);
      if (distance >= nearest) continue;
      nearest = distance;
      joint = muscle.joint;
    }
    weights[i][joint] = 1.0f;
  }
  diffuse_weights(weights, neighbours, 14);

  BodyTemplate body;
  body.skeleton = anatomy.skeleton;
  keep_four(weights, body.joints, body.weights);
  for (const glm::dvec3& normal : vertex_normals(mesh.vertices, mesh.triangles)) body.normals.emplace_back(normal);
  for (const glm::dvec3& vertex : mesh.vertices) body.vertices.emplace_back(vertex);
  body.triangles = mesh.triangles;
  return body;
}

}  // namespace arah

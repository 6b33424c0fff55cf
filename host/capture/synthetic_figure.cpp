#include "host/capture/synthetic_figure.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <string>
#include <utility>

#include "host/capture/figure_anatomy.h"
#include "host/capture/implicit_surface.h"

namespace arah {

namespace {

double ramp(double from, double to, double x) {
  const double t = std::clamp((x - from) / (to - from), 0.0, 1.0);
  return t * t * (3 - 2 * t);
}

// Where each garment ends, for the average build, as the signed distance (metres, roughly) inside its hem: kept where
// >= 0.
double shirt_inside(const glm::dvec3& p, const Wardrobe& clothes) {
  const double hem = p.y - clothes.shirt_hem, sleeve = clothes.sleeve_end - std::abs(p.x);
  const double from_neck = std::hypot(p.x, p.z + 0.025) - 0.088;
  const double neckline = std::max(1.415 - 0.35 * (p.z + 0.02) - p.y, from_neck);
  return std::min({hem, sleeve, neckline});
}
double shorts_inside(const glm::dvec3& p, const Wardrobe& clothes) {
  return std::min(0.925 - p.y, p.y - clothes.shorts_hem);
}
double shoe_inside(const glm::dvec3& p, const Wardrobe&) {
  return 0.088 + 0.12 * std::min(0.0, p.z + 0.02) - p.y;
}
// The hairline: above a plane that falls towards the nape, and not in the face.
double hair_inside(const glm::dvec3& p, const Wardrobe& = {}) {
  const double fall = p.y - (1.595 + 0.95 * (p.z + 0.02));
  const double face = std::max(p.y - 1.692 - 0.25 * std::abs(p.x), 0.02 - p.z);
  const double nape = p.y - 1.555 - 0.1 * std::abs(p.x);
  return std::min({std::max(fall, p.z < -0.02 ? nape : fall), face, nape});
}

using Inside = double (*)(const glm::dvec3&, const Wardrobe&);

struct Garment {
  FigureLayer layer;
  bool Muscle::*worn_by;  // which muscles it wraps
  double blend_factor;    // cloth spans hollows that skin follows
  Inside inside;
  double (*offset)(const glm::dvec3&);     // metres above the skin
  double (*looseness)(const glm::dvec3&);  // 0..1
};

const Garment kGarments[] = {
    {FigureLayer::kShirt, &Muscle::shirt, 1.6, shirt_inside,
     [](const glm::dvec3& p) {
       return 0.013 + 0.016 * ramp(1.15, 0.85, p.y) + 0.007 * ramp(0.22, 0.34, std::abs(p.x));
     },
     [](const glm::dvec3& p) {
       return std::max(0.12 + 0.88 * ramp(1.25, 0.86, p.y), 0.7 * ramp(0.2, 0.34, std::abs(p.x))) *
              ramp(0.0, 0.06, 1.47 - p.y);
     }},
    {FigureLayer::kShorts, &Muscle::shorts, 1.2, shorts_inside,
     [](const glm::dvec3& p) { return 0.010 + 0.020 * ramp(0.85, 0.52, p.y); },
     [](const glm::dvec3& p) { return 0.05 + 0.8 * ramp(0.85, 0.52, p.y); }},
    {FigureLayer::kShoes, &Muscle::shoe, 1.0, shoe_inside, [](const glm::dvec3&) { return 0.009; },
     [](const glm::dvec3&) { return 0.0; }},
    {FigureLayer::kHair, &Muscle::hair, 1.0, hair_inside,
     [](const glm::dvec3& p) { return 0.004 + 0.014 * ramp(0.0, 0.035, hair_inside(p)); },
     [](const glm::dvec3&) { return 0.0; }},
};

struct Sheet {
  std::vector<glm::dvec3> vertices, normals;
  std::vector<std::uint8_t> under_cloth;  // empty: none of it
  std::vector<glm::uvec3> triangles;
  std::vector<glm::u8vec4> joints;
  std::vector<glm::vec4> weights;
  std::vector<float> looseness;
  std::vector<glm::vec3> tint;
};

// Appends a sheet of one layer to the figure's surface.
void append(ClothedFigure& figure, const Sheet& sheet, FigureLayer layer) {
  const auto base = static_cast<std::uint32_t>(figure.rest.size());
  for (std::size_t i = 0; i < sheet.vertices.size(); ++i) {
    figure.rest.emplace_back(sheet.vertices[i]);
    figure.normals.emplace_back(sheet.normals[i]);
    figure.layers.push_back(layer);
    figure.tint.push_back(sheet.tint.empty() ? glm::vec3(1) : sheet.tint[i]);
    figure.joints.push_back(sheet.joints[i]);
    figure.weights.push_back(sheet.weights[i]);
    figure.looseness.push_back(sheet.looseness[i]);
    figure.under_cloth.push_back(sheet.under_cloth.empty() ? std::uint8_t{0} : sheet.under_cloth[i]);
  }
  for (const glm::uvec3& t : sheet.triangles) figure.triangles.push_back(t + base);
}

// Drops the vertices that no triangle uses.
void compact(Sheet& sheet) {
  constexpr std::uint32_t unused = ~0u;
  std::vector<std::uint32_t> place(sheet.vertices.size(), unused);
  std::uint32_t count = 0;
  Sheet kept;
  for (glm::uvec3& t : sheet.triangles)
    for (int k = 0; k < 3; ++k) {
      const std::uint32_t i = t[k];
      if (place[i] == unused) {
        place[i] = count++;
        kept.vertices.push_back(sheet.vertices[i]);
        kept.normals.push_back(sheet.normals[i]);
        kept.joints.push_back(sheet.joints[i]);
        kept.weights.push_back(sheet.weights[i]);
        kept.looseness.push_back(sheet.looseness[i]);
        if (!sheet.tint.empty()) kept.tint.push_back(sheet.tint[i]);
        if (!sheet.under_cloth.empty()) kept.under_cloth.push_back(sheet.under_cloth[i]);
      }
      t[k] = place[i];
    }
  kept.triangles = std::move(sheet.triangles);
  sheet = std::move(kept);
}

// Skinning weights of points off the body: the nearest body vertex's, found in a grid of 4 cm cells, then diffused over
// the sheet.
class NearestWeights {
 public:
  explicit NearestWeights(const BodyTemplate& body) : body_(body) {
    for (std::uint32_t i = 0; i < body.vertices.size(); ++i) {
      low_ = glm::min(low_, glm::dvec3(body.vertices[i]));
      high_ = glm::max(high_, glm::dvec3(body.vertices[i]));
    }
    size_ = glm::ivec3((high_ - low_) / kCell) + 1;
    cells_.resize(static_cast<std::size_t>(size_.x) * static_cast<std::size_t>(size_.y) *
                  static_cast<std::size_t>(size_.z));
    for (std::uint32_t i = 0; i < body.vertices.size(); ++i) cells_[index(cell(body.vertices[i]))].push_back(i);
  }

  std::uint32_t nearest(const glm::dvec3& point) const {
    const glm::ivec3 c = cell(point);
    double best = std::numeric_limits<double>::max();
    std::uint32_t found = 0;
    for (int z = std::max(c.z - 2, 0); z <= std::min(c.z + 2, size_.z - 1); ++z)
      for (int y = std::max(c.y - 2, 0); y <= std::min(c.y + 2, size_.y - 1); ++y)
        for (int x = std::max(c.x - 2, 0); x <= std::min(c.x + 2, size_.x - 1); ++x)
          for (const std::uint32_t i : cells_[index({x, y, z})]) {
            const glm::dvec3 d = glm::dvec3(body_.vertices[i]) - point;
            if (glm::dot(d, d) >= best) continue;
            best = glm::dot(d, d);
            found = i;
          }
    return found;
  }

 private:
  static constexpr double kCell = 0.04;
  glm::ivec3 cell(const glm::dvec3& p) const {
    return glm::clamp(glm::ivec3((p - low_) / kCell), glm::ivec3(0), size_ - 1);
  }
  std::size_t index(const glm::ivec3& c) const {
    const auto nx = static_cast<std::size_t>(size_.x), ny = static_cast<std::size_t>(size_.y);
    return static_cast<std::size_t>(c.x) + nx * (static_cast<std::size_t>(c.y) + ny * static_cast<std::size_t>(c.z));
  }

  const BodyTemplate& body_;
  glm::dvec3 low_{1e9}, high_{-1e9};
  glm::ivec3 size_{1};
  std::vector<std::vector<std::uint32_t>> cells_;
};

// How deep inside the shirt's hems a place of average build is; the shirt ends above the legs and below the head.
double under_shirt(const glm::dvec3& p, const Wardrobe& clothes) {
  return !clothes.shirt || p.y > 1.5 || p.y < 0.6 ? -1.0 : shirt_inside(p, clothes);
}

Sheet make_garment(const Garment& garment, const Anatomy& anatomy, const BodyTemplate& body, const NearestWeights& near,
                   double height, const Stretch& stretch, const Wardrobe& clothes) {
  const auto average = [&](const glm::dvec3& p) { return stretch.to_average(p / height); };
  const double standing_off = height * (garment.layer == FigureLayer::kHair ? 1.0 : clothes.looseness);
  std::vector<Muscle> worn;
  for (const Muscle& muscle : anatomy.muscles)
    if (muscle.*garment.worn_by) worn.push_back(muscle);
  const Box box = bounds(worn, 0.08 * std::max(1.0, clothes.looseness));  // cloth stands off by up to 4 cm and its blends swell
  const ImplicitField skin = muscle_union(worn, garment.blend_factor);
  const ImplicitField cloth = [&](const glm::dvec3& p) { return skin(p) - standing_off * garment.offset(average(p)); };
  TriangleMesh mesh = mesh_zero_set(cloth, box.low, box.high, 0.0135);

  std::vector<std::vector<float>> all(mesh.vertices.size(), std::vector<float>(body.skeleton.size(), 0.0f));
  for (std::size_t i = 0; i < all.size(); ++i) {
    const std::uint32_t source = near.nearest(mesh.vertices[i]);
    for (int k = 0; k < 4; ++k) all[i][body.joints[source][k]] += body.weights[source][k];
  }
  diffuse_weights(all, vertex_neighbours(mesh.vertices.size(), mesh.triangles), 6);

  std::vector<double> inside;
  for (const glm::dvec3& p : mesh.vertices) inside.push_back(garment.inside(average(p), clothes));
  const CutTriangles cut = cut_triangles(mesh.triangles, inside);
  const std::vector<glm::dvec3> normals = vertex_normals(mesh.vertices, mesh.triangles);
  Sheet sheet;
  std::vector<std::vector<float>> weights;
  for (const VertexOrigin& origin : cut.vertices) {
    sheet.vertices.push_back(glm::mix(mesh.vertices[origin.first], mesh.vertices[origin.second], origin.t));
    sheet.normals.push_back(glm::normalize(glm::mix(normals[origin.first], normals[origin.second], origin.t)));
    std::vector<float> blended = all[origin.first];
    for (std::size_t b = 0; b < blended.size(); ++b)
      blended[b] += static_cast<float>(origin.t) * (all[origin.second][b] - blended[b]);
    weights.push_back(std::move(blended));
    const glm::dvec3 place = average(sheet.vertices.back());
    sheet.looseness.push_back(static_cast<float>(garment.looseness(place)));
    sheet.under_cloth.push_back(garment.layer == FigureLayer::kShorts && under_shirt(place, clothes) > 0 ? 1 : 0);
  }
  keep_four(weights, sheet.joints, sheet.weights);
  sheet.triangles = cut.triangles;
  return sheet;
}

// The three joints that fold each loose vertex most. Folds run around the bone that hangs from the joint, 55 mm apart.
void add_folds(ClothedFigure& figure) {
  const Skeleton& skeleton = figure.body.skeleton;
  std::vector<glm::vec3> along(skeleton.size(), glm::vec3(0));
  for (std::size_t j = 1; j < skeleton.size(); ++j)
    along[skeleton.parents[j]] += glm::vec3(skeleton.rest_joints[j] - skeleton.rest_joints[skeleton.parents[j]]);
  const float scale = static_cast<float>(figure.scale);
  const float wave = 2 * std::numbers::pi_v<float> / (0.055f * scale);
  figure.folds.assign(figure.rest.size(), {});
  for (std::size_t i = 0; i < figure.rest.size(); ++i) {
    if (figure.looseness[i] <= 0) continue;
    std::vector<Fold> candidates;
    for (std::size_t j = 1; j < skeleton.size(); ++j) {  // joint 0 turns the whole figure and folds nothing
      const glm::vec3 from = figure.rest[i] - glm::vec3(skeleton.rest_joints[j]);
      const float distance = glm::length(from) / (0.15f * scale);
      const float length = glm::length(along[j]);
      const glm::vec3 axis = length > 0 ? along[j] / length : glm::vec3(0, 1, 0);
      const float slant = 0.35f * (from.x + from.z);
      candidates.push_back(
          {static_cast<int>(j), std::exp(-distance * distance), wave * (glm::dot(from, axis) + slant)});
    }
    const auto count = std::min<std::size_t>(3, candidates.size());
    std::partial_sort(candidates.begin(), candidates.begin() + static_cast<std::ptrdiff_t>(count), candidates.end(),
                      [](const Fold& a, const Fold& b) { return a.strength > b.strength; });
    std::copy_n(candidates.begin(), count, figure.folds[i].begin());
    for (Fold& fold : figure.folds[i]) fold.strength *= std::min(1.0f, 0.3f + figure.looseness[i]);
  }
}

Sheet body_sheet(const BodyTemplate& body) {
  Sheet sheet;
  sheet.vertices.assign(body.vertices.begin(), body.vertices.end());
  sheet.normals.assign(body.normals.begin(), body.normals.end());
  sheet.triangles = body.triangles;
  sheet.joints = body.joints;
  sheet.weights = body.weights;
  sheet.looseness.assign(body.vertices.size(), 0.0f);
  return sheet;
}

// A colour for each joint, hues spread by the golden ratio.
glm::vec3 joint_color(int joint) {
  const float hue = 6.0f * static_cast<float>(std::fmod(0.07 + 0.618034 * joint, 1.0));
  const auto channel = [&](float shift) {
    return std::clamp(std::abs(std::fmod(hue + shift, 6.0f) - 3.0f) - 1.0f, 0.0f, 1.0f);
  };
  return glm::mix(glm::vec3(0.8f), glm::vec3(channel(0), channel(4), channel(2)), 0.45f);
}

// How far inside the garment each vertex of a rig is, > 0 under it: by weight for SMPL's names, by height for others.
std::vector<double> rig_garment_inside(const BodyTemplate& rig, double low, double height) {
  std::vector<bool> worn(rig.skeleton.size(), false);
  const bool human = has_smpl_legs(rig.skeleton);
  for (const char* name : {"pelvis", "left_hip", "right_hip", "spine1", "spine2", "spine3", "left_collar",
                           "right_collar", "left_shoulder", "right_shoulder"}) {
    const int joint = find_joint(rig.skeleton, name);
    if (joint >= 0) worn[joint] = true;
  }
  std::vector<double> inside(rig.vertices.size(), -0.5);
  for (std::size_t i = 0; i < inside.size(); ++i) {
    if (human) {
      for (int k = 0; k < 4; ++k)
        if (worn[rig.joints[i][k]]) inside[i] += static_cast<double>(rig.weights[i][k]);
    } else {
      // Linear in the vertices, so that even a triangle as tall as the rig is cut at the right place.
      inside[i] = (static_cast<double>(rig.vertices[i].y) - low) / height - 0.45;
    }
  }
  return inside;
}

}  // namespace

int ground_truth_part(FigureLayer layer) {
  switch (layer) {
    case FigureLayer::kShirt:
    case FigureLayer::kShorts:
    case FigureLayer::kRigGarment:
      return 1;
    case FigureLayer::kShoes:
      return 2;
    case FigureLayer::kHair:
      return 3;
    case FigureLayer::kSkin:
    case FigureLayer::kRigBody:
      break;
  }
  return 0;
}

ClothedFigure make_clothed_figure(std::uint64_t seed, const FigureVariation& variation) {
  const Anatomy anatomy = make_anatomy(seed, variation);
  const Wardrobe& clothes = variation.clothes;
  ClothedFigure figure;
  figure.body = make_body(anatomy);
  figure.stretch = Stretch(variation.build);
  const double pelvis = figure.stretch.from_average({0, 0.93, 0}).y;
  const glm::dvec3 reach = figure.stretch.from_average({0.84, 1.74, 0}) / glm::dvec3(0.84, 1.74, 1);
  const double height = anatomy.skeleton.rest_joints[0].y / pelvis;
  figure.scale = height;
  figure.middle_height = pelvis * height;
  figure.camera_distance = 3 * height * std::max({1.0, reach.x, reach.y});

  // Skin more than 25 mm inside a hem cannot be seen, so it is no part of the surface.
  Sheet skin = body_sheet(figure.body);
  std::vector<bool> covered;
  for (const glm::dvec3& vertex : skin.vertices) {
    const glm::dvec3 p = figure.stretch.to_average(vertex / height);
    const bool foot = p.y<0.2, head = p.y> 1.5;
    const double depth =
        std::max({under_shirt(p, clothes), clothes.shorts ? shorts_inside(p, clothes) - (std::abs(p.x) > 0.3 ? 1.0 : 0.0) : -1.0,
                  foot && clothes.shoes ? shoe_inside(p, clothes) : -1.0, head ? hair_inside(p) : -1.0});
    covered.push_back(depth > (foot ? 0.02 : 0.03));
    skin.under_cloth.push_back(depth > 0 ? 1 : 0);
  }
  std::erase_if(skin.triangles, [&](const glm::uvec3& t) { return covered[t.x] && covered[t.y] && covered[t.z]; });
  compact(skin);
  append(figure, skin, FigureLayer::kSkin);

  const NearestWeights near(figure.body);
  for (const Garment& garment : kGarments) {
    const bool worn = garment.layer == FigureLayer::kShirt    ? clothes.shirt
                      : garment.layer == FigureLayer::kShorts ? clothes.shorts
                      : garment.layer == FigureLayer::kShoes  ? clothes.shoes
                                                        : true;
    if (worn) append(figure, make_garment(garment, anatomy, figure.body, near, height, figure.stretch, clothes), garment.layer);
  }
  add_folds(figure);
  return figure;
}

BodyTemplate body_with_shape(const ClothedFigure& figure, const Build& build) {
  constexpr double unit = 0.1;
  BodyTemplate body = figure.body;
  ShapeSpace& shape = body.shape;
  shape.base_vertices = body.vertices;
  shape.base_joints = body.skeleton.rest_joints;
  const auto add = [&](const char* name, const auto& offset) {
    shape.names.emplace_back(name);
    shape.beta.push_back(0.0);
    std::vector<glm::vec3>& vertices = shape.vertex_offsets.emplace_back();
    for (const glm::vec3& vertex : body.vertices) vertices.emplace_back(offset(glm::dvec3(vertex)));
    std::vector<glm::dvec3>& joints = shape.joint_offsets.emplace_back();
    for (const glm::dvec3& joint : body.skeleton.rest_joints) joints.push_back(offset(joint));
  };
  add("height", [](const glm::dvec3& place) { return unit * place; });
  for (const auto& [name, length] : {std::pair{"arm_length", &Build::arm_length}, {"leg_length", &Build::leg_length}, {"trunk_length", &Build::trunk_length}}) {
    Build longer = build;
    longer.*length *= 1 + unit;
    const Stretch stretch(build), more(longer);
    add(name, [&](const glm::dvec3& place) {
      const glm::dvec3 average = figure.stretch.to_average(place / figure.scale);
      return figure.scale * (more.from_average(average) - stretch.from_average(average));
    });
  }
  return body;
}

ClothedFigure dress_rig(BodyTemplate rig) {
  ClothedFigure figure;
  glm::vec3 low = rig.vertices.at(0), high = low;
  for (const glm::vec3& vertex : rig.vertices) {
    low = glm::min(low, vertex);
    high = glm::max(high, vertex);
  }
  const glm::vec3 extent = high - low;
  figure.scale = static_cast<double>(std::max({extent.x, extent.y, extent.z})) / 1.74;
  figure.middle_height = 0.53 * static_cast<double>(extent.y);
  // A person's T-pose has a wide diagonal that no pose fills; of other rigs the whole ball around them must be in view:
  // its radius over the sine of half the field of view, 21 degrees, and 10 % of air.
  figure.camera_distance = 3 * figure.scale;
  if (!has_smpl_legs(rig.skeleton))
    figure.camera_distance = std::max(figure.camera_distance, 1.55 * static_cast<double>(glm::length(extent)));
  const std::vector<double> inside = rig_garment_inside(rig, low.y, std::max(static_cast<double>(extent.y), 1e-9));

  Sheet body = body_sheet(rig);
  for (std::size_t i = 0; i < body.vertices.size(); ++i) {
    glm::vec3 color(0);
    for (int k = 0; k < 4; ++k) color += rig.weights[i][k] * joint_color(rig.joints[i][k]);
    body.tint.push_back(color);
    body.under_cloth.push_back(inside[i] > 0 ? 1 : 0);
  }
  const CutTriangles cut = cut_triangles(rig.triangles, inside);
  Sheet garment;
  for (const VertexOrigin& origin : cut.vertices) {
    const glm::dvec3 normal =
        glm::normalize(glm::mix(body.normals[origin.first], body.normals[origin.second], origin.t));
    garment.vertices.push_back(glm::mix(body.vertices[origin.first], body.vertices[origin.second], origin.t) +
                               0.012 * figure.scale * normal);
    garment.normals.push_back(normal);
    // Skinning of a new vertex on a cut edge: the nearer end's, which differs by less than an edge.
    const std::uint32_t source = origin.t < 0.5 ? origin.first : origin.second;
    garment.joints.push_back(rig.joints[source]);
    garment.weights.push_back(rig.weights[source]);
    const double hem = glm::mix(inside[origin.first], inside[origin.second], origin.t);
    garment.looseness.push_back(static_cast<float>(0.15 + 0.65 * ramp(0.4, 0.0, hem)));
  }
  garment.triangles = cut.triangles;
  append(figure, body, FigureLayer::kRigBody);
  append(figure, garment, FigureLayer::kRigGarment);
  figure.body = std::move(rig);
  add_folds(figure);
  return figure;
}

ClothedFigure undressed_rig(BodyTemplate rig) {
  ClothedFigure figure;
  append(figure, body_sheet(rig), FigureLayer::kRigBody);
  figure.body = std::move(rig);
  add_folds(figure);
  return figure;
}

}  // namespace arah

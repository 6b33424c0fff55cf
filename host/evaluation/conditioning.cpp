#include "host/evaluation/conditioning.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <glm/matrix.hpp>
#include <limits>
#include <nlohmann/json.hpp>
#include <opencv2/core.hpp>

#include "host/input_error.h"
#include "kernels/tracing/normalise_inputs.h"
#include "shaders/shared/tracing.h"

namespace arah {
namespace {

constexpr uint32_t rows_at_once = 4096;
constexpr std::array<double, 5> shell_offsets{-1, -0.5, 0, 0.5, 1};  // of the reach, along the posed normal

// States of a search (kernels/tracing/broyden_state.h).
constexpr float converged_state = 2, diverged_state = 3, exhausted_state = 4;

RootFindingSettings search_of(const ConditioningSettings& settings) {
  RootFindingSettings search;
  search.max_iterations = settings.max_iterations;
  search.tolerance = settings.tolerance;
  search.rescue_steps = settings.rescue_steps;
  return search;
}

RootFindingSettings with_bone_starts(RootFindingSettings search) {
  search.initialisations = 2;
  return search;
}

const Avatar& with_skinning_network(const Avatar& avatar) {
  if (avatar.spec.skinning.kind != Skinning::network) throw InputError("avatar", "spec.skinning.kind", "network, whose inverse is searched", std::string("'") + to_string(avatar.spec.skinning.kind) + "'", "Without one there is no Jacobian to be singular.");
  return avatar;
}

// rows vec4 by point, w = 1; padded by points that are not wanted.
std::vector<std::array<float, 4>> rows_of(const std::vector<glm::vec3>& points, std::size_t first, uint32_t count) {
  std::vector<std::array<float, 4>> rows(padded_points(count), {0, 0, 0, 0});
  for (uint32_t i = 0; i < count; ++i) rows[i] = {points[first + i].x, points[first + i].y, points[first + i].z, 1};
  return rows;
}

// Of each part of at most rows_at_once points.
template <class Each>
void in_parts(std::size_t points, Each&& each) {
  for (std::size_t first = 0; first < points; first += rows_at_once) each(first, static_cast<uint32_t>(std::min<std::size_t>(rows_at_once, points - first)));
}

std::vector<glm::dvec3> posed_normals(const std::vector<glm::dvec3>& vertices, const std::vector<glm::uvec3>& triangles) {
  std::vector<glm::dvec3> normals(vertices.size(), glm::dvec3(0));
  for (const glm::uvec3& t : triangles) {
    const glm::dvec3 twice_area = glm::cross(vertices[t.y] - vertices[t.x], vertices[t.z] - vertices[t.x]);
    for (int k = 0; k < 3; ++k) normals[t[k]] += twice_area;
  }
  for (glm::dvec3& n : normals) n = glm::length(n) > 0 ? glm::normalize(n) : glm::dvec3(0, 0, 1);
  return normals;
}

double share_of(std::size_t part, std::size_t all) { return all > 0 ? double(part) / double(all) : 0; }

// The shader's threshold, in double precision.
bool teaches_nothing(const glm::dmat3& jacobian) {
  const glm::dmat3 rows = glm::transpose(jacobian);
  const double determinant = glm::determinant(jacobian);
  return !std::isfinite(determinant) || std::abs(determinant) <= 4e-7 * glm::length(rows[0]) * glm::length(rows[1]) * glm::length(rows[2]);
}

// A NaN or an infinity is not the best, however it compares.
double or_singular(double sigma) { return std::isfinite(sigma) ? sigma : 0; }

}  // namespace

std::array<double, 3> singular_values(const glm::dmat3& matrix) {
  cv::Matx33d values;
  for (int row = 0; row < 3; ++row)
    for (int column = 0; column < 3; ++column) {
      values(row, column) = matrix[column][row];
      if (!std::isfinite(values(row, column))) return {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::quiet_NaN()};
    }
  cv::Matx31d singular;
  cv::SVD::compute(values, singular, cv::SVD::NO_UV);
  return {singular(0), singular(1), singular(2)};
}

Conditioning::Conditioning(Device& device, const Avatar& avatar, const ConditioningSettings& settings)
    : device_(device),
      avatar_(with_skinning_network(avatar)),
      settings_(settings),
      search_(search_of(settings)),
      commands_(device),
      extraction_(device, avatar, MeshSettings{.cell = settings.cell}),
      skinning_(device, extraction_.networks(), rows_at_once, "conditioning"),
      sdf_tape_(device, "conditioning: distances", extraction_.networks().sdf_shape(), rows_at_once, SirenTape::Holds::gradient, Element::float32, false),
      finder_(device, extraction_.networks(), rows_at_once, with_bone_starts(search_)),
      points_(device, "conditioning: points", rows_at_once * 16ull, BufferPlace::device),
      roots_(device, "conditioning: roots", rows_at_once * 16ull, BufferPlace::device) {}

Conditioning::Skinned Conditioning::skinned(const std::vector<glm::vec3>& canonical) {
  Skinned result;
  in_parts(canonical.size(), [&](std::size_t first, uint32_t count) {
    device_.upload(points_.slice(), rows_of(canonical, first, count));
    skinning_.record(commands_, extraction_.frame(), {{count, {}}, {}}, points_.slice(), true);
    commands_.submit_and_wait();
    const auto posed = device_.download<std::array<float, 4>>(skinning_.posed().sub(0, count * 16ull));
    const auto rows = device_.download<std::array<float, 4>>(skinning_.jacobians().sub(0, count * 48ull));
    for (std::size_t i = 0; i < count; ++i) {
      result.posed.emplace_back(posed[i][0], posed[i][1], posed[i][2]);
      glm::dmat3 jacobian;
      for (int row = 0; row < 3; ++row)
        for (int column = 0; column < 3; ++column) jacobian[column][row] = rows[3 * i + static_cast<std::size_t>(row)][static_cast<std::size_t>(column)];
      result.jacobians.push_back(jacobian);
    }
  });
  return result;
}

std::vector<Conditioning::Distance> Conditioning::distances(const std::vector<glm::vec3>& canonical) {
  std::vector<Distance> result;
  const double metres = avatar_.cube.metres_per_unit();
  in_parts(canonical.size(), [&](std::size_t first, uint32_t count) {
    device_.upload(points_.slice(), rows_of(canonical, first, count));
    record_normalise_inputs(commands_, {{{count, {}}, {}}, extraction_.frame().constants(), points_.slice(), sdf_tape_.input()});
    Siren& sdf = extraction_.networks().sdf();
    sdf.record_forward(commands_, sdf_tape_, {count, {}}, true);
    sdf.record_gradient(commands_, sdf_tape_, {count, {}}, false);
    commands_.submit_and_wait();
    const Matrix f = sdf_tape_.sdf(), gradient = sdf_tape_.gradient();
    const std::vector<float> values = device_.download<float>(f.slice.elements(0, uint64_t(count) * f.stride)), slopes = device_.download<float>(gradient.slice.elements(0, uint64_t(count) * gradient.stride));
    for (std::size_t i = 0; i < count; ++i) {
      const float* g = &slopes[i * gradient.stride + gradient.column];
      result.push_back({metres * double{values[i * f.stride + f.column]}, glm::length(glm::dvec3(g[0], g[1], g[2]))});
    }
  });
  return result;
}

// Roots by point (read where found), of Broyden's method and the rescue; counts them, and the points that have several.
std::vector<glm::vec3> Conditioning::search(const std::vector<glm::vec3>& targets, ConditioningFigures& figures, std::vector<char>& found) {
  struct Root {
    std::size_t point;
    bool apart;  // from those before
  };
  std::vector<glm::vec3> roots(targets.size(), glm::vec3(0)), all;
  std::vector<Root> of_all;
  found.assign(targets.size(), 0);
  figures.samples = targets.size();
  figures.steps.assign(settings_.max_iterations + 1, 0);
  in_parts(targets.size(), [&](std::size_t first, uint32_t count) {
    device_.upload(points_.slice(), rows_of(targets, first, count));
    const auto download = [&](const BufferSlice& slice) { return device_.download<std::array<float, 4>>(slice.sub(0, count * 16ull)); };
    finder_.solve(commands_, extraction_.frame(), count, points_.slice(), roots_.slice(), search_);
    const auto canonical = download(roots_.slice()), states = download(finder_.states());
    std::vector<std::vector<glm::vec3>> apart(count);
    const auto take = [&](std::size_t i, const std::array<float, 4>& root) {
      const glm::vec3 at(root[0], root[1], root[2]);
      for (const glm::vec3& other : apart[i])
        if (glm::distance(at, other) <= float(roots_apart)) return;
      apart[i].push_back(at);
    };
    for (std::size_t i = 0; i < count; ++i) {
      const bool by_broyden = states[i][2] == converged_state;
      if (by_broyden) {
        ++figures.found;
        ++figures.steps[std::min<std::size_t>(static_cast<std::size_t>(states[i][1]), settings_.max_iterations)];
      }
      figures.refused += states[i][2] == diverged_state && states[i][1] == 0;
      figures.diverged += states[i][2] == diverged_state && states[i][1] > 0;
      figures.exhausted += states[i][2] == exhausted_state;
      if (canonical[i][3] <= 0) continue;
      figures.rescued += !by_broyden;
      found[first + i] = 1;
      roots[first + i] = {canonical[i][0], canonical[i][1], canonical[i][2]};
      take(i, canonical[i]);
    }
    for (uint32_t rank = 0; rank < settings_.bone_starts; ++rank) {
      finder_.solve_from_bone(commands_, extraction_.frame(), count, points_.slice(), roots_.slice(), search_, rank);
      const auto others = download(roots_.slice());
      for (std::size_t i = 0; i < count; ++i)
        if (others[i][3] > 0) take(i, others[i]);
    }
    for (std::size_t i = 0; i < count; ++i)
      for (std::size_t r = 0; r < apart[i].size(); ++r) {
        all.push_back(apart[i][r]);
        of_all.push_back({first + i, r > 0});
      }
  });
  std::vector<std::size_t> number(targets.size(), 0), near(targets.size(), 0);
  const std::vector<Distance> at = distances(all);
  for (std::size_t r = 0; r < all.size(); ++r) {
    ++number[of_all[r].point];
    near[of_all[r].point] += std::abs(at[r].f) <= 2 * settings_.reach;
  }
  const auto several = [](const std::vector<std::size_t>& counts) { return share_of(static_cast<std::size_t>(std::count_if(counts.begin(), counts.end(), [](std::size_t n) { return n > 1; })), counts.size()); };
  figures.several_share = several(number);
  figures.several_near_share = several(near);
  return roots;
}

ExaminedPose Conditioning::examine(const Pose& pose, std::size_t latent_row, int frame) {
  ExaminedPose result;
  ConditioningFigures& figures = result.figures;
  figures.frame = frame;
  const TriangleMesh& mesh = extraction_.mesh(pose, latent_row).canonical();
  const std::vector<glm::vec3> canonical(mesh.vertices.begin(), mesh.vertices.end());
  const Skinned surface = skinned(canonical);
  const glm::dvec3 root_translation(extraction_.frame().root_translation()[0], extraction_.frame().root_translation()[1], extraction_.frame().root_translation()[2]);
  result.triangles = mesh.triangles;
  figures.vertices = canonical.size();
  std::size_t singular = 0, folded = 0, bad = 0;
  for (std::size_t v = 0; v < canonical.size(); ++v) {
    const std::array<double, 3> sigma = singular_values(surface.jacobians[v]);
    const double least = or_singular(sigma[2]), determinant = glm::determinant(surface.jacobians[v]);
    result.vertices.emplace_back(surface.posed[v] + root_translation);
    result.singular.push_back(static_cast<float>(least));
    result.determinants.push_back(static_cast<float>(determinant));
    figures.greatest_singular = std::max(figures.greatest_singular, or_singular(sigma[0]));
    const bool is_singular = least < nearly_singular, is_folded = determinant < 0;
    singular += is_singular;
    folded += is_folded;
    bad += is_singular || is_folded;
  }
  std::vector<float> sorted = result.singular;
  std::sort(sorted.begin(), sorted.end());
  if (!sorted.empty()) {
    figures.least_singular = double{sorted.front()};
    figures.median_singular = double{sorted[sorted.size() / 2]};
  }
  figures.nearly_singular_share = share_of(singular, canonical.size());
  figures.folded_share = share_of(folded, canonical.size());
  figures.bad_share = share_of(bad, canonical.size());
  const auto mean_residual = [](const std::vector<Distance>& distances) {
    double sum = 0;
    for (const Distance& d : distances) sum += std::abs(d.slope - 1);
    return distances.empty() ? 0.0 : sum / double(distances.size());
  };
  figures.eikonal = mean_residual(distances(canonical));

  const std::vector<glm::dvec3> normals = posed_normals(surface.posed, mesh.triangles);
  const std::size_t places = std::min(canonical.size(), std::max<std::size_t>(1, settings_.samples / shell_offsets.size()));
  std::vector<glm::vec3> targets;
  for (std::size_t i = 0; i < places; ++i) {
    const std::size_t v = i * canonical.size() / places;
    for (const double offset : shell_offsets) targets.emplace_back(surface.posed[v] + offset * settings_.reach * normals[v]);
  }
  std::vector<char> found;
  const std::vector<glm::vec3> searched = search(targets, figures, found);
  std::vector<glm::vec3> roots;
  for (std::size_t i = 0; i < targets.size(); ++i) {
    if (found[i]) roots.push_back(searched[i]);
    else result.unsolved.push_back(targets[i] + glm::vec3(root_translation));
  }
  figures.shell_eikonal = mean_residual(distances(roots));
  std::size_t amplified = 0;
  for (const glm::dmat3& jacobian : skinned(roots).jacobians) {
    const double amplification = 1 / std::max(or_singular(singular_values(jacobian)[2]), 1e-12);
    amplified += amplification > 1 / nearly_singular;
    figures.greatest_amplification = std::max(figures.greatest_amplification, amplification);
    figures.untaught += teaches_nothing(jacobian);
  }
  figures.amplified_share = share_of(amplified, roots.size());
  return result;
}

nlohmann::ordered_json conditioning_json(const Avatar& avatar, const ConditioningSettings& settings, const std::vector<ConditioningFigures>& poses) {
  nlohmann::ordered_json json;
  json["b"] = density_scale(avatar);
  json["steps_trained"] = avatar.steps;
  json["settings"] = {{"cell", settings.cell}, {"samples", settings.samples}, {"reach", settings.reach}, {"bone_starts", settings.bone_starts}, {"max_iterations", settings.max_iterations}, {"tolerance", settings.tolerance}, {"rescue_steps", settings.rescue_steps}};
  json["poses"] = nlohmann::ordered_json::array();
  for (const ConditioningFigures& f : poses)
    json["poses"].push_back({{"frame", f.frame},
                             {"surface", {{"vertices", f.vertices}, {"least_singular_value", f.least_singular}, {"median_least_singular_value", f.median_singular}, {"greatest_singular_value", f.greatest_singular}, {"nearly_singular_share", f.nearly_singular_share}, {"folded_share", f.folded_share}, {"nearly_singular_or_folded_share", f.bad_share}, {"eikonal", f.eikonal}}},
                             {"shell", {{"samples", f.samples}, {"found", f.found}, {"refused", f.refused}, {"diverged", f.diverged}, {"exhausted", f.exhausted}, {"rescued", f.rescued}, {"unsolved", f.unsolved()}, {"steps", f.steps}, {"several_roots_share", f.several_share}, {"several_roots_near_share", f.several_near_share}, {"eikonal", f.shell_eikonal}}},
                             {"gradients", {{"amplified_share", f.amplified_share}, {"greatest_amplification", f.greatest_amplification}, {"untaught", f.untaught}}}});
  return json;
}

std::string describe(const ConditioningFigures& f) {
  return fmt::format("frame {}: least singular value {:.3f} (median {:.2f}), {:.2f} % of the surface below {:g}, {:.2f} % folded, stretched {:.1f} times at most; {:.2f} % of {} points not found, {:.2f} % after rescue, {:.1f} % with several roots; eikonal residual {:.3f}",
                     f.frame, f.least_singular, f.median_singular, 100 * f.nearly_singular_share, nearly_singular, 100 * f.folded_share, f.greatest_singular, 100 * share_of(f.unfound(), f.samples), f.samples, 100 * share_of(f.unsolved(), f.samples), 100 * f.several_share, f.eikonal);
}

}  // namespace arah

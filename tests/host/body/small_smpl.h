// A small body model in the files of the SMPL family, .npz and .pkl.
#pragma once

#include "host/body/smpl_joints.h"
#include "tests/host/body/python_files.h"

namespace arah {

// A model of `joints` joints and twice as many vertices along a line, every second of them a joint's own place.
struct SmallModel {
  explicit SmallModel(std::size_t joint_count = 24) : joints(joint_count), vertices(2 * joint_count) {
    for (std::size_t v = 0; v < vertices; ++v) {
      const double x = 0.05 * static_cast<double>(v);
      rest.insert(rest.end(), {x, v % 2 ? 1.2 : 1.0, 0.01 * x * x});
      directions.insert(directions.end(), {0.1, 0.0, 0.0, x, 0.0, 0.3});  // x grows by beta 0, y by x · beta 1 ([3][2])
      for (std::size_t j = 0; j < joints; ++j) {
        regressor.push_back(0);
        weights.push_back(0);
      }
      weights[v * joints + v / 2] = 1.0;
    }
    for (std::size_t j = 0; j < joints; ++j) regressor[j * vertices + 2 * j] = 1.0;
    // All different, and small: pose directions of the k-th number of the feature.
    for (std::size_t i = 0; i < 3 * vertices; ++i)
      for (std::size_t k = 0; k < 9 * (joints - 1); ++k) pose_directions.push_back(0.001 * static_cast<double>((7 * i + 3 * k) % 11) - 0.005);
    // Vertex 0 has six joints: 0.3, 0.25, 0.2, 0.15, 0.06 and 0.04.
    const double six[] = {0.3, 0.25, 0.2, 0.15, 0.06, 0.04};
    for (std::size_t j = 0; j < 6; ++j) weights[j] = six[j];
    for (std::size_t v = 0; v + 2 < vertices; ++v) faces.insert(faces.end(), {static_cast<std::uint32_t>(v), static_cast<std::uint32_t>(v + 1), static_cast<std::uint32_t>(v + 2)});
    for (const int parent : smpl_joint_parents(joints, "test")) tree.push_back(static_cast<std::uint32_t>(parent));
    for (std::size_t j = 0; j < joints; ++j) tree.push_back(static_cast<std::uint32_t>(j));
  }
  std::string npz(bool deflate_them) const {
    return python::npz({{"v_template", python::npy({vertices, 3}, rest)},
                        {"shapedirs", python::npy({vertices, 3, shapes}, directions)},
                        {"posedirs", python::npy({vertices, 3, 9 * (joints - 1)}, pose_directions)},
                        {"J_regressor", python::npy({joints, vertices}, regressor)},
                        {"weights", python::npy({vertices, joints}, weights)},
                        {"f", python::npy("<u4", {faces.size() / 3, 3}, python::raw(faces))},
                        {"kintree_table", python::npy("<u4", {2, joints}, python::raw(tree))}},
                       deflate_them);
  }
  // As the original files are: shape directions in chumpy's class, the regressor in scipy's.
  std::string pickle(bool by_rows = false) const {
    std::vector<double> values;
    std::vector<std::int32_t> indices, starts{0};
    for (std::size_t o = 0; o < (by_rows ? joints : vertices); ++o) {
      for (std::size_t i = 0; i < (by_rows ? vertices : joints); ++i) {
        const double value = by_rows ? regressor[o * vertices + i] : regressor[i * vertices + o];
        if (value == 0) continue;
        values.push_back(value);
        indices.push_back(static_cast<std::int32_t>(i));
      }
      starts.push_back(static_cast<std::int32_t>(values.size()));
    }
    const auto count = [](std::size_t n) { return python::integer(static_cast<std::int64_t>(n)); };
    const std::string sparse = python::dictionary({{"_shape", python::tuple({count(joints), count(vertices)})},
                                                   {"data", python::array({values.size()}, values)},
                                                   {"indices", python::array("i4", {indices.size()}, python::bytes(python::raw(indices)))},
                                                   {"indptr", python::array("i4", {starts.size()}, python::bytes(python::raw(starts)))},
                                                   {"maxprint", python::integer(50)}});
    const std::string kind = by_rows ? "csr" : "csc";
    return python::pickle(python::dictionary(
        {{"v_template", python::array({vertices, 3}, rest)},
         {"shapedirs", python::instance("chumpy.ch", "Ch", python::dictionary({{"x", python::array({vertices, 3, shapes}, directions)}, {"_dirty_vars", python::call(python::name("__builtin__", "set"), {python::list({python::text("x")})})}}))},
         {"J_regressor", python::instance("scipy.sparse." + kind, kind + "_matrix", sparse)},
         {"weights", python::array({vertices, joints}, weights)},
         {"f", python::array("u4", {faces.size() / 3, 3}, python::bytes(python::raw(faces)))},
         {"kintree_table", python::array("u4", {2, joints}, python::bytes(python::raw(tree)))},
         {"bs_type", python::text("lrotmin")}}));
  }
  std::size_t joints, vertices, shapes = 2;
  std::vector<double> rest, directions, pose_directions, regressor, weights;
  std::vector<std::uint32_t> faces, tree;
};

}  // namespace arah

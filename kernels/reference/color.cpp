#include "kernels/reference/color.h"

#include <array>
#include <cmath>

#include "kernels/reference/sizes.h"
#include "kernels/reference/small_matrix.h"

namespace arah::reference {
namespace {

// The width of a part, 0 when it is left out.
std::size_t row_width(const char* what, const std::vector<double>& part, std::size_t points) {
  if (part.empty()) return 0;
  const std::size_t width = points == 0 ? 0 : part.size() / points;
  check_size(what, part.size(), points * width);
  return width;
}

double determinant(const Matrix<3>& m) {
  return m[0][0] * (m[1][1] * m[2][2] - m[1][2] * m[2][1]) - m[0][1] * (m[1][0] * m[2][2] - m[1][2] * m[2][0]) +
         m[0][2] * (m[1][0] * m[2][1] - m[1][1] * m[2][0]);
}

}  // namespace

std::vector<double> view_encoding_forward(std::size_t points, std::span<const double> view, std::size_t octaves) {
  check_size("view encoding: view", view.size(), points * 3);
  std::vector<double> encoding;
  encoding.reserve(points * 3 * (1 + 2 * octaves));
  for (std::size_t p = 0; p < points; ++p) {
    const auto v = view.subspan(p * 3, 3);
    encoding.insert(encoding.end(), v.begin(), v.end());
    double frequency = 1;
    for (std::size_t k = 0; k < octaves; ++k, frequency *= 2) {
      for (double component : v) encoding.push_back(std::sin(frequency * component));
      for (double component : v) encoding.push_back(std::cos(frequency * component));
    }
  }
  return encoding;
}

std::vector<double> view_encoding_backward(std::size_t points, std::span<const double> view, std::size_t octaves,
                                           std::span<const double> d_encoding) {
  const std::size_t width = 3 * (1 + 2 * octaves);
  check_size("view encoding backward: view", view.size(), points * 3);
  check_size("view encoding backward: d_encoding", d_encoding.size(), points * width);
  std::vector<double> d_view(points * 3);
  for (std::size_t p = 0; p < points; ++p) {
    const auto d = d_encoding.subspan(p * width, width);
    for (std::size_t i = 0; i < 3; ++i) {
      const double v = view[p * 3 + i];
      double sum = d[i];
      double frequency = 1;
      for (std::size_t k = 0; k < octaves; ++k, frequency *= 2) {
        sum += frequency * (d[3 + 6 * k + i] * std::cos(frequency * v) - d[6 + 6 * k + i] * std::sin(frequency * v));
      }
      d_view[p * 3 + i] = sum;
    }
  }
  return d_view;
}

std::vector<double> color_view(std::size_t points, std::span<const double> view, std::span<const double> transforms,
                               std::span<const double> rotation, std::span<const double> normal) {
  check_size("colour view: view", view.size(), points * 3);
  if (!transforms.empty()) check_size("colour view: transforms", transforms.size(), points * 9);
  if (!rotation.empty()) check_size("colour view: rotation", rotation.size(), 9);
  if (!rotation.empty()) check_size("colour view: normal", normal.size(), points * 3);
  const auto matrix = [](std::span<const double> rows) {
    return Matrix<3>{{{rows[0], rows[1], rows[2]}, {rows[3], rows[4], rows[5]}, {rows[6], rows[7], rows[8]}}};
  };
  std::vector<double> result;
  for (std::size_t p = 0; p < points; ++p) {
    const auto turned = [&](const Vector<3>& v) {
      if (transforms.empty()) return v;
      const Matrix<3> t = matrix(transforms.subspan(9 * p, 9));
      return std::abs(determinant(t)) > kLeastBlendDeterminant ? multiply<3>(inverse<3>(t).value(), v) : v;
    };
    const Vector<3> v{view[3 * p], view[3 * p + 1], view[3 * p + 2]};
    Vector<3> taken = turned(v);
    if (!rotation.empty()) {
      const Vector<3> rotated = turned(multiply<3>(matrix(rotation), v));
      if (dot<3>({normal[3 * p], normal[3 * p + 1], normal[3 * p + 2]}, rotated) > 0) taken = rotated;
    }
    result.insert(result.end(), taken.begin(), taken.end());
  }
  return result;
}

std::vector<double> color_input(std::size_t points, const ColorInputs& inputs) {
  std::vector<double> view;
  if (!inputs.view.empty()) view = view_encoding_forward(points, inputs.view, kViewOctaves);
  const std::array<const std::vector<double>*, 6> parts = {&inputs.x,       &view,          &inputs.normal,
                                                           &inputs.feature, &inputs.latent, &inputs.grid};
  std::array<std::size_t, 6> widths{};
  for (std::size_t i = 0; i < parts.size(); ++i) widths[i] = row_width("colour input: a part", *parts[i], points);
  std::vector<double> rows;
  for (std::size_t p = 0; p < points; ++p) {
    for (std::size_t i = 0; i < parts.size(); ++i) {
      const auto row = std::span(*parts[i]).subspan(p * widths[i], widths[i]);
      rows.insert(rows.end(), row.begin(), row.end());
    }
  }
  return rows;
}

DenseTape color_forward(const DenseNetwork& network, std::size_t points, const ColorInputs& inputs) {
  return dense_forward(network, points, color_input(points, inputs));
}

ColorInputs color_backward(const DenseNetwork& network, const DenseTape& tape, const ColorInputs& inputs,
                           std::span<const double> d_rgb, DenseNetwork* gradients) {
  const std::vector<double> d_rows = dense_backward(network, tape, d_rgb, gradients);
  const std::size_t points = tape.points, channels = network.input_size();
  std::size_t next = 0;  // the first channel of the next part
  const auto part = [&](std::size_t width) {
    std::vector<double> d;
    for (std::size_t p = 0; p < points && width > 0; ++p) {
      const auto row = std::span(d_rows).subspan(p * channels + next, width);
      d.insert(d.end(), row.begin(), row.end());
    }
    next += width;
    return d;
  };
  ColorInputs d;
  d.x = part(row_width("colour input: x", inputs.x, points));
  if (!inputs.view.empty()) {
    d.view = view_encoding_backward(points, inputs.view, kViewOctaves, part(3 * (1 + 2 * kViewOctaves)));
  }
  d.normal = part(row_width("colour input: normal", inputs.normal, points));
  d.feature = part(row_width("colour input: feature", inputs.feature, points));
  d.latent = part(row_width("colour input: latent", inputs.latent, points));
  d.grid = part(row_width("colour input: grid", inputs.grid, points));
  return d;
}

}  // namespace arah::reference

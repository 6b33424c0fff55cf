// Which rows a launch works on. Networks run over rows that lie together; the points that these belong to may be any.
#pragma once

#include <cstdint>
#include <vector>

#include "kernels/linear/linear.h"

namespace arah {

// Rows 0 … range.points − 1, or as many of them as the WorkCount at range.indirect says. Row r belongs to point ids[r];
// without ids to point r. Buffers by row and `ids` are padded to padded_points(range.points) rows, and the padding
// entries of `ids` are points as well (record_compact writes them so): kernels look them up.
struct Rows {
  PointRange range;
  BufferSlice ids;  // uint32 [padded rows], or empty
};

// Puts bindings 0 and 1 and the workgroups of a shader that includes lib/rows.glsl into the launch. `unused` stands
// where a slice is empty: any that the launch binds.
void add_rows(Launch& launch, const Rows& rows, const BufferSlice& unused);
// The two specialization constants of lib/rows.glsl.
std::vector<uint32_t> rows_specialization(const Rows& rows);

// Bytes of buffers by row, padding included.
inline uint64_t uint_bytes(uint32_t rows) {
  return uint64_t(padded_points(rows)) * 4;
}
inline uint64_t vec4_bytes(uint32_t rows) {
  return uint64_t(padded_points(rows)) * 16;
}
inline uint64_t matrix_bytes(const Matrix& matrix, uint32_t rows) {
  return uint64_t(padded_points(rows)) * matrix.stride * 4;
}
// A matrix as a binding that the launch reads or writes in `rows` rows.
inline Binding matrix_binding(const Matrix& matrix, uint32_t rows) {
  return {matrix.slice, matrix_bytes(matrix, rows)};
}
// Throws std::invalid_argument with `what` where the matrix has no room for `channels` from its column on.
void check_channels(const char* what, const Matrix& matrix, uint32_t channels);

}  // namespace arah

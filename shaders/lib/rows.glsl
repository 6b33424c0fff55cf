// Which rows a launch works on (kernels/tracing/rows.h). Includers define ROWS_CONSTANT, the first of two specialization
// constants, and give bindings 0 and 1 to this file; row_limit is their push constant.
#ifndef ARAH_LIB_ROWS_GLSL
#define ARAH_LIB_ROWS_GLSL

#include "shared/work_count.h"

layout(constant_id = ROWS_CONSTANT) const bool INDEXED = false;      // row r belongs to point row_ids[r], else to point r
layout(constant_id = ROWS_CONSTANT + 1) const bool COUNTED = false;  // the number of rows is on the device

layout(binding = 0, scalar) restrict readonly buffer RowIds { uint row_ids[]; };
layout(binding = 1, scalar) restrict readonly buffer RowWork { WorkCount row_work; };

uint row_count(uint limit) { return COUNTED ? min(limit, row_work.count) : limit; }
int point_of_row(uint row) { return INDEXED ? int(row_ids[row]) : int(row); }

#endif

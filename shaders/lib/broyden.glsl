// A point's state in a root search (kernels/tracing/broyden_state.h) and what start and step share. Vectors have UNKNOWNS
// components; for 3 the fourth is 0 throughout, so that the formulas are the same. Includers define
// BROYDEN_CONSTANT, the first of two specialization constants.
//   g = [x_bar(x) - target; 0]  or, with the depth along a ray, g = [f_metric(x); x_bar(x) - (c + d v - t)]
#ifndef ARAH_LIB_BROYDEN_GLSL
#define ARAH_LIB_BROYDEN_GLSL

#include "lib/finite.glsl"

layout(constant_id = BROYDEN_CONSTANT) const int UNKNOWNS = 3;  // 3: x; 4: x and d
layout(constant_id = BROYDEN_CONSTANT + 1) const bool KEEP_TRANSFORMS = false;

const float NEVER_STARTED = 0.0;
const float ACTIVE = 1.0;
const float CONVERGED = 2.0;
const float DIVERGED = 3.0;
const float EXHAUSTED = 4.0;

// Planes of the state: vec4 plane · capacity + point.
const uint ITERATE = 0u;   // u, the one to be evaluated next
const uint STEP = 1u;      // the step that led to it
const uint RESIDUAL = 2u;  // g before that step
const uint BEST = 3u;      // the iterate with the smallest residual
const uint STATUS = 4u;    // smallest |g|, steps taken, status, 0
const uint INVERSE = 5u;   // the rows of H, the approximate inverse Jacobian
const uint PLANES = INVERSE + uint(UNKNOWNS);  // blended transforms begin here: three vec4 a point

vec4 times(vec4 rows[4], vec4 v) { return vec4(dot(rows[0], v), dot(rows[1], v), dot(rows[2], v), dot(rows[3], v)); }

#endif

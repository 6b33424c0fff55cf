// What a row of a damped Newton search keeps (kernels/reference/damped_newton.h).
#ifndef ARAH_LIB_DAMPED_NEWTON_GLSL
#define ARAH_LIB_DAMPED_NEWTON_GLSL

struct DampedNewtonState {
  vec4 best;         // the iterate with the smallest residual; w: that residual's norm, metres, infinite before the first evaluation
  vec4 residual;     // there; w: the damping
  vec4 jacobian[3];  // there, by rows
};

const float FIRST_DAMPING = 1e-3;
const float LEAST_DAMPING = 1e-7;
const float GREATEST_DAMPING = 1e6;
const float DAMPING_FACTOR = 8.0;

#endif

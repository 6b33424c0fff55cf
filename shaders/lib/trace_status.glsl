// What has become of a ray of sphere tracing; kept as a float in the fourth component of its trace
// (kernels/tracing/sphere_step.h).
#ifndef ARAH_LIB_TRACE_STATUS_GLSL
#define ARAH_LIB_TRACE_STATUS_GLSL
const float UNDER_WAY = 0.0;
const float ON_SURFACE = 1.0;  // |sdf| <= tolerance
const float DIVERGED = 2.0;    // depth >= where tracing gives up, or an sdf that is not finite
#endif

// Activations and their derivatives (kernels/reference/activation.h is the truth).
// Numbers of the activations: linear.h's enum Activation.
#ifndef ARAH_LIB_ACTIVATION_GLSL
#define ARAH_LIB_ACTIVATION_GLSL

#include "lib/finite.glsl"
#include "lib/sine.glsl"
#include "lib/stable.glsl"

const int ACTIVATION_NONE = 0, ACTIVATION_RELU = 1, ACTIVATION_LEAKY_RELU = 2, ACTIVATION_SOFTPLUS = 3, ACTIVATION_SINE = 4,
          ACTIVATION_SIGMOID = 5;
const float LEAKY_SLOPE = 0.2;
const float SOFTPLUS_BETA = 100.0;
const float SOFTPLUS_LINEAR_ABOVE = 20.0;  // of beta · x, as PyTorch does

// cosine: of x, where the activation is the sine; else 0.
vec4 activate(int activation, vec4 x, out vec4 cosine) {
  cosine = vec4(0);
  switch (activation) {
    case ACTIVATION_RELU: return relu(x);
    case ACTIVATION_LEAKY_RELU: return max(x, LEAKY_SLOPE * x);
    case ACTIVATION_SOFTPLUS: {
      // log(1 + e^t) = max(t, 0) + log(1 + e^−|t|): no overflow for any t
      const vec4 t = SOFTPLUS_BETA * x;
      const vec4 soft = (max(t, vec4(0)) + log(1.0 + exp(-abs(t)))) * (1.0 / SOFTPLUS_BETA);
      return mix(soft, x, greaterThan(t, vec4(SOFTPLUS_LINEAR_ABOVE)));
    }
    case ACTIVATION_SINE: return sine(x, cosine);
    case ACTIVATION_SIGMOID: {
      // e^−|x| never overflows; for x < 0 sigmoid(x) = e^x / (1 + e^x)
      const vec4 e = exp(-abs(x));
      return mix(vec4(1), e, lessThan(x, vec4(0))) / (1.0 + e);
    }
    default: return x;
  }
}

// act'(x) from what the forward pass stored: the value y = act(x), or for the sine its cosine.
vec4 derivative_from_stored(int activation, vec4 stored) {
  switch (activation) {
    case ACTIVATION_RELU: return vec4(greaterThan(stored, vec4(0)));
    case ACTIVATION_LEAKY_RELU: return mix(vec4(LEAKY_SLOPE), vec4(1), greaterThan(stored, vec4(0)));
    case ACTIVATION_SOFTPLUS: return 1.0 - exp(-SOFTPLUS_BETA * stored);  // 1 + e^t = e^(β y), so sigmoid(t) = 1 − e^(−β y)
    case ACTIVATION_SINE: return stored;
    case ACTIVATION_SIGMOID: return stored * (1.0 - stored);
    default: return vec4(1);
  }
}

#endif

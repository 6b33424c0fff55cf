// Single floats through texels of four: on a CPU device several times cheaper than from a storage buffer.
#ifndef ARAH_LIB_ELEMENTS_GLSL
#define ARAH_LIB_ELEMENTS_GLSL

// Component i of a texel, without indexing a vector by a variable.
float component(vec4 texel, uint i) {
  vec2 pair = (i & 2u) != 0u ? texel.zw : texel.xy;
  return (i & 1u) != 0u ? pair.y : pair.x;
}

// Number i of an imageBuffer of rgba32f.
#define ELEMENT(buffer, i) component(imageLoad(buffer, int((i) >> 2)), (i) & 3u)

#endif

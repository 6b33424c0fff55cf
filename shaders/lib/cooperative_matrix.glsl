// Matrices of 16 × 16 that a subgroup holds together, halves to multiply and float32 to sum up, by the name of either
// extension: SPIR-V for VK_KHR_cooperative_matrix where ARAH_KHR_COOPERATIVE_MATRIX is defined, else for
// VK_NV_cooperative_matrix (cmake/Shaders.cmake tries both). Arrays are row-major; `at` and `stride` count their elements.
// Both extensions ask for Vulkan's memory model; includers begin with `#pragma use_vulkan_memory_model`.
#ifndef ARAH_LIB_COOPERATIVE_MATRIX_GLSL
#define ARAH_LIB_COOPERATIVE_MATRIX_GLSL

#ifdef ARAH_KHR_COOPERATIVE_MATRIX
#define LeftMatrix coopmat<float16_t, gl_ScopeSubgroup, 16, 16, gl_MatrixUseA>
#define RightMatrix coopmat<float16_t, gl_ScopeSubgroup, 16, 16, gl_MatrixUseB>
#define SumMatrix coopmat<float, gl_ScopeSubgroup, 16, 16, gl_MatrixUseAccumulator>
#define LOAD_MATRIX(matrix, array, at, stride) coopMatLoad(matrix, array, at, stride, gl_CooperativeMatrixLayoutRowMajor)
#define STORE_MATRIX(matrix, array, at, stride) coopMatStore(matrix, array, at, stride, gl_CooperativeMatrixLayoutRowMajor)
#define MULTIPLY_ADD(left, right, sum) coopMatMulAdd(left, right, sum)
#else
#define LeftMatrix fcoopmatNV<16, gl_ScopeSubgroup, 16, 16>
#define RightMatrix fcoopmatNV<16, gl_ScopeSubgroup, 16, 16>
#define SumMatrix fcoopmatNV<32, gl_ScopeSubgroup, 16, 16>
#define LOAD_MATRIX(matrix, array, at, stride) coopMatLoadNV(matrix, array, at, stride, false)
#define STORE_MATRIX(matrix, array, at, stride) coopMatStoreNV(matrix, array, at, stride, false)
#define MULTIPLY_ADD(left, right, sum) coopMatMulAddNV(left, right, sum)
#endif

#endif

# GLSL compute → SPIR-V → checked → embedded.
# arah_embed_shaders(TARGET): every shaders/<area>/<stem>.comp is compiled for Vulkan 1.2 by glslangValidator,
# checked by spirv-val and embedded in the static library TARGET under the name "<area>/<stem>".
find_program(GLSLANG_VALIDATOR glslangValidator REQUIRED)
find_program(SPIRV_VAL spirv-val REQUIRED)
set(ARAH_GLSLANG ${GLSLANG_VALIDATOR} --quiet -V --target-env vulkan1.2)
set(ARAH_SPIRV_VAL ${SPIRV_VAL} --target-env vulkan1.2 --scalar-block-layout)

# For which extension the tools build linear/cooperative_forward, tried on the kernel itself: VK_KHR_cooperative_matrix, which
# drivers of several vendors have, where Vulkan's headers know it too; else VK_NV_cooperative_matrix; else none, and the kernel
# is left out. Sets `extension` to the name or "", `defines` to what the compiler needs for it.
function(arah_cooperative_matrix_extension extension defines)
  set(kernel ${CMAKE_CURRENT_SOURCE_DIR}/linear/cooperative_forward.comp)
  set_property(DIRECTORY APPEND PROPERTY CMAKE_CONFIGURE_DEPENDS ${kernel} ${CMAKE_CURRENT_SOURCE_DIR}/lib/cooperative_matrix.glsl)
  set(trial ${CMAKE_CURRENT_BINARY_DIR}/cooperative_trial.spv)
  file(STRINGS ${Vulkan_INCLUDE_DIRS}/vulkan/vulkan_core.h headers_know_khr REGEX "define VK_KHR_cooperative_matrix 1")
  set(candidates VK_NV_cooperative_matrix)
  if(headers_know_khr)
    list(PREPEND candidates VK_KHR_cooperative_matrix)
  endif()
  foreach(candidate IN LISTS candidates)
    set(flags "")
    if(candidate STREQUAL VK_KHR_cooperative_matrix)
      set(flags -DARAH_KHR_COOPERATIVE_MATRIX=1)
    endif()
    execute_process(COMMAND ${ARAH_GLSLANG} ${flags} -I${CMAKE_CURRENT_SOURCE_DIR} -o ${trial} ${kernel} RESULT_VARIABLE refused OUTPUT_QUIET ERROR_QUIET)
    if(refused EQUAL 0)
      execute_process(COMMAND ${ARAH_SPIRV_VAL} ${trial} RESULT_VARIABLE refused OUTPUT_QUIET ERROR_QUIET)
    endif()
    if(refused EQUAL 0)
      message(STATUS "Cooperative matrices: kernel for ${candidate}")
      set(${extension} ${candidate} PARENT_SCOPE)
      set(${defines} "${flags}" PARENT_SCOPE)
      return()
    endif()
  endforeach()
  message(STATUS "Cooperative matrices: left out, ${GLSLANG_VALIDATOR} and ${SPIRV_VAL} take the kernel for none of ${candidates}")
  set(${extension} "" PARENT_SCOPE)
  set(${defines} "" PARENT_SCOPE)
endfunction()

function(arah_embed_shaders target)
  file(GLOB_RECURSE shaders CONFIGURE_DEPENDS RELATIVE ${CMAKE_CURRENT_SOURCE_DIR} *.comp)
  file(GLOB_RECURSE includes CONFIGURE_DEPENDS ${CMAKE_CURRENT_SOURCE_DIR}/*.glsl ${CMAKE_CURRENT_SOURCE_DIR}/shared/*.h)
  list(SORT shaders)
  arah_cooperative_matrix_extension(cooperative_extension cooperative_defines)
  if(NOT cooperative_extension)
    list(REMOVE_ITEM shaders linear/cooperative_forward.comp)
  endif()
  set(assembly ".section .rodata\n")
  set(table "")
  set(declarations "")
  set(binaries "")
  foreach(shader IN LISTS shaders)
    string(REGEX REPLACE "\\.comp$" "" stem ${shader})
    string(MAKE_C_IDENTIFIER ${stem} symbol)
    set(binary ${CMAKE_CURRENT_BINARY_DIR}/${stem}.spv)
    get_filename_component(folder ${binary} DIRECTORY)
    file(MAKE_DIRECTORY ${folder})
    set(defines "")
    if(stem STREQUAL linear/cooperative_forward)
      set(defines ${cooperative_defines})
    endif()
    add_custom_command(OUTPUT ${binary}
      COMMAND ${ARAH_GLSLANG} ${defines} -I${CMAKE_CURRENT_SOURCE_DIR} -o ${binary} ${CMAKE_CURRENT_SOURCE_DIR}/${shader}
      COMMAND ${ARAH_SPIRV_VAL} ${binary}
      DEPENDS ${CMAKE_CURRENT_SOURCE_DIR}/${shader} ${includes}
      COMMENT "Shader ${stem}" VERBATIM)
    list(APPEND binaries ${binary})
    string(APPEND assembly ".balign 4\n.global spv_${symbol}_begin\nspv_${symbol}_begin: .incbin \"${binary}\"\n"
                           ".global spv_${symbol}_end\nspv_${symbol}_end:\n")
    string(APPEND declarations "extern const unsigned char spv_${symbol}_begin[], spv_${symbol}_end[];\n")
    string(APPEND table "    {\"${stem}\", spv_${symbol}_begin, spv_${symbol}_end},\n")
  endforeach()
  string(APPEND assembly ".section .note.GNU-stack,\"\",@progbits\n")
  file(CONFIGURE OUTPUT ${CMAKE_CURRENT_BINARY_DIR}/embedded.S CONTENT "${assembly}" @ONLY)
  set(source [[
#include "shaders/embedded.h"
extern "C" {
@declarations@}
namespace arah {
static const EmbeddedShader table[] = {
@table@    {nullptr, nullptr, nullptr}};
const EmbeddedShader* embedded_shaders() { return table; }
const char* cooperative_matrix_extension() { return "@cooperative_extension@"; }
}  // namespace arah
]])
  string(CONFIGURE "${source}" source @ONLY)
  file(CONFIGURE OUTPUT ${CMAKE_CURRENT_BINARY_DIR}/embedded.cpp CONTENT "${source}" @ONLY)
  set_source_files_properties(${CMAKE_CURRENT_BINARY_DIR}/embedded.S PROPERTIES OBJECT_DEPENDS "${binaries}")
  add_library(${target} STATIC ${CMAKE_CURRENT_BINARY_DIR}/embedded.cpp ${CMAKE_CURRENT_BINARY_DIR}/embedded.S)
  target_include_directories(${target} PUBLIC ${CMAKE_SOURCE_DIR})
endfunction()

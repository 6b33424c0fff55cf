# GLSL compute → SPIR-V → checked → embedded.
# arah_embed_shaders(TARGET): every shaders/<area>/<stem>.comp is compiled for Vulkan 1.2 by glslangValidator,
# checked by spirv-val and embedded in the static library TARGET under the name "<area>/<stem>".
find_program(GLSLANG_VALIDATOR glslangValidator REQUIRED)
find_program(SPIRV_VAL spirv-val REQUIRED)

function(arah_embed_shaders target)
  file(GLOB_RECURSE shaders CONFIGURE_DEPENDS RELATIVE ${CMAKE_CURRENT_SOURCE_DIR} *.comp)
  file(GLOB_RECURSE includes CONFIGURE_DEPENDS ${CMAKE_CURRENT_SOURCE_DIR}/*.glsl ${CMAKE_CURRENT_SOURCE_DIR}/shared/*.h)
  list(SORT shaders)
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
    add_custom_command(OUTPUT ${binary}
      COMMAND ${GLSLANG_VALIDATOR} --quiet -V --target-env vulkan1.2 -I${CMAKE_CURRENT_SOURCE_DIR} -o ${binary} ${CMAKE_CURRENT_SOURCE_DIR}/${shader}
      COMMAND ${SPIRV_VAL} --target-env vulkan1.2 --scalar-block-layout ${binary}
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
}  // namespace arah
]])
  string(CONFIGURE "${source}" source @ONLY)
  file(CONFIGURE OUTPUT ${CMAKE_CURRENT_BINARY_DIR}/embedded.cpp CONTENT "${source}" @ONLY)
  set_source_files_properties(${CMAKE_CURRENT_BINARY_DIR}/embedded.S PROPERTIES OBJECT_DEPENDS "${binaries}")
  add_library(${target} STATIC ${CMAKE_CURRENT_BINARY_DIR}/embedded.cpp ${CMAKE_CURRENT_BINARY_DIR}/embedded.S)
  target_include_directories(${target} PUBLIC ${CMAKE_SOURCE_DIR})
endfunction()

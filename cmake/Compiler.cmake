# Warnings and sanitizers, as one interface target that every target of ours links.
add_library(arah_compiler INTERFACE)
target_compile_options(arah_compiler INTERFACE
  -Wall -Wextra -Wshadow -Wnon-virtual-dtor -Wold-style-cast -Wcast-align -Woverloaded-virtual
  # Vulkan and launch structures are zero beyond the members that are named; that is what their {sType} form is for.
  -Wno-missing-field-initializers
  # GCC 12 reports these inside libstdc++ and OpenCV headers at -O2; they are false positives there.
  -Wno-maybe-uninitialized -Wno-stringop-overflow)
if(ARAH_WERROR)
  target_compile_options(arah_compiler INTERFACE -Werror)
endif()
if(ARAH_SANITIZE)
  add_compile_options(-fsanitize=${ARAH_SANITIZE} -fno-omit-frame-pointer -fno-sanitize-recover=undefined)
  add_link_options(-fsanitize=${ARAH_SANITIZE})
endif()

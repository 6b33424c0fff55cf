// The one place where tinygltf's implementation is compiled.
#include <nlohmann/json.hpp>

#define TINYGLTF_IMPLEMENTATION
#include "host/body/gltf.h"

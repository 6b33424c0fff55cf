// Whether anything in a run's folder is a number that is NaN or infinite.
#pragma once

#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "host/avatar/safetensors.h"
#include "host/training/run_folder.h"

namespace arah {

// The tensors that have one.
inline std::vector<std::string> tensors_not_finite(const SafetensorsFile& file) {
  std::vector<std::string> found;
  for (const auto& [name, tensor] : file.tensors) {
    if (tensor.dtype != "F32" && tensor.dtype != "F64") continue;
    size_t bad = 0;
    for (const double value : tensor.as<double>()) bad += !std::isfinite(value);
    if (bad) found.push_back(name + ": " + std::to_string(bad) + " of " + std::to_string(tensor.count()) + " numbers");
  }
  return found;
}

// Lines of events.jsonl that hold one, which JSON writes as null, and those that are no JSON.
inline std::vector<std::string> events_not_finite(const RunFolder& folder) {
  std::vector<std::string> found;
  std::ifstream file(folder.events_file());
  for (std::string line; std::getline(file, line);) {
    const nlohmann::json event = nlohmann::json::parse(line, nullptr, false);
    bool good = event.is_object();
    const nlohmann::json numbers = good ? event.flatten() : nlohmann::json::object();
    for (const auto& value : numbers) good = good && !value.is_null() && !(value.is_number() && !std::isfinite(value.get<double>()));
    if (!good) found.push_back(line);
  }
  return found;
}

}  // namespace arah

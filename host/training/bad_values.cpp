#include "host/training/bad_values.h"

#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "host/input_error.h"

namespace arah {
namespace {

constexpr const char* failure_key = "failure";

// "3 NaN, 1 infinite and 2 beyond 1e+06"
std::string counts_text(const BadTensor& tensor) {
  std::vector<std::string> parts;
  if (tensor.nan) parts.push_back(fmt::format("{} NaN", tensor.nan));
  if (tensor.infinite) parts.push_back(fmt::format("{} infinite", tensor.infinite));
  if (tensor.beyond) parts.push_back(fmt::format("{} beyond {:g}", tensor.beyond, tensor.limit));
  std::string text;
  for (size_t i = 0; i < parts.size(); ++i) text += (i == 0 ? "" : i + 1 == parts.size() ? " and " : ", ") + parts[i];
  return text;
}

std::string tensor_text(const BadTensor& tensor) {
  return fmt::format("stage '{}': {} of the {}, the first at index {}: {}", tensor.stage, counts_text(tensor), tensor.tensor, tensor.index, tensor.place);
}

}  // namespace

std::string describe(const BadValues& bad) {
  if (bad.tensors.empty()) return fmt::format("training step {}: nothing bad", bad.step);
  std::string text = fmt::format("training step {}: {}", bad.step, tensor_text(bad.tensors[0]));
  for (size_t i = 1; i < bad.tensors.size(); ++i) text += fmt::format("{} {} ({})", i == 1 ? "; after it" : ",", bad.tensors[i].tensor, bad.tensors[i].stage);
  return text;
}

void put_bad_values(SafetensorsFile& file, const BadValues& bad) {
  nlohmann::ordered_json tensors = nlohmann::ordered_json::array();
  for (const BadTensor& t : bad.tensors)
    tensors.push_back({{"stage", t.stage}, {"tensor", t.tensor}, {"index", t.index}, {"place", t.place}, {"nan", t.nan}, {"infinite", t.infinite}, {"beyond", t.beyond}, {"limit", t.limit}});
  file.metadata[failure_key] = nlohmann::ordered_json{{"step", bad.step}, {"state", bad.state}, {"searches", bad.searches}, {"tensors", tensors}}.dump();
}

std::optional<BadValues> bad_values_of(const SafetensorsFile& file) {
  const auto found = file.metadata.find(failure_key);
  if (found == file.metadata.end()) return std::nullopt;
  const nlohmann::json json = nlohmann::json::parse(found->second, nullptr, false);
  const auto refuse = [&](const std::string& field, const char* expected) { return InputError(file.path.string(), fmt::format("metadata {}{}", failure_key, field), expected, "something else"); };
  const auto number = [&](const nlohmann::json& object, const char* name) {
    if (!object.contains(name) || !object[name].is_number_unsigned()) throw refuse(std::string(".") + name, "a whole number of at least 0");
    return object[name].get<uint64_t>();
  };
  const auto text = [&](const nlohmann::json& object, const char* name) {
    if (!object.contains(name) || !object[name].is_string()) throw refuse(std::string(".") + name, "a text");
    return object[name].get<std::string>();
  };
  if (!json.is_object() || !json.contains("tensors") || !json["tensors"].is_array()) throw refuse("", "an object with step, searches and tensors");
  BadValues bad;
  bad.step = number(json, "step");
  if (!json.contains("state") || !json["state"].is_boolean()) throw refuse(".state", "true or false");
  bad.state = json["state"].get<bool>();
  bad.searches = text(json, "searches");
  for (const nlohmann::json& t : json["tensors"]) {
    if (!t.is_object() || !t.contains("limit") || !t["limit"].is_number()) throw refuse(".tensors", "objects with a limit");
    bad.tensors.push_back({text(t, "stage"), text(t, "tensor"), number(t, "index"), text(t, "place"), number(t, "nan"), number(t, "infinite"), number(t, "beyond"), t["limit"].get<double>()});
  }
  return bad;
}

std::string bad_values_report(const BadValues& bad) {
  std::string text = fmt::format("a training step that failed: step {}; the file holds the state before it{}\n", bad.step, bad.state ? ", which is bad itself" : "");
  for (const BadTensor& tensor : bad.tensors) text += "  " + tensor_text(tensor) + "\n";
  if (!bad.searches.empty()) text += "  searches for correspondences: " + bad.searches + "\n";
  return text;
}

}  // namespace arah

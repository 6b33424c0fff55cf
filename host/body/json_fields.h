// Reading JSON files field by field, with errors that say where. For .cpp files only: the JSON library is slow to
// compile.
#pragma once

#include <cmath>
#include <filesystem>
#include <glm/vec3.hpp>
#include <nlohmann/json.hpp>
#include <string>
#include <string_view>

#include "host/body/json_text.h"
#include "host/body/mapped_file.h"
#include "host/input_error.h"

namespace arah {

// Throws InputError naming `where` and `field`: not JSON (NaN and Infinity are not), and what check_json_text() refuses.
template <typename Json = nlohmann::json>
Json parse_json(std::string_view text, const std::string& where, const std::string& field = "") {
  check_json_text(text, where, field);
  try {
    return Json::parse(text);
  } catch (const nlohmann::json::exception& error) {
    throw InputError(where, field, "JSON", error.what());
  }
}

// The whole file. Throws InputError if it cannot be opened, has more than kMostJsonFile bytes, or as parse_json() does.
inline nlohmann::json read_json(const std::filesystem::path& path) {
  if (!std::filesystem::is_regular_file(path)) throw InputError(path.string(), "", "a JSON file", "none that can be opened");
  const MappedFile file(path, kMostJsonFile);
  return parse_json(file.bytes(), path.string());
}

// A value in words, short enough for one line.
inline std::string json_excerpt(const nlohmann::json& value) {
  if (value.is_structured() && value.size() > 60) return fmt::format("{} of {} values", value.is_array() ? "a list" : "an object", value.size());
  const std::string text = value.dump(-1, ' ', true, nlohmann::json::error_handler_t::replace);
  return text.size() <= 60 ? text : text.substr(0, 57) + "...";
}

// A member that must be there.
inline const nlohmann::json& json_member(const nlohmann::json& object, const char* name, const std::string& where,
                                         const std::string& field) {
  if (!object.is_object()) throw InputError(where, field, "an object", json_excerpt(object));
  const auto found = object.find(name);
  if (found == object.end()) {
    throw InputError(where, field.empty() ? name : field + " " + name, "this field", "none");
  }
  return *found;
}

// A list of exactly `count` values, or of any number where count is negative.
inline const nlohmann::json& json_list(const nlohmann::json& value, long count, const std::string& where,
                                       const std::string& field) {
  if (!value.is_array()) throw InputError(where, field, "a list", json_excerpt(value));
  if (count >= 0 && value.size() != static_cast<std::size_t>(count)) {
    throw InputError(where, field, fmt::format("{} values", count), fmt::format("{}", value.size()));
  }
  return value;
}

// A finite number.
inline double json_number(const nlohmann::json& value, const std::string& where, const std::string& field) {
  if (!value.is_number() || !std::isfinite(value.get<double>())) {
    throw InputError(where, field, "a finite number", json_excerpt(value));
  }
  return value.get<double>();
}

// An integer in least..greatest.
inline int json_integer(const nlohmann::json& value, int least, int greatest, const std::string& where,
                        const std::string& field) {
  const double number = value.is_number() ? value.get<double>() : std::nan("");
  if (!(number >= least && number <= greatest) || number != std::floor(number)) {
    throw InputError(where, field, fmt::format("an integer from {} to {}", least, greatest), json_excerpt(value));
  }
  return static_cast<int>(number);
}

inline std::string json_text(const nlohmann::json& value, const std::string& where, const std::string& field) {
  if (!value.is_string()) throw InputError(where, field, "a text", json_excerpt(value));
  return value.get<std::string>();
}

inline glm::dvec3 json_vector(const nlohmann::json& value, const std::string& where, const std::string& field) {
  json_list(value, 3, where, field);
  return {json_number(value[0], where, field), json_number(value[1], where, field),
          json_number(value[2], where, field)};
}

}  // namespace arah

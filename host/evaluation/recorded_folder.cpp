#include "host/evaluation/recorded_folder.h"

#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "host/body/json_fields.h"
#include "host/file_writing.h"
#include "host/input_error.h"

namespace arah {

void Fingerprint::add_bits(std::uint64_t bits) {
  for (int byte = 0; byte < 8; ++byte) hash_ = (hash_ ^ (bits >> 8 * byte & 255)) * 0x100000001b3ull;
}

std::string Fingerprint::text() const { return fmt::format("{:016x}", hash_); }

std::string fingerprint_of(const Avatar& avatar) {
  Fingerprint print;
  print.add(avatar.steps);
  for (const float value : avatar.parameters) print.add(value);
  return print.text();
}

void claim_folder(const std::filesystem::path& folder, const std::string& record, const nlohmann::ordered_json& now, const std::string& results, const std::function<bool()>& there) {
  namespace fs = std::filesystem;
  const fs::path file = folder / record;
  if (!fs::exists(file)) {
    std::error_code error;
    fs::create_directories(folder, error);
    if (error || !fs::is_directory(folder)) throw InputError(folder.string(), "", fmt::format("a folder for the {}", results), error ? error.message() : "a file", "Choose another name.");
    if (there()) throw InputError(folder.string(), record, fmt::format("what says how the {} here were made", results), "none", fmt::format("Choose another name, or remove the {}.", results));
    write_file_safely(file, now.dump(1) + "\n");
    return;
  }
  const nlohmann::json before = read_json(file);
  for (const auto& [name, value] : now.items()) {
    const nlohmann::json was = before.is_object() ? before.value(name, nlohmann::json()) : nlohmann::json();
    if (was == nlohmann::json(value)) continue;
    throw InputError(file.string(), name, fmt::format("what the {} there were made with, {}", results, json_excerpt(was)), json_excerpt(value),
                     fmt::format("Go on with the same options, choose another name, or remove {}.", folder.string()));
  }
}

}  // namespace arah

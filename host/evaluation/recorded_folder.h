// Folders of results, a file a frame, beside which a record says what they were made with: the same call goes on where it was stopped,
// another one is refused before it mixes its files with them.
#pragma once

#include <bit>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <nlohmann/json_fwd.hpp>
#include <string>

#include "host/avatar/avatar.h"

namespace arah {

// FNV-1a over numbers of 4 or 8 bytes.
class Fingerprint {
 public:
  template <typename Number>
  void add(const Number& number) {
    if constexpr (sizeof(Number) == 8) add_bits(std::bit_cast<std::uint64_t>(number));
    else add_bits(std::bit_cast<std::uint32_t>(number));
  }
  std::string text() const;  // 16 hexadecimal digits

 private:
  void add_bits(std::uint64_t bits);
  std::uint64_t hash_ = 0xcbf29ce484222325ull;
};

// Of its steps and parameters.
std::string fingerprint_of(const Avatar& avatar);

// Makes the folder where there is none, and writes `now`, an object, as its record; or checks that the record there says the same.
// results: what the files are, "pictures"; there: whether any of them is there, asked where there is no record.
// Throws InputError: a file of the folder's name, results without a record, a record that differs, naming the entry.
void claim_folder(const std::filesystem::path& folder, const std::string& record, const nlohmann::ordered_json& now, const std::string& results, const std::function<bool()>& there);

}  // namespace arah

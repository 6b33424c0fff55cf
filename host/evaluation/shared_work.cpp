#include "host/evaluation/shared_work.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstring>
#include <stdexcept>

#include "host/evaluation/recorded_folder.h"
#include "host/version.h"

namespace arah {
namespace {

// So many of a picture for each rank: the last one to be done keeps the others waiting for a band at most.
constexpr uint32_t bands_a_rank = 8;

// Calls with(bytes of the rows, their number) for each of the picture's planes.
template <typename AnyPicture, typename With>
void each_plane(AnyPicture& picture, int begin, int end, const With& with) {
  const auto pixels = static_cast<std::size_t>(picture.width) * static_cast<std::size_t>(picture.height);
  const auto plane = [&](auto& values) {
    if (values.empty()) return;
    const std::size_t row = values.size() / pixels * static_cast<std::size_t>(picture.width);
    with(values.data() + row * static_cast<std::size_t>(begin), row * static_cast<std::size_t>(end - begin) * sizeof values[0]);
  };
  plane(picture.color);
  plane(picture.alpha);
  plane(picture.depth);
  plane(picture.normal);
  if (!picture.inspection) return;
  plane(picture.inspection->canonical);
  for (auto* counts : {&picture.inspection->placed, &picture.inspection->wanted, &picture.inspection->unfound, &picture.inspection->shaded, &picture.inspection->steps, &picture.inspection->most_steps}) plane(*counts);
}

}  // namespace

void agree_on_work(const Ranks& ranks, const Avatar& avatar, const std::string& wanted) {
  if (ranks.count() > 1) ranks.agree({{"version", kVersion}, {"avatar", fingerprint_of(avatar)}, {"work", wanted}});
}

std::vector<nlohmann::json> shared_out(const Ranks& ranks, uint64_t count, const std::function<nlohmann::json(uint64_t)>& work) {
  using nlohmann::json;
  json own = json::array();
  ranks.share(count, [&](uint64_t number) {
    own.push_back({number, work(number)});
    return true;
  });
  std::vector<json> outcomes(ranks.first() ? count : 0);
  const auto put = [&](json& some) {
    for (json& outcome : some) outcomes.at(outcome.at(0).get<uint64_t>()) = std::move(outcome.at(1));
  };
  if (ranks.count() == 1) {
    put(own);
    return outcomes;
  }
  std::string bytes;
  json::to_cbor(own, bytes);
  own = {};
  for (const std::string& of_rank : ranks.collect(bytes)) {
    json some = json::from_cbor(of_rank);
    put(some);
  }
  return outcomes;
}

std::vector<uint8_t> rows_of(const Picture& picture, int begin, int end) {
  std::vector<uint8_t> bytes;
  each_plane(picture, begin, end, [&](const auto* values, std::size_t size) {
    const std::size_t before = bytes.size();
    bytes.resize(before + size);
    if (size) std::memcpy(bytes.data() + before, values, size);
  });
  return bytes;
}

void put_rows(Picture& picture, int begin, int end, const std::vector<uint8_t>& bytes) {
  std::size_t expected = 0, at = 0;
  each_plane(picture, begin, end, [&](auto*, std::size_t size) { expected += size; });
  if (expected != bytes.size()) throw std::runtime_error(fmt::format("rows {} to {} of a picture: {} bytes instead of {}", begin, end, bytes.size(), expected));
  each_plane(picture, begin, end, [&](auto* values, std::size_t size) {
    if (size) std::memcpy(values, bytes.data() + at, size);
    at += size;
  });
}

Picture render_shared(Renderer& renderer, const Camera& camera, const Pose& pose, std::size_t latent_row, const Ranks& ranks, const RenderingProgress& progress) {
  if (ranks.count() == 1) return renderer.render(camera, pose, latent_row, progress);
  const Camera computed = renderer.computed(camera);
  const auto height = static_cast<uint32_t>(computed.height);
  const std::vector<uint32_t> bands(std::min(height, bands_a_rank * ranks.count()), 1);
  const auto band = [&](uint64_t number) { return Ranks::part_of(height, 1, static_cast<uint32_t>(number), bands); };
  const std::vector<nlohmann::json> parts = shared_out(ranks, bands.size(), [&](uint64_t number) {
    const int begin = static_cast<int>(band(number).begin), end = static_cast<int>(band(number).end);
    const Picture rows = renderer.render_rows(computed, pose, latent_row, begin, end, [&](const PictureSoFar& so_far) {
      return !progress || progress({(static_cast<double>(number) + so_far.part) / static_cast<double>(bands.size()), so_far.picture, 0});
    });
    return nlohmann::json::binary(rows_of(rows, begin, end));
  });
  if (!ranks.first()) return {};
  Picture picture = renderer.render_rows(computed, pose, latent_row, 0, 0);
  for (std::size_t number = 0; number < parts.size(); ++number) put_rows(picture, static_cast<int>(band(number).begin), static_cast<int>(band(number).end), parts[number].get_binary());
  return renderer.whole(std::move(picture), camera);
}

}  // namespace arah

// Work on pictures that several ranks (host/training/ranks.h) share out among them: each its outcome, all of them on the first rank, which
// then has what it would have made alone.
#pragma once

#include <cstdint>
#include <functional>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "host/avatar/avatar.h"
#include "host/rendering/renderer.h"
#include "host/training/ranks.h"

namespace arah {

// Collective: throws InputError where the ranks' programs, avatars or `wanted` (what is to be made of it) differ.
void agree_on_work(const Ranks& ranks, const Avatar& avatar, const std::string& wanted);

// Collective: work(i) once for each i of 0 ... count - 1, on the rank that is free first. All outcomes in order on the first rank, nothing
// on the others. They travel as CBOR: numbers keep their bits, infinities too, and bytes (json::binary) are bytes.
std::vector<nlohmann::json> shared_out(const Ranks& ranks, uint64_t count, const std::function<nlohmann::json(uint64_t)>& work);

// Rows begin ... end - 1 of all that a picture holds, as bytes, and into a picture of the same size and kind, which they replace. Throws
// std::runtime_error for bytes that are not as many.
std::vector<uint8_t> rows_of(const Picture& picture, int begin, int end);
void put_rows(Picture& picture, int begin, int end, const std::vector<uint8_t>& bytes);

// Collective: Renderer::render's picture on the first rank, bit for bit, of bands of rows that the ranks share out; an empty one on the others.
// progress: as there, of this rank; `part` is of the bands.
Picture render_shared(Renderer& renderer, const Camera& camera, const Pose& pose, std::size_t latent_row, const Ranks& ranks, const RenderingProgress& progress = {});

}  // namespace arah

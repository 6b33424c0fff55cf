// A reader of GLB files that knows nothing of the program's own: container, accessors, what the format demands, and what a skin, an
// animation and morph targets make of the vertices.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <glm/gtc/quaternion.hpp>
#include <glm/mat4x4.hpp>
#include <glm/vec2.hpp>
#include <glm/vec3.hpp>
#include <glm/vec4.hpp>
#include <nlohmann/json.hpp>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include <fmt/format.h>

namespace arah {

class GlbReader {
 public:
  using Json = nlohmann::json;

  explicit GlbReader(const std::vector<std::uint8_t>& bytes) {
    const auto word = [&](size_t at) {
      std::uint32_t value = 0;
      if (at + 4 > bytes.size()) throw std::runtime_error("the file ends early");
      std::memcpy(&value, &bytes[at], 4);
      return value;
    };
    if (word(0) != 0x46546c67 || word(4) != 2 || word(8) != bytes.size()) throw std::runtime_error("no GLB of version 2 and its own length");
    const size_t text = word(12);
    if (word(16) != 0x4e4f534a || text % 4 || 20 + text + 8 > bytes.size()) throw std::runtime_error("no JSON chunk");
    json = Json::parse(bytes.begin() + 20, bytes.begin() + 20 + static_cast<std::ptrdiff_t>(text));
    const size_t data = word(20 + text);
    if (word(24 + text) != 0x004e4942 || data % 4 || 28 + text + data != bytes.size()) throw std::runtime_error("no BIN chunk to the end");
    binary.assign(bytes.begin() + 28 + static_cast<std::ptrdiff_t>(text), bytes.end());
  }

  Json json;
  std::vector<std::uint8_t> binary;

  // [count][components], whatever the type; normalised integers are not used in these files.
  std::vector<std::vector<double>> values(size_t accessor) const {
    const Json& a = json.at("accessors").at(accessor);
    const Json& view = json.at("bufferViews").at(a.at("bufferView").get<size_t>());
    const size_t components = components_of(a), size = size_of(a), count = a.at("count");
    const size_t stride = view.value("byteStride", components * size), first = view.value("byteOffset", size_t{0}) + a.value("byteOffset", size_t{0});
    std::vector<std::vector<double>> result(count, std::vector<double>(components));
    for (size_t i = 0; i < count; ++i)
      for (size_t c = 0; c < components; ++c) {
        const std::uint8_t* at = &binary.at(first + i * stride + c * size);
        const int type = a.at("componentType");
        if (type == 5126) {
          float value = 0;
          std::memcpy(&value, at, 4);
          result[i][c] = double{value};
        } else {
          std::uint32_t value = 0;
          std::memcpy(&value, at, size);
          result[i][c] = value;
        }
      }
    return result;
  }
  const Json& primitive() const { return json.at("meshes").at(0).at("primitives").at(0); }
  std::vector<glm::dvec3> vectors(size_t accessor) const {
    std::vector<glm::dvec3> result;
    for (const auto& v : values(accessor)) result.emplace_back(v[0], v[1], v[2]);
    return result;
  }
  std::vector<glm::dvec3> attribute(const std::string& name) const { return vectors(primitive().at("attributes").at(name)); }
  std::vector<glm::dvec2> uvs() const {
    std::vector<glm::dvec2> result;
    for (const auto& v : values(primitive().at("attributes").at("TEXCOORD_0"))) result.emplace_back(v[0], v[1]);
    return result;
  }
  std::vector<glm::uvec3> triangles() const {
    const auto indices = values(primitive().at("indices"));
    std::vector<glm::uvec3> result;
    for (size_t i = 0; i < indices.size(); i += 3) result.emplace_back(indices[i][0], indices[i + 1][0], indices[i + 2][0]);
    return result;
  }

  // The vertices at a time of the first animation, or, without a time, as the nodes stand.
  std::vector<glm::dvec3> posed(std::optional<double> seconds) const {
    std::vector<glm::dvec3> vertices = attribute("POSITION");
    std::vector<glm::dvec3> translations(nodes(), glm::dvec3(0.0));
    std::vector<glm::dquat> rotations(nodes(), glm::dquat(1, 0, 0, 0));
    for (size_t n = 0; n < nodes(); ++n) {
      const Json& node = json["nodes"][n];
      if (node.contains("translation")) translations[n] = {node["translation"][0], node["translation"][1], node["translation"][2]};
      if (node.contains("rotation")) rotations[n] = glm::dquat(node["rotation"][3], node["rotation"][0], node["rotation"][1], node["rotation"][2]);
    }
    std::vector<double> weights;
    if (seconds)
      for (const Json& channel : json.at("animations").at(0).at("channels")) {
        const Json& sampler = json["animations"][0]["samplers"].at(channel.at("sampler").get<size_t>());
        const auto times = values(sampler.at("input")), outputs = values(sampler.at("output"));
        size_t next = 0;
        while (next < times.size() && times[next][0] < *seconds - 1e-9) ++next;
        const size_t after = std::min(next, times.size() - 1), before = after > 0 && times[after][0] > *seconds + 1e-9 ? after - 1 : after;
        const double span = times[after][0] - times[before][0], t = span > 0 ? (*seconds - times[before][0]) / span : 0;
        const std::string path = channel["target"]["path"];
        if (path == "weights") {
          const size_t targets = primitive().at("targets").size();
          for (size_t k = 0; k < targets; ++k) weights.push_back((1 - t) * outputs[before * targets + k][0] + t * outputs[after * targets + k][0]);
          continue;
        }
        const size_t node = channel["target"]["node"];
        const auto& a = outputs[before];
        const auto& b = outputs[after];
        if (path == "translation") translations[node] = (1 - t) * glm::dvec3(a[0], a[1], a[2]) + t * glm::dvec3(b[0], b[1], b[2]);
        else rotations[node] = glm::slerp(glm::dquat(a[3], a[0], a[1], a[2]), glm::dquat(b[3], b[0], b[1], b[2]), t);
      }
    for (size_t k = 0; k < weights.size(); ++k) {
      const std::vector<glm::dvec3> offsets = vectors(primitive()["targets"][k].at("POSITION"));
      for (size_t v = 0; v < vertices.size(); ++v) vertices[v] += weights[k] * offsets[v];
    }
    if (!json.contains("skins")) return vertices;
    std::vector<glm::dmat4> world(nodes());
    const auto walk = [&](const auto& self, size_t n, const glm::dmat4& parent) -> void {
      glm::dmat4 local(glm::mat3_cast(rotations[n]));
      local[3] = glm::dvec4(translations[n], 1.0);
      world[n] = parent * local;
      for (const Json& child : json["nodes"][n].value("children", Json::array())) self(self, child.get<size_t>(), world[n]);
    };
    for (const Json& root : json["scenes"][0]["nodes"]) walk(walk, root.get<size_t>(), glm::dmat4(1.0));
    const Json& skin = json["skins"][0];
    std::vector<glm::dmat4> matrices;
    const auto inverse_bind = values(skin.at("inverseBindMatrices"));
    for (size_t j = 0; j < skin["joints"].size(); ++j) {
      glm::dmat4 matrix;
      for (int i = 0; i < 16; ++i) matrix[i / 4][i % 4] = inverse_bind[j][static_cast<size_t>(i)];
      matrices.push_back(world[skin["joints"][j].get<size_t>()] * matrix);
    }
    const auto joints = values(primitive()["attributes"].at("JOINTS_0")), shares = values(primitive()["attributes"].at("WEIGHTS_0"));
    for (size_t v = 0; v < vertices.size(); ++v) {
      glm::dvec4 sum(0.0);
      for (size_t k = 0; k < 4; ++k) sum += shares[v][k] * (matrices.at(static_cast<size_t>(joints[v][k])) * glm::dvec4(vertices[v], 1.0));
      vertices[v] = glm::dvec3(sum);
    }
    return vertices;
  }

  // What the format demands and the file does not keep.
  std::vector<std::string> complaints() const {
    std::vector<std::string> found;
    const auto expect = [&](bool holds, const std::string& what) {
      if (!holds) found.push_back(what);
    };
    expect(json.at("asset").at("version") == "2.0", "asset.version");
    expect(json.at("buffers").size() == 1 && json["buffers"][0].at("byteLength") <= binary.size() && binary.size() - json["buffers"][0]["byteLength"].get<size_t>() < 4, "one buffer, the BIN chunk");
    for (size_t i = 0; i < json.at("bufferViews").size(); ++i) {
      const Json& view = json["bufferViews"][i];
      expect(view.value("byteOffset", size_t{0}) + view.at("byteLength").get<size_t>() <= binary.size(), fmt::format("buffer view {} within the buffer", i));
    }
    for (size_t i = 0; i < json.at("accessors").size(); ++i) {
      const Json& a = json["accessors"][i];
      const Json& view = json["bufferViews"].at(a.at("bufferView").get<size_t>());
      const size_t size = size_of(a), element = size * components_of(a), stride = view.value("byteStride", element);
      expect((view.value("byteOffset", size_t{0}) + a.value("byteOffset", size_t{0})) % size == 0, fmt::format("accessor {} aligned to its components", i));
      expect(a.at("count") >= 1 && a.value("byteOffset", size_t{0}) + (a["count"].get<size_t>() - 1) * stride + element <= view["byteLength"], fmt::format("accessor {} within its view", i));
      if (!found.empty()) return found;  // nothing below may be read
      const auto all = values(i);
      for (const auto& v : all)
        for (const double x : v) expect(std::isfinite(x), fmt::format("accessor {} finite", i));
      for (const char* bound : {"min", "max"})
        if (a.contains(bound))
          for (size_t c = 0; c < components_of(a); ++c) {
            double extreme = all[0][c];
            for (const auto& v : all) extreme = std::string(bound) == "min" ? std::min(extreme, v[c]) : std::max(extreme, v[c]);
            expect(a[bound].at(c).get<double>() == extreme, fmt::format("accessor {}: {} of component {} is {}, not {}", i, bound, c, extreme, a[bound][c].get<double>()));
          }
    }
    const Json& attributes = primitive().at("attributes");
    const size_t count = json["accessors"][attributes.at("POSITION").get<size_t>()]["count"];
    for (const auto& [name, accessor] : attributes.items()) {
      const Json& a = json["accessors"].at(accessor.get<size_t>());
      expect(a["count"] == count, name + " has as many as POSITION");
      const Json& view = json["bufferViews"][a["bufferView"].get<size_t>()];
      expect((view.value("byteOffset", size_t{0}) + a.value("byteOffset", size_t{0})) % 4 == 0 && (components_of(a) * size_of(a)) % 4 == 0, name + " aligned to 4 bytes");
    }
    expect(json["accessors"][attributes["POSITION"].get<size_t>()].contains("min") && json["accessors"][attributes["POSITION"].get<size_t>()].contains("max"), "bounds of POSITION");
    for (const auto& n : values(attributes.at("NORMAL"))) expect(std::abs(std::hypot(n[0], n[1], n[2]) - 1) < 5e-4, "normals of unit length");
    for (const auto& index : values(primitive().at("indices"))) expect(index[0] < static_cast<double>(count), "indices in range");
    expect(json["accessors"][primitive()["indices"].get<size_t>()]["count"].get<size_t>() % 3 == 0, "three indices a triangle");
    for (const Json& target : primitive().value("targets", Json::array()))
      for (const auto& [name, accessor] : target.items()) expect(json["accessors"].at(accessor.get<size_t>())["count"] == count, "a morph target's " + name + " of every vertex");
    if (json.contains("skins")) {
      const Json& skin = json["skins"][0];
      const size_t joints = skin.at("joints").size();
      expect(json["accessors"].at(skin.at("inverseBindMatrices").get<size_t>())["count"] == joints, "an inverse bind matrix a joint");
      for (const auto& m : values(skin["inverseBindMatrices"])) expect(m[3] == 0 && m[7] == 0 && m[11] == 0 && m[15] == 1, "affine inverse bind matrices");
      const auto used = values(attributes.at("JOINTS_0")), weights = values(attributes.at("WEIGHTS_0"));
      for (size_t v = 0; v < count; ++v) {
        float sum = 0;
        for (size_t k = 0; k < 4; ++k) {
          sum += static_cast<float>(weights[v][k]);
          expect(weights[v][k] >= 0 && used[v][k] < static_cast<double>(joints), "weights ≥ 0 of joints that there are");
          expect(weights[v][k] > 0 || used[v][k] == 0, "joint 0 where a slot is unused");
          for (size_t l = 0; l < k; ++l) expect(weights[v][k] == 0 || weights[v][l] == 0 || used[v][k] != used[v][l], "each joint of a vertex once");
        }
        expect(std::abs(sum - 1) < 4e-7f, fmt::format("weights of vertex {} sum to {}", v, sum));
      }
    }
    std::vector<int> parents(nodes(), 0);
    for (size_t n = 0; n < nodes(); ++n)
      for (const Json& child : json["nodes"][n].value("children", Json::array())) ++parents.at(child.get<size_t>());
    for (const Json& root : json.at("scenes").at(0).at("nodes")) ++parents.at(root.get<size_t>());
    for (const int count_of : parents) expect(count_of == 1, "every node once in the scene");
    for (const Json& animation : json.value("animations", Json::array()))
      for (const Json& channel : animation.at("channels")) {
        const Json& sampler = animation.at("samplers").at(channel.at("sampler").get<size_t>());
        const auto times = values(sampler.at("input"));
        const Json& input = json["accessors"][sampler["input"].get<size_t>()];
        expect(input.contains("min") && input.contains("max"), "bounds of times");
        for (size_t i = 1; i < times.size(); ++i) expect(times[i][0] > times[i - 1][0], "times that increase");
        const std::string path = channel.at("target").at("path");
        const auto outputs = values(sampler.at("output"));
        expect(outputs.size() == times.size() * (path == "weights" ? primitive().at("targets").size() : 1), path + ": an output a key");
        expect(channel["target"].at("node").get<size_t>() < nodes(), "a node that there is");
        if (path == "rotation")
          for (const auto& q : outputs) expect(std::abs(std::sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]) - 1) < 1e-6, "unit quaternions");
      }
    for (const Json& image : json.value("images", Json::array())) {
      const Json& view = json["bufferViews"].at(image.at("bufferView").get<size_t>());
      const size_t at = view.value("byteOffset", size_t{0});
      expect(image.at("mimeType") == "image/png" && std::memcmp(&binary.at(at), "\x89PNG\r\n\x1a\n", 8) == 0, "a PNG");
    }
    std::sort(found.begin(), found.end());
    found.erase(std::unique(found.begin(), found.end()), found.end());
    return found;
  }

 private:
  size_t nodes() const { return json.at("nodes").size(); }
  static size_t components_of(const Json& accessor) {
    const std::string type = accessor.at("type");
    return type == "SCALAR" ? 1 : type == "VEC2" ? 2 : type == "VEC3" ? 3 : type == "VEC4" ? 4 : 16;
  }
  static size_t size_of(const Json& accessor) {
    const int type = accessor.at("componentType");
    return type == 5121 ? 1 : type == 5123 ? 2 : 4;
  }
};

// What a program on the PATH or a package of node's says on its standard output; none where it is not there.
inline std::optional<std::string> output_of(const std::string& command) {
  std::FILE* pipe = ::popen((command + " 2>&1").c_str(), "r");
  if (!pipe) return {};
  std::string text;
  char buffer[4096];
  for (size_t read = 0; (read = std::fread(buffer, 1, sizeof buffer, pipe)) > 0;) text.append(buffer, read);
  return ::pclose(pipe) == 0 ? std::optional(text) : std::nullopt;
}

// The report of the Khronos validator, by gltf_validator on the PATH or node's package gltf-validator (where NODE_PATH
// finds it); none where neither is installed.
inline std::optional<nlohmann::json> khronos_report(const std::filesystem::path& file) {
  const auto parsed = [](const std::optional<std::string>& text) -> std::optional<nlohmann::json> {
    if (!text) return {};
    const nlohmann::json report = nlohmann::json::parse(*text, nullptr, false);
    return report.is_object() && report.contains("issues") ? std::optional(report) : std::nullopt;
  };
  if (output_of("command -v gltf_validator"))
    if (const auto report = parsed(output_of(fmt::format("gltf_validator -o '{}'; true", file.string())))) return report;
  return parsed(output_of(fmt::format("node -e \"require('gltf-validator').validateBytes(new Uint8Array(require('fs').readFileSync('{}'))).then(r => console.log(JSON.stringify(r)))\"", file.string())));
}

}  // namespace arah

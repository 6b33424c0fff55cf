#include "host/capture/figure_texture.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>

namespace arah {

namespace {

// 0..1 across an edge `width` metres wide: keeps lines sharp yet free of staircases.
float step_at(float edge, float x, float width = 0.0015f) {
  return std::clamp((x - edge) / width + 0.5f, 0.0f, 1.0f);
}
float inside(float radius, float distance) {
  return 1.0f - step_at(radius, distance);
}

// Repeatable noise in 0..1 on a lattice of unit cells, smooth between them.
float lattice(int x, int y, int z) {
  std::uint32_t h = static_cast<std::uint32_t>(x) * 0x8da6b343u ^ static_cast<std::uint32_t>(y) * 0xd8163841u ^
                    static_cast<std::uint32_t>(z) * 0xcb1ab31fu;
  h = (h ^ (h >> 15)) * 0x2c1b3c6du;
  h = (h ^ (h >> 12)) * 0x297a2d39u;
  return static_cast<float>((h ^ (h >> 15)) >> 8) * 0x1p-24f;
}

float noise(const glm::vec3& p) {
  const glm::vec3 cell = glm::floor(p);
  const glm::vec3 f = p - cell, s = f * f * (3.0f - 2.0f * f);
  const glm::ivec3 c(cell);
  float plane[2];
  for (int k = 0; k < 2; ++k) {
    const float low = glm::mix(lattice(c.x, c.y, c.z + k), lattice(c.x + 1, c.y, c.z + k), s.x);
    const float high = glm::mix(lattice(c.x, c.y + 1, c.z + k), lattice(c.x + 1, c.y + 1, c.z + k), s.x);
    plane[k] = glm::mix(low, high, s.y);
  }
  return glm::mix(plane[0], plane[1], s.z);
}

// 1 on the lines of a pattern with this period and line width (metres), 0 between.
float line(float x, float period, float width) {
  const float from_line = std::abs(x - period * std::round(x / period));
  return inside(0.5f * width, from_line);
}

// A star with five points about the origin.
float star(float x, float y, float radius) {
  const float sector = 2.0f * std::numbers::pi_v<float> / 5.0f;
  float angle = std::atan2(x, y);
  angle -= sector * std::round(angle / sector);
  const float r = std::hypot(x, y), px = r * std::cos(angle), py = r * std::abs(std::sin(angle));
  // The edge from the tip (radius, 0) to the notch at 0.42 radius, half a sector away.
  const float nx = 0.42f * radius * std::cos(0.5f * sector), ny = 0.42f * radius * std::sin(0.5f * sector);
  const float ex = nx - radius, ey = ny;
  return step_at(0.0f, (ex * py - ey * (px - radius)) / std::hypot(ex, ey));
}

// The digit 7 in a box 1 wide and 1.6 high about the origin, in units of `size` metres.
float seven(float x, float y, float size) {
  const float u = x / size, v = y / size;
  const float bar = std::abs(u) < 0.5f && v > 0.55f && v < 0.8f ? 1.0f : 0.0f;
  const float slope = std::abs(u - 0.32f * (v + 0.1f) / 0.9f) < 0.15f && v > -0.8f && v <= 0.8f ? 1.0f : 0.0f;
  return std::max(bar, slope);
}

glm::vec3 skin_color(const Palette& palette, const glm::vec3& p) {
  glm::vec3 color = palette.skin * (0.90f + 0.12f * noise(p * 35.0f) + 0.06f * noise(p * 140.0f));
  const float x = std::abs(p.x);
  if (p.y > 1.5f && p.z > 0.03f) {
    const glm::vec3 blush = color * glm::vec3(1.0f, 0.82f, 0.8f);
    color = glm::mix(color, blush, 0.8f * (1.0f - std::clamp(std::hypot(x - 0.045f, p.y - 1.60f) / 0.03f, 0.0f, 1.0f)));
    const float eye = inside(1.0f, std::hypot((x - 0.031f) / 0.0145f, (p.y - 1.643f) / 0.0075f) * 0.02f + 0.98f);
    color = glm::mix(color, glm::vec3(0.93f), eye);
    const float from_pupil = std::hypot(x - 0.031f, p.y - 1.643f);
    color = glm::mix(color, palette.iris, eye * inside(0.0068f, from_pupil));
    color = glm::mix(color, glm::vec3(0.03f), eye * inside(0.0032f, from_pupil));
    const float brow = std::abs(p.y - (1.666f - 0.12f * std::abs(x - 0.034f)));
    if (std::abs(x - 0.034f) < 0.020f) color = glm::mix(color, 0.7f * palette.hair, inside(0.0042f, brow));
    const float lips = std::hypot(x / 0.026f, (p.y - (1.571f + 0.1f * x)) / 0.0085f);
    color = glm::mix(color, palette.lips, inside(1.0f, lips * 0.02f + 0.98f));
    if (x < 0.022f) color = glm::mix(color, 0.45f * palette.lips, inside(0.0012f, std::abs(p.y - (1.571f + 0.1f * x))));
  }
  if (p.y < 0.55f && p.y > 0.44f && p.z > 0.0f)
    color = glm::mix(color, color * glm::vec3(0.98f, 0.86f, 0.84f), 1.0f - std::abs(p.y - 0.495f) / 0.055f);
  return color;
}

glm::vec3 shirt_color(const Palette& palette, const glm::vec3& p) {
  const float x = std::abs(p.x);
  const bool sleeve = x > 0.215f && p.y > 1.2f;
  // Stripes around the trunk and around the sleeves, a plain yoke above.
  glm::vec3 color = palette.shirt;
  if (sleeve) {
    color = glm::mix(color, palette.stripe, line(x - 0.235f, 0.06f, 0.022f));
  } else if (p.y < 1.36f) {
    color = glm::mix(color, palette.stripe, line(p.y - 0.87f, 0.075f, 0.026f));
  }
  color = glm::mix(color, palette.trim, std::max(step_at(0.327f, x), 1.0f - step_at(0.862f, p.y)));
  const float from_neck = std::hypot(p.x, p.z + 0.025f);
  const float above_neckline = p.y - (1.415f - 0.35f * (p.z + 0.02f));
  if (!sleeve)
    color = glm::mix(color, palette.trim, std::min(inside(0.104f, from_neck), step_at(-0.016f, above_neckline)));
  if (p.z > 0.03f) {
    const float distance = std::hypot(p.x, p.y - 1.245f);
    color = glm::mix(color, palette.trim, inside(0.078f, distance));
    color = glm::mix(color, palette.shirt, inside(0.068f, distance));
    color = glm::mix(color, palette.stripe, star(p.x, p.y - 1.245f, 0.062f));
  }
  if (p.z < -0.03f) {
    const bool panel = x < 0.105f && std::abs(p.y - 1.225f) < 0.095f;
    if (panel) color = palette.shirt;
    // Seen from behind the figure's left is on the left.
    const float number =
        std::max(seven(-p.x + 0.045f, p.y - 1.225f, 0.085f), seven(-p.x - 0.05f, p.y - 1.225f, 0.085f));
    color = glm::mix(color, palette.stripe, number);
  }
  return color * (0.92f + 0.10f * noise(p * 60.0f) + 0.05f * noise(p * 220.0f));
}

glm::vec3 shorts_color(const Palette& palette, const glm::vec3& p) {
  // Round the leg: the angle about the leg's axis times its radius.
  const float around = 0.085f * std::atan2(std::abs(p.x) - 0.098f, p.z);
  glm::vec3 color = palette.shorts;
  color = glm::mix(color, 0.72f * palette.shorts, 0.8f * line(p.y, 0.055f, 0.024f));
  color = glm::mix(color, 0.72f * palette.shorts, 0.8f * line(around, 0.0535f, 0.022f));
  color = glm::mix(color, palette.shorts_line,
                   0.9f * std::max(line(p.y + 0.0275f, 0.055f, 0.006f), line(around + 0.02675f, 0.0535f, 0.006f)));
  if (std::abs(p.x) > 0.125f && std::abs(p.z) < 0.022f) color = palette.shorts_line;
  color = glm::mix(color, palette.shorts_line, inside(0.532f, p.y));
  return color * (0.88f + 0.16f * noise(p * 70.0f));
}

glm::vec3 hair_color(const Palette& palette, const glm::vec3& p) {
  const float around = std::atan2(p.x, p.z + 0.01f) * 14.0f;
  const float strand = noise({around, p.y * 12.0f, std::hypot(p.x, p.z) * 60.0f});
  return palette.hair * (0.65f + 0.7f * strand + 0.25f * noise({around * 3.0f, p.y * 30.0f, 0.0f}));
}

glm::vec3 shoe_color(const Palette& palette, const glm::vec3& p) {
  glm::vec3 color = palette.shoes * (0.9f + 0.15f * noise(p * 90.0f));
  const bool instep = std::abs(std::abs(p.x) - 0.124f) < 0.016f && p.z > 0.0f && p.z < 0.10f && p.y > 0.05f;
  if (instep) color = glm::mix(color, palette.sole, line(p.z, 0.018f, 0.007f));
  color = glm::mix(color, palette.sole, line(p.y + 0.6f * p.z - 0.05f, 0.16f, 0.014f));
  color = glm::mix(color, palette.sole, inside(0.022f, p.y));
  return glm::mix(color, palette.stripe, inside(0.006f, p.y));
}

glm::vec3 rig_color(const glm::vec3& p, const glm::vec3& tint, bool garment, const Palette& palette) {
  const float grain = 0.88f + 0.16f * noise(p * 40.0f);
  if (!garment) return tint * grain;
  const glm::vec3 ground = glm::mix(palette.shirt, palette.stripe, line(p.y, 0.075f, 0.03f));
  return glm::mix(ground, palette.trim, line(p.x - 0.04f, 0.08f, 0.006f)) * grain;
}

glm::vec3 from_hue(float hue, float saturation, float value) {
  const auto channel = [&](float shift) {
    const float k = std::fmod(shift + 6.0f * hue, 6.0f);
    return value * (1.0f - saturation * std::clamp(std::min(k, 4.0f - k), 0.0f, 1.0f));
  };
  return {channel(5.0f), channel(3.0f), channel(1.0f)};
}

}  // namespace

Palette make_palette(std::uint64_t seed) {
  Palette palette{.skin = {0.87f, 0.67f, 0.56f},
                  .lips = {0.76f, 0.42f, 0.40f},
                  .hair = {0.30f, 0.19f, 0.11f},
                  .iris = {0.25f, 0.42f, 0.55f},
                  .shirt = {0.93f, 0.91f, 0.86f},
                  .stripe = {0.16f, 0.33f, 0.60f},
                  .trim = {0.80f, 0.24f, 0.20f},
                  .shorts = {0.36f, 0.47f, 0.38f},
                  .shorts_line = {0.87f, 0.80f, 0.55f},
                  .shoes = {0.55f, 0.22f, 0.20f},
                  .sole = {0.94f, 0.94f, 0.92f}};
  if (seed == 0) return palette;
  std::mt19937_64 random(seed ^ 0x9e3779b97f4a7c15u);
  const auto uniform = [&](float low, float high) {
    return low + (high - low) * static_cast<float>(random() >> 40) * 0x1p-24f;
  };
  const float tone = uniform(0.45f, 1.08f);
  palette.skin *= glm::vec3(tone, tone * (0.25f + 0.75f * tone), tone * (0.3f + 0.7f * tone)) / std::max(1.0f, tone);
  palette.lips *= glm::vec3(0.4f + 0.6f * tone) / std::max(1.0f, tone);
  palette.hair = from_hue(uniform(0.05f, 0.12f), uniform(0.3f, 0.75f), uniform(0.12f, 0.62f));
  const float hue = uniform(0.0f, 1.0f);
  palette.shirt = from_hue(hue, uniform(0.05f, 0.35f), uniform(0.8f, 0.95f));
  palette.stripe = from_hue(std::fmod(hue + uniform(0.3f, 0.7f), 1.0f), uniform(0.55f, 0.85f), uniform(0.4f, 0.7f));
  palette.trim = from_hue(std::fmod(hue + uniform(0.1f, 0.9f), 1.0f), 0.75f, uniform(0.6f, 0.85f));
  palette.shorts = from_hue(uniform(0.0f, 1.0f), uniform(0.2f, 0.6f), uniform(0.35f, 0.6f));
  palette.shorts_line = from_hue(uniform(0.0f, 1.0f), 0.35f, 0.88f);
  palette.shoes = from_hue(uniform(0.0f, 1.0f), uniform(0.3f, 0.7f), uniform(0.3f, 0.6f));
  return palette;
}

glm::vec3 surface_color(const Palette& palette, FigureLayer layer, const glm::vec3& rest, const glm::vec3& tint) {
  switch (layer) {
    case FigureLayer::kShirt:
      return shirt_color(palette, rest);
    case FigureLayer::kShorts:
      return shorts_color(palette, rest);
    case FigureLayer::kShoes:
      return shoe_color(palette, rest);
    case FigureLayer::kHair:
      return hair_color(palette, rest);
    case FigureLayer::kRigBody:
      return rig_color(rest, tint, false, palette);
    case FigureLayer::kRigGarment:
      return rig_color(rest, tint, true, palette);
    case FigureLayer::kSkin:
      break;
  }
  return skin_color(palette, rest);
}

glm::vec3 lit(const glm::vec3& color, const glm::vec3& normal) {
  static const glm::vec3 key = glm::normalize(glm::vec3(0.35f, -0.75f, 0.85f));
  const float wrapped = std::max(0.0f, (glm::dot(normal, key) + 0.35f) / 1.35f);
  const float sky = 0.5f + 0.5f * normal.z;
  return color * (glm::vec3(0.46f, 0.47f, 0.50f) + 0.16f * sky + glm::vec3(0.46f, 0.45f, 0.42f) * wrapped);
}

}  // namespace arah

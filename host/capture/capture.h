// A capture: a folder with calibrated cameras, a skinned template, motions and pictures whose alpha is the mask:
//   cameras.json  template.glb  motion_<split>.json  images/<split>/<camera>/<frame:06d>.png
//   borders/<split>/<camera>/<frame:06d>.png, where masks are not to be trusted near their edges (load_border)
#pragma once

#include <cstdint>
#include <filesystem>
#include <glm/vec3.hpp>
#include <map>
#include <span>
#include <string>
#include <vector>

#include "host/body/body_template.h"
#include "host/body/motion.h"
#include "host/capture/camera.h"

namespace arah {

struct Capture {
  std::filesystem::path path;
  BodyTemplate body_template;
  std::vector<Camera> cameras;
  std::map<std::string, Motion> motions;  // by split ("train", "novel", "ood", …), poses in the template's joint order
};

// Row-major pixels, top left first; colour is premultiplied by alpha. Values 0..1 as stored (sRGB, not linearised).
struct Image {
  int width = 0;
  int height = 0;
  std::vector<float> rgba;  // [height][width][4]
};

// One byte a pixel, 1 inside and 0 outside, row-major.
struct PixelMask {
  int width = 0;
  int height = 0;
  std::vector<std::uint8_t> inside;  // [height][width]
};

// Opens a capture: reads everything but the pictures. Throws InputError: no such folder, a file missing or bad (see
// read_body_template, read_cameras, read_motion), no motion at all, a motion whose joints do not fit the template.
Capture open_capture(const std::filesystem::path& path);

// The motion of a split, or the named camera's index in capture.cameras. Throw InputError naming what there is instead.
const Motion& motion_of(const Capture& capture, const std::string& split);
std::size_t camera_index(const Capture& capture, const std::string& name);

// Where the picture of this frame is, or would be.
std::filesystem::path image_path(const Capture& capture, const std::string& split, std::size_t camera, int frame);

// The numbers of the frames of the split, in the motion's order, that have a picture from this camera.
std::vector<int> frames_with_images(const Capture& capture, const std::string& split, std::size_t camera);

// The picture `width` columns wide (0: as stored), undistorted, premultiplied, then averaged over areas. It matches
// capture.cameras[camera].scaled(width). Throws InputError naming the file: missing, truncated, no alpha channel, not
// the camera's size, or narrower than `width`.
Image load_image(const Capture& capture, const std::string& split, std::size_t camera, int frame, int width = 0);

// The pixels that training leaves out, of the same size as load_image(): those that the picture of the same name in borders/
// marks (one channel of 8 bits, 0: to be trusted), each reduced pixel that touches one of them among them. Empty where the
// capture has no such picture. Throws InputError naming the file: damaged, of another size or kind.
PixelMask load_border(const Capture& capture, const std::string& split, std::size_t camera, int frame, int width = 0);

// The mean of `image` over areas, `width` columns wide and as high as Camera::scaled() says; whole pixels where the
// factor is an integer. Throws std::invalid_argument unless 1 <= width <= image.width.
Image reduced(const Image& image, int width);

// The region in which a body is looked for and measured (ARAH.md §4): the filled union of the six projected faces,
// corners rounded to pixels, of the vertices' axis-aligned world box grown by `margin` metres on all sides. Parts of
// the box behind the camera are cut away; an empty mask means that nothing is in view.
PixelMask projected_box_mask(const Camera& camera, std::span<const glm::vec3> vertices, double margin = 0.05);

}  // namespace arah

// A small subject to train on: a synthetic capture of a few little pictures, and an avatar with every part in odd sizes.
#pragma once

#include <unistd.h>

#include <filesystem>
#include <string>

#include "host/avatar/avatar.h"
#include "host/capture/capture.h"
#include "host/capture/synthetic_capture.h"
#include "host/training/template_fit.h"
#include "host/training/training_settings.h"
#include "tests/kernels/device_fixture.h"

namespace arah {

// Written once for the whole program, and removed at its end.
inline const Capture& small_capture() {
  struct Folder {
    std::filesystem::path path = std::filesystem::temp_directory_path() / ("arah_training_" + std::to_string(getpid()));
    ~Folder() { std::filesystem::remove_all(path); }
  };
  static const Folder folder;
  static const Capture capture = [] {
    write_synthetic_capture(folder.path, {{}, 4, 64, 5});
    return open_capture(folder.path);
  }();
  return capture;
}

// Stated here rather than taken from a preset: the numbers that the tests hold on to must not move with one.
inline AvatarSpec small_spec() {
  AvatarSpec spec;
  spec.preset = "test";
  spec.skinning = {Skinning::network, 24, 2};
  spec.sdf = {24, 2, 30.0, SdfConditioning::latent, 16, 1};
  spec.color = {.width = 24, .hidden_layers = 2, .skip = 2, .narrow = 13, .view = true, .feature = true, .latent = true};
  spec.latent_size = 5;
  spec.grid_cells = {0.1};
  return spec;
}

inline TrainingSettings small_settings() {
  TrainingSettings settings;
  settings.seed = 3;
  settings.rays = 61;
  settings.mask_fraction = 0.6;
  settings.sampling.samples = 7;
  settings.sampling.shell = {.cell = 0.03, .margin = 0.1, .outer = 0.055, .inner = 0.03};
  settings.sampling.root.max_iterations = 12;
  settings.least_weight = 0;
  settings.color_weight = 30;
  settings.alpha_weight = 1;
  settings.eikonal_weight = 10;
  settings.off_surface_weight = 100;
  settings.inside_weight = 10;
  settings.skinning_weight = 10;
  settings.eikonal_points = 65;
  settings.off_surface_points = 63;
  settings.inside_points = 33;
  settings.skinning_points = 65;
  settings.skinning_every = 3;
  settings.sdf = {.rate = 2e-4, .freeze = 2, .warm_up = 3, .max_norm = 10};
  settings.mapping = {.rate = 1e-4};
  settings.skinning = {.rate = 1e-4, .max_norm = 10};
  settings.color = {.rate = 1e-3, .warm_up = 4, .weight_decay = 1e-4};
  settings.latent = {.rate = 1e-3};
  settings.deviation = {.rate = 1e-4};
  settings.grid = {.rate = 1e-2};
  settings.end_fraction = 0.05;
  settings.average_decay = 0.9;
  settings.fit_steps = settings.fit_skinning_steps = 20;
  settings.fit_rate = 1e-3;
  settings.fit_skinning_rate = 5e-3;
  settings.clothing = 0.01;
  return settings;
}

// An avatar close enough to the template for poses and shape to matter.
inline Avatar well_fitted_avatar(Device& device, const AvatarSpec& spec) {
  Avatar made = make_avatar(spec, small_capture(), 3);
  TrainingSettings settings = small_settings();
  settings.fit_steps = settings.fit_skinning_steps = 120;
  settings.fit_skinning_rate = 1e-2;
  fit_template(device, made, settings);
  return made;
}

}  // namespace arah

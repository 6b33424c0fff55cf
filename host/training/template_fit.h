// The start of training: the canonical SDF and the skinning network fitted to the subject's own template
// (ARAH.md §10, "A licence-free alternative").
#pragma once

#include <functional>

#include "host/body/pose.h"
#include "host/training/template_samples.h"
#include "host/training/training_settings.h"

namespace arah {

struct TemplateFit {
  double sdf_error = 0;       // mean |f − target| over points within 1 cm of the surface, metres
  double skinning_error = 0;  // mean Σ_b |w_b − w_b of the template| over surface points
};

// Trains the avatar's sdf and skinning parameters for settings.fit_steps and fit_skinning_steps.
// The SDF's target is the template's distance less settings.clothing: people wear clothes.
// progress: the part done, 0..1; return false to stop (throws std::runtime_error "stopped").
// poses: those that a backward skinning network (Skinning::backward) begins with, each with a little noise; none: poses about
// the resting one. Where the SDF's pose networks are not zero, as a prior's are, the SDF of these poses is fitted, one pose a
// step, through the parameters that all poses share; else that shared SDF.
// Throws std::runtime_error where a fit ends with numbers that are not finite, naming its rate.
TemplateFit fit_template(Device& device, Avatar& avatar, const TrainingSettings& settings, const std::function<bool(double)>& progress = {}, const std::vector<Pose>& poses = {});

}  // namespace arah

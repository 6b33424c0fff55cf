// Every variant of the paper's ablations is a training that can be had.
#include "host/evaluation/ablation.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "host/input_error.h"

namespace arah {
namespace {

using testing::Contains;
using testing::HasSubstr;
using testing::Not;
using testing::Pair;

RunConfig full_of(const std::string& preset, const CaptureFacts& facts) {
  const SpecChoice choice = choose_spec(preset, facts);
  RunConfig config{preset_settings(preset), choice.spec, "capture", "0"};
  config.settings.pose_refinement = choice.pose_refinement;
  return config;
}

std::vector<std::string> names_of(const Ablation& study) {
  std::vector<std::string> names;
  for (const AblationVariant& variant : study.variants) names.push_back(variant.name);
  return names;
}

TEST(Ablation, EveryVariantIsValidForEveryPreset) {
  for (const CaptureFacts& facts : {CaptureFacts{12, 9, 24, false, true}, CaptureFacts{4, 9, 24, false, false}, CaptureFacts{4, 9, 24, true, true}, CaptureFacts{4, 9, 1, false, true}, CaptureFacts{1, 1, 24, true, false}}) {
    for (const std::string& preset : preset_names()) {
      const Ablation study = ablation(full_of(preset, facts), facts, "some.safetensors");
      EXPECT_EQ(study.variants.size() + study.left_out.size(), ablation_names().size());
      for (const AblationVariant& variant : study.variants) {
        SCOPED_TRACE(preset + " " + variant.name);
        validate_spec(variant.config.spec, variant.name);
        check_settings(variant.config.settings, variant.config.spec, variant.name);
        EXPECT_EQ(settings_to_json(settings_from_json(settings_to_json(variant.config.settings), variant.name)), settings_to_json(variant.config.settings));
        EXPECT_EQ(spec_from_json(spec_to_json(variant.config.spec), variant.name), variant.config.spec);
        if (variant.config.settings.pose_refinement) {
          EXPECT_NE(variant.config.spec.skinning.kind, Skinning::none);
        }
      }
    }
  }
}

TEST(Ablation, AVariantIsItsAssignments) {
  const CaptureFacts facts{12, 9, 24, false, true};
  const Ablation tiny = ablation(full_of("tiny", facts), facts, "some.safetensors");
  for (const AblationVariant& v : tiny.variants) {
    if (v.name == "hypernetwork") {
      EXPECT_EQ(v.config.spec.sdf.pose_width, 64u);
    }
    if (v.name == "low_rank") {
      EXPECT_EQ(v.config.spec.sdf.pose, PoseConditioning::low_rank);
    }
    if (v.name == "no_latent") {
      EXPECT_EQ(v.config.spec.latent_size, 0u);
    }
    if (v.name == "several_starts") {
      EXPECT_EQ(v.config.settings.sampling.root.initialisations, 3u);
    }
    if (v.name == "refined_poses") {
      EXPECT_EQ(v.config.settings.sampling.root.correspondence, Correspondence::search_from_grid);
    }
    if (v.name == "prior") {
      EXPECT_EQ(v.config.settings.prior, "some.safetensors");
    }
  }
  EXPECT_THAT(tiny.left_out, Contains(Pair("no_conditioning", "the same training as full")));
  const Ablation paper = ablation(full_of("paper", facts), facts);
  EXPECT_THAT(names_of(paper), Contains("no_conditioning"));
  EXPECT_THAT(paper.left_out, Contains(Pair("prior", "no --prior was given")));
  for (const AblationVariant& v : paper.variants) {
    if (v.name == "hypernetwork") {
      EXPECT_EQ(v.config.spec.sdf.pose_width, 256u);
    }
    if (v.name == "density") {
      EXPECT_EQ(v.config.settings.sampling.mode, SamplingMode::shell);
    }
  }
}

TEST(Ablation, OnlySomeAreTaken) {
  const CaptureFacts facts{12, 9, 24, false, true};
  EXPECT_THAT(names_of(ablation(full_of("tiny", facts), facts, "", {"density", "full"})), testing::ElementsAre("full", "density"));
  EXPECT_THROW(ablation(full_of("tiny", facts), facts, "", {"fulll"}), InputError);
}

TEST(Ablation, TablesHoldEveryRowAndMarkTheBest) {
  AblationTable table;
  AblationRow row;
  row.name = "full";
  row.shows = "all";
  row.steps = 10;
  row.splits = {{"views", 30.0, 0.9}};
  row.surface = 0.004;
  table.rows.push_back(row);
  row.name = "density";
  row.splits = {{"views", 31.0, 0.8}};
  row.surface.reset();
  table.rows.push_back(row);
  table.left_out = {{"prior", "no --prior was given"}};
  EXPECT_THAT(ablation_csv(table), HasSubstr("variant,psnr_views,ssim_views,surface_mm,found_percent,least_found_percent,steps,seconds_per_step,learned_numbers,device_mb\nfull,30.00,0.9000,4.00,,,10,,0,0.0\ndensity,31.00,0.8000,,,,10,,0,0.0\n"));
  EXPECT_THAT(ablation_markdown(table), testing::AllOf(HasSubstr("| 30.00 | **0.9000** | **4.00** |"), HasSubstr("| **31.00** | 0.8000 | – |"), HasSubstr("`prior` is left out")));
  EXPECT_THAT(ablation_text(table), Not(HasSubstr("*")));
}

}  // namespace
}  // namespace arah

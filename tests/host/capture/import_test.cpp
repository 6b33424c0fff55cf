// Sequences of public datasets become captures: cameras, poses, pictures and splits are those of the dataset, in our
// conventions; what is missing is said, what is wrong is refused, and nothing half-written stays.
#include "host/capture/import_capture.h"

#include <fmt/ranges.h>

#include <glm/matrix.hpp>
#include <nlohmann/json.hpp>

#include "host/body/smpl_file.h"
#include "tests/host/body/memory_of_refusal.h"
#include "tests/host/body/small_smpl.h"
#include "tests/host/capture/made_up_sequence.h"

namespace arah {
namespace {

namespace fs = std::filesystem;

ImportSettings settings_for(const MadeUpSequence& made) {
  ImportSettings settings;
  settings.layout = "zju-mocap";
  settings.in = made.folder;
  settings.out = made.root / "capture";
  settings.body = made.root / "body.glb";
  return settings;
}

// The table of ARAH.md §8, restated: train and test frames, ends excluded, in the counts in which they are published.
struct Published {
  const char* name;
  int train_first, train_end, test_first, test_end;
};
constexpr Published kPublishedZju[] = {{"313", 0, 60, 60, 1061},  {"315", 0, 400, 400, 1401}, {"377", 0, 300, 300, 618}, {"386", 0, 300, 300, 647},
                                       {"387", 0, 300, 300, 655}, {"390", 700, 1000, 0, 700}, {"392", 0, 300, 300, 557}, {"393", 0, 300, 300, 659},
                                       {"394", 0, 300, 300, 860}};
constexpr Published kPublishedH36m[] = {{"S1", 0, 150, 150, 199},  {"S5", 0, 250, 250, 327}, {"S6", 0, 150, 150, 233}, {"S7", 0, 300, 300, 500},
                                        {"S8", 0, 250, 250, 337}, {"S9", 0, 260, 260, 393}, {"S11", 0, 200, 200, 282}};

TEST(DatasetPresets, AreThePublishedSplits) {
  EXPECT_EQ(dataset_presets().size(), 16u);
  const std::string table = preset_table();
  const auto expect_ranges = [&](const DatasetPreset& preset, const Published& published, int step, int every) {
    EXPECT_THAT(table, testing::HasSubstr(preset.name + " "));
    ASSERT_EQ(preset.plan.ranges.size(), 2u);
    const FrameRange &train = preset.plan.ranges[0], &novel = preset.plan.ranges[1];
    EXPECT_EQ(train.split, "train");
    EXPECT_EQ(novel.split, "novel");
    for (int frame = 0; frame < 1500; ++frame) {
      EXPECT_EQ(train.has(frame * step), frame >= published.train_first && frame < published.train_end) << preset.name << " " << frame;
      EXPECT_EQ(novel.has(frame * step), frame >= published.test_first && frame < published.test_end && (frame - published.test_first) % every == 0);
    }
    EXPECT_EQ(train.has(published.train_first * step + 1), step == 1);
    EXPECT_EQ(preset.plan.held_out_step, every);
    EXPECT_TRUE(preset.plan.only_held_out);
  };
  for (const Published& published : kPublishedZju) {
    const DatasetPreset& preset = dataset_preset(std::string("zju-") + published.name);
    EXPECT_EQ(preset.sequence, std::string("CoreView_") + published.name);
    expect_ranges(preset, published, 1, 30);
    EXPECT_THAT(preset.plan.train_cameras, testing::ElementsAre("1", "7", "13", "19"));
    const bool fewer = preset.name == "zju-313" || preset.name == "zju-315";
    std::vector<std::string> others{"2", "3", "4", "5", "6", "8", "9", "10", "11", "12", "14", "15", "16", "17", "18", "20", "21", "22", "23"};
    if (fewer) others.erase(others.end() - 4, others.end() - 2);
    EXPECT_EQ(preset.plan.test_cameras, others);
    EXPECT_EQ(preset.plan.training_band, 0);
    EXPECT_EQ(preset.plan.evaluation_band, 2);
  }
  for (const Published& published : kPublishedH36m) {
    const DatasetPreset& preset = dataset_preset(std::string("h36m-") + published.name);
    expect_ranges(preset, published, 5, 6);
    EXPECT_THAT(preset.plan.train_cameras, testing::ElementsAre("54138969", "55011271", "58860488"));
    EXPECT_THAT(preset.plan.test_cameras, testing::ElementsAre("60457274"));
    EXPECT_EQ(preset.plan.training_band, 2);
    EXPECT_EQ(preset.plan.evaluation_band, 0);
  }
  EXPECT_THAT(table, testing::ContainsRegex("zju-390 +CoreView_390 +700:1000 +0:700:30 +1,7,13,19 +2,3,4,5,6,8,"));
  EXPECT_THAT(table, testing::ContainsRegex("h36m-S9 +S9 +0:260 +260:393:6 +54138969,55011271,58860488 +60457274"));
  expect_input_error([] { dataset_preset("zju-314"); }, {"--split", "zju-313", "'zju-314'"});
}

TEST(DatasetPresets, FramesAndCamerasAreNamedInFewWords) {
  const FrameRange range = parse_frame_range("novel=60:79:3");
  EXPECT_EQ(range.split, "novel");
  EXPECT_TRUE(range.has(63));
  EXPECT_FALSE(range.has(64));
  EXPECT_FALSE(range.has(81));
  EXPECT_EQ(parse_frame_range("train=0:5").step, 1);
  for (const char* bad : {"train", "train=", "train=3", "=0:3", "train=3:3", "train=0:3:0", "train=0:3:1:1", "train=a:3", "train=-1:3", "../x=0:3", "train=0:3:"}) {
    expect_input_error([&] { parse_frame_range(bad); }, {"--frames", bad});
  }
  EXPECT_TRUE(camera_is("Camera_B1", "1"));
  EXPECT_TRUE(camera_is("Camera_B1", "Camera_B1"));
  EXPECT_FALSE(camera_is("Camera_B11", "1"));
  EXPECT_FALSE(camera_is("54138969", "9"));
}

TEST(Import, BringsCamerasPosesAndPictures) {
  const MadeUpSequence made;
  ImportSettings settings = settings_for(made);
  settings.ranges = {{"train", 0, 3, 1}, {"novel", 3, 4, 1}};
  settings.train_cameras = {"1"};
  std::size_t told = 0;
  const ImportReport report = import_capture(settings, [&](std::size_t done, std::size_t total) {
    told += 1;
    EXPECT_EQ(done, told);
    EXPECT_EQ(total, 6u);
    return true;
  });
  EXPECT_EQ(report.pictures, 6u);  // 3 of camera 1 and the first of camera 2; both of the novel frame
  EXPECT_THAT(report.notes, testing::IsEmpty());
  EXPECT_FALSE(fs::exists(made.root / "capture.partial"));

  const Capture capture = open_capture(settings.out);
  ASSERT_EQ(capture.cameras.size(), 2u);
  EXPECT_EQ(capture.cameras[0].role, "train");
  EXPECT_EQ(capture.cameras[1].role, "test");
  for (std::size_t c = 0; c < 2; ++c) {
    const Camera &is = capture.cameras[c], &was = made.cameras[c];
    EXPECT_EQ(is.name, was.name);
    EXPECT_EQ(is.K, was.K);
    EXPECT_EQ(is.R, was.R);
    EXPECT_LT(glm::length(is.T - was.T), 1e-14);
    EXPECT_FALSE(is.distorted());
  }
  EXPECT_THAT(frames_with_images(capture, "train", 0), testing::ElementsAre(0, 1, 2));
  EXPECT_THAT(frames_with_images(capture, "train", 1), testing::ElementsAre(0));
  EXPECT_EQ(motion_of(capture, "train").poses, "estimated");

  // EasyMocap turns about the origin, and then moves.
  for (int f = 0; f < 4; ++f) {
    const MotionFrame* frame = find_frame(motion_of(capture, f < 3 ? "train" : "novel"), f);
    ASSERT_TRUE(frame);
    const BodyFit& fit = made.fits[static_cast<std::size_t>(f)];
    Pose unturned{fit.poses, made.body.skeleton.rest_joints[0]};
    const std::vector<glm::vec3> local = posed_vertices(made.body, unturned), world = posed_vertices(capture.body_template, frame->pose);
    const glm::dmat3 turn = rotation_from_axis_angle(fit.Rh);
    double largest = 0;
    for (std::size_t v = 0; v < local.size(); ++v) largest = std::max(largest, glm::length(turn * glm::dvec3(local[v]) + fit.Th - glm::dvec3(world[v])));
    EXPECT_LT(largest, 2e-6);
  }

  // The red mark is where the undistorted camera sees it; outside the mask all is black.
  for (std::size_t c = 0; c < 2; ++c) {
    const Image image = load_image(capture, "train", c, 0);
    const auto pixel = [&](double u, double v) { return &image.rgba[4 * (static_cast<std::size_t>(std::lround(v)) * 96 + static_cast<std::size_t>(std::lround(u)))]; };
    const glm::dvec2 at = capture.cameras[c].project(MadeUpSequence::mark);
    EXPECT_GT(pixel(at.x, at.y)[0], 0.9f) << c;
    EXPECT_LT(pixel(at.x, at.y)[1], 0.1f) << c;
    EXPECT_EQ(pixel(at.x, at.y)[3], 1.0f);
    EXPECT_NEAR(pixel(45, 35)[0], 110 / 255.0, 1e-6);  // another label is the person too
    EXPECT_EQ(pixel(5, 5)[3], 0.0f);
    EXPECT_EQ(pixel(5, 5)[0], 0.0f);
  }
  EXPECT_TRUE(load_border(capture, "train", 0, 0).inside.empty());

  // Again, over it: reduced, and with a band.
  settings.size = 48;
  settings.border = 2;
  settings.exact_poses = true;
  import_capture(settings);
  const Capture reduced_capture = open_capture(settings.out);
  EXPECT_EQ(motion_of(reduced_capture, "train").poses, "exact");
  const Camera expected = made.cameras[0].scaled(48);
  EXPECT_EQ(reduced_capture.cameras[0].K, expected.K);
  EXPECT_EQ(reduced_capture.cameras[0].height, 40);
  const PixelMask border = load_border(reduced_capture, "train", 0, 1);
  ASSERT_EQ(border.inside.size(), 48u * 40u);
  // The mask's left edge lies between columns 19 and 20: 18 to 21 are the band, 9 and 10 of the reduced ones.
  const auto marked = [&](std::size_t u) { return border.inside[20 * 48 + u]; };
  EXPECT_EQ(marked(8), 0);
  EXPECT_EQ(marked(9), 1);
  EXPECT_EQ(marked(10), 1);
  EXPECT_EQ(marked(11), 0);
  EXPECT_EQ(load_border(reduced_capture, "train", 0, 1, 24).inside[10 * 24 + 4], 1);
  EXPECT_TRUE(load_border(reduced_capture, "train", 1, 0).inside.empty());  // held-out cameras train nothing
  EXPECT_TRUE(load_border(reduced_capture, "novel", 0, 3).inside.empty());
}

TEST(Import, ReadsTheOldNamesAndTakesThePublishedSplit) {
  const MadeUpSequence made("CoreView_313", true);
  ImportSettings settings = settings_for(made);
  const ImportReport report = import_capture(settings);
  EXPECT_EQ(report.preset, "zju-313");
  EXPECT_THAT(report.notes, testing::Contains("Camera 3 of the split is not in the sequence."));
  EXPECT_THAT(report.notes, testing::Contains("Camera 7 of the split, for training, is not in the sequence."));
  const Capture capture = open_capture(settings.out);
  EXPECT_EQ(capture.cameras[0].name, "Camera_1");
  EXPECT_EQ(capture.cameras[1].name, "Camera_2");
  EXPECT_EQ(capture.cameras[1].role, "test");
  // Files count from 1, frames from 0; the body's file goes with the picture's.
  EXPECT_THAT(frames_with_images(capture, "train", 0), testing::ElementsAre(0, 1, 2, 3));
  EXPECT_EQ(motion_of(capture, "train").frames[2].pose.theta[0], made.fits[2].Rh);
  // Masks of held-out cameras are grown by two pixels, others not.
  const auto alpha = [&](std::size_t camera, std::size_t u, std::size_t v) { return load_image(capture, "train", camera, 0).rgba[4 * (v * 96 + u) + 3]; };
  EXPECT_EQ(alpha(0, 19, 40), 0.0f);
  EXPECT_EQ(alpha(0, 20, 40), 1.0f);
}

TEST(Import, GivesABodyModelTheSequencesShape) {
  const MadeUpSequence made;
  ImportSettings settings = settings_for(made);
  for (int f = 0; f < 4; ++f) {
    BodyFit fit = made.fits[static_cast<std::size_t>(f)];
    fit.shapes = {0.5, -0.2, 0, 0, 0, 0, 0, 0, 0, 0};
    made.write_fit(f, fit);
  }
  settings.body = made.root.write("SMPL_NEUTRAL.npz", SmallModel().npz(true));
  const ImportReport report = import_capture(settings);
  EXPECT_THAT(report.notes, testing::Contains(testing::HasSubstr("Pose blend shapes: the mesh at rest has their mean over 4 poses")));
  const Capture capture = open_capture(settings.out);
  const std::vector<double> betas{0.5, -0.2};
  std::vector<std::vector<glm::dvec3>> poses;
  for (const BodyFit& fit : made.fits) poses.push_back(fit.poses);
  EXPECT_EQ(capture.body_template.vertices, read_smpl_body(settings.body, betas, poses).body.vertices);
  EXPECT_EQ(capture.body_template.shape.beta, betas);
  EXPECT_TRUE(capture.body_template.shape.moves_joints()) << "so that training refines it";
  const glm::dvec3 root = capture.body_template.skeleton.rest_joints[0];
  EXPECT_LT(glm::length(root - glm::dvec3(0.05, 1.0, -0.06)), 1e-6);
  const glm::dvec3 expected = rotation_from_axis_angle(made.fits[1].Rh) * root + made.fits[1].Th;
  EXPECT_LT(glm::length(motion_of(capture, "train").frames[1].pose.root_position - expected), 1e-6);
}

TEST(Import, SaysWhatIsMissing) {
  const MadeUpSequence made;
  fs::remove(made.folder / "new_params" / "1.npy");
  fs::remove(made.folder / "mask_cihp" / "Camera_B1" / "000002.png");
  BodyFit shaped = made.fits[3];
  shaped.shapes[0] = 0.5;
  made.write_fit(3, shaped);
  const ImportReport report = import_capture(settings_for(made));
  EXPECT_EQ(report.pictures, 5u);
  EXPECT_THAT(report.notes, testing::ElementsAre(testing::HasSubstr("all frames are for training"), testing::HasSubstr("1 frames have no fitted body"),
                                                 testing::HasSubstr("1 pictures have no file"), testing::HasSubstr("differ by up to 0.5")));
}

TEST(Import, RefusesWhatIsWrongAndLeavesNothing) {
  const MadeUpSequence made;
  const ImportSettings good = settings_for(made);
  const auto refuse = [&](const ImportSettings& settings, const std::vector<std::string>& parts) {
    expect_input_error([&] { import_capture(settings); }, parts);
    EXPECT_FALSE(fs::exists(made.root / "capture"));
    EXPECT_FALSE(fs::exists(made.root / "capture.partial"));
  };
  ImportSettings bad = good;
  bad.body.clear();
  refuse(bad, {"--body"});
  bad = good;
  bad.layout = "coco";
  refuse(bad, {"zju-mocap, h36m, easymocap", "'coco'"});
  bad = good;
  bad.preset = "h36m-S9";
  refuse(bad, {"a preset of zju-mocap"});
  bad = good;
  bad.train_cameras = {"9"};
  refuse(bad, {"Camera_B1, Camera_B2"});
  bad = good;
  bad.size = 97;
  refuse(bad, {"at most 96 columns"});
  bad = good;
  bad.ranges = {{"train", 10, 20, 1}};
  refuse(bad, {"none of them with all three"});
  bad = good;
  bad.ranges = {{"train", 0, 2, 1}, {"train", 1, 3, 1}};
  refuse(bad, {"frame 1 twice"});
  bad = good;
  bad.in = made.root / "none";
  refuse(bad, {"the folder of a sequence"});
  bad.in = made.root.path();
  refuse(bad, {"annots.npy", "sequence's own folder"});

  const auto spoil = [&](const std::string& name, const std::string& content, const std::vector<std::string>& parts) {
    std::ifstream file(made.folder / name, std::ios::binary);
    const std::string before((std::istreambuf_iterator<char>(file)), {});
    made.write(name, content);
    refuse(good, parts);
    made.write(name, before);
  };
  const auto annotated = [&](const std::string& from, const std::string& to) {
    std::string changed = made.annotations;
    const std::size_t at = changed.find(from);
    EXPECT_NE(at, changed.npos);
    return python::npy_of_value(changed.replace(at, from.size(), to));
  };
  spoil("annots.npy", python::npy_of_value(python::call(python::name("os", "system"), {python::text("true")})), {"annots.npy", "'os.system'"});
  spoil("annots.npy", annotated(python::text("cams"), python::text("cans")), {"annots.npy: cams: expected this entry"});
  spoil("annots.npy", annotated(python::text("K"), python::text("L")), {"cams K"});
  spoil("annots.npy", annotated("Camera_B1/000000.png", "../../BB1/000000.png"), {"pictures in folders of the sequence"});
  spoil("annots.npy", annotated("Camera_B2/000001.png", "Camera_B2/000002.png"), {"one frame of the first frame's cameras"});
  spoil("annots.npy", annotated("Camera_B2/000001.png", "Camera_B2/first_.png"), {"called by their frame", "'first_'"});
  spoil("annots.npy", python::npy({3}, {1, 2, 3}), {"a dictionary", "an array of 3"});
  spoil("new_params/1.npy", python::npy_of_value(python::dictionary({{"poses", python::array({1, 4}, {1, 2, 3, 4})}})), {"1.npy: poses", "three numbers a joint"});
  spoil("new_params/1.npy", "cut", {"1.npy", "NumPy"});
  spoil("Camera_B1/000001.png", "no picture", {"000001.png", "a PNG or JPEG picture"});
  std::ifstream file(made.folder / "Camera_B2/000001.png", std::ios::binary);
  std::string huge((std::istreambuf_iterator<char>(file)), {});
  for (std::size_t i = 0; i < 4; ++i) huge[16 + i] = huge[20 + i] = static_cast<char>(100'000 >> (24 - 8 * i));
  spoil("Camera_B2/000001.png", huge, {"000001.png", "1 to 8192 pixels", "100000x100000"});
  cv::Mat small(40, 48, CV_8UC3, cv::Scalar(1, 2, 3));
  std::vector<std::uint8_t> encoded;
  cv::imencode(".png", small, encoded);
  spoil("Camera_B2/000001.png", {encoded.begin(), encoded.end()}, {"expected 96x80", "found 48x40"});
  cv::imencode(".jpg", small, encoded);
  spoil("Camera_B2/000001.png", {encoded.begin(), encoded.end() - 30}, {"a whole JPEG picture"});

  bool stopped = false;
  try {
    import_capture(good, [](std::size_t, std::size_t) { return false; });
  } catch (const std::runtime_error& error) {
    stopped = std::string(error.what()).find("nothing was written") != std::string::npos;
  }
  EXPECT_TRUE(stopped);
  EXPECT_FALSE(fs::exists(made.root / "capture.partial"));
  made.root.write("capture/thesis.tex", "years of work");
  expect_input_error([&] { import_capture(good); }, {"an earlier imported capture", "Nothing was written"});
  EXPECT_TRUE(fs::exists(made.root / "capture/thesis.tex"));
}

// A million frames that share one list of a thousand pictures: a file of 2 MB.
TEST(Import, SharedListsAreNoBomb) {
  const TemporaryFolder folder;
  for (const char* name : {"mask", "params"}) std::filesystem::create_directory(folder / name);
  {
    std::string images = "](", frames = "](";
    for (int i = 0; i < 1000; ++i) images += python::text(fmt::format("camera_{}/000000.jpg", i));
    for (int i = 0; i < 1'000'000; ++i) frames += "h\1";
    std::vector<std::string> squares, triples, fives;
    for (int i = 0; i < 1000; ++i) squares.push_back("h\2"), triples.push_back("h\3"), fives.push_back("h\4");
    const std::string shared = python::dictionary({{"ims", images + "e"}}) + "q\1" "0" + python::array({9}, {1, 0, 0, 0, 1, 0, 0, 0, 1}) + "q\2" "0" + python::array({3}, {0, 0, 0}) + "q\3" "0" + python::array({5}, {0, 0, 0, 0, 0}) + "q\4" "0";
    const std::string cams = python::dictionary({{"K", python::list(squares)}, {"R", python::list(squares)}, {"T", python::list(triples)}, {"D", python::list(fives)}});
    folder.write("annots.npy", python::npy("|O", {}, python::pickle(shared + python::dictionary({{"cams", cams}, {"ims", frames + "e"}}))));
  }
  EXPECT_LT(memory_of_refusal([&] { read_h36m(folder.path()); }), kMostMemoryOfRefusal);
  expect_input_error([&] { read_h36m(folder.path()); }, {"annots.npy: ims", "at most 300000 pictures"});
}

TEST(Import, ResizesHuman36mToItsIntrinsics) {
  const MadeUpSequence made("Posing");
  ImportSettings settings = settings_for(made);
  settings.layout = "h36m";
  settings.ranges = {{"train", 0, 2, 1}};
  settings.border = 2;
  const ImportReport report = import_capture(settings);
  const Capture capture = open_capture(settings.out);
  EXPECT_EQ(capture.cameras[0].width, 1000);
  EXPECT_EQ(capture.cameras[0].height, 1002);
  EXPECT_EQ(capture.cameras[0].K, made.cameras[0].K);
  // The band is five pixels of the mask on disk, which has 96 columns.
  const PixelMask border = load_border(capture, "train", 0, 0);
  const double scale = 1000.0 / 96;
  EXPECT_EQ(border.inside[500 * 1000 + static_cast<std::size_t>(18.5 * scale)], 1);
  EXPECT_EQ(border.inside[500 * 1000 + static_cast<std::size_t>(17.5 * scale)], 0);
}

std::string yaml_matrix(const std::string& key, std::size_t rows, std::size_t columns, const std::vector<double>& numbers) {
  return fmt::format("{}: !!opencv-matrix\r\n  rows: {}\r\n  cols: {}\r\n  dt: d\r\n  data: [{:.17g}]\r\n", key, rows, columns, fmt::join(numbers, ", "));
}

// The made-up sequence once more, as EasyMocap lays it out.
struct EasyMocapFolder {
  explicit EasyMocapFolder(const MadeUpSequence& made) : folder(made.root / "easy") {
    intrinsics = extrinsics = "%YAML:1.0\r\n---\r\nnames:\r\n  - \"B1\"\r\n  - \"B2\"\r\n";
    for (std::size_t c = 0; c < 2; ++c) {
      const Camera& camera = made.cameras[c];
      const std::string name = fmt::format("B{}", c + 1);
      const auto& D = camera.distortion;
      intrinsics += yaml_matrix("K_" + name, 3, 3, MadeUpSequence::rows(camera.K)) + yaml_matrix("dist_" + name, 1, 5, {D.begin(), D.end()}) + "H_" + name + ": 80\r\n";
      const glm::dvec3 R = axis_angle_from_rotation(camera.R);
      extrinsics += yaml_matrix("R_" + name, 3, 1, {R.x, R.y, R.z}) + yaml_matrix("Rot_" + name, 3, 3, MadeUpSequence::rows(camera.R)) +
                    yaml_matrix("T_" + name, 3, 1, {camera.T.x, camera.T.y, camera.T.z});
      fs::create_directories(folder / "images");
      fs::create_directories(folder / "mask");
      fs::copy(made.folder / camera.name, folder / "images" / name);
      fs::copy(made.folder / "mask_cihp" / camera.name, folder / "mask" / name);
    }
    made.root.write("easy/intri.yml", intrinsics);
    made.root.write("easy/extri.yml", extrinsics);
    for (std::size_t f = 0; f < 4; ++f) made.root.write(fmt::format("easy/output-smpl-3d/smpl/{:06}.json", f), fit_json(made.fits[f], f));
  }
  // Frames 0 and 1 as earlier versions write them, the others as later ones: under "annots", without the root's zeros.
  static std::string fit_json(const BodyFit& fit, std::size_t frame) {
    nlohmann::json person = {{"id", 0}, {"Rh", {{fit.Rh.x, fit.Rh.y, fit.Rh.z}}}, {"Th", {{fit.Th.x, fit.Th.y, fit.Th.z}}}, {"shapes", {fit.shapes}}};
    nlohmann::json poses = nlohmann::json::array();
    for (std::size_t j = frame < 2 ? 0 : 1; j < fit.poses.size(); ++j)
      for (int k = 0; k < 3; ++k) poses.push_back(fit.poses[j][k]);
    person["poses"] = {poses};
    nlohmann::json other = person;
    other["id"] = 1;
    other["Th"] = {{9, 9, 9}};
    const nlohmann::json people = {other, person};
    return frame < 2 ? people.dump() : nlohmann::json{{"annots", people}}.dump();
  }
  fs::path folder;
  std::string intrinsics, extrinsics;
};

TEST(Import, ReadsEasyMocapsLayout) {
  const MadeUpSequence made;
  const EasyMocapFolder easy(made);
  ImportSettings settings = settings_for(made);
  import_capture(settings);
  const Capture expected = open_capture(settings.out);
  settings.layout = "easymocap";
  settings.in = easy.folder;
  settings.out = made.root / "from_easymocap";
  EXPECT_EQ(import_capture(settings).pictures, 8u);
  const Capture capture = open_capture(settings.out);
  for (std::size_t c = 0; c < 2; ++c) {
    EXPECT_EQ(capture.cameras[c].name, fmt::format("B{}", c + 1));
    EXPECT_EQ(capture.cameras[c].K, expected.cameras[c].K);
    for (int k = 0; k < 3; ++k) EXPECT_LT(glm::length(capture.cameras[c].R[k] - expected.cameras[c].R[k]), 1e-12);
    EXPECT_LT(glm::length(capture.cameras[c].T - expected.cameras[c].T), 1e-12);
    for (int f = 0; f < 4; ++f) EXPECT_EQ(load_image(capture, "train", c, f).rgba, load_image(expected, "train", c, f).rgba);
  }
  for (std::size_t f = 0; f < 4; ++f) EXPECT_EQ(motion_of(capture, "train").frames[f].pose, motion_of(expected, "train").frames[f].pose);
}

TEST(Import, RefusesWhatEasyMocapWouldNotWrite) {
  const MadeUpSequence made;
  const EasyMocapFolder easy(made);
  ImportSettings settings = settings_for(made);
  settings.layout = "easymocap";
  settings.in = easy.folder;
  const auto refuse = [&](const std::string& name, const std::string& whole, const std::string& from, const std::string& to, const std::vector<std::string>& parts) {
    std::string changed = whole;
    ASSERT_NE(changed.find(from), changed.npos);
    made.root.write("easy/" + name, changed.replace(changed.find(from), from.size(), to));
    expect_input_error([&] { import_capture(settings); }, parts);
    made.root.write("easy/" + name, whole);
  };
  refuse("intri.yml", easy.intrinsics, "K_B2", "L_B2", {"intri.yml: K_B2: expected a matrix, found none"});
  refuse("intri.yml", easy.intrinsics, "rows: 3", "rows: 2", {"intri.yml: K_B1: expected 2x3 numbers, found 9"});
  refuse("intri.yml", easy.intrinsics, "rows: 3", "rows: -3", {"line 7", "rows or columns"});
  refuse("intri.yml", easy.intrinsics, "K_B2", "K_B1", {"each key once"});
  refuse("intri.yml", easy.intrinsics, "data: [", "data: [x", {"line 10", "finite number"});
  refuse("intri.yml", easy.intrinsics, "data: [", "data: ", {"numbers in brackets"});
  refuse("intri.yml", easy.intrinsics, "\"B2\"", "\"../B2\"", {"K_../B2"});
  refuse("intri.yml", easy.intrinsics, "]\r\nH_B2", "\r\nH_B2", {"a list that ends"});
  refuse("extri.yml", easy.extrinsics, "T_B1", "t_B1", {"extri.yml: T_B1"});
  refuse("output-smpl-3d/smpl/000001.json", EasyMocapFolder::fit_json(made.fits[1], 1), "\"Th\":[[0.1", "\"Tx\":[[0.1", {"000001.json", "Th"});
  refuse("output-smpl-3d/smpl/000001.json", EasyMocapFolder::fit_json(made.fits[1], 1), "[", "", {"000001.json", "JSON"});
  refuse("output-smpl-3d/smpl/000001.json", std::string(10'000, '['), "[", "[", {"000001.json", "JSON"});
  refuse("output-smpl-3d/smpl/000001.json", std::string(10'000, '[') + std::string(10'000, ']'), "[", "[", {"000001.json", "nested at most 64 deep"});
  refuse("output-smpl-3d/smpl/000001.json", std::string(50, '[') + std::string(50, ']'), "[", "[", {"000001.json", "a fit for each"});
}

// The same subject in both layouts. Pictures went through JPEG and masks lost their soft edges on the way; all else is equal.
TEST(Import, TheSharedSubjectIsTheSameFromBothLayouts) {
  const fs::path sequence = subject_a() / ".." / "zju" / "CoreView_901";
  if (!fs::exists(sequence) || !fs::exists(subject_a())) GTEST_SKIP() << "no captures at " << subject_a().parent_path();
  const TemporaryFolder folder;
  ImportSettings settings;
  settings.layout = "zju-mocap";
  settings.in = sequence;
  settings.out = folder / "capture";
  settings.body = subject_a() / "template.glb";
  settings.train_cameras = {"1", "2", "3", "4"};
  settings.ranges = {{"train", 0, 60, 12}, {"novel", 60, 79, 9}, {"ood", 79, 85, 5}};  // encoding pictures takes the time
  const ImportReport report = import_capture(settings);
  EXPECT_THAT(report.notes, testing::IsEmpty());
  const Capture imported = open_capture(settings.out), native = open_capture(subject_a());
  EXPECT_EQ(imported.body_template.glb, native.body_template.glb);

  ASSERT_EQ(imported.cameras.size(), native.cameras.size());
  double cameras_differ = 0;
  for (std::size_t c = 0; c < native.cameras.size(); ++c) {
    const Camera &a = imported.cameras[c], &b = native.cameras[c];
    EXPECT_EQ(a.name, fmt::format("Camera_B{}", c + 1));
    EXPECT_EQ(a.role, b.role);
    EXPECT_EQ(a.width, b.width);
    EXPECT_EQ(a.height, b.height);
    for (int i = 0; i < 3; ++i) {
      cameras_differ = std::max(cameras_differ, glm::length(a.R[i] - b.R[i]));
      cameras_differ = std::max(cameras_differ, glm::length(a.K[i] - b.K[i]) / 512);
    }
    cameras_differ = std::max(cameras_differ, glm::length(a.T - b.T));
  }
  double joints_differ = 0, colors_differ = 0, colors = 0, luma_differs = 0;
  std::size_t frames = 0, pictures = 0, masks_differ = 0;
  for (const auto& [split, motion] : imported.motions) {
    for (const MotionFrame& frame : motion.frames) {
      const MotionFrame* truth = find_frame(motion_of(native, split), frame.number);
      ASSERT_TRUE(truth) << split << frame.number;
      ++frames;
      const std::vector<glm::dmat4> a = forward_kinematics(imported.body_template.skeleton, frame.pose), b = forward_kinematics(native.body_template.skeleton, truth->pose);
      for (std::size_t j = 0; j < a.size(); ++j) {
        const glm::dvec3 difference = glm::dvec3(a[j][3]) + root_translation(imported.body_template.skeleton, frame.pose) - glm::dvec3(b[j][3]) -
                                      root_translation(native.body_template.skeleton, truth->pose);
        joints_differ = std::max(joints_differ, glm::length(difference));
      }
      for (std::size_t c = 0; c < native.cameras.size(); ++c) {
        if (!fs::exists(image_path(imported, split, c, frame.number)) || !fs::exists(image_path(native, split, c, frame.number))) continue;
        const Image is = load_image(imported, split, c, frame.number), was = load_image(native, split, c, frame.number);
        ++pictures;
        for (std::size_t p = 0; p < is.rgba.size(); p += 4) {
          masks_differ += (is.rgba[p + 3] >= 0.5f) != (was.rgba[p + 3] >= 0.5f);
          if (is.rgba[p + 3] < 0.5f) continue;
          double difference = 0;
          for (std::size_t k = 0; k < 3; ++k) difference += double{(is.rgba[p + k] - was.rgba[p + k]) * (is.rgba[p + k] - was.rgba[p + k])};
          colors_differ += difference;
          colors += 3;
          const double luma = 0.299 * (is.rgba[p] - was.rgba[p]) + 0.587 * (is.rgba[p + 1] - was.rgba[p + 1]) + 0.114 * (is.rgba[p + 2] - was.rgba[p + 2]);
          luma_differs += luma * luma;
        }
      }
    }
  }
  const double psnr = -10 * std::log10(colors_differ / colors);
  std::printf("  %zu cameras differ by %.1e, joints of %zu frames by %.1e m, masks of %zu pictures by %zu pixels; colours: %.1f dB, luma %.1f dB\n", imported.cameras.size(),
              cameras_differ, frames, joints_differ, pictures, masks_differ, psnr, -10 * std::log10(3 * luma_differs / colors));
  EXPECT_LT(cameras_differ, 1e-6);
  EXPECT_LT(joints_differ, 5e-6);  // float32 here, six decimals there
  EXPECT_EQ(masks_differ, 0u);
  // The JPEG keeps brightness at full resolution and colour at half of it; a shift by a pixel would cost brightness too.
  EXPECT_GT(psnr, 30);
  EXPECT_GT(-10 * std::log10(3 * luma_differs / colors), 40);
  EXPECT_GE(pictures, 50u);
}

}  // namespace
}  // namespace arah

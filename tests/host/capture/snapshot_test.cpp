// People Snapshot becomes a capture: camera, poses, pictures and masks from the set's own files, upright, and what is wrong in
// them is refused by name.
#include <glm/matrix.hpp>

#include "host/capture/hdf5_file.h"
#include "host/capture/import_capture.h"
#include "host/capture/lzf.h"
#include "host/capture/video_frames.h"
#include "tests/host/body/small_smpl.h"
#include "tests/host/capture/made_up_snapshot.h"

namespace arah {
namespace {

namespace fs = std::filesystem;

ImportSettings settings_for(const MadeUpSnapshot& made) {
  ImportSettings settings;
  settings.layout = "people-snapshot";
  settings.in = made.folder;
  settings.out = made.root / "capture";
  settings.body = made.root / "body.glb";
  return settings;
}

// The body as the set means it: in the camera's axes, turned about its root and then moved.
Pose published_pose(const MadeUpSnapshot& made, std::size_t frame) {
  Pose pose = rest_pose(made.body.skeleton);
  for (std::size_t j = 0; j < 24; ++j) pose.theta[j] = {made.poses[frame][3 * j], made.poses[frame][3 * j + 1], made.poses[frame][3 * j + 2]};
  pose.root_position += glm::dvec3(made.places[frame][0], made.places[frame][1], made.places[frame][2]);
  return pose;
}

TEST(Lzf, UnpacksWhatPackersWrite) {
  const auto unpacked = [](const std::vector<std::uint8_t>& packed, std::size_t most = 1000) {
    const std::vector<std::uint8_t> bytes = unpack_lzf(packed, most);
    return std::string(bytes.begin(), bytes.end());
  };
  EXPECT_EQ(unpacked({2, 'a', 'b', 'c'}), "abc");
  EXPECT_EQ(unpacked({1, 'a', 'b', 0x20, 1}), "ababa");                       // three, two back
  EXPECT_EQ(unpacked({0, 'x', 0xe0, 0, 0}), std::string(10, 'x'));            // nine of what it makes itself
  EXPECT_EQ(unpacked({0, 'x', 0xe0, 255, 0}), std::string(265, 'x'));         // the longest
  EXPECT_EQ(unpacked({0, 'x', 0xe0, 255, 0}, 264), "") << "more than is allowed";
  EXPECT_EQ(unpacked({2, 'a', 'b'}), "") << "ends early";
  EXPECT_EQ(unpacked({0, 'x', 0xe0}), "");
  EXPECT_EQ(unpacked({0, 'x', 0xe0, 3}), "");
  EXPECT_EQ(unpacked({0, 'x', 0x20, 1}), "") << "before the beginning";
  EXPECT_EQ(unpacked({}), "");
  std::string plain;
  for (int i = 0; i < 20'000; ++i) plain += static_cast<char>(i % 700 < 500 ? i / 700 : i * i);
  const std::string packed = packed_lzf(plain);
  EXPECT_LT(packed.size(), plain.size() / 2);
  EXPECT_EQ(unpacked({packed.begin(), packed.end()}, plain.size()), plain);
}

TEST(Snapshot, BringsCameraPosesPicturesAndMasks) {
  const MadeUpSnapshot made;
  const ImportReport report = import_capture(settings_for(made));
  EXPECT_EQ(report.pictures, 5u);
  EXPECT_THAT(report.notes, testing::ElementsAre(testing::HasSubstr("6 poses, 5 pictures and 5 masks: the first 5"), testing::HasSubstr("SMPL's female model"),
                                                 testing::HasSubstr("all frames are for training")));
  const Capture capture = open_capture(made.root / "capture");
  ASSERT_EQ(capture.cameras.size(), 1u);
  const Camera& camera = capture.cameras[0];
  EXPECT_EQ(camera.K, glm::dmat3(90.5, 0, 0, 0, 91, 0, 47, 40.25, 1));
  EXPECT_EQ(glm::dvec2(camera.width, camera.height), glm::dvec2(96, 80));
  EXPECT_EQ(camera.T, glm::dvec3(0.0));
  EXPECT_EQ(camera.to_camera({0, 0, 1}), glm::dvec3(0, -1, 0)) << "the world's up is up in the picture";
  EXPECT_FALSE(camera.distorted());
  EXPECT_THAT(frames_with_images(capture, "train", 0), testing::ElementsAre(0, 1, 2, 3, 4));
  EXPECT_EQ(motion_of(capture, "train").poses, "estimated");

  double largest = 0, joints = 0, colors = 0;
  std::size_t differ = 0;
  Camera distorted = camera;
  distorted.distortion = {-0.2, 0.05, 0.01, -0.005, 0.0};
  for (std::size_t f = 0; f < 5; ++f) {
    const MotionFrame* frame = find_frame(motion_of(capture, "train"), static_cast<int>(f));
    ASSERT_TRUE(frame);
    const Pose published = published_pose(made, f);
    const Skeleton& skeleton = made.body.skeleton;
    const std::vector<glm::vec3> seen = posed_vertices(made.body, published), world = posed_vertices(capture.body_template, frame->pose);
    for (std::size_t v = 0; v < seen.size(); ++v) largest = std::max(largest, glm::length(camera.to_camera(glm::dvec3(world[v])) - glm::dvec3(seen[v])));
    const std::vector<glm::dmat4> a = forward_kinematics(skeleton, published), b = forward_kinematics(skeleton, frame->pose);
    for (std::size_t j = 0; j < a.size(); ++j) {
      const glm::dvec3 in_world = glm::dvec3(b[j][3]) + root_translation(skeleton, frame->pose);
      joints = std::max(joints, glm::length(camera.to_camera(in_world) - glm::dvec3(a[j][3]) - root_translation(skeleton, published)));
    }
    // Head above hips.
    const auto head = static_cast<std::size_t>(find_joint(skeleton, "head"));
    EXPECT_GT(b[head][3].z, b[0][3].z + 0.3);

    const Image image = load_image(capture, "train", 0, static_cast<int>(f));
    for (int v = 0; v < 80; ++v) {
      for (int u = 0; u < 96; ++u) {
        const float* pixel = &image.rgba[4 * static_cast<std::size_t>(v * 96 + u)];
        const glm::dvec2 at = distorted.distort({u, v});
        const glm::ivec2 nearest(std::lround(at.x), std::lround(at.y));
        const bool inside = nearest.x >= 0 && nearest.y >= 0 && nearest.x < 96 && nearest.y < 80 && made.masks[f].at<std::uint8_t>(nearest.y, nearest.x) != 0;
        differ += inside != (pixel[3] > 0.5f);
        if (!inside || pixel[3] < 0.5f) continue;
        colors = std::max(colors, std::abs(255.0 * static_cast<double>(pixel[2]) - (40.0 + 30.0 * static_cast<double>(f))));
        colors = std::max(colors, std::abs(255.0 * static_cast<double>(pixel[0]) - (200.0 - 30.0 * static_cast<double>(f))));
      }
    }
  }
  std::printf("  vertices differ by %.1e m, joints by %.1e m, masks by %zu pixels, colours by %.1f of 255\n", largest, joints, differ, colors);
  EXPECT_LT(largest, 2e-6);
  EXPECT_LT(joints, 2e-6);  // float32 in the file
  EXPECT_EQ(differ, 0u);
  EXPECT_LT(colors, 8) << "a codec's doing; the next frame is 30 away";
}

TEST(Snapshot, IsTheSameFromEachWayOfStoringIt) {
  const MadeUpSnapshot made;
  ImportSettings settings = settings_for(made);
  import_capture(settings);
  const Capture first = open_capture(settings.out);
  settings.out = made.root / "other";
  for (const Hdf5Packing packing : {Hdf5Packing::plain, Hdf5Packing::deflate}) {
    Hdf5Writer(made.folder / "masks.hdf5").write_masks(made.masks, packing);
    import_capture(settings);
    const Capture other = open_capture(settings.out);
    for (int f = 0; f < 5; ++f) EXPECT_EQ(load_image(other, "train", 0, f).rgba, load_image(first, "train", 0, f).rgba) << f;
  }
  // As loaders have it: pictures, masks and bodies in files of their own, here counted from 7.
  made.write_pictures(".png", 7);
  fs::remove(made.folder / "reconstructed_poses.hdf5");
  fs::remove(made.folder / "masks.hdf5");
  for (std::size_t f = 0; f < 5; ++f) {
    const std::string name = std::to_string(7 + f);
    write_picture(made.folder / "mask" / (name + ".png"), made.masks[f]);
    const std::vector<double>& pose = made.poses[f];
    made.write("models/" + name + ".npz", python::npz({{"root_orient", python::npy({3}, {pose.begin(), pose.begin() + 3})},
                                                       {"pose_body", python::npy({63}, {pose.begin() + 3, pose.begin() + 66})},
                                                       {"pose_hand", python::npy({6}, {pose.begin() + 66, pose.end()})},
                                                       {"trans", python::npy({3}, made.places[f])}}));
  }
  const ImportReport report = import_capture(settings);
  EXPECT_THAT(report.notes, testing::Each(testing::Not(testing::HasSubstr("poses,"))));
  const Capture prepared = open_capture(settings.out);
  for (std::size_t f = 0; f < 5; ++f) {
    EXPECT_EQ(motion_of(prepared, "train").frames[f].pose, motion_of(first, "train").frames[f].pose);
    const std::vector<float> is = load_image(prepared, "train", 0, static_cast<int>(f)).rgba, was = load_image(first, "train", 0, static_cast<int>(f)).rgba;
    for (std::size_t p = 3; p < is.size(); p += 4) ASSERT_EQ(is[p], was[p]);
  }
  // A frame that is not there must not move the others.
  fs::remove(made.folder / "mask" / "9.png");
  expect_input_error([&] { import_capture(settings); }, {"mask: expected a file for each frame", "none for 9"});
}

TEST(Hdf5File, ReadsWhatWasNeverWrittenAsZero) {
  const TemporaryFolder folder;
  {
    const Hdf5Writer file(folder / "a.hdf5");
    const hsize_t shape[2] = {5, 3}, chunk[2] = {2, 2}, at[2] = {2, 2};
    const hid_t space = H5Screate_simple(2, shape, nullptr), properties = H5Pcreate(H5P_DATASET_CREATE);
    H5Pset_chunk(properties, 2, chunk);
    const hid_t data = H5Dcreate2(file.id(), "some", H5T_STD_I16BE, space, H5P_DEFAULT, properties, H5P_DEFAULT);
    EXPECT_GE(H5Dwrite_chunk(data, H5P_DEFAULT, 0, at, 8, "\x01\x02\x7f\x7f\xff\xfe\x7f\x7f"), 0);
    H5Dclose(data);
    H5Dclose(H5Dcreate2(file.id(), "none", H5T_STD_I16BE, space, H5P_DEFAULT, properties, H5P_DEFAULT));
    H5Pclose(properties);
    H5Sclose(space);
  }
  const Hdf5File file(folder / "a.hdf5");
  EXPECT_EQ(file.numbers("some", {-1, 3}), (std::vector<double>{0, 0, 0, 0, 0, 0, 0, 0, 258, 0, 0, -2, 0, 0, 0}));
  EXPECT_EQ(file.numbers("none", {5, -1}), std::vector<double>(15, 0.0));
}

TEST(Snapshot, ReducesChoosesFramesAndGivesTheShape) {
  MadeUpSnapshot made("male-1-plaza");
  made.betas[0] = 0.5;
  made.betas[1] = -0.25;
  made.poses[3].assign(72, 0.0);  // as where a fit ended early
  made.places[3].assign(3, 0.0);
  made.write_poses();
  ImportSettings settings = settings_for(made);
  settings.size = 48;
  settings.border = 1;
  settings.body = made.root.write("SMPL_MALE.npz", SmallModel().npz(true));
  settings.ranges = {{"novel", 1, 5, 2}, {"train", 0, 5, 2}};  // the second begins before the first
  const ImportReport report = import_capture(settings);
  EXPECT_THAT(report.notes, testing::Contains(testing::HasSubstr("SMPL's male model")));
  EXPECT_THAT(report.notes, testing::Contains(testing::HasSubstr("1 frames have no fitted body and are left out, the first of them frame 3.")));
  const Capture capture = open_capture(settings.out);
  EXPECT_THAT(frames_with_images(capture, "train", 0), testing::ElementsAre(0, 2, 4));
  EXPECT_THAT(frames_with_images(capture, "novel", 0), testing::ElementsAre(1));
  Camera whole;
  whole.width = 96;
  whole.height = 80;
  whole.K = {90.5, 0, 0, 0, 91, 0, 47, 40.25, 1};
  EXPECT_EQ(capture.cameras[0].K, whole.scaled(48).K);
  // The frame's colour says which it is.
  const Image image = load_image(capture, "novel", 0, 1);
  EXPECT_NEAR(255 * image.rgba[4 * (20 * 48 + 20) + 2], 70, 8);
  EXPECT_NEAR(255 * load_image(capture, "train", 0, 4).rgba[4 * (20 * 48 + 24) + 2], 160, 8);
  const glm::dvec3 root = capture.body_template.skeleton.rest_joints[0];
  EXPECT_LT(glm::length(root - glm::dvec3(0.05, 1.0, -0.075)), 1e-6);
}

TEST(Snapshot, RefusesWhatTheSetWouldNotHold) {
  const MadeUpSnapshot made;
  const ImportSettings settings = settings_for(made);
  const auto refuse = [&](const std::vector<std::string>& parts) {
    expect_input_error([&] { import_capture(settings); }, parts);
    EXPECT_FALSE(fs::exists(made.root / "capture"));
    EXPECT_FALSE(fs::exists(made.root / "capture.partial"));
  };
  const auto rewrite_poses = [&](const std::function<void(const Hdf5Writer&)>& write, const std::vector<std::string>& parts) {
    write(Hdf5Writer(made.folder / "reconstructed_poses.hdf5"));
    refuse(parts);
    made.write_poses();
  };
  const std::vector<double> zeros(500, 0.0);
  rewrite_poses([&](const Hdf5Writer&) {}, {"reconstructed_poses.hdf5: pose: expected this array, found none"});
  rewrite_poses([&](const Hdf5Writer& file) { file.write("pose", {6, 70}, zeros); }, {"pose: expected an array of Nx72, found 6x70"});
  rewrite_poses([&](const Hdf5Writer& file) { file.write("pose", {432}, zeros); }, {"an array of Nx72, found 432"});
  rewrite_poses([&](const Hdf5Writer& file) { H5Gclose(H5Gcreate2(file.id(), "pose", H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT)); }, {"pose: expected an array", "HDF5 says"});
  rewrite_poses([&](const Hdf5Writer& file) { H5Lcreate_external("/etc/other.hdf5", "pose", file.id(), "pose", H5P_DEFAULT, H5P_DEFAULT); }, {"in the file itself, found a link"});
  rewrite_poses([&](const Hdf5Writer& file) { file.write("pose", {1, 72}, zeros), file.write("betas", {10}, zeros), file.write("trans", {2, 3}, zeros); },
                {"trans: expected an array of 1x3, found 2x3"});
  rewrite_poses([&](const Hdf5Writer& file) { file.write("pose", {1, 72}, std::vector<double>(72, NAN)); }, {"pose: expected finite numbers"});
  rewrite_poses(
      [&](const Hdf5Writer& file) {
        const hid_t text = H5Tcopy(H5T_C_S1);
        H5Tset_size(text, 4);
        const std::string letters(4 * 72, 'x');
        file.write("pose", text, {1, 72}, text, letters.data());
        H5Tclose(text);
      },
      {"numbers of at most 8 bytes, found elements of another type"});
  rewrite_poses(
      [&](const Hdf5Writer& file) {  // a word that asks for 2 PB
        const hsize_t shape[2] = {hsize_t{1} << 42, 72}, chunk[2] = {1, 72};
        const hid_t space = H5Screate_simple(2, shape, nullptr), properties = H5Pcreate(H5P_DATASET_CREATE);
        H5Pset_chunk(properties, 2, chunk);
        H5Dclose(H5Dcreate2(file.id(), "pose", H5T_IEEE_F64LE, space, H5P_DEFAULT, properties, H5P_DEFAULT));
        H5Pclose(properties);
        H5Sclose(space);
      },
      {"pose: expected at most 16000000 numbers", "4398046511104x72"});
  MadeUpSnapshot few;
  few.poses.resize(3);
  few.places.resize(3);
  few.write_poses();
  expect_input_error([&] { import_capture(settings_for(few)); }, {"3 poses, 5 pictures and 5 masks"});

  const auto rewrite_masks = [&](const std::function<void(const Hdf5Writer&)>& write, const std::vector<std::string>& parts) {
    write(Hdf5Writer(made.folder / "masks.hdf5"));
    refuse(parts);
    Hdf5Writer(made.folder / "masks.hdf5").write_masks(made.masks, Hdf5Packing::lzf);
  };
  rewrite_masks([&](const Hdf5Writer& file) { file.write("masks", {5, 96}, zeros); }, {"masks.hdf5: masks: expected an array of NxNxN, found 5x96"});
  rewrite_masks([&](const Hdf5Writer& file) { file.write("masks", {5, 8, 10}, zeros); }, {"masks: expected whole numbers of one byte"});
  rewrite_masks([&](const Hdf5Writer& file) { file.write_masks({made.masks[0], made.masks[1]}, Hdf5Packing::plain); }, {"6 poses, 5 pictures and 2 masks"});
  rewrite_masks([&](const Hdf5Writer& file) { file.write_masks(std::vector<cv::Mat>(5, cv::Mat(40, 48, CV_8U, cv::Scalar(1))), Hdf5Packing::plain); },
                {"masks.hdf5 frame 0: size: expected 96x80", "48x40"});
  const auto with_chunk = [&](std::uint32_t skipped, const std::string& bytes) {
    return [&made, skipped, bytes](const Hdf5Writer& file) {
      file.write_masks(made.masks, Hdf5Packing::lzf);
      const hid_t data = H5Dopen2(file.id(), "masks", H5P_DEFAULT);
      const hsize_t at[3] = {2, 40, 48};
      EXPECT_GE(H5Dwrite_chunk(data, H5P_DEFAULT, skipped, at, bytes.size(), bytes.data()), 0);
      H5Dclose(data);
    };
  };
  rewrite_masks(with_chunk(0, "\x1fxyz"), {"masks frame 2: expected a chunk of 3840 bytes, found one that is damaged"});
  rewrite_masks(with_chunk(0, packed_lzf(std::string(3839, 'x'))), {"masks frame 2: expected a chunk of 3840 bytes, found one that is damaged"});
  rewrite_masks(with_chunk(1, std::string(100, 'x')), {"masks frame 2: expected a chunk of 3840 bytes, found one that is damaged"});
  rewrite_masks(with_chunk(0, std::string(9000, 'x')), {"masks frame 2: expected a chunk of at most 7744 bytes, found 9000"});
  rewrite_masks(
      [&](const Hdf5Writer& file) {
        const hsize_t shape[3] = {5, 80, 96};
        const hid_t space = H5Screate_simple(3, shape, nullptr), properties = H5Pcreate(H5P_DATASET_CREATE);
        H5Pset_external(properties, "/etc/hostname", 0, H5F_UNLIMITED);
        H5Dclose(H5Dcreate2(file.id(), "masks", H5T_STD_U8LE, space, H5P_DEFAULT, properties, H5P_DEFAULT));
        H5Pclose(properties);
        H5Sclose(space);
      },
      {"in the file itself", "refers to other files"});
  rewrite_masks(
      [&](const Hdf5Writer& file) {
        const hsize_t shape[3] = {5, 80, 96}, chunk[3] = {1, 80, 96};
        const hid_t space = H5Screate_simple(3, shape, nullptr), properties = H5Pcreate(H5P_DATASET_CREATE);
        H5Pset_chunk(properties, 3, chunk);
        H5Pset_filter(properties, 32001, H5Z_FLAG_OPTIONAL, 0, nullptr);
        H5Dclose(H5Dcreate2(file.id(), "masks", H5T_STD_U8LE, space, H5P_DEFAULT, properties, H5P_DEFAULT));
        H5Pclose(properties);
        H5Sclose(space);
      },
      {"found filter 32001", "h5repack"});

  // Cut off anywhere, or something else altogether.
  for (const std::string& name : {std::string("masks.hdf5"), std::string("reconstructed_poses.hdf5")}) {
    std::ifstream file(made.folder / name, std::ios::binary);
    const std::string whole((std::istreambuf_iterator<char>(file)), {});
    for (const std::size_t length : {std::size_t{0}, std::size_t{7}, std::size_t{96}, whole.size() / 2, whole.size() - 1}) {
      made.write(name, whole.substr(0, length));
      refuse({name + ": expected an HDF5 file", "HDF5 says", "Copy it again"});
    }
    made.write(name, std::string(5000, 'x'));
    refuse({name + ": expected an HDF5 file"});
    made.write(name, whole);
  }

  const auto camera = [&](const char* name, const std::string& value, const std::vector<std::string>& parts) {
    auto changed = made.camera;
    for (auto& [key, stored] : changed) {
      if (key == name) stored = value;
    }
    made.write("camera.pkl", python::pickle(python::dictionary(changed)));
    refuse(parts);
    made.write("camera.pkl", python::pickle(python::dictionary(made.camera)));
  };
  camera("width", python::integer(100'000), {"camera.pkl: width: expected 1 to 8192 pixels, found 100000"});
  camera("camera_f", python::array({3}, {1, 2, 3}), {"camera.pkl: camera_f"});
  camera("camera_f", python::array({2}, {-90, 90}), {"focal"});
  camera("camera_k", python::call(python::name("os", "system"), {python::text("true")}), {"camera.pkl", "'os.system'"});

  if (made.has_video()) {
    const fs::path video = made.folder / "female-3-sport.mp4";
    made.write_video(video, 9);
    refuse({"6 poses, 9 pictures and 5 masks"});
    made.write("female-3-sport.mp4", "no video at all");
    refuse({"female-3-sport.mp4: expected a video that OpenCV can decode"});
    fs::remove(video);
    refuse({"female-3-sport.mp4: expected the sequence's video, or its frames in image/, found neither"});
    made.write_video(made.folder / "another.mp4", 5);  // the only one serves
    VideoFrames frames(made.folder / "another.mp4");
    EXPECT_NEAR(frames.read(4).at<cv::Vec3b>(40, 48)[0], 160, 8);
    EXPECT_NEAR(frames.read(1).at<cv::Vec3b>(40, 48)[0], 70, 8) << "going back";
    expect_input_error([&] { frames.read(5); }, {"another.mp4: frame 5: expected a video that is long enough, found 5 frames"});
  }
  import_capture(settings);
  fs::remove(made.folder / "masks.hdf5");
  expect_input_error([&] { import_capture(settings); }, {"masks.hdf5: expected the masks of the frames, or mask/, found neither"});
  fs::remove(made.folder / "camera.pkl");
  expect_input_error([&] { import_capture(settings); }, {"camera.pkl", "sequence's own folder"});
}

}  // namespace
}  // namespace arah

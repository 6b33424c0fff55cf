#include "host/avatar/safetensors.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/resource.h>
#include <unistd.h>

#include <csignal>
#include <cstring>
#include <fstream>
#include <limits>
#include <random>

#include "host/input_error.h"
#include "tests/host/body/hostile_json.h"
#include "tests/host/body/memory_of_refusal.h"
#include "tests/golden.h"

namespace arah {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

class Safetensors : public ::testing::Test {
 protected:
  void SetUp() override {
    const auto* test = ::testing::UnitTest::GetInstance()->current_test_info();
    folder_ = fs::temp_directory_path() / ("arah_safetensors_" + std::to_string(getpid()) + "_" + test->name());
    fs::create_directories(folder_);
    path_ = folder_ / "file.safetensors";
  }
  void TearDown() override { fs::remove_all(folder_); }

  void put(const std::string& bytes) { std::ofstream(path_, std::ios::binary) << bytes; }
  void put(const std::string& header, const std::string& data) { put(length(header.size()) + header + data); }
  std::string bytes() const {
    std::ifstream stream(path_, std::ios::binary);
    return {std::istreambuf_iterator<char>(stream), {}};
  }
  static std::string length(uint64_t value) {
    std::string text(8, '\0');
    std::memcpy(text.data(), &value, 8);
    return text;
  }
  // The text of the error that reading gives; empty when it succeeds.
  std::string refusal() const {
    try {
      read_safetensors(path_);
    } catch (const InputError& error) {
      return error.what();
    }
    return "";
  }
  static SafetensorsFile sample() {
    SafetensorsFile file;
    file.tensors["weights"] =
        Tensor::from<float>({2, 3}, {1.5f, -2, 3, 4, 5, std::numeric_limits<float>::denorm_min()});
    file.tensors["exact"] = Tensor::from<double>({}, {0.1});
    file.tensors["ids"] = Tensor::from<int32_t>({3}, {-1, 0, 7});
    file.tensors["big"] = Tensor::from<int64_t>({1}, {int64_t{1} << 40});
    file.tensors["bytes \"quoted\" é"] = Tensor::from<uint8_t>({5}, {0, 1, 2, 254, 255});
    file.tensors["none"] = Tensor::from<float>({4, 0, 2}, std::vector<float>{});
    file.metadata["spec"] = R"({"width": 64})";
    return file;
  }

  fs::path folder_, path_;
};

TEST_F(Safetensors, GivesBackWhatWasWritten) {
  const SafetensorsFile written = sample();
  write_safetensors(path_, written);
  const SafetensorsFile read = read_safetensors(path_);
  EXPECT_EQ(read.metadata, written.metadata);
  ASSERT_EQ(read.tensors.size(), written.tensors.size());
  for (const auto& [name, tensor] : written.tensors) {
    EXPECT_EQ(read.at(name).dtype, tensor.dtype) << name;
    EXPECT_EQ(read.at(name).shape, tensor.shape) << name;
    EXPECT_EQ(read.at(name).data, tensor.data) << name;
  }
  EXPECT_EQ(read.at("weights").as<double>()[1], -2.0);
  EXPECT_EQ(read.at("exact").count(), 1);
  EXPECT_EQ(read.values<float>("ids", {3}), (std::vector<float>{-1, 0, 7}));
  EXPECT_THROW(read.values<float>("ids", {1, 3}), InputError);
  EXPECT_THROW(read.values<int32_t>("weights", {2, 3}), InputError);
  EXPECT_THROW(read.values<int32_t>("big", {1}), InputError);
  EXPECT_THROW(read.values<uint8_t>("ids", {3}), InputError);
  EXPECT_THROW(read.at("absent"), InputError);
}

TEST_F(Safetensors, WritesAnEmptyFile) {
  write_safetensors(path_, {});
  EXPECT_TRUE(read_safetensors(path_).tensors.empty());
}

TEST_F(Safetensors, KeepsEveryTensorAligned) {
  write_safetensors(path_, sample());
  const std::string all = bytes();
  uint64_t header = 0;
  std::memcpy(&header, all.data(), 8);
  EXPECT_EQ(header % 8, 0u);
  const double exact = 0.1;
  const size_t at = all.find(std::string(reinterpret_cast<const char*>(&exact), 8));
  ASSERT_NE(at, std::string::npos);
  EXPECT_EQ(at % 8, 0u);
}

TEST_F(Safetensors, RefusesAFileCutAnywhere) {
  write_safetensors(path_, sample());
  const std::string all = bytes();
  for (size_t size = 0; size < all.size(); ++size) {
    put(all.substr(0, size));
    EXPECT_THAT(refusal(), HasSubstr(path_.string())) << "cut to " << size << " of " << all.size() << " bytes";
  }
  put(all + '\0');
  EXPECT_THAT(refusal(), HasSubstr("data"));
}

TEST_F(Safetensors, NamesWhatIsWrong) {
  struct Row {
    const char* header;
    const char* data;
    const char* says;
  };
  const Row rows[] = {
      {"[1]", "", "object"},
      {"{\"a\": 3}", "", "\"a\""},
      {"{\"a\": ", "", "JSON"},
      {"{\"a\": {\"dtype\": \"BF16\", \"shape\": [2], \"data_offsets\": [0, 4]}}", "1234", "BF16"},
      {"{\"a\": {\"dtype\": 3, \"shape\": [1], \"data_offsets\": [0, 4]}}", "1234", "dtype"},
      {"{\"a\": {\"dtype\": \"F32\", \"data_offsets\": [0, 4]}}", "1234", "shape"},
      {"{\"a\": {\"dtype\": \"F32\", \"shape\": [-1], \"data_offsets\": [0, 4]}}", "1234", "-1"},
      {"{\"a\": {\"dtype\": \"F32\", \"shape\": [1.5], \"data_offsets\": [0, 4]}}", "1234", "1.5"},
      {"{\"a\": {\"dtype\": \"F32\", \"shape\": [2], \"data_offsets\": [0, 4]}}", "1234", "shape"},
      {"{\"a\": {\"dtype\": \"F32\", \"shape\": [18446744073709551615], \"data_offsets\": [0, 4]}}", "1234", "shape"},
      // 2^62 * 4 + 1 numbers: the product wraps to 1 in 64 bits
      {"{\"a\": {\"dtype\": \"F32\", \"shape\": [4611686018427387905, 4], \"data_offsets\": [0, 16]}}",
       "0123456789abcdef", "shape"},
      // 2^62 numbers of 4 bytes: the byte count wraps to 0
      {"{\"a\": {\"dtype\": \"F32\", \"shape\": [4611686018427387904], \"data_offsets\": [0, 0]}}", "", "shape"},
      {"{\"a\": {\"dtype\": \"F32\", \"shape\": [1], \"data_offsets\": [4, 0]}}", "1234", "data_offsets"},
      {"{\"a\": {\"dtype\": \"F32\", \"shape\": [1], \"data_offsets\": [0, 4, 8]}}", "1234", "data_offsets"},
      {"{\"a\": {\"dtype\": \"F32\", \"shape\": [1], \"data_offsets\": [-4, 0]}}", "1234", "data_offsets"},
      {"{\"a\": {\"dtype\": \"F32\", \"shape\": [1], \"data_offsets\": [4, 8]}}", "1234", "data_offsets"},
      {"{\"a\": {\"dtype\": \"F32\", \"shape\": [1], \"data_offsets\": [18446744073709551612, 18446744073709551616]}}",
       "1234", "data_offsets"},
      // overlap
      {"{\"a\": {\"dtype\": \"F32\", \"shape\": [1], \"data_offsets\": [0, 4]},"
       "\"b\": {\"dtype\": \"U8\", \"shape\": [4], \"data_offsets\": [2, 6]}}",
       "123456", "\"b\""},
      // gap
      {"{\"a\": {\"dtype\": \"F32\", \"shape\": [1], \"data_offsets\": [0, 4]},"
       "\"b\": {\"dtype\": \"U8\", \"shape\": [1], \"data_offsets\": [5, 6]}}",
       "123456", "\"b\""},
      // the same name twice
      {"{\"a\": {\"dtype\": \"U8\", \"shape\": [1], \"data_offsets\": [0, 1]},"
       "\"a\": {\"dtype\": \"U8\", \"shape\": [1], \"data_offsets\": [0, 1]}}",
       "1", "several"},
      {"{\"__metadata__\": {\"seed\": 3}}", "", "seed"},
      {"{\"__metadata__\": \"text\"}", "", "__metadata__"},
  };
  for (const Row& row : rows) {
    put(row.header, row.data);
    EXPECT_THAT(refusal(), HasSubstr(row.says)) << row.header;
    EXPECT_THAT(refusal(), HasSubstr(path_.string())) << row.header;
  }
  for (const std::string& deep : {nested_lists(10'000), nested_objects(10'000), "{\"a\":" + nested_lists(1'000'000) + "}"}) {
    put(length(deep.size()) + deep);
    EXPECT_THAT(refusal(), HasSubstr("nested at most 64 deep"));
  }
  {
    const std::string many = list_of("[]", 30'000'000);  // 90 MB that would take 2.5 GB
    put(length(many.size()) + many);
  }
  EXPECT_LT(memory_of_refusal([&] { read_safetensors(path_); }), kMostMemoryOfRefusal);
  put(length(~uint64_t{0}) + "{}");
  EXPECT_THAT(refusal(), HasSubstr("header length"));
  fs::remove(path_);
  EXPECT_THAT(refusal(), HasSubstr(path_.string()));
  fs::create_directory(path_);
  EXPECT_THAT(refusal(), HasSubstr(path_.string()));
}

// One bit, wherever it is: the file is refused, or what it says is what was written. That is so in the name of the checksum alone.
TEST_F(Safetensors, NoFlippedBitOpensAsOtherNumbers) {
  write_safetensors(path_, sample());
  const SafetensorsFile written = read_safetensors(path_);
  const std::string all = bytes();
  const size_t name = all.find("arah.crc32");
  ASSERT_NE(name, std::string::npos);
  uint64_t header = 0;
  std::memcpy(&header, all.data(), 8);
  size_t refused = 0, by_checksum = 0, of_data = 0;
  for (size_t bit = 0; bit < 8 * all.size(); ++bit) {
    std::string changed = all;
    changed[bit / 8] = static_cast<char>(changed[bit / 8] ^ (1 << bit % 8));
    put(changed);
    const std::string says = refusal();
    if (!says.empty()) {
      refused += 1;
      by_checksum += says.find("arah.crc32") != std::string::npos;
      of_data += bit / 8 >= 8 + header;
      continue;
    }
    ASSERT_TRUE(bit / 8 >= name && bit / 8 < name + 10) << "bit " << bit % 8 << " of byte " << bit / 8;
    const SafetensorsFile read = read_safetensors(path_);
    ASSERT_EQ(read.tensors.size(), written.tensors.size());
    for (const auto& [of, tensor] : written.tensors) ASSERT_EQ(read.at(of).data, tensor.data) << of;
    ASSERT_EQ(read.metadata.at("spec"), written.metadata.at("spec"));
  }
  std::printf("  %zu bits flipped, %zu refused, %zu of them by the checksum\n", 8 * all.size(), refused, by_checksum);
  EXPECT_EQ(of_data, 8 * (all.size() - 8 - header));
  EXPECT_GE(by_checksum, of_data);
}

TEST_F(Safetensors, TheChecksumIsOfOursAlone) {
  write_safetensors(path_, sample());
  const std::string ours = bytes();
  const size_t last = ours.size() - 1;
  // Another program's, with none: whatever it holds is what it says.
  std::string others = ours;
  others.replace(others.find("arah.crc32"), 10, "other.name");
  others[last] = 7;
  put(others);
  EXPECT_EQ(refusal(), "");
  // One that changed a number and kept ours.
  std::string changed = ours;
  changed[last] = 7;
  put(changed);
  EXPECT_THAT(refusal(), ::testing::AllOf(HasSubstr("\"arah.crc32\": expected "), HasSubstr("found "), HasSubstr("another program changed it")));
  // One that spells the header in another way and kept ours.
  uint64_t header = 0;
  std::memcpy(&header, ours.data(), 8);
  put(length(header + 1) + " " + ours.substr(8));
  EXPECT_THAT(refusal(), HasSubstr("arah.crc32"));
  // What is read and written again has one of its own.
  put(ours);
  SafetensorsFile file = read_safetensors(path_);
  EXPECT_FALSE(file.metadata.contains("arah.crc32"));
  file.tensors["ids"] = Tensor::from<int32_t>({3}, {4, 5, 6});
  file.metadata["arah.crc32"] = "of another";
  write_safetensors(path_, file);
  EXPECT_EQ(read_safetensors(path_).values<int32_t>("ids", {3}), (std::vector<int32_t>{4, 5, 6}));
}

// Whatever a flipped byte does, the answer is a file or an InputError, and nothing else, where no checksum refuses it first.
TEST_F(Safetensors, SurvivesFlippedBytes) {
  write_safetensors(path_, sample());
  std::string all = bytes();
  all.replace(all.find("arah.crc32"), 10, "other.name");
  std::mt19937 random(1);
  int refused = 0;
  for (int round = 0; round < 2000; ++round) {
    std::string changed = all;
    for (int i = 0; i <= round % 3; ++i) changed[random() % changed.size()] = static_cast<char>(random());
    put(changed);
    refused += refusal().empty() ? 0 : 1;
  }
  EXPECT_GT(refused, 500);
  EXPECT_LT(refused, 2000);
}

TEST_F(Safetensors, LeavesTheOldFileWhenWritingFails) {
  SafetensorsFile file = sample();
  write_safetensors(path_, file);
  const std::string before = bytes();
  file.tensors["weights"].data.pop_back();
  EXPECT_THROW(write_safetensors(path_, file), std::invalid_argument);
  file = sample();
  file.tensors["\xff"] = Tensor::from<float>({}, {1.0f});
  EXPECT_THROW(write_safetensors(path_, file), std::invalid_argument);
  file = sample();
  file.tensors["__metadata__"] = Tensor::from<float>({}, {1.0f});
  EXPECT_THROW(write_safetensors(path_, file), std::invalid_argument);
  EXPECT_EQ(bytes(), before);

  EXPECT_THROW(write_safetensors(folder_ / "absent" / "file", sample()), InputError);
  fs::create_directories(folder_ / "taken" / "inside");
  EXPECT_THROW(write_safetensors(folder_ / "taken", sample()), std::runtime_error);  // the rename fails
  const auto entries = std::distance(fs::directory_iterator(folder_), fs::directory_iterator());
  EXPECT_EQ(entries, 2) << "a temporary file was left behind";
}

// A limit on the size of files stands in for a full disk.
TEST_F(Safetensors, LeavesTheOldFileWhenTheDiskIsFull) {
  write_safetensors(path_, sample());
  const std::string before = bytes();
  SafetensorsFile large;
  large.tensors["large"] = Tensor::from<float>({1 << 16}, std::vector<float>(1 << 16));
  rlimit original{};
  ASSERT_EQ(getrlimit(RLIMIT_FSIZE, &original), 0);
  const auto handler = std::signal(SIGXFSZ, SIG_IGN);
  const rlimit small{1 << 12, original.rlim_max};
  ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &small), 0);
  EXPECT_THROW(write_safetensors(path_, large), std::runtime_error);
  setrlimit(RLIMIT_FSIZE, &original);
  std::signal(SIGXFSZ, handler);
  EXPECT_EQ(bytes(), before);
  EXPECT_EQ(std::distance(fs::directory_iterator(folder_), fs::directory_iterator()), 1);
  write_safetensors(path_, large);
  EXPECT_EQ(read_safetensors(path_).at("large").count(), 1 << 16);
}

TEST_F(Safetensors, FromRefusesAWrongCount) {
  EXPECT_THROW(Tensor::from<float>({2, 2}, {1.0f}), std::invalid_argument);
  EXPECT_THROW(Tensor::from<float>({-1}, {1.0f}), std::invalid_argument);
}

TEST_F(Safetensors, ReadsEveryGoldenFile) {
  ARAH_SKIP_WITHOUT_GOLDEN();
  int files = 0;
  for (const auto& entry : fs::directory_iterator(golden::folder())) {
    if (entry.path().extension() != ".safetensors") continue;
    const SafetensorsFile file = read_safetensors(entry.path());
    EXPECT_FALSE(file.tensors.empty()) << entry.path();
    write_safetensors(path_, file);
    const SafetensorsFile again = read_safetensors(path_);
    EXPECT_EQ(again.metadata, file.metadata);
    for (const auto& [name, tensor] : file.tensors) EXPECT_EQ(again.at(name).data, tensor.data) << name;
    ++files;
  }
  EXPECT_GT(files, 0);
}

}  // namespace
}  // namespace arah

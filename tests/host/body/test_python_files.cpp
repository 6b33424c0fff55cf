// What Python's users store comes in as numbers, texts, lists, dictionaries and arrays; everything else, and everything
// damaged or hostile, is an error that names the file, and costs little memory.
#include <fmt/format.h>

#include "host/body/npy.h"
#include "host/body/npz.h"
#include "host/body/pickle.h"
#include "tests/host/body/memory_of_refusal.h"
#include "tests/host/body/python_files.h"
#include "tests/host/body/python_pickles.h"
#include "tests/host/body/rigs.h"

namespace arah {
namespace {

using testing::ElementsAre;

const PythonValue& at(const PythonValue& value, const char* name) { return python_member(value, name, "file", ""); }

// The numbers of the one array in a .npy file.
std::vector<double> npy_numbers(const std::string& file) {
  const PythonData data = parse_npy(file, "a.npy");
  return python_numbers(*data.root, -1, "a.npy", "");
}

void expect_refused_pickle(const std::string& value, const std::vector<std::string>& parts) {
  expect_input_error([&] { parse_pickle(python::pickle(value), "bad.pkl"); }, parts);
}

TEST(Npy, ReadsAllVersionsTypesAndOrders) {
  for (int version = 1; version <= 3; ++version) {
    EXPECT_THAT(npy_numbers(python::npy("<f4", {2, 2}, python::raw<float>({1, 2, 3, 4.5f}), false, version)), ElementsAre(1, 2, 3, 4.5));
  }
  EXPECT_THAT(npy_numbers(python::npy("<f8", {2}, python::raw<double>({-0.1, 1e300}))), ElementsAre(-0.1, 1e300));
  EXPECT_THAT(npy_numbers(python::npy("<f2", {4}, python::raw<std::uint16_t>({0x3c00, 0xc000, 0x3555, 1}))),
              ElementsAre(1, -2, 0.333251953125, 0x1p-24));
  EXPECT_THAT(npy_numbers(python::npy("<i8", {2}, python::raw<std::int64_t>({-5, 1ll << 40}))), ElementsAre(-5, 0x1p40));
  EXPECT_THAT(npy_numbers(python::npy("<u4", {1}, python::raw<std::uint32_t>({4294967295u}))), ElementsAre(4294967295.0));
  EXPECT_THAT(npy_numbers(python::npy("<i2", {1}, python::raw<std::int16_t>({-300}))), ElementsAre(-300));
  EXPECT_THAT(npy_numbers(python::npy("|i1", {1}, "\xff")), ElementsAre(-1));
  EXPECT_THAT(npy_numbers(python::npy("|u1", {1}, "\xff")), ElementsAre(255));
  EXPECT_THAT(npy_numbers(python::npy("|b1", {2}, std::string("\1\0", 2))), ElementsAre(1, 0));
  EXPECT_THAT(npy_numbers(python::npy(">i4", {1}, std::string("\0\0\1\2", 4))), ElementsAre(258));
  EXPECT_THAT(npy_numbers(python::npy("<f4", {}, python::raw<float>({7}))), ElementsAre(7));
  EXPECT_THAT(npy_numbers(python::npy("<f4", {0, 3}, "")), ElementsAre());
  // Rows 1 2 3 and 4 5 6, column after column.
  EXPECT_THAT(npy_numbers(python::npy("<f4", {2, 3}, python::raw<float>({1, 4, 2, 5, 3, 6}), true)), ElementsAre(1, 2, 3, 4, 5, 6));
  const std::string letters = python::npy("<U4", {}, python::raw<std::uint32_t>({'m', 0xe9, 0, 0}));
  EXPECT_EQ(python_text(*parse_npy(letters, "a.npy").root, "a.npy", ""), "m\xc3\xa9");
  const std::string saved = python::npy_of_value(python::dictionary({{"a", python::integer(3)}}));
  EXPECT_EQ(python_integer(at(*parse_npy(saved, "a.npy").root, "a"), "a.npy", "a"), 3);
}

TEST(Npy, RefusesWhatIsDamagedOrNoPlainArray) {
  const std::string whole = python::npy({2, 2}, {1, 2, 3, 4});
  for (std::size_t length = 0; length < whole.size(); ++length) {
    expect_input_error([&] { parse_npy(std::string_view(whole).substr(0, length), "cut.npy"); }, {"cut.npy"});
  }
  const auto refuse = [](const std::string& file, const std::string& part) {
    expect_input_error([&] { parse_npy(file, "bad.npy"); }, {"bad.npy", part});
  };
  refuse(whole + "x", "expected 32 bytes of elements, found 33");
  refuse("PNG", "NumPy");
  refuse(python::npy("<f8", {1u << 31, 1u << 31, 1u << 31}, ""), "an array that fits");
  refuse(python::npy("<c8", {1}, "12345678"), "'<c8'");
  refuse(python::npy("<f3", {1}, "123"), "'<f3'");
  refuse(python::npy("<f8", std::vector<std::size_t>(33, 1), "12345678"), "at most 32 axes");
  std::string structured = whole;
  structured.replace(structured.find("'<f8'"), 5, "[('a'");
  refuse(structured, "a structure of several");
  std::string version = whole;
  version[6] = 9;
  refuse(version, "expected 1 to 3, found 9");
  expect_input_error([] { read_npy("/no/such.npy"); }, {"/no/such.npy", "No such file"});
}

TEST(Pickle, ReadsPythonsOwnInAllProtocols) {
  for (const std::string& file : pickles_of_python()) {
    const PythonData data = parse_pickle(file, "a.pkl");
    const PythonValue& root = *data.root;
    EXPECT_THAT(python_numbers(at(root, "numbers"), 7, "a", ""), ElementsAre(1, -2, 300, 70000, 0x1p40, -0x1p40, 3.5));
    EXPECT_TRUE(std::holds_alternative<PythonNone>(at(root, "none").content));
    EXPECT_THAT(python_numbers(at(root, "truths"), 2, "a", ""), ElementsAre(1, 0));
    EXPECT_EQ(python_text(at(root, "text"), "a", ""), "h\xc3\xa9\xe2\x82\xac\n\\");
    EXPECT_EQ(python_text(at(root, "bytes"), "a", ""), std::string("\0\xff", 2));
    EXPECT_EQ(python_items(at(root, "empty"), 3, "a", "").size(), 3u);
    const PythonArray& array = python_array(at(root, "array"), {2, 2}, "a", "");
    EXPECT_EQ(array.number(3), 4.5);
    const std::vector<double> fortran = python_numbers(at(root, "fortran"), 4, "a", "");
    EXPECT_THAT(fortran, ElementsAre(1, 3, 2, 4));
    const auto& objects = python_items(at(root, "objects"), 2, "a", "");
    EXPECT_EQ(python_integer(*objects[0], "a", ""), 1);
    EXPECT_EQ(python_text(*objects[1], "a", ""), "two");
    EXPECT_THAT(python_numbers(at(at(root, "sparse"), "data"), 2, "a", ""), ElementsAre(0.25, 0.75));
    EXPECT_THAT(python_numbers(at(at(root, "sparse"), "_shape"), 2, "a", ""), ElementsAre(2, 3));
    EXPECT_THAT(python_numbers(at(at(root, "chumpy"), "x"), 2, "a", ""), ElementsAre(1.5, -2.0));
    EXPECT_THAT(python_excerpt(at(root, "chumpy")), "a chumpy.ch.Ch");
    for (std::size_t length = 0; length < file.size(); ++length) {
      expect_input_error([&] { parse_pickle(std::string_view(file).substr(0, length), "cut.pkl"); }, {"cut.pkl"});
    }
  }
}

TEST(Pickle, ReadsPythonTwosTextsAndProtocolFivesBuffers) {
  const std::string old = "(dp0\nS'key'\np1\nS'a\\x00\\\\\\n\\''\np2\nsS\"o\"\nI7\ns.";
  const PythonData data = parse_pickle(old, "old.pkl");
  EXPECT_EQ(python_text(at(*data.root, "key"), "old.pkl", ""), std::string("a\0\\\n'", 5));
  EXPECT_EQ(python_integer(at(*data.root, "o"), "old.pkl", ""), 7);
  const std::string elements = "\x96" + python::little(8, 8) + python::raw<float>({1, 2});
  const std::string buffer = python::call(python::name("numpy._core.numeric", "_frombuffer"),
                                          {elements, python::element_type("f4"), python::shape_of({2}), python::text("C")});
  const std::string file = "\x80\x05" + buffer + ".";
  EXPECT_THAT(python_numbers(*parse_pickle(file, "a").root, 2, "a", ""), ElementsAre(1, 2));
  const std::string scalar = python::call(python::name("numpy.core.multiarray", "scalar"),
                                          {python::element_type("i8"), python::bytes(python::raw<std::int64_t>({-9}))});
  const std::string scalar_file = python::pickle(scalar);
  EXPECT_EQ(python_integer(*parse_pickle(scalar_file, "a").root, "a", ""), -9);
}

TEST(Pickle, ExecutesNothingAndNamesWhatItRefuses) {
  expect_refused_pickle(python::call(python::name("os", "system"), {python::text("true")}), {"bad.pkl", "'os.system'", "Nothing of the file was executed"});
  expect_refused_pickle(python::name("builtins", "eval"), {"'builtins.eval'"});
  expect_refused_pickle(python::text("posix") + python::text("system") + "\x93", {"'posix.system'"});
  expect_refused_pickle("(iposix\nsystem\n", {"'posix.system'"});
  expect_refused_pickle("(" + python::name("builtins", "object") + "o", {"instruction 0x6f"});
  expect_refused_pickle("P17\n", {"instruction 0x50"});
  expect_refused_pickle("\x82\x01", {"instruction 0x82"});
  expect_refused_pickle(python::call(python::name("builtins", "object"), {}), {"a call of 'builtins.object'"});
  expect_refused_pickle(python::call(python::name("copyreg", "_reconstructor"), {python::name("numpy", "dtype"), python::name("builtins", "object"), "N"}),
                        {"an instance of 'numpy.dtype'"});
  expect_refused_pickle(python::name("numpy", "ndarray") + ")\x81", {"an instance of 'numpy.ndarray'"});
  expect_refused_pickle(python::name("numpy\x1b[31m", "x"), {"'numpy?[31m.x'"});  // nothing of the file reaches the terminal
}

TEST(Pickle, RefusesWrongTypes) {
  expect_refused_pickle(python::call(python::integer(3), {}), {"expected a name, found 3"});
  expect_refused_pickle("}" + python::integer(1) + "a", {"expected a list, found a dictionary"});
  expect_refused_pickle("]" + python::integer(1) + python::integer(2) + "s", {"expected a dictionary, found a list"});
  expect_refused_pickle("}(" + python::integer(1) + "u", {"a value for each key"});
  expect_refused_pickle(python::integer(1) + "}b", {"another value with a state"});
  expect_refused_pickle("", {"an empty stack"});
  expect_refused_pickle("t", {"a mark"});
  expect_refused_pickle("h\x05", {"stored before"});
  expect_refused_pickle("\x8a\xff" + std::string(255, 'x'), {"at most 8 bytes"});
  expect_refused_pickle("Inine\n", {"expected a number, found 'nine'"});
  expect_refused_pickle("S'open\n", {"in quotes"});
  expect_refused_pickle(python::array("f8", {2}, python::bytes("12345678")), {"expected 16 bytes in an array, found 8"});
  expect_refused_pickle(python::array("f8", {1}, python::text("12345678")), {"expected bytes"});
  expect_refused_pickle(python::array("f8", {1ull << 40, 1ull << 40}, python::bytes("")), {"an array that fits"});
  expect_refused_pickle(python::array("O8", {3}, python::list({"N"})), {"expected 3 values in an array, found 1"});
  expect_refused_pickle(python::array("M8", {1}, python::bytes("12345678")), {"'M8'"});
  expect_refused_pickle(python::call(python::name("numpy", "dtype"), {python::text("V8")}), {"'V8'"});
  expect_refused_pickle(python::call(python::name("_codecs", "encode"), {python::text("a"), python::text("zlib")}), {"the codec latin1"});
  const std::string file = python::pickle(python::dictionary({{"a", python::text("x")}, {"n", python::real(0.0 / 0.0)}}));
  const PythonData data = parse_pickle(file, "a.pkl");
  expect_input_error([&] { python_member(*data.root, "b", "a.pkl", "cams"); }, {"a.pkl: cams b: expected this entry, found none"});
  expect_input_error([&] { python_numbers(at(*data.root, "a"), 1, "a.pkl", "K"); }, {"a.pkl: K: expected numbers, found 'x'"});
  expect_input_error([&] { python_numbers(at(*data.root, "n"), 1, "a.pkl", "K"); }, {"finite"});
  expect_input_error([&] { python_items(at(*data.root, "a"), 1, "a.pkl", "K"); }, {"expected a list, found 'x'"});
  expect_input_error([&] { python_array(at(*data.root, "a"), {3, -1}, "a.pkl", "K"); }, {"an array of 3xN numbers"});
}

TEST(Pickle, RefusesCyclesAndDepth) {
  expect_refused_pickle("]q\x01h\x01" "a", {"do not contain themselves", "a list of 1"});
  expect_refused_pickle("]q\x01(h\x01t" "a", {"do not contain themselves"});
  expect_refused_pickle("}q\x01" + python::text("me") + "h\x01s", {"do not contain themselves", "a dictionary"});
  expect_refused_pickle(python::name("chumpy.ch", "Ch") + ")\x81q\x01}" + python::text("x") + "h\x01sb", {"do not contain themselves"});
  std::string deep;
  for (int i = 0; i < 100'000; ++i) deep += ']';
  for (int i = 0; i < 99'999; ++i) deep += 'a';
  expect_refused_pickle(deep, {"at most 64 deep"});
  // Shared values reach down as far as anywhere else: 40 levels on top of the same 40 levels.
  std::string shared(40, ']');
  shared += std::string(39, 'a') + "q\x01" + "0";
  std::string above(40, ']');
  expect_refused_pickle(shared + above + "h\x01" + std::string(40, 'a'), {"at most 64 deep"});
  // Forty lists of two, each twice the one before: 2^40 paths through it, visited once.
  std::string doubled = "]";
  for (char i = 1; i <= 40; ++i) doubled += std::string("q") + i + "0](h" + i + "h" + i + "e";
  const std::string file = python::pickle(doubled);
  EXPECT_EQ(python_items(*parse_pickle(file, "a").root, 2, "a", "").size(), 2u);
}

TEST(Pickle, BombsStayUnderHalfAGigabyte) {
  const TemporaryFolder folder;
  const auto expect_small = [&](const std::string& title, const std::string& value) {
    const auto path = folder.write("bomb.pkl", python::pickle(value));
    const std::uint64_t bytes = memory_of_refusal([&] { read_pickle(path); });
    std::printf("  %-28s %4.0f MB\n", title.c_str(), 1e-6 * static_cast<double>(bytes));
    EXPECT_LT(bytes, kMostMemoryOfRefusal) << title;
  };
  const auto repeated = [&](const std::string& start, const std::string& instruction, int times) {
    std::string all = start;
    for (int i = 0; i < times; ++i) all += instruction;
    return all;
  };
  expect_small("values on the stack", std::string(20'000'000, 'N'));
  expect_small("marks", std::string(20'000'000, '('));
  expect_small("integers", repeated("", std::string("K\1", 2), 4'000'000));
  expect_small("lists", std::string(20'000'000, ']'));
  expect_small("arrays", repeated(python::name("numpy.core.multiarray", "_reconstruct") + "q\1" "0" + python::tuple({python::name("numpy", "ndarray"), ")", "N"}) + "q\2" "0",
                                  "h\1h\2R", 3'000'000));
  expect_small("a far place in the memo", "Nr" + python::little(4'000'000'000, 4));
  expect_small("one text decoded again", repeated(python::name("_codecs", "encode") + "q\1" "0" + python::tuple({python::text(std::string(1 << 20, 'x')), python::text("latin1")}) + "q\2" "0",
                                                  "h\1h\2R", 1000));
  std::string many = "](";
  many += std::string(1'000'000, 'N') + "eq\1" "0";
  expect_small("one list copied again", repeated(many + python::name("builtins", "set") + "q\2" "0h\1\x85q\3" "0", "h\2h\3R", 1000));
  expect_small("appended to itself", repeated("](" + std::string(1000, 'N') + "eq\1", "(h\1h\1h\1e", 2'000'000));
}

TEST(Npz, ReadsStoredAndDeflatedArrays) {
  const TemporaryFolder folder;
  std::vector<double> many(10'000);
  for (std::size_t i = 0; i < many.size(); ++i) many[i] = static_cast<double>(i * i % 977);
  for (const bool deflate_them : {false, true}) {
    const NpzFile file(folder.write("a.npz", python::npz({{"poses", python::npy({100, 100}, many)},
                                                           {"gender", python::npy("<U7", {}, python::raw<std::uint32_t>({'n', 'e', 'u', 't', 'r', 'a', 'l'}))},
                                                           {"values", python::npy_of_value(python::list({python::integer(4)}))}},
                                                          deflate_them)));
    EXPECT_THAT(file.names(), ElementsAre("gender", "poses", "values"));
    EXPECT_EQ(python_numbers(*file.read("poses").root, 10'000, "a.npz", "poses"), many);
    EXPECT_EQ(python_text(*file.read("gender").root, "a.npz", "gender"), "neutral");
    EXPECT_EQ(python_integer(*file.read("values").root, "a.npz", "values"), 4);
    expect_input_error([&] { file.read("trans"); }, {"a.npz: trans: expected this array, found none"});
  }
}

TEST(Npz, RefusesDamageAndBombs) {
  const TemporaryFolder folder;
  const std::string whole = python::npz({{"a", python::npy({2}, {1, 2})}, {"b", python::npy({2}, {3, 4})}});
  const auto read_both = [&](const std::string& content) {
    const NpzFile file(folder.write("bad.npz", content));
    file.read("a");
    file.read("b");
  };
  read_both(whole);
  for (std::size_t length = 0; length < whole.size(); ++length) {
    expect_input_error([&] { read_both(whole.substr(0, length)); }, {"bad.npz"});
  }
  // One bit wrong anywhere: an error that names the file, or the same numbers (times, comments and versions do not count).
  int refused = 0;
  for (std::size_t i = 0; i < whole.size(); ++i) {
    std::string changed = whole;
    changed[i] = static_cast<char>(changed[i] ^ 0x10);
    try {
      read_both(changed);
      const NpzFile file(folder / "bad.npz");
      EXPECT_EQ(python_numbers(*file.read("a").root, 2, "", ""), (std::vector<double>{1, 2}));
    } catch (const InputError& error) {
      ++refused;
      EXPECT_THAT(error.what(), testing::HasSubstr("bad.npz"));
    }
  }
  EXPECT_GT(refused, 200);

  const auto refuse_file = [&](const std::string& content, const std::string& part) {
    const auto path = folder.write("bomb.npz", content);
    expect_input_error([&] { NpzFile(path).read("a"); }, {"bomb.npz", part});
    EXPECT_LT(memory_of_refusal([&] { NpzFile(path).read("a"); }), kMostMemoryOfRefusal);
  };
  const auto refuse = [&](const std::vector<python::Member>& members, const std::string& part) { refuse_file(python::zip(members), part); };
  // The zeros themselves are gone when the memory is measured.
  refuse_file([] { return python::npz({{"a", python::npy("|u1", {200'000'000}, std::string(200'000'000, '\0'))}}); }(), "deflates to no less than a 400th");
  refuse({{"a.npy", python::npy({2}, {1, 2}), true, 4'000'000'000}}, "as its header says");
  refuse({{"a.npy", python::npy("|u1", {4'000'000'000 - 138}, ""), true, 4'000'000'000}}, "at most 320000000 bytes");
  refuse({{"a.npy", python::npy({2}, {1, 2})}, {"a.npy", python::npy({2}, {1, 2})}}, "each member once");
  refuse({{"a.npy", "no array"}}, "NumPy");
}

}  // namespace
}  // namespace arah

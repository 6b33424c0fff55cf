#include "host/body/pickle.h"

#include <bit>
#include <charconv>

#include "host/body/mapped_file.h"
#include "host/body/pickle_names.h"
#include "host/input_error.h"

namespace arah {
namespace {

constexpr std::uint8_t kBeingVisited = 255;
static_assert(kMostPickleDepth < kBeingVisited);

// Python's stack machine, less everything that executes. Names of instructions as in Python's pickletools.
class PickleMachine {
 public:
  PickleMachine(std::string_view bytes, const std::string& where)
      : bytes_(bytes), where_(where), store_(data_, where), none_(store_.make(PythonNone{})),
        true_(store_.make(true)), false_(store_.make(false)) {}

  PythonData run() {
    while (true) {
      store_.place = at_;
      const auto instruction = static_cast<unsigned char>(take(1)[0]);
      if (instruction == '.') break;  // STOP
      step(instruction);
    }
    data_.root = pop();
    check_tree();
    return std::move(data_);
  }

 private:
  [[noreturn]] void fail(const std::string& expected, const std::string& found, const std::string& advice = "") const {
    throw InputError(where_, store_.field(), expected, found, advice);
  }

  // --- bytes

  std::string_view take(std::size_t count) {
    if (count > bytes_.size() - at_) {
      fail(fmt::format("{} more bytes", count), fmt::format("{}, the file's last", bytes_.size() - at_), "Copy it again.");
    }
    at_ += count;
    return bytes_.substr(at_ - count, count);
  }
  // Little-endian and unsigned.
  std::size_t number(std::size_t bytes) {
    std::size_t value = 0, shift = 0;
    for (const char byte : take(bytes)) {
      value |= std::size_t{static_cast<unsigned char>(byte)} << shift;
      shift += 8;
    }
    return value;
  }
  std::string_view line() {
    const std::size_t end = bytes_.find('\n', at_);
    if (end == bytes_.npos) fail("the end of a line", "the end of the file", "Copy it again.");
    const std::string_view text = bytes_.substr(at_, end - at_);
    at_ = end + 1;
    return text;
  }
  template <typename Number>
  Number decimal(std::string_view text) const {
    Number value{};
    const auto [stop, error] = std::from_chars(text.data(), text.data() + text.size(), value);
    if (error != std::errc() || stop != text.data() + text.size()) {
      fail("a number", python_excerpt(PythonValue{text}));
    }
    return value;
  }
  // Two's complement, as many bytes as it needs.
  std::int64_t long_integer(std::size_t count) {
    if (count > 8) fail("integers of at most 8 bytes", fmt::format("one of {}", count));
    if (count == 0) return 0;
    const std::size_t shift = 64 - 8 * count;
    return static_cast<std::int64_t>(number(count) << shift) >> shift;
  }

  // --- stack and memo

  void push(PythonValue* value) {
    if (++steps_ > kMostPickleSteps) fail(fmt::format("at most {} steps", kMostPickleSteps), "more");
    stack_.push_back(value);
  }
  std::size_t floor() const { return marks_.empty() ? 0 : marks_.back(); }
  PythonValue* top() const {
    if (stack_.size() <= floor()) fail("a value", "an empty stack");
    return stack_.back();
  }
  PythonValue* pop() {
    PythonValue* value = top();
    stack_.pop_back();
    return value;
  }
  std::vector<const PythonValue*> pop_to_mark() {
    if (marks_.empty()) fail("a mark", "none");
    std::vector<const PythonValue*> items(stack_.begin() + static_cast<std::ptrdiff_t>(marks_.back()), stack_.end());
    stack_.resize(marks_.back());
    marks_.pop_back();
    return items;
  }
  std::vector<const PythonValue*> pop_some(std::size_t count) {
    std::vector<const PythonValue*> items(count);
    while (count-- > 0) items[count] = pop();
    return items;
  }
  void remember(std::size_t place) {
    if (place > kMostPickleSteps) fail("a smaller place in the memo", fmt::format("{}", place));
    if (place >= memo_.size()) memo_.resize(std::max(place + 1, memo_.size() + memo_.size() / 2));
    memo_[place] = top();
    remembered_ = std::max(remembered_, place + 1);
  }
  PythonValue* recall(std::size_t place) const {
    if (place >= memo_.size() || !memo_[place]) fail("a value that was stored before", fmt::format("place {}", place));
    return memo_[place];
  }
  template <typename Content>
  Content& top_as(const char* expected) const {
    auto* content = std::get_if<Content>(&top()->content);
    if (!content) fail(expected, python_excerpt(*top()));
    return *content;
  }
  void append(std::vector<const PythonValue*> items) {
    auto& list = top_as<PythonList>("a list").items;
    list.insert(list.end(), items.begin(), items.end());
  }
  void set_items(const std::vector<const PythonValue*>& items) {
    if (items.size() % 2 != 0) fail("a value for each key", "one without");
    auto& dictionary = top_as<PythonDictionary>("a dictionary").items;
    for (std::size_t i = 0; i < items.size(); i += 2) dictionary.emplace_back(items[i], items[i + 1]);
  }

  // --- texts

  std::string_view as_text(const PythonValue* value) const {
    const auto* text = std::get_if<std::string_view>(&value->content);
    if (!text) fail("a text", python_excerpt(*value));
    return *text;
  }
  static unsigned hexadecimal(std::string_view digits) {
    unsigned value = 0;
    const auto [stop, error] = std::from_chars(digits.data(), digits.data() + digits.size(), value, 16);
    return error == std::errc() && stop == digits.data() + digits.size() ? value : ~0u;
  }
  // STRING: bytes in quotes, with Python's escapes.
  std::string_view quoted(std::string_view text) {
    if (text.size() < 2 || text.front() != text.back() || (text.front() != '\'' && text.front() != '"')) {
      fail("a text in quotes", python_excerpt(PythonValue{text}));
    }
    text = text.substr(1, text.size() - 2);
    if (text.find('\\') == text.npos) return text;
    std::string bytes;
    bytes.reserve(text.size());
    for (std::size_t i = 0; i < text.size(); ++i) {
      if (text[i] != '\\') {
        bytes += text[i];
        continue;
      }
      const char escape = ++i < text.size() ? text[i] : ' ';
      const std::size_t simple = std::string_view("ntr\\'\"").find(escape);
      if (simple != std::string_view::npos) {
        bytes += "\n\t\r\\'\""[simple];
      } else {
        const unsigned value = escape == 'x' && i + 2 < text.size() ? hexadecimal(text.substr(i + 1, 2)) : ~0u;
        if (value > 255) fail("an escape that Python writes", fmt::format("another after {} letters", i));
        bytes += static_cast<char>(value);
        i += 2;
      }
    }
    return store_.keep(std::move(bytes));
  }
  // UNICODE: letters up to 255 as they are, others and backslashes as \uXXXX; the result is UTF-8.
  std::string_view raw_unicode(std::string_view text) {
    std::string letters;
    for (std::size_t i = 0; i < text.size(); ++i) {
      unsigned letter = static_cast<unsigned char>(text[i]);
      if (letter == '\\' && i + 1 < text.size() && text[i + 1] == 'u') {
        letter = i + 5 < text.size() ? hexadecimal(text.substr(i + 2, 4)) : ~0u;
        if (letter > 0xffff) fail("an escape that Python writes", fmt::format("another after {} letters", i));
        i += 5;
      }
      if (letter < 0x80) {
        letters += static_cast<char>(letter);
      } else if (letter < 0x800) {
        letters += static_cast<char>(0xc0 | letter >> 6);
        letters += static_cast<char>(0x80 | (letter & 63));
      } else {
        letters += static_cast<char>(0xe0 | letter >> 12);
        letters += static_cast<char>(0x80 | (letter >> 6 & 63));
        letters += static_cast<char>(0x80 | (letter & 63));
      }
    }
    return store_.keep(std::move(letters));
  }

  // --- names

  [[noreturn]] void refuse_name(std::string_view module, std::string_view name) const {
    const std::string full = fmt::format("{}.{}", module, name);
    fail("plain data: numbers, texts, lists, dictionaries, arrays", python_excerpt(PythonValue{std::string_view(full)}),
         "Nothing of the file was executed.");
  }
  PythonValue* named(std::string_view module, std::string_view name) {
    const auto known = known_pickle_name(module, name);
    if (!known) refuse_name(module, name);
    return store_.make(PythonName{known->name});
  }
  std::string_view popped_name() {
    const PythonValue* value = pop();
    const auto* name = std::get_if<PythonName>(&value->content);
    if (!name) fail("a name", python_excerpt(*value));
    return name->name;
  }

  void step(unsigned char instruction) {
    switch (instruction) {
      // frames, marks and the memo
      case 0x80: {  // PROTO
        const std::size_t protocol = number(1);
        if (protocol > 5) fail("protocol 0 to 5", fmt::format("{}", protocol));
        return;
      }
      case 0x95: return void(number(8));  // FRAME: a hint for reading
      case '(':
        if (++steps_ > kMostPickleSteps) fail(fmt::format("at most {} steps", kMostPickleSteps), "more");
        return marks_.push_back(stack_.size());
      case '0': return void(pop());
      case '1': return void(pop_to_mark());
      case '2': return push(top());
      case 'p': return remember(decimal<std::size_t>(line()));
      case 'q': return remember(number(1));
      case 'r': return remember(number(4));
      case 0x94: return remember(remembered_);  // MEMOIZE
      case 'g': return push(recall(decimal<std::size_t>(line())));
      case 'h': return push(recall(number(1)));
      case 'j': return push(recall(number(4)));

      // numbers
      case 'N': return push(none_);
      case 0x88: return push(true_);
      case 0x89: return push(false_);
      case 'I': {
        const std::string_view text = line();
        if (text == "00" || text == "01") return push(text == "01" ? true_ : false_);
        return push(store_.make(decimal<std::int64_t>(text)));
      }
      case 'L': {
        std::string_view text = line();
        if (text.ends_with('L')) text.remove_suffix(1);
        return push(store_.make(decimal<std::int64_t>(text)));
      }
      case 'J': return push(store_.make(std::int64_t{static_cast<std::int32_t>(number(4))}));
      case 'K': return push(store_.make(static_cast<std::int64_t>(number(1))));
      case 'M': return push(store_.make(static_cast<std::int64_t>(number(2))));
      case 0x8a: return push(store_.make(long_integer(number(1))));
      case 0x8b: return push(store_.make(long_integer(number(4))));
      case 'F': return push(store_.make(decimal<double>(line())));
      case 'G': return push(store_.make(std::bit_cast<double>(__builtin_bswap64(number(8)))));  // stored with its highest byte first

      // texts and bytes; Python 2's texts are bytes
      case 'S': return push(store_.make(PythonBytes{quoted(line())}));
      case 'T': return push(store_.make(PythonBytes{take(number(4))}));
      case 'U': return push(store_.make(PythonBytes{take(number(1))}));
      case 'V': return push(store_.make(raw_unicode(line())));
      case 'X': return push(store_.make(take(number(4))));
      case 0x8c: return push(store_.make(take(number(1))));
      case 0x8d: return push(store_.make(take(number(8))));
      case 'B': return push(store_.make(PythonBytes{take(number(4))}));
      case 'C': return push(store_.make(PythonBytes{take(number(1))}));
      case 0x8e:
      case 0x96: return push(store_.make(PythonBytes{take(number(8))}));

      // lists, tuples, sets and dictionaries
      case ']':
      case ')':
      case 0x8f: return push(store_.make(PythonList{}));
      case 'l':
      case 't':
      case 0x91: {
        auto items = pop_to_mark();
        return push(store_.make(PythonList{std::move(items)}));
      }
      case 0x85:
      case 0x86:
      case 0x87: {
        auto items = pop_some(instruction - 0x84u);
        return push(store_.make(PythonList{std::move(items)}));
      }
      case 'a': return append(pop_some(1));
      case 'e':
      case 0x90: return append(pop_to_mark());
      case '}': return push(store_.make(PythonDictionary{}));
      case 'd': {
        const auto items = pop_to_mark();
        push(store_.make(PythonDictionary{}));
        return set_items(items);
      }
      case 's': return set_items(pop_some(2));
      case 'u': return set_items(pop_to_mark());

      // names, and what they stand for
      case 'c': {
        const std::string_view module = line();
        return push(named(module, line()));
      }
      case 0x93: {
        const PythonValue* name = pop();
        return push(named(as_text(pop()), as_text(name)));
      }
      case 'R': {
        const PythonValue* arguments = pop();
        return push(pickled_call(store_, popped_name(), *arguments));
      }
      case 0x81: {
        const PythonValue* arguments = pop();
        const auto* none = std::get_if<PythonList>(&arguments->content);
        if (!none || !none->items.empty()) fail("an instance without arguments", python_excerpt(*arguments));
        return push(pickled_instance(store_, popped_name()));
      }
      case 'b': {
        const PythonValue* state = pop();
        return set_pickled_state(store_, *top(), *state);
      }
      case 'i': {
        const std::string_view module = line();
        refuse_name(module, line());
      }
      default:
        fail("an instruction that builds plain data", fmt::format("instruction 0x{:02x}", instruction),
             "Nothing of the file was executed.");
    }
  }

  // --- the finished tree

  static const PythonValue* child(const PythonValue& value, std::size_t index) {
    if (const auto* list = std::get_if<PythonList>(&value.content)) return index < list->items.size() ? list->items[index] : nullptr;
    if (const auto* dictionary = std::get_if<PythonDictionary>(&value.content)) {
      if (index / 2 >= dictionary->items.size()) return nullptr;
      const auto& item = dictionary->items[index / 2];
      return index % 2 ? item.second : item.first;
    }
    if (const auto* array = std::get_if<std::unique_ptr<PythonArray>>(&value.content)) {
      return index < (*array)->items.size() ? (*array)->items[index] : nullptr;
    }
    const auto* object = std::get_if<PythonObject>(&value.content);
    return object && index == 0 ? object->state : nullptr;
  }

  // Readers go down without looking for cycles or counting: nothing may contain itself or be deep. Values that several
  // others share are visited once; `height` keeps how far they reach down.
  void check_tree() const {
    struct Visit {
      PythonValue* value;
      std::size_t next = 0;
      std::size_t height = 1;
    };
    std::vector<Visit> path;
    const auto enter = [&](const PythonValue* value) {
      path.push_back({const_cast<PythonValue*>(value)});
      path.back().value->height = kBeingVisited;
    };
    enter(data_.root);
    while (!path.empty()) {
      const PythonValue* below = child(*path.back().value, path.back().next++);
      std::size_t reach = 0;
      if (!below) {
        reach = path.back().height;
        path.back().value->height = static_cast<std::uint8_t>(reach);
        path.pop_back();
        if (path.empty()) return;
      } else if (below->height == kBeingVisited) {
        throw InputError(where_, "", "values that do not contain themselves", python_excerpt(*below) + " that does");
      } else if (below->height == 0) {
        if (path.size() >= kMostPickleDepth) too_deep();
        enter(below);
        continue;
      } else {
        reach = below->height;
      }
      if (path.size() + reach > kMostPickleDepth) too_deep();
      path.back().height = std::max(path.back().height, reach + 1);
    }
  }
  [[noreturn]] void too_deep() const {
    throw InputError(where_, "", fmt::format("values at most {} deep in one another", kMostPickleDepth), "deeper ones");
  }

  std::string_view bytes_;
  const std::string& where_;
  std::size_t at_ = 0;
  PythonData data_;
  PickleStore store_;
  PythonValue *none_, *true_, *false_;
  std::vector<PythonValue*> stack_, memo_;
  std::vector<std::size_t> marks_;
  std::size_t steps_ = 0, remembered_ = 0;
};

}  // namespace

PythonData parse_pickle(std::string_view bytes, const std::string& where) { return PickleMachine(bytes, where).run(); }

PythonData read_pickle(const std::filesystem::path& path) {
  const auto file = std::make_shared<const MappedFile>(path);
  PythonData data = parse_pickle(file->bytes(), path.string());
  data.file = file;
  return data;
}

}  // namespace arah

#include "host/training/ranks.h"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstdlib>
#include <nlohmann/json.hpp>
#include <numeric>
#include <stdexcept>
#include <thread>

#include "host/input_error.h"
#ifdef ARAH_MPI
#include <mpi.h>
#endif

namespace arah {
Ranks::Part Ranks::part_of(uint32_t count, uint32_t unit, uint32_t rank, const std::vector<uint32_t>& shares) {
  const uint64_t ranks = shares.size(), units = (uint64_t{count} + unit - 1) / unit, all = std::accumulate(shares.begin(), shares.end(), uint64_t{0});
  const auto begin = [&](uint64_t r) {
    const uint64_t before = std::accumulate(shares.begin(), shares.begin() + static_cast<std::ptrdiff_t>(r), uint64_t{0});
    const uint64_t first = units >= ranks ? r + (units - ranks) * before / all : units * before / all;
    return static_cast<uint32_t>(std::min<uint64_t>(count, first * unit));
  };
  return {begin(rank), begin(rank + 1)};
}

Ranks::Part Ranks::part(uint32_t count, uint32_t unit) const { return part_of(count, unit, rank_, shares_.empty() ? std::vector<uint32_t>(count_, 1) : shares_); }

void Ranks::set_shares(std::vector<uint32_t> shares) {
  const bool some = !shares.empty();
  if (some && (shares.size() != count_ || std::find(shares.begin(), shares.end(), 0u) != shares.end()))
    throw InputError("shares", "", fmt::format("{}, one a rank, each from 1 on", count_), fmt::format("{}", fmt::join(shares, ",")));
  agree({{"shares", fmt::format("{}", fmt::join(shares, ","))}});
  shares_ = std::move(shares);
}

bool Ranks::all_alike(const std::string& text) const {
  const std::vector<std::string> all = gather(text);
  return std::all_of(all.begin(), all.end(), [&](const std::string& other) { return other == all[0]; });
}

uint64_t Ranks::before(uint64_t own) const {
  std::vector<double> all(count_, 0.0);
  all[rank_] = static_cast<double>(own);
  sum(all);
  double sum_before = 0;
  for (uint32_t r = 0; r < rank_; ++r) sum_before += all[r];
  return static_cast<uint64_t>(sum_before);
}

uint64_t Ranks::broadcast(uint64_t number) const {
  std::string text = std::to_string(number);
  broadcast(text);
  return std::strtoull(text.c_str(), nullptr, 10);
}

void Ranks::agree(const std::map<std::string, std::string>& facts) const {
  if (count_ == 1) return;
  const std::vector<std::string> all = gather(nlohmann::json(facts).dump(-1, ' ', false, nlohmann::json::error_handler_t::replace));
  const auto first = nlohmann::json::parse(all[0]);
  for (uint32_t r = 1; r < count_; ++r) {
    const auto other = nlohmann::json::parse(all[r]);
    for (const auto& [some, more] : {std::pair{&first, &other}, {&other, &first}})
      for (const auto& [name, value] : some->items()) {
        if (more->contains(name) && (*more)[name] == value) continue;
        const auto text = [&, key = name](const nlohmann::json& of) { return of.contains(key) ? of[key].get<std::string>() : std::string("nothing"); };
        throw InputError(fmt::format("rank {}", r), name, fmt::format("what rank 0 has, {}", text(first)), text(other), "Start all ranks with the same program, files and options.");
      }
  }
}

#ifdef ARAH_MPI

namespace {

std::vector<MPI_Comm> groups{MPI_COMM_WORLD};  // by Ranks::group_
// Numbers that are exchanged together, so that the room for them stays small beside a large avatar's: 64 MiB of floats.
constexpr std::size_t numbers_at_a_time = std::size_t{1} << 24;
constexpr std::size_t bytes_at_a_time = std::size_t{1} << 26;

// Variables that launchers set for each process: Open MPI, PMIx (Slurm), MPICH.
bool launched() {
  for (const char* name : {"OMPI_COMM_WORLD_SIZE", "PMIX_RANK", "PMI_SIZE"})
    if (std::getenv(name)) return true;
  return false;
}

bool joined = false, together = false;
std::vector<int64_t> processes;  // by rank: its id; 0: on another machine

void refuse(int code, const char* call) {
  if (code != MPI_SUCCESS) throw std::runtime_error(fmt::format("{}: MPI error {}", call, code));
}

// The rank on this machine whose process is gone; -1: none.
int gone() {
  for (std::size_t r = 0; r < processes.size(); ++r)
    if (processes[r] && ::kill(static_cast<pid_t>(processes[r]), 0) != 0 && errno == ESRCH) return static_cast<int>(r);
  return -1;
}

// MPI's own waiting keeps a core busy, which a CPU device wants, and never ends where a rank has died.
void wait_for(MPI_Request& request) {
  using namespace std::chrono_literals;
  const auto done = [&] {
    int yes = 0;
    refuse(MPI_Test(&request, &yes, MPI_STATUS_IGNORE), "MPI_Test");
    return yes != 0;
  };
  for (int tries = 0; tries < 1000; ++tries)
    if (done()) return;
  for (uint64_t tries = 1;; ++tries) {
    std::this_thread::sleep_for(50us);
    if (done()) return;
    if (tries % 1000) continue;
    const int rank = gone();
    if (rank < 0) continue;
    // What it sent before its end may still be on its way.
    for (int more = 0; more < 1000; ++more) {
      std::this_thread::sleep_for(50us);
      if (done()) return;
    }
    throw std::runtime_error(fmt::format("rank {} of {} (process {}) has died", rank, processes.size(), processes[static_cast<std::size_t>(rank)]));
  }
}

template <typename Number>
void sum_in_order(std::span<Number> values, MPI_Datatype type, uint32_t rank, uint32_t ranks, MPI_Comm group) {
  for (std::size_t first = 0; first < values.size(); first += numbers_at_a_time) {
    const std::span<Number> some = values.subspan(first, std::min(numbers_at_a_time, values.size() - first));
    // Rank r adds up part r, of which it gets everyone's.
    std::vector<int> counts, begins;
    const std::vector<uint32_t> even(ranks, 1);
    for (uint32_t r = 0; r < ranks; ++r) {
      const Ranks::Part part = Ranks::part_of(static_cast<uint32_t>(some.size()), 1, r, even);
      counts.push_back(static_cast<int>(part.size()));
      begins.push_back(static_cast<int>(part.begin));
    }
    const std::size_t own = static_cast<std::size_t>(counts[rank]);
    const std::vector<int> own_counts(ranks, counts[rank]);
    std::vector<int> own_begins;
    for (uint32_t r = 0; r < ranks; ++r) own_begins.push_back(static_cast<int>(r) * counts[rank]);
    std::vector<Number> all(ranks * own);
    MPI_Request request;
    refuse(MPI_Ialltoallv(some.data(), counts.data(), begins.data(), type, all.data(), own_counts.data(), own_begins.data(), type, group, &request), "MPI_Ialltoallv");
    wait_for(request);
    for (uint32_t r = 1; r < ranks; ++r)
      for (std::size_t i = 0; i < own; ++i) all[i] += all[r * own + i];
    refuse(MPI_Iallgatherv(all.data(), counts[rank], type, some.data(), counts.data(), begins.data(), type, group, &request), "MPI_Iallgatherv");
    wait_for(request);
  }
}

}  // namespace

const Ranks& Ranks::of_process() {
  static const Ranks ranks = [] {
    Ranks result;
    if (!launched()) return result;
    int level = 0, rank = 0, count = 1, on_machine = 0;
    refuse(MPI_Init_thread(nullptr, nullptr, MPI_THREAD_FUNNELED, &level), "MPI_Init_thread");
    joined = true;
    refuse(MPI_Comm_rank(MPI_COMM_WORLD, &rank), "MPI_Comm_rank");
    refuse(MPI_Comm_size(MPI_COMM_WORLD, &count), "MPI_Comm_size");
    MPI_Comm machine;
    refuse(MPI_Comm_split_type(MPI_COMM_WORLD, MPI_COMM_TYPE_SHARED, rank, MPI_INFO_NULL, &machine), "MPI_Comm_split_type");
    refuse(MPI_Comm_rank(machine, &on_machine), "MPI_Comm_rank");
    // (rank, process) of this machine's.
    int here = 1;
    refuse(MPI_Comm_size(machine, &here), "MPI_Comm_size");
    const int64_t own[2]{rank, ::getpid()};
    std::vector<int64_t> all(2 * static_cast<std::size_t>(here));
    refuse(MPI_Allgather(own, 2, MPI_INT64_T, all.data(), 2, MPI_INT64_T, machine), "MPI_Allgather");
    processes.assign(static_cast<std::size_t>(count), 0);
    for (std::size_t i = 0; i < all.size(); i += 2) processes[static_cast<std::size_t>(all[i])] = all[i + 1];
    MPI_Comm_free(&machine);
    result.rank_ = static_cast<uint32_t>(rank);
    result.count_ = static_cast<uint32_t>(count);
    result.on_machine_ = static_cast<uint32_t>(on_machine);
    return result;
  }();
  return ranks;
}

void Ranks::end_together() { together = true; }

int Ranks::leave(int code) {
  if (!joined) return code;
  if (code != 0 && !together && processes.size() > 1) MPI_Abort(MPI_COMM_WORLD, code);
  of_process().wait_for_all();
  MPI_Finalize();
  return code;
}

void Ranks::sum(std::span<float> values) const {
  if (count_ > 1) sum_in_order(values, MPI_FLOAT, rank_, count_, groups[group_]);
}
void Ranks::sum(std::span<double> values) const {
  if (count_ > 1) sum_in_order(values, MPI_DOUBLE, rank_, count_, groups[group_]);
}
void Ranks::sum(std::span<uint32_t> values) const {
  if (count_ > 1) sum_in_order(values, MPI_UINT32_T, rank_, count_, groups[group_]);
}

Ranks Ranks::first_ranks(uint32_t count) const {
  Ranks result;
  if (count_ == 1) return result;
  MPI_Comm group = MPI_COMM_NULL;
  refuse(MPI_Comm_split(groups[group_], rank_ < count ? 0 : MPI_UNDEFINED, static_cast<int>(rank_), &group), "MPI_Comm_split");
  if (rank_ >= count) return result;
  result.rank_ = rank_, result.count_ = count, result.on_machine_ = on_machine_;
  result.group_ = groups.size();
  groups.push_back(group);
  return result;
}

void Ranks::broadcast(std::span<float> values) const {
  if (count_ == 1) return;
  for (std::size_t first = 0; first < values.size(); first += numbers_at_a_time) {
    MPI_Request request;
    refuse(MPI_Ibcast(values.data() + first, static_cast<int>(std::min(numbers_at_a_time, values.size() - first)), MPI_FLOAT, 0, groups[group_], &request), "MPI_Ibcast");
    wait_for(request);
  }
}

void Ranks::broadcast(std::string& bytes) const {
  if (count_ == 1) return;
  uint64_t size = bytes.size();
  MPI_Request request;
  refuse(MPI_Ibcast(&size, 1, MPI_UINT64_T, 0, groups[group_], &request), "MPI_Ibcast");
  wait_for(request);
  bytes.resize(size);
  for (std::size_t first = 0; first < size; first += numbers_at_a_time) {
    refuse(MPI_Ibcast(bytes.data() + first, static_cast<int>(std::min(numbers_at_a_time, bytes.size() - first)), MPI_CHAR, 0, groups[group_], &request), "MPI_Ibcast");
    wait_for(request);
  }
}

std::vector<std::string> Ranks::gather(const std::string& bytes) const {
  if (count_ == 1) return {bytes};
  int size = static_cast<int>(bytes.size());
  std::vector<int> sizes(count_), begins;
  MPI_Request request;
  refuse(MPI_Iallgather(&size, 1, MPI_INT, sizes.data(), 1, MPI_INT, groups[group_], &request), "MPI_Iallgather");
  wait_for(request);
  int sum_of_sizes = 0;
  for (const int some : sizes) begins.push_back(sum_of_sizes), sum_of_sizes += some;
  std::string all(static_cast<std::size_t>(sum_of_sizes), '\0');
  refuse(MPI_Iallgatherv(bytes.data(), size, MPI_CHAR, all.data(), sizes.data(), begins.data(), MPI_CHAR, groups[group_], &request), "MPI_Iallgatherv");
  wait_for(request);
  std::vector<std::string> result;
  for (uint32_t r = 0; r < count_; ++r) result.push_back(all.substr(static_cast<std::size_t>(begins[r]), static_cast<std::size_t>(sizes[r])));
  return result;
}

std::vector<std::string> Ranks::collect(const std::string& bytes) const {
  if (count_ == 1) return {bytes};
  const std::vector<std::string> sizes = gather(std::to_string(bytes.size()));
  const auto pass = [&](auto&& call, const char* name, auto* begin, std::size_t size, uint32_t other) {
    for (std::size_t at = 0; at < size; at += bytes_at_a_time) {
      MPI_Request request;
      refuse(call(begin + at, static_cast<int>(std::min(bytes_at_a_time, size - at)), MPI_CHAR, static_cast<int>(other), 0, groups[group_], &request), name);
      wait_for(request);
    }
  };
  if (!first()) {
    pass(MPI_Isend, "MPI_Isend", bytes.data(), bytes.size(), 0);
    return {};
  }
  std::vector<std::string> result{bytes};
  for (uint32_t r = 1; r < count_; ++r) {
    std::string& other = result.emplace_back(std::strtoull(sizes[r].c_str(), nullptr, 10), '\0');
    pass(MPI_Irecv, "MPI_Irecv", other.data(), other.size(), r);
  }
  return result;
}

void Ranks::wait_for_all() const {
  if (count_ == 1) return;
  MPI_Request request;
  refuse(MPI_Ibarrier(groups[group_], &request), "MPI_Ibarrier");
  wait_for(request);
}

bool Ranks::share(uint64_t count, const std::function<bool(uint64_t)>& work) const {
  if (count_ == 1) {
    for (uint64_t number = 0; number < count; ++number)
      if (!work(number)) return false;
    return true;
  }
  // The next number lies with the first rank, and whoever is free takes it from there.
  uint64_t* next = nullptr;
  MPI_Win window;
  refuse(MPI_Win_allocate(first() ? sizeof *next : 0, sizeof *next, MPI_INFO_NULL, groups[group_], &next, &window), "MPI_Win_allocate");
  if (first()) *next = 0;
  wait_for_all();
  const auto take = [&](uint64_t step) {
    uint64_t number = 0;
    refuse(MPI_Win_lock(MPI_LOCK_SHARED, 0, 0, window), "MPI_Win_lock");
    refuse(MPI_Fetch_and_op(&step, &number, MPI_UINT64_T, 0, 0, MPI_SUM, window), "MPI_Fetch_and_op");
    refuse(MPI_Win_unlock(0, window), "MPI_Win_unlock");
    return number;
  };
  double stopped = 0;
  for (uint64_t number = take(1); number < count; number = take(1)) {
    if (work(number)) continue;
    stopped = 1;
    take(count);
    break;
  }
  sum(std::span(&stopped, 1));
  MPI_Win_free(&window);
  return stopped == 0;
}

#else

const Ranks& Ranks::of_process() {
  static const Ranks ranks;
  for (const char* name : {"OMPI_COMM_WORLD_SIZE", "PMI_SIZE"}) {
    const char* size = std::getenv(name);
    if (size && std::atoi(size) > 1) throw InputError("mpirun", "", "a build with MPI", "one without", "Install libopenmpi-dev and build again.");
  }
  return ranks;
}

void Ranks::end_together() {}
int Ranks::leave(int code) { return code; }
void Ranks::sum(std::span<float>) const {}
void Ranks::sum(std::span<double>) const {}
void Ranks::sum(std::span<uint32_t>) const {}
void Ranks::broadcast(std::string&) const {}
void Ranks::broadcast(std::span<float>) const {}
Ranks Ranks::first_ranks(uint32_t) const { return {}; }
std::vector<std::string> Ranks::gather(const std::string& bytes) const { return {bytes}; }
std::vector<std::string> Ranks::collect(const std::string& bytes) const { return {bytes}; }
void Ranks::wait_for_all() const {}

bool Ranks::share(uint64_t count, const std::function<bool(uint64_t)>& work) const {
  for (uint64_t number = 0; number < count; ++number)
    if (!work(number)) return false;
  return true;
}

#endif

}  // namespace arah

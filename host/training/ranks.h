// Several processes that do one work together, each on a device of its own or on a shared one: ranks, as MPI calls them.
// `mpirun -n 4 arah train ...` starts four. Without mpirun, or in a build without MPI, there is one, and nothing is exchanged.
//
// What all ranks call, in the same order, is said to be collective: it returns when every rank has called it. Sums are formed in
// the order of the ranks, each number by one of them, so that they have the same bits on all ranks and, for so many ranks, in
// every run; MPI_Allreduce promises neither.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <span>
#include <string>
#include <vector>

namespace arah {

class Ranks {
 public:
  Ranks() = default;  // one, which exchanges nothing

  // Those that this process is one of; MPI is started at the first call, and only where mpirun (or another launcher) started the
  // process. Throws InputError where that started several and this build has no MPI.
  static const Ranks& of_process();
  // From now on this process ends well, whatever its code, as all ranks do.
  static void end_together();
  // The end of the process: waits for the other ranks where `code` is 0 or they end together, ends them all with the code otherwise.
  // Returns it.
  static int leave(int code);

  uint32_t rank() const { return rank_; }
  uint32_t count() const { return count_; }
  bool first() const { return rank_ == 0; }
  // Collective: the first `count` of them, as ranks of their own; on the others one alone, that none of this is said to.
  Ranks first_ranks(uint32_t count) const;
  uint32_t on_machine() const { return on_machine_; }  // number of this rank among those of its machine

  // This rank's part of `count` things, shared out in whole `unit`s in the order of the ranks, as evenly, or as near to their
  // shares, as that goes. Each gets one unit at least where there are as many.
  struct Part {
    uint32_t begin = 0, end = 0;
    uint32_t size() const { return end - begin; }
  };
  Part part(uint32_t count, uint32_t unit = 1) const;
  static Part part_of(uint32_t count, uint32_t unit, uint32_t rank, const std::vector<uint32_t>& shares);  // one share a rank
  // By rank, whole numbers from 1 on, the same on all ranks. Throws InputError where they are not.
  void set_shares(std::vector<uint32_t> shares);
  const std::vector<uint32_t>& shares() const { return shares_; }  // empty: even ones

  // Collective, with as many numbers on each rank: their sums, on all of them. Of uint32_t modulo 2^32.
  void sum(std::span<float> values) const;
  void sum(std::span<double> values) const;
  void sum(std::span<uint32_t> values) const;
  // Collective: the sum of `own` over the ranks before this one.
  uint64_t before(uint64_t own) const;
  // Collective: what the first rank has, on all of them; of numbers as many on each.
  void broadcast(std::string& bytes) const;
  void broadcast(std::span<float> values) const;
  uint64_t broadcast(uint64_t number) const;
  // Collective: every rank's, by rank.
  std::vector<std::string> gather(const std::string& bytes) const;
  // Collective: the same, of any length, for the first rank alone; nothing on the others.
  std::vector<std::string> collect(const std::string& bytes) const;
  // Collective: whether all ranks have this.
  bool all_alike(const std::string& text) const;
  // Collective: throws InputError, on all ranks alike, where one of these is another one on some rank, naming rank and fact.
  void agree(const std::map<std::string, std::string>& facts) const;
  // Collective: nothing but that.
  void wait_for_all() const;

  // Collective: does each of 0 ... count - 1 once, on the rank that is free first. Where `work` returns false no more is begun.
  // Returns whether all was done. (Ranks on other machines get their next number when the first rank has finished its own.)
  bool share(uint64_t count, const std::function<bool(uint64_t)>& work) const;

 private:
  uint32_t rank_ = 0, count_ = 1, on_machine_ = 0;
  std::vector<uint32_t> shares_;
  std::size_t group_ = 0;  // of the process's MPI communicators
};

}  // namespace arah

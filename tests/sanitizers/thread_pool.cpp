// The thread pool under ThreadSanitizer: callers that wait for one another, jobs of all sizes, exceptions, and what one
// job wrote read by the next.
#include "common/thread_pool.hpp"

#include <cstdio>
#include <numeric>
#include <stdexcept>
#include <thread>
#include <vector>

namespace {

// Rounds of two jobs, of which the second reads what the first wrote. Returns how many values were wrong.
std::size_t sum_in_rounds(int threads, std::size_t tasks, int rounds) {
  std::vector<std::size_t> squares(tasks), doubled(tasks);
  std::size_t wrong = 0;
  for (int round = 0; round < rounds; ++round) {
    aa4d::parallel_for(threads, tasks, [&](std::size_t i) { squares[i] = i * i + round; });
    aa4d::parallel_for(threads, tasks, [&](std::size_t i) { doubled[i] = 2 * squares[tasks - 1 - i]; });
    for (std::size_t i = 0; i < tasks; ++i) {
      const std::size_t j = tasks - 1 - i;
      wrong += doubled[i] != 2 * (j * j + round);
    }
  }
  return wrong;
}

std::size_t throw_in_rounds(int threads, std::size_t tasks, int rounds) {
  std::size_t caught = 0;
  for (int round = 0; round < rounds; ++round) {
    try {
      aa4d::parallel_for(threads, tasks, [&](std::size_t i) {
        if (i % 7 == 3) throw std::runtime_error("as asked");
      });
    } catch (const std::runtime_error&) {
      ++caught;
    }
  }
  return rounds - caught;
}

}  // namespace

int main() {
  std::vector<std::size_t> wrong(6);
  std::vector<std::thread> callers;
  for (std::size_t caller = 0; caller < wrong.size(); ++caller) {
    callers.emplace_back([&wrong, caller] {
      for (const std::size_t tasks : {std::size_t{2}, std::size_t{5}, std::size_t{64}, std::size_t{1000}}) {
        wrong[caller] += sum_in_rounds(2 + static_cast<int>(caller), tasks, 200);
        wrong[caller] += throw_in_rounds(4, tasks + 4, 50);
      }
    });
  }
  for (std::thread& caller : callers) caller.join();
  const std::size_t total = std::accumulate(wrong.begin(), wrong.end(), std::size_t{0});
  std::printf("thread pool: %zu wrong values, %d workers\n", total, aa4d::worker_count());
  return total != 0;
}

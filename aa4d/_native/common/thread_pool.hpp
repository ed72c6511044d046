// A persistent pool of threads. The order in which tasks run never matters to a result: every task writes to its own
// place, and sums over tasks are taken afterwards, in order.
#pragma once

#include <cstddef>
#include <functional>

namespace aa4d {

// Runs body(task) for every task in [0, tasks) on at most `threads` threads, the caller's among them; returns when all
// are done. Calls from several threads at a time wait for one another. An exception of a task is thrown to the caller.
void parallel_for(int threads, std::size_t tasks, const std::function<void(std::size_t)>& body);

// Threads of this process that wait for work besides the callers' own.
int worker_count();

}  // namespace aa4d

#include "common/thread_pool.hpp"

#include <unistd.h>

#include <atomic>
#include <condition_variable>
#include <exception>
#include <memory>
#include <mutex>
#include <thread>
#include <vector>

namespace aa4d {
namespace {

struct Job {
  const std::function<void(std::size_t)>* body = nullptr;
  std::size_t tasks = 0;
  std::atomic<std::size_t> next{0};
  std::atomic<int> places{0};  // how many more workers may join
  std::exception_ptr error;
  std::mutex error_mutex;

  void work() {
    for (std::size_t task; (task = next.fetch_add(1, std::memory_order_relaxed)) < tasks;) {
      try {
        (*body)(task);
      } catch (...) {
        const std::lock_guard lock(error_mutex);
        if (!error) error = std::current_exception();
        next.store(tasks);
      }
    }
  }
};

class ThreadPool {
 public:
  ~ThreadPool() {
    {
      const std::lock_guard lock(mutex_);
      stopping_ = true;
    }
    wake_.notify_all();
    for (std::thread& worker : workers_) worker.join();
  }

  void run(int threads, std::size_t tasks, const std::function<void(std::size_t)>& body) {
    const std::lock_guard one_at_a_time(run_mutex_);
    Job job;
    job.body = &body;
    job.tasks = tasks;
    const int helpers = static_cast<int>(std::min<std::size_t>(threads, tasks)) - 1;
    while (static_cast<int>(workers_.size()) < helpers) workers_.emplace_back([this] { serve(); });
    {
      const std::lock_guard lock(mutex_);
      job.places = helpers;
      job_ = &job;
      ++generation_;
    }
    if (helpers == 1)
      wake_.notify_one();
    else
      wake_.notify_all();
    job.work();
    spin_until([this] { return active_ == 0; });
    std::unique_lock lock(mutex_);
    job_ = nullptr;  // who has not joined by now need not
    idle_.wait(lock, [this] { return active_ == 0; });
    if (job.error) std::rethrow_exception(job.error);
  }

  int worker_count() {
    const std::lock_guard one_at_a_time(run_mutex_);
    return static_cast<int>(workers_.size());
  }

 private:
  // One phase of an image follows another within microseconds, which is less than it takes to fall asleep and wake up.
  template <class Condition>
  static void spin_until(const Condition& met) {
    constexpr int kTurns = 1000;
    for (int i = 0; i < kTurns && !met(); ++i) {
#if defined(__x86_64__)
      __builtin_ia32_pause();
#endif
    }
  }

  void serve() {
    std::size_t seen = 0;
    std::unique_lock lock(mutex_);
    for (;;) {
      lock.unlock();
      spin_until([&] { return generation_ != seen; });
      lock.lock();
      wake_.wait(lock, [&] { return stopping_ || (job_ != nullptr && generation_ != seen); });
      if (stopping_) return;
      seen = generation_;
      Job* job = job_;
      if (job->places-- <= 0) continue;
      ++active_;
      lock.unlock();
      job->work();
      lock.lock();
      if (--active_ == 0) idle_.notify_one();
    }
  }

  std::mutex run_mutex_, mutex_;
  std::condition_variable wake_, idle_;
  std::vector<std::thread> workers_;
  Job* job_ = nullptr;
  std::atomic<std::size_t> generation_ = 0;
  std::atomic<int> active_ = 0;
  bool stopping_ = false;
};

// Threads do not survive a fork: the child makes its own pool and abandons the parent's, whose threads it never had.
ThreadPool& pool() {
  static std::mutex mutex;
  static ThreadPool* current = nullptr;
  static pid_t owner = 0;
  const std::lock_guard lock(mutex);
  if (owner != getpid()) {
    current = new ThreadPool;  // never destroyed: joining threads while the interpreter exits can dead-lock
    owner = getpid();
  }
  return *current;
}

}  // namespace

void parallel_for(int threads, std::size_t tasks, const std::function<void(std::size_t)>& body) {
  if (threads <= 1 || tasks <= 1) {
    for (std::size_t task = 0; task < tasks; ++task) body(task);
    return;
  }
  pool().run(threads, tasks, body);
}

int worker_count() { return pool().worker_count(); }

}  // namespace aa4d

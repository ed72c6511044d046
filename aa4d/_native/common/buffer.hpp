// A grow-only array for scratch memory: keeps its storage between frames and never initialises it. Its accessors are
// always inlined, since kernels compiled for instruction sets that not every machine has use them too.
#pragma once

#include <cstddef>
#include <cstdlib>
#include <new>
#include <type_traits>
#include <utility>

namespace aa4d {

template <class T>
class Buffer {
  static_assert(std::is_trivially_copyable_v<T>);

 public:
  Buffer() = default;
  ~Buffer() { std::free(data_); }
  Buffer(Buffer&& other) noexcept : data_(other.data_), size_(other.size_), capacity_(other.capacity_) {
    other.data_ = nullptr;
    other.size_ = other.capacity_ = 0;
  }
  Buffer(const Buffer&) = delete;
  Buffer& operator=(const Buffer&) = delete;
  Buffer& operator=(Buffer&&) = delete;

  void swap(Buffer& other) noexcept {
    std::swap(data_, other.data_);
    std::swap(size_, other.size_);
    std::swap(capacity_, other.capacity_);
  }

  // The old content is lost when the storage has to grow.
  void resize_discarding(std::size_t size) {
    if (size > capacity_) {
      std::free(data_);
      data_ = nullptr;
      capacity_ = 0;
      reserve(size + size / 4);
    }
    size_ = size;
  }

  void clear() { size_ = 0; }

  void push_back(T value) {
    if (size_ == capacity_) grow();
    data_[size_++] = value;
  }

  [[gnu::always_inline]] T* data() { return data_; }
  [[gnu::always_inline]] const T* data() const { return data_; }
  [[gnu::always_inline]] std::size_t size() const { return size_; }
  [[gnu::always_inline]] T& operator[](std::size_t i) { return data_[i]; }
  [[gnu::always_inline]] const T& operator[](std::size_t i) const { return data_[i]; }

 private:
  static constexpr std::size_t kAlignment = 64;  // a cache line, and the widest register

  void reserve(std::size_t capacity) {
    const std::size_t bytes = (capacity * sizeof(T) + kAlignment - 1) / kAlignment * kAlignment;
    data_ = static_cast<T*>(std::aligned_alloc(kAlignment, bytes));
    if (data_ == nullptr) throw std::bad_alloc();
    capacity_ = capacity;
  }

  void grow() {
    Buffer larger;
    larger.reserve(capacity_ ? capacity_ * 2 : 1024);
    for (std::size_t i = 0; i < size_; ++i) larger.data_[i] = data_[i];
    std::free(data_);
    data_ = larger.data_;
    capacity_ = larger.capacity_;
    larger.data_ = nullptr;
  }

  T* data_ = nullptr;
  std::size_t size_ = 0;
  std::size_t capacity_ = 0;
};

}  // namespace aa4d

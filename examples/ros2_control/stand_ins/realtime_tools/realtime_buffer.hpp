/* Stand-in: a value that is written outside the real-time loop and read inside, by two copies that change places. */
#ifndef REALTIME_TOOLS_REALTIME_BUFFER_HPP
#define REALTIME_TOOLS_REALTIME_BUFFER_HPP

#include <mutex>
#include <utility>

namespace realtime_tools
{
template <class T>
class RealtimeBuffer
{
public:
  T * readFromRT()
  {
    const std::unique_lock<std::mutex> lock(mutex_, std::try_to_lock);
    if (lock.owns_lock() && fresh_) {
      std::swap(inside_, outside_);
      fresh_ = false;
    }
    return inside_;
  }
  void writeFromNonRT(const T & value)
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    *outside_ = value;
    fresh_ = true;
  }

private:
  T values_[2] = {};
  T * inside_ = &values_[0];
  T * outside_ = &values_[1];
  bool fresh_ = false;
  std::mutex mutex_;
};
}  // namespace realtime_tools

#endif

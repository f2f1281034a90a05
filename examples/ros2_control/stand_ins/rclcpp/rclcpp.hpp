/* Stand-in: times, parameters, messages and loggers of rclcpp. */
#ifndef RCLCPP_RCLCPP_HPP
#define RCLCPP_RCLCPP_HPP

#include <cstdint>
#include <cstdio>
#include <functional>
#include <memory>
#include <stdexcept>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#define RCLCPP_LOG_(level, logger, ...) \
  (std::fprintf(stderr, level " [%s] ", (logger).get_name()), std::fprintf(stderr, __VA_ARGS__), std::fputc('\n', stderr))
#define RCLCPP_WARN(logger, ...) RCLCPP_LOG_("WARN", logger, __VA_ARGS__)
#define RCLCPP_ERROR(logger, ...) RCLCPP_LOG_("ERROR", logger, __VA_ARGS__)

namespace rclcpp
{
class Time
{
};

class Duration
{
public:
  static Duration from_seconds(double seconds) { return Duration(seconds); }
  double seconds() const { return seconds_; }

private:
  explicit Duration(double seconds) : seconds_(seconds) {}
  double seconds_;
};

class Logger
{
public:
  explicit Logger(std::string name) : name_(std::move(name)) {}
  const char * get_name() const { return name_.c_str(); }

private:
  std::string name_;
};

class SystemDefaultsQoS
{
};

class ParameterValue
{
public:
  using Value = std::variant<std::int64_t, double, std::vector<std::string>>;
  explicit ParameterValue(Value value) : value_(std::move(value)) {}
  template <class T>
  const T & get() const
  {
    if (!std::holds_alternative<T>(value_)) {
      throw std::runtime_error("parameter of another type");
    }
    return std::get<T>(value_);
  }

private:
  Value value_;
};

class Parameter
{
public:
  Parameter(std::string name, ParameterValue value) : name_(std::move(name)), value_(std::move(value)) {}
  const std::string & get_name() const { return name_; }
  const ParameterValue & get_parameter_value() const { return value_; }
  template <class T>
  T get_value() const
  {
    return value_.get<T>();
  }

private:
  std::string name_;
  ParameterValue value_;
};

class NodeOptions
{
public:
  NodeOptions & parameter_overrides(const std::vector<Parameter> & overrides)
  {
    overrides_ = overrides;
    return *this;
  }
  const std::vector<Parameter> & parameter_overrides() const { return overrides_; }

private:
  std::vector<Parameter> overrides_;
};

class SubscriptionBase
{
public:
  virtual ~SubscriptionBase() = default;
};

template <class Message>
class Subscription : public SubscriptionBase
{
public:
  using SharedPtr = std::shared_ptr<Subscription>;
  using Callback = std::function<void(std::shared_ptr<Message>)>;
  explicit Subscription(Callback callback) : callback_(std::move(callback)) {}
  void receive(const Message & message) { callback_(std::make_shared<Message>(message)); }  // the test publishes

private:
  Callback callback_;
};
}  // namespace rclcpp

#endif

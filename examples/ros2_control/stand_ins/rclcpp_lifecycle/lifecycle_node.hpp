/* Stand-in: a node with parameters and subscriptions. */
#ifndef RCLCPP_LIFECYCLE_LIFECYCLE_NODE_HPP
#define RCLCPP_LIFECYCLE_LIFECYCLE_NODE_HPP

#include <map>
#include <memory>
#include <stdexcept>
#include <string>

#include "rclcpp/rclcpp.hpp"
#include "rclcpp_lifecycle/state.hpp"

namespace rclcpp
{
namespace node_interfaces
{
class NodeParametersInterface
{
public:
  using SharedPtr = std::shared_ptr<NodeParametersInterface>;
  explicit NodeParametersInterface(const NodeOptions & options)
  {
    for (const auto & given : options.parameter_overrides()) {
      overrides_.emplace(given.get_name(), given.get_parameter_value());
    }
  }
  const std::map<std::string, ParameterValue> & get_parameter_overrides() const { return overrides_; }

private:
  std::map<std::string, ParameterValue> overrides_;
};
}  // namespace node_interfaces
}  // namespace rclcpp

namespace rclcpp_lifecycle
{
namespace node_interfaces
{
class LifecycleNodeInterface
{
public:
  enum class CallbackReturn { SUCCESS, FAILURE, ERROR };
  virtual ~LifecycleNodeInterface() = default;
  virtual CallbackReturn on_configure(const State &) { return CallbackReturn::SUCCESS; }
  virtual CallbackReturn on_activate(const State &) { return CallbackReturn::SUCCESS; }
  virtual CallbackReturn on_deactivate(const State &) { return CallbackReturn::SUCCESS; }
};
}  // namespace node_interfaces

class LifecycleNode
{
public:
  LifecycleNode(const std::string & name, const rclcpp::NodeOptions & options)
  : name_(name), parameters_(std::make_shared<rclcpp::node_interfaces::NodeParametersInterface>(options))
  {
  }

  const char * get_name() const { return name_.c_str(); }
  rclcpp::Logger get_logger() const { return rclcpp::Logger(name_); }
  rclcpp::node_interfaces::NodeParametersInterface::SharedPtr get_node_parameters_interface() { return parameters_; }

  bool has_parameter(const std::string & name) const { return declared_.count(name) != 0; }

  template <class T>
  T declare_parameter(const std::string & name, const T & usual)
  {
    const auto & given = parameters_->get_parameter_overrides();
    const auto found = given.find(name);
    const rclcpp::ParameterValue value = found == given.end() ? rclcpp::ParameterValue(usual) : found->second;
    value.get<T>();  // throws for another type
    declared_.emplace(name, value);
    return value.get<T>();
  }

  rclcpp::Parameter get_parameter(const std::string & name) const { return {name, declared_.at(name)}; }

  template <class Message, class Callback>
  typename rclcpp::Subscription<Message>::SharedPtr create_subscription(
    const std::string & topic, const rclcpp::SystemDefaultsQoS &, Callback && callback)
  {
    auto made = std::make_shared<rclcpp::Subscription<Message>>(callback);
    subscriptions_[topic] = made;
    return made;
  }

  template <class Message>
  void receive(const std::string & topic, const Message & message)  // the test publishes
  {
    dynamic_cast<rclcpp::Subscription<Message> &>(*subscriptions_.at(topic)).receive(message);
  }

private:
  std::string name_;
  rclcpp::node_interfaces::NodeParametersInterface::SharedPtr parameters_;
  std::map<std::string, rclcpp::ParameterValue> declared_;
  std::map<std::string, std::shared_ptr<rclcpp::SubscriptionBase>> subscriptions_;
};
}  // namespace rclcpp_lifecycle

#endif

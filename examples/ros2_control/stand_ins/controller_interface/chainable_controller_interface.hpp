/* Stand-in: the base classes of a controller that others may precede. */
#ifndef CONTROLLER_INTERFACE_CHAINABLE_CONTROLLER_INTERFACE_HPP
#define CONTROLLER_INTERFACE_CHAINABLE_CONTROLLER_INTERFACE_HPP

#include <cstdint>
#include <memory>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "hardware_interface/loaned_command_interface.hpp"
#include "rclcpp_lifecycle/lifecycle_node.hpp"

namespace controller_interface
{
using CallbackReturn = rclcpp_lifecycle::node_interfaces::LifecycleNodeInterface::CallbackReturn;
enum class return_type : std::uint8_t { OK = 0, ERROR = 1 };
enum class interface_configuration_type : std::uint8_t { ALL = 0, INDIVIDUAL = 1, NONE = 2 };

struct InterfaceConfiguration
{
  interface_configuration_type type;
  std::vector<std::string> names = {};
};

class ControllerInterfaceBase : public rclcpp_lifecycle::node_interfaces::LifecycleNodeInterface
{
public:
  virtual InterfaceConfiguration command_interface_configuration() const = 0;
  virtual InterfaceConfiguration state_interface_configuration() const = 0;
  virtual CallbackReturn on_init() = 0;
  virtual return_type update(const rclcpp::Time & time, const rclcpp::Duration & period) = 0;

  return_type init(
    const std::string & controller_name, const std::string &, unsigned int, const std::string &,
    const rclcpp::NodeOptions & node_options)
  {
    node_ = std::make_shared<rclcpp_lifecycle::LifecycleNode>(controller_name, node_options);
    return on_init() == CallbackReturn::SUCCESS ? return_type::OK : return_type::ERROR;
  }
  void assign_interfaces(
    std::vector<hardware_interface::LoanedCommandInterface> && commands,
    std::vector<hardware_interface::LoanedStateInterface> && states)
  {
    command_interfaces_ = std::move(commands);
    state_interfaces_ = std::move(states);
  }
  std::shared_ptr<rclcpp_lifecycle::LifecycleNode> get_node() { return node_; }
  std::shared_ptr<const rclcpp_lifecycle::LifecycleNode> get_node() const { return node_; }

  template <typename ParameterT>
  auto auto_declare(const std::string & name, const ParameterT & default_value)
  {
    return node_->has_parameter(name) ? node_->get_parameter(name).template get_value<ParameterT>()
                                      : node_->declare_parameter<ParameterT>(name, default_value);
  }

protected:
  std::vector<hardware_interface::LoanedCommandInterface> command_interfaces_;
  std::vector<hardware_interface::LoanedStateInterface> state_interfaces_;

private:
  std::shared_ptr<rclcpp_lifecycle::LifecycleNode> node_;
};

class ChainableControllerInterface : public ControllerInterfaceBase
{
public:
  return_type update(const rclcpp::Time & time, const rclcpp::Duration & period) final
  {
    if (!chained_ && update_reference_from_subscribers(time, period) != return_type::OK) {
      return return_type::ERROR;
    }
    return update_and_write_commands(time, period);
  }

  std::vector<hardware_interface::CommandInterface::SharedPtr> export_reference_interfaces()
  {
    std::vector<hardware_interface::CommandInterface::SharedPtr> shared;
    for (auto & one : on_export_reference_interfaces()) {
      if (one.get_name().rfind(std::string(get_node()->get_name()) + "/", 0) != 0) {
        throw std::runtime_error("reference interface without the controller's name");
      }
      shared.push_back(std::make_shared<hardware_interface::CommandInterface>(std::move(one)));
    }
    if (shared.size() != reference_interfaces_.size()) {
      throw std::runtime_error("another number of reference interfaces than reference_interfaces_");
    }
    return shared;
  }

  bool set_chained_mode(bool chained_mode)
  {
    const bool done = on_set_chained_mode(chained_mode);
    chained_ = done ? chained_mode : chained_;
    return done;
  }

protected:
  virtual std::vector<hardware_interface::CommandInterface> on_export_reference_interfaces() = 0;
  virtual bool on_set_chained_mode(bool) { return true; }
  virtual return_type update_reference_from_subscribers(const rclcpp::Time & time, const rclcpp::Duration & period) = 0;
  virtual return_type update_and_write_commands(const rclcpp::Time & time, const rclcpp::Duration & period) = 0;

  std::vector<double> reference_interfaces_;

private:
  bool chained_ = false;
};
}  // namespace controller_interface

#endif

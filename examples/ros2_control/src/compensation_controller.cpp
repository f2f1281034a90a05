/* A controller of ros2_control that corrects joint positions by the calibration in truepose's generated C.

   It stands between whoever plans nominal joint positions (a joint_trajectory_controller, or a topic) and the drives:
   each update passes the reference through NAME_compensate and writes the command that puts the real tool where the
   nominal robot would have put it. NAME, the machine's name in its file, is told by -DMACHINE=NAME.

   ROS counts joints in rad and m, the generated C in rad and mm. Updates allocate nothing, wait for nobody and log nothing. */
#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <exception>
#include <iterator>
#include <limits>
#include <memory>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

#include "control_msgs/msg/interface_value.hpp"
#include "controller_interface/chainable_controller_interface.hpp"
#include "hardware_interface/types/hardware_interface_type_values.hpp"
#include "pluginlib/class_list_macros.hpp"
#include "rclcpp/rclcpp.hpp"
#include "rclcpp_lifecycle/state.hpp"
#include "realtime_tools/realtime_buffer.hpp"
#include "std_msgs/msg/float64_multi_array.hpp"

#define JOIN_(a, b) a##b
#define JOIN(a, b) JOIN_(a, b)
#define TEXT_(a) #a
#define TEXT(a) TEXT_(a)
#include TEXT(JOIN(MACHINE, _kin.hpp))

namespace truepose_compensation
{
namespace machine = JOIN(MACHINE, _kin);
using controller_interface::CallbackReturn;
using controller_interface::InterfaceConfiguration;
using controller_interface::return_type;

constexpr double nan = std::numeric_limits<double>::quiet_NaN();

class CompensationController : public controller_interface::ChainableControllerInterface
{
public:
  CallbackReturn on_init() override;
  CallbackReturn on_configure(const rclcpp_lifecycle::State & previous) override;
  CallbackReturn on_activate(const rclcpp_lifecycle::State & previous) override;
  CallbackReturn on_deactivate(const rclcpp_lifecycle::State & previous) override;
  InterfaceConfiguration command_interface_configuration() const override;
  InterfaceConfiguration state_interface_configuration() const override;

protected:
  std::vector<hardware_interface::CommandInterface> on_export_reference_interfaces() override;
  return_type update_reference_from_subscribers(const rclcpp::Time & time, const rclcpp::Duration & period) override;
  return_type update_and_write_commands(const rclcpp::Time & time, const rclcpp::Duration & period) override;

private:
  using Reference = std::array<double, machine::joints>;  // rad and m

  template <class Names, class Values>
  void read_named(const std::string & prefix, const Names & names, Values & values);
  void read_parameters();
  void take_reference(const std_msgs::msg::Float64MultiArray & message);
  void take_drivers(const control_msgs::msg::InterfaceValue & message);
  bool write(const machine::Joints & nominal, const machine::Joints & target, double seconds);
  return_type hold();

  std::vector<std::string> joints_;
  double correction_rate_ = 0.0;                     // rad/s and m/s
  std::int64_t tolerated_failures_ = 0;              // updates in a row
  machine::Parameters calibration_ = machine::calibrated();
  machine::Drivers drivers_ = machine::usual();      // of the subscriber; updates read the buffer
  realtime_tools::RealtimeBuffer<machine::Drivers> drivers_now_;
  realtime_tools::RealtimeBuffer<Reference> reference_now_;
  rclcpp::Subscription<control_msgs::msg::InterfaceValue>::SharedPtr drivers_subscription_;
  rclcpp::Subscription<std_msgs::msg::Float64MultiArray>::SharedPtr reference_subscription_;

  std::array<double, machine::joints> correction_{};  // command less nominal, rad and mm
  bool moved_ = false;                                // a command was written since the activation
  std::int64_t failures_ = 0;                         // updates in a row without a new command
  std::atomic<std::int64_t> held_{0};                 // such updates since the activation
};

/* What one unit of ROS is in the units of the generated C: joints that slide have mm there, m here. */
double machine_units(std::size_t joint)
{
  return std::string_view(machine::joint_units[joint]) == "mm" ? 1000.0 : 1.0;
}

/* Place of a name among the machine's; names.size() if it is none of them. */
template <class Names>
std::size_t place_of(const Names & names, const std::string & name)
{
  return static_cast<std::size_t>(std::distance(names.begin(), std::find(names.begin(), names.end(), name)));
}

// ---- parameters -----------------------------------------------------------------------------------------------------

CallbackReturn CompensationController::on_init()
{
  try {
    auto_declare("joints", std::vector<std::string>(machine::joint_names.begin(), machine::joint_names.end()));
    auto_declare<double>("correction_rate", 0.1);
    auto_declare<std::int64_t>("tolerated_failures", 5);
    const auto usual = machine::usual();
    for (std::size_t k = 0; k != machine::parameter_names.size(); ++k) {
      auto_declare<double>(std::string("calibration.") + machine::parameter_names[k], calibration_[k]);
    }
    for (std::size_t k = 0; k != machine::driver_names.size(); ++k) {
      auto_declare<double>(std::string("drivers.") + machine::driver_names[k], usual[k]);
    }
  } catch (const std::exception & error) {  // a parameter of another type
    RCLCPP_ERROR(get_node()->get_logger(), "%s", error.what());
    return CallbackReturn::ERROR;
  }
  return CallbackReturn::SUCCESS;
}

/* Values by the machine's names. A name that the machine does not have is an error: a typing error would go unseen. */
template <class Names, class Values>
void CompensationController::read_named(const std::string & prefix, const Names & names, Values & values)
{
  for (const auto & given : get_node()->get_node_parameters_interface()->get_parameter_overrides()) {
    const std::string & name = given.first;
    if (name.compare(0, prefix.size(), prefix) == 0 && place_of(names, name.substr(prefix.size())) == names.size()) {
      throw std::invalid_argument(name + ": found no such name, expected one of " TEXT(MACHINE) "_kin.h");
    }
  }
  for (std::size_t k = 0; k != names.size(); ++k) {
    const double value = get_node()->get_parameter(prefix + names[k]).template get_value<double>();
    if (!std::isfinite(value)) {
      throw std::invalid_argument(prefix + names[k] + ": found no finite number");
    }
    values[k] = static_cast<machine::real>(value);
  }
}

void CompensationController::read_parameters()
{
  joints_ = get_node()->get_parameter("joints").get_value<std::vector<std::string>>();
  correction_rate_ = get_node()->get_parameter("correction_rate").get_value<double>();
  tolerated_failures_ = get_node()->get_parameter("tolerated_failures").get_value<std::int64_t>();
  if (joints_.size() != machine::joints) {
    throw std::invalid_argument(
      "joints: found " + std::to_string(joints_.size()) + " names, expected " + std::to_string(machine::joints));
  }
  if (!(correction_rate_ > 0.0) || tolerated_failures_ < 0) {
    throw std::invalid_argument("expected correction_rate above 0 and tolerated_failures of 0 or more");
  }
  read_named("calibration.", machine::parameter_names, calibration_);
  read_named("drivers.", machine::driver_names, drivers_);
}

// ---- life -----------------------------------------------------------------------------------------------------------

CallbackReturn CompensationController::on_configure(const rclcpp_lifecycle::State &)
{
  try {
    read_parameters();
  } catch (const std::exception & error) {
    RCLCPP_ERROR(get_node()->get_logger(), "%s", error.what());
    return CallbackReturn::ERROR;
  }
  drivers_now_.writeFromNonRT(drivers_);
  reference_interfaces_.assign(machine::joints, nan);
  drivers_subscription_ = get_node()->create_subscription<control_msgs::msg::InterfaceValue>(
    "~/drivers", rclcpp::SystemDefaultsQoS(),
    [this](const control_msgs::msg::InterfaceValue::SharedPtr message) { take_drivers(*message); });
  reference_subscription_ = get_node()->create_subscription<std_msgs::msg::Float64MultiArray>(
    "~/reference", rclcpp::SystemDefaultsQoS(),
    [this](const std_msgs::msg::Float64MultiArray::SharedPtr message) { take_reference(*message); });
  return CallbackReturn::SUCCESS;
}

/* The correction starts at nothing and grows by its rate, so that nothing jumps when the controller is switched on. */
CallbackReturn CompensationController::on_activate(const rclcpp_lifecycle::State &)
{
  bool ordered = command_interfaces_.size() == joints_.size();
  for (std::size_t k = 0; ordered && k < joints_.size(); ++k) {
    ordered = command_interfaces_[k].get_name() == joints_[k] + "/" + hardware_interface::HW_IF_POSITION;
  }
  if (!ordered) {
    RCLCPP_ERROR(get_node()->get_logger(), "found other command interfaces than the joints' positions, in order");
    return CallbackReturn::ERROR;
  }
  Reference nothing;
  nothing.fill(nan);
  reference_now_.writeFromNonRT(nothing);
  std::fill(reference_interfaces_.begin(), reference_interfaces_.end(), nan);
  correction_.fill(0.0);
  moved_ = false;
  failures_ = 0;
  held_ = 0;
  return CallbackReturn::SUCCESS;
}

CallbackReturn CompensationController::on_deactivate(const rclcpp_lifecycle::State &)
{
  if (held_ > 0) {
    RCLCPP_WARN(
      get_node()->get_logger(), "%lld updates held the last command: the reference was no number or out of reach",
      static_cast<long long>(held_));
  }
  return CallbackReturn::SUCCESS;
}

InterfaceConfiguration CompensationController::command_interface_configuration() const
{
  InterfaceConfiguration claimed{controller_interface::interface_configuration_type::INDIVIDUAL, {}};
  for (const auto & joint : joints_) {
    claimed.names.push_back(joint + "/" + hardware_interface::HW_IF_POSITION);
  }
  return claimed;
}

/* The correction depends on where the joints are to go, not on where they are. */
InterfaceConfiguration CompensationController::state_interface_configuration() const
{
  return {controller_interface::interface_configuration_type::NONE, {}};
}

std::vector<hardware_interface::CommandInterface> CompensationController::on_export_reference_interfaces()
{
  std::vector<hardware_interface::CommandInterface> exported;
  for (std::size_t k = 0; k < joints_.size(); ++k) {
    exported.emplace_back(
      get_node()->get_name(), joints_[k] + "/" + hardware_interface::HW_IF_POSITION, &reference_interfaces_[k]);
  }
  return exported;
}

// ---- subscribers, outside the real-time loop ------------------------------------------------------------------------

void CompensationController::take_reference(const std_msgs::msg::Float64MultiArray & message)
{
  if (message.data.size() != machine::joints) {
    RCLCPP_ERROR(
      get_node()->get_logger(), "~/reference: found %zu positions, expected %zu", message.data.size(), machine::joints);
    return;
  }
  Reference reference;
  std::copy(message.data.begin(), message.data.end(), reference.begin());
  reference_now_.writeFromNonRT(reference);
}

/* Drivers that a message does not name keep their value; a message with a mistake changes none. */
void CompensationController::take_drivers(const control_msgs::msg::InterfaceValue & message)
{
  machine::Drivers drivers = drivers_;
  bool good = message.interface_names.size() == message.values.size();
  for (std::size_t k = 0; good && k < message.values.size(); ++k) {
    const std::size_t place = place_of(machine::driver_names, message.interface_names[k]);
    good = place != machine::driver_names.size() && std::isfinite(message.values[k]);
    if (good) {
      drivers[place] = static_cast<machine::real>(message.values[k]);
    }
  }
  if (!good) {
    RCLCPP_ERROR(
      get_node()->get_logger(), "~/drivers: expected a finite value for each name, names as in " TEXT(MACHINE) "_kin.h");
    return;
  }
  drivers_ = drivers;
  drivers_now_.writeFromNonRT(drivers_);
}

// ---- the real-time loop ---------------------------------------------------------------------------------------------

/* Called where no other controller writes the reference. */
return_type CompensationController::update_reference_from_subscribers(const rclcpp::Time &, const rclcpp::Duration &)
{
  const Reference & reference = *reference_now_.readFromRT();
  std::copy(reference.begin(), reference.end(), reference_interfaces_.begin());
  return return_type::OK;
}

return_type CompensationController::update_and_write_commands(const rclcpp::Time &, const rclcpp::Duration & period)
{
  const machine::Drivers & drivers = *drivers_now_.readFromRT();
  machine::Joints nominal{};
  machine::Joints target{};
  bool given = true;
  for (std::size_t k = 0; k < machine::joints; ++k) {
    given = given && std::isfinite(reference_interfaces_[k]);
    nominal[k] = static_cast<machine::real>(reference_interfaces_[k] * machine_units(k));
  }
  if (!given && !moved_) {
    return return_type::OK;  // nobody has asked for anything yet: the drives stay as they are
  }
  const bool solved = given && machine::compensate(nominal, target, {&calibration_, &drivers}) == machine::Code::solved;
  if (!solved || !write(nominal, target, period.seconds())) {
    return hold();
  }
  failures_ = 0;
  moved_ = true;
  return return_type::OK;
}

/* The reference with its correction, which changes no faster than its rate: a payload that is picked up, or the
   activation itself, must not be a step for the drives. */
bool CompensationController::write(const machine::Joints & nominal, const machine::Joints & target, double seconds)
{
  bool written = true;
  for (std::size_t k = 0; k < machine::joints; ++k) {
    const double unit = machine_units(k);
    const double step = correction_rate_ * unit * seconds;
    const double wanted = static_cast<double>(target[k]) - static_cast<double>(nominal[k]);
    correction_[k] += std::clamp(wanted - correction_[k], -step, step);
    written = command_interfaces_[k].set_value(reference_interfaces_[k] + correction_[k] / unit) && written;
  }
  return written;
}

/* The last good command stays. The nominal one would be a step by the whole correction, and may be out of range. After
   too many in a row the controller manager is told, which stops the controller and starts its fallback controllers. */
return_type CompensationController::hold()
{
  ++held_;
  return ++failures_ > tolerated_failures_ ? return_type::ERROR : return_type::OK;
}

}  // namespace truepose_compensation

PLUGINLIB_EXPORT_CLASS(
  truepose_compensation::CompensationController, controller_interface::ChainableControllerInterface)

/* Stand-in for the controller manager: loads the plug-in, configures and activates it, and updates it at 1 kHz.

     loop PARAMETERS chained|topic < rows

   PARAMETERS: lines "name number" (an integer for those that are one), or "joints name name ...".
   A row: references of the joints (rad, m), then values of the drivers named by "#drivers name name ..." in the first line.
   Out: a line for each row: 0 or 1 (return_type), allocations during the update, the commands. */
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <iostream>
#include <limits>
#include <memory>
#include <new>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include "control_msgs/msg/interface_value.hpp"
#include "controller_interface/chainable_controller_interface.hpp"
#include "pluginlib/class_list_macros.hpp"
#include "rclcpp/rclcpp.hpp"
#include "std_msgs/msg/float64_multi_array.hpp"

using controller_interface::CallbackReturn;
using controller_interface::ChainableControllerInterface;
using controller_interface::return_type;

namespace pluginlib
{
template <>
std::unique_ptr<ChainableControllerInterface> create<ChainableControllerInterface>();
}

/* ---- every allocation is counted: operator new, and malloc by the linker's --wrap ---- */
namespace
{
long allocations = 0;
}
extern "C" {
void * __real_malloc(std::size_t size);
void * __real_calloc(std::size_t count, std::size_t size);
void * __real_realloc(void * place, std::size_t size);
void * __wrap_malloc(std::size_t size)
{
  ++allocations;
  return __real_malloc(size);
}
void * __wrap_calloc(std::size_t count, std::size_t size)
{
  ++allocations;
  return __real_calloc(count, size);
}
void * __wrap_realloc(void * place, std::size_t size)
{
  ++allocations;
  return __real_realloc(place, size);
}
}
void * operator new(std::size_t size)
{
  void * place = std::malloc(size);
  if (!place) {
    throw std::bad_alloc();
  }
  return place;
}
void operator delete(void * place) noexcept { std::free(place); }
void operator delete(void * place, std::size_t) noexcept { std::free(place); }

namespace
{
[[noreturn]] void stop(const std::string & what)
{
  std::cerr << what << '\n';
  std::exit(2);
}

rclcpp::Parameter parameter_of(const std::string & line)
{
  std::istringstream words(line);
  std::string name, word;
  std::vector<std::string> values;
  words >> name;
  while (words >> word) {
    values.push_back(word);
  }
  if (name == "joints") {
    return {name, rclcpp::ParameterValue(values)};
  }
  const bool integer = values.at(0).find_first_not_of("-0123456789") == std::string::npos;
  return integer ? rclcpp::Parameter(name, rclcpp::ParameterValue(std::int64_t{std::stoll(values[0])}))
                 : rclcpp::Parameter(name, rclcpp::ParameterValue(std::strtod(values[0].c_str(), nullptr)));
}

std::vector<double> numbers_of(const std::string & line)
{
  std::istringstream words(line);
  std::vector<double> values;
  for (std::string word; words >> word;) {
    values.push_back(std::strtod(word.c_str(), nullptr));  // nan as well
  }
  return values;
}
}  // namespace

int main(int count, char ** arguments)
{
  if (count != 3) {
    stop("usage: loop PARAMETERS chained|topic < rows");
  }
  std::vector<rclcpp::Parameter> given;
  std::ifstream file(arguments[1]);
  for (std::string line; std::getline(file, line);) {
    given.push_back(parameter_of(line));
  }
  auto controller = pluginlib::create<ChainableControllerInterface>();
  const auto options = rclcpp::NodeOptions().parameter_overrides(given);
  if (controller->init("compensation_controller", "", 1000, "", options) != return_type::OK) {
    stop("not initialised");
  }
  if (controller->on_configure({}) != CallbackReturn::SUCCESS) {
    stop("not configured");
  }
  const bool chained = std::string(arguments[2]) == "chained";
  auto references = controller->export_reference_interfaces();
  controller->set_chained_mode(chained);

  const auto claimed = controller->command_interface_configuration().names;
  std::vector<double> commands(claimed.size(), std::numeric_limits<double>::quiet_NaN());
  std::vector<hardware_interface::LoanedCommandInterface> loaned;
  for (std::size_t k = 0; k < claimed.size(); ++k) {
    const auto slash = claimed[k].rfind('/');
    loaned.emplace_back(std::make_shared<hardware_interface::CommandInterface>(
      claimed[k].substr(0, slash), claimed[k].substr(slash + 1), &commands[k]));
  }
  controller->assign_interfaces(std::move(loaned), {});
  if (controller->on_activate({}) != CallbackReturn::SUCCESS) {
    stop("not activated");
  }

  control_msgs::msg::InterfaceValue drivers;
  std::string line;
  std::getline(std::cin, line);
  std::istringstream names(line.substr(line.find(' ') == std::string::npos ? line.size() : line.find(' ')));
  for (std::string name; names >> name;) {
    drivers.interface_names.push_back(name);
  }
  while (std::getline(std::cin, line)) {
    const auto row = numbers_of(line);
    if (row.size() != commands.size() + drivers.interface_names.size()) {
      stop("a row of another length");
    }
    const auto split = row.begin() + static_cast<std::ptrdiff_t>(commands.size());
    const std::vector<double> wanted(row.begin(), split);
    if (chained) {
      for (std::size_t k = 0; k < wanted.size(); ++k) {
        references[k]->set_value(wanted[k]);
      }
    } else {
      controller->get_node()->receive("~/reference", std_msgs::msg::Float64MultiArray{wanted});
    }
    drivers.values.assign(split, row.end());
    if (!drivers.values.empty()) {
      controller->get_node()->receive("~/drivers", drivers);
    }
    const long before = allocations;
    const auto code = controller->update(rclcpp::Time(), rclcpp::Duration::from_seconds(0.001));
    const long taken = allocations - before;
    std::printf("%d %ld", code == return_type::OK ? 0 : 1, taken);
    for (const double command : commands) {
      std::printf(" %.17g", command);
    }
    std::putchar('\n');
  }
  return controller->on_deactivate({}) == CallbackReturn::SUCCESS ? 0 : 2;
}

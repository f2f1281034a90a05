/* Stand-in: values by name. */
#ifndef CONTROL_MSGS_MSG_INTERFACE_VALUE_HPP
#define CONTROL_MSGS_MSG_INTERFACE_VALUE_HPP

#include <memory>
#include <string>
#include <vector>

namespace control_msgs
{
namespace msg
{
struct InterfaceValue
{
  using SharedPtr = std::shared_ptr<InterfaceValue>;
  std::vector<std::string> interface_names;
  std::vector<double> values;
};
}  // namespace msg
}  // namespace control_msgs

#endif

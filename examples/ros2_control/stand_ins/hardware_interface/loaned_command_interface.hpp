/* Stand-in: a command interface while a controller has it. */
#ifndef HARDWARE_INTERFACE_LOANED_COMMAND_INTERFACE_HPP
#define HARDWARE_INTERFACE_LOANED_COMMAND_INTERFACE_HPP

#include <string>
#include <utility>

#include "hardware_interface/handle.hpp"

namespace hardware_interface
{
class LoanedCommandInterface
{
public:
  explicit LoanedCommandInterface(CommandInterface::SharedPtr interface) : interface_(std::move(interface)) {}
  LoanedCommandInterface(const LoanedCommandInterface &) = delete;
  LoanedCommandInterface(LoanedCommandInterface &&) = default;
  const std::string & get_name() const { return interface_->get_name(); }
  template <class T>
  [[nodiscard]] bool set_value(const T & value, unsigned int = 10)
  {
    return interface_->set_value(value);
  }

private:
  CommandInterface::SharedPtr interface_;
};

class LoanedStateInterface
{
};
}  // namespace hardware_interface

#endif

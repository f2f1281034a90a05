/* Stand-in: a named number that is somewhere else. */
#ifndef HARDWARE_INTERFACE_HANDLE_HPP
#define HARDWARE_INTERFACE_HANDLE_HPP

#include <memory>
#include <string>

namespace hardware_interface
{
class Handle
{
public:
  Handle(const std::string & prefix_name, const std::string & interface_name, double * value_ptr)
  : name_(prefix_name + "/" + interface_name), value_(value_ptr)
  {
  }
  const std::string & get_name() const { return name_; }
  template <class T>
  bool set_value(const T & value)
  {
    *value_ = value;
    return true;
  }

private:
  std::string name_;
  double * value_;
};

class CommandInterface : public Handle
{
public:
  using Handle::Handle;
  using SharedPtr = std::shared_ptr<CommandInterface>;
  CommandInterface(const CommandInterface &) = delete;
  CommandInterface(CommandInterface &&) = default;
};
}  // namespace hardware_interface

#endif

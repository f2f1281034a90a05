/* Stand-in: names of interfaces. */
#ifndef HARDWARE_INTERFACE_TYPE_VALUES_HPP
#define HARDWARE_INTERFACE_TYPE_VALUES_HPP

namespace hardware_interface
{
constexpr char HW_IF_POSITION[] = "position";
}  // namespace hardware_interface

#endif

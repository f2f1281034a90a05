/* Stand-in: the one plug-in of a program, by its base class. */
#ifndef PLUGINLIB_CLASS_LIST_MACROS_HPP
#define PLUGINLIB_CLASS_LIST_MACROS_HPP

#include <memory>

namespace pluginlib
{
template <class Base>
std::unique_ptr<Base> create();
}  // namespace pluginlib

#define PLUGINLIB_EXPORT_CLASS(class_type, base_class_type)          \
  template <>                                                        \
  std::unique_ptr<base_class_type> pluginlib::create<base_class_type>() \
  {                                                                  \
    return std::make_unique<class_type>();                           \
  }

#endif

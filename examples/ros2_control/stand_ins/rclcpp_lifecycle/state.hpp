/* Stand-in: a state of a lifecycle node. */
#ifndef RCLCPP_LIFECYCLE_STATE_HPP
#define RCLCPP_LIFECYCLE_STATE_HPP

namespace rclcpp_lifecycle
{
class State
{
};
}  // namespace rclcpp_lifecycle

#endif

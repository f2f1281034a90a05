/* Stand-in: numbers in a row. */
#ifndef STD_MSGS_MSG_FLOAT64_MULTI_ARRAY_HPP
#define STD_MSGS_MSG_FLOAT64_MULTI_ARRAY_HPP

#include <memory>
#include <vector>

namespace std_msgs
{
namespace msg
{
struct Float64MultiArray
{
  using SharedPtr = std::shared_ptr<Float64MultiArray>;
  std::vector<double> data;
};
}  // namespace msg
}  // namespace std_msgs

#endif

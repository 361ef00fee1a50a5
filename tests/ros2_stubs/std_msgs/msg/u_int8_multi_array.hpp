// The fields of std_msgs/UInt8MultiArray that examples/ros2_compensator uses; see rclcpp/rclcpp.hpp.
#pragma once
#include <cstdint>
#include <vector>

namespace std_msgs::msg
{
struct UInt8MultiArray
{
  std::vector<uint8_t> data;
};
}  // namespace std_msgs::msg

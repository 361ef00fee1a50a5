// The fields of geometry_msgs that examples/ros2_compensator uses; see rclcpp/rclcpp.hpp.
#pragma once
#include <memory>

#include <rclcpp/rclcpp.hpp>

namespace std_msgs::msg
{
struct Header
{
  builtin_interfaces::msg::Time stamp;
};
}  // namespace std_msgs::msg

namespace geometry_msgs::msg
{
struct Vector3
{
  double x, y, z;
};
struct Quaternion
{
  double x, y, z, w;
};
struct Wrench
{
  Vector3 force, torque;
};
struct WrenchStamped
{
  using ConstSharedPtr = std::shared_ptr<const WrenchStamped>;
  std_msgs::msg::Header header;
  Wrench wrench;
};
}  // namespace geometry_msgs::msg

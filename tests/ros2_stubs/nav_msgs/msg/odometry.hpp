// The fields of nav_msgs/Odometry that examples/ros2_compensator uses; see rclcpp/rclcpp.hpp.
#pragma once
#include <geometry_msgs/msg/wrench_stamped.hpp>

namespace nav_msgs::msg
{
struct Odometry
{
  using ConstSharedPtr = std::shared_ptr<const Odometry>;
  std_msgs::msg::Header header;
  struct
  {
    struct
    {
      geometry_msgs::msg::Vector3 position;
      geometry_msgs::msg::Quaternion orientation;
    } pose;
  } pose;
  struct
  {
    struct
    {
      geometry_msgs::msg::Vector3 linear, angular;
    } twist;
  } twist;
};
}  // namespace nav_msgs::msg

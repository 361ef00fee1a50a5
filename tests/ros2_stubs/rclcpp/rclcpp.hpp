// As much of rclcpp's interface as examples/ros2_compensator uses, to check that node's syntax and types without ROS.
#pragma once
#include <functional>
#include <memory>
#include <string>

namespace builtin_interfaces::msg
{
struct Time
{
  int sec;
  unsigned nanosec;
};
}  // namespace builtin_interfaces::msg

namespace rclcpp
{
struct KeepLast
{
  explicit KeepLast(std::size_t depth);
};
struct QoS
{
  QoS(const KeepLast & history);
  QoS & best_effort();
};
struct Time
{
  Time(const builtin_interfaces::msg::Time & stamp);
  double seconds() const;
};
struct Clock
{
  using SharedPtr = std::shared_ptr<Clock>;
};
struct Logger
{
};
template <typename M>
struct Publisher
{
  using SharedPtr = std::shared_ptr<Publisher>;
  void publish(const M & message);
};
template <typename M>
struct Subscription
{
  using SharedPtr = std::shared_ptr<Subscription>;
};
class Node
{
public:
  explicit Node(const std::string & name);
  virtual ~Node() = default;
  template <typename T>
  T declare_parameter(const std::string & name, const T & usual);
  template <typename M>
  typename Publisher<M>::SharedPtr create_publisher(const std::string & topic, const QoS & qos);
  template <typename M>
  typename Subscription<M>::SharedPtr create_subscription(
    const std::string & topic, const QoS & qos, std::function<void(typename M::ConstSharedPtr)> callback);
  Logger get_logger() const;
  Clock::SharedPtr get_clock() const;
};
void init(int argc, char ** argv);
void spin(std::shared_ptr<Node> node);
void shutdown();
void warn_throttle(const Logger & logger, Clock & clock, int milliseconds, const char * form, ...);
}  // namespace rclcpp

#define RCLCPP_WARN_THROTTLE(logger, clock, milliseconds, ...) \
  ::rclcpp::warn_throttle(logger, clock, milliseconds, __VA_ARGS__)

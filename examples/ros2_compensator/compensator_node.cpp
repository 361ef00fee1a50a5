// Desired wrenches in, commanded wrenches out: a ROS 2 node around the C99 of `wrenchgap export`. See README.md.
#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <memory>

#include <geometry_msgs/msg/wrench_stamped.hpp>
#include <nav_msgs/msg/odometry.hpp>
#include <rclcpp/rclcpp.hpp>
#include <std_msgs/msg/u_int8_multi_array.hpp>

#include "wrenchgap_record.h"

using geometry_msgs::msg::WrenchStamped;
using nav_msgs::msg::Odometry;
using std_msgs::msg::UInt8MultiArray;

namespace
{
std::array<double, 6> numbers(const geometry_msgs::msg::Wrench & wrench)
{
  return {wrench.force.x, wrench.force.y, wrench.force.z, wrench.torque.x, wrench.torque.y, wrench.torque.z};
}
}  // namespace

class CompensatorNode : public rclcpp::Node
{
public:
  CompensatorNode() : rclcpp::Node("compensator")
  {
    stale_ = declare_parameter<double>("stale", 0.1);
    airborne_ = declare_parameter<double>("airborne", 0.0);
    wg_reset(&memory_);
    const auto newest = rclcpp::QoS(rclcpp::KeepLast(1)).best_effort();
    commanded_ = create_publisher<WrenchStamped>("commanded", newest);
    record_ = create_publisher<UInt8MultiArray>("record", rclcpp::QoS(rclcpp::KeepLast(100)));
    desired_ = create_subscription<WrenchStamped>(
      "desired", newest, [this](WrenchStamped::ConstSharedPtr message) { step(*message); });
    odometry_ = create_subscription<Odometry>(
      "odometry", newest, [this](Odometry::ConstSharedPtr message) { remember(*message); });
    feedback_ = create_subscription<WrenchStamped>("feedback", newest, [this](WrenchStamped::ConstSharedPtr message) {
      const auto wrench = numbers(message->wrench);
      std::copy(wrench.begin(), wrench.end(), input_.feedback);
    });
  }

private:
  // Position and attitude of O in E. The twist of nav_msgs/Odometry is in B, the compensation wants velocity in E.
  void remember(const Odometry & message)
  {
    const auto & p = message.pose.pose.position;
    const auto & q = message.pose.pose.orientation;
    const auto & v = message.twist.twist.linear;
    const auto & w = message.twist.twist.angular;
    const double tx = 2.0 * (q.y * v.z - q.z * v.y), ty = 2.0 * (q.z * v.x - q.x * v.z), tz = 2.0 * (q.x * v.y - q.y * v.x);
    const double position[] = {p.x, p.y, p.z}, quat[] = {q.w, q.x, q.y, q.z}, rates[] = {w.x, w.y, w.z};
    const double velocity[] = {
      v.x + q.w * tx + (q.y * tz - q.z * ty), v.y + q.w * ty + (q.z * tx - q.x * tz),
      v.z + q.w * tz + (q.x * ty - q.y * tx)};
    for (int i = 0; i < 3; i++) {
      input_.position_E[i] = static_cast<wg_real>(position[i]);
      input_.velocity_E[i] = static_cast<wg_real>(velocity[i]);
      input_.omega_B[i] = static_cast<wg_real>(rates[i]);
    }
    for (int i = 0; i < 4; i++) {
      input_.quat_EB[i] = static_cast<wg_real>(quat[i]);
    }
    seen_ = rclcpp::Time(message.header.stamp).seconds();
    heard_ = true;
  }

  void step(const WrenchStamped & message)
  {
    WrenchStamped out = message;
    const double now = rclcpp::Time(message.header.stamp).seconds();
    if (!heard_ || !(std::fabs(now - seen_) <= stale_)) {
      pass(out, "no odometry, or an old one: desired wrench passed on unchanged");
      return;
    }
    if (!started_) {
      start_ = now;
      started_ = true;
    }
    const auto wrench = numbers(message.wrench);
    // An observer (export --observer) would take the torque of the ground for a disturbance.
    if (std::hypot(wrench[0], wrench[1], wrench[2]) < airborne_) {
      wg_reset(&memory_);
      commanded_->publish(message);
      return;
    }
    std::copy(wrench.begin(), wrench.end(), input_.wrench_desired);
    input_.time = static_cast<wg_real>(now - start_);
    wg_output result;
    UInt8MultiArray record;  // for `wrenchgap replay LOG --export compensator/`
    record.data.resize(WG_RECORD_BYTES);
    if (wg_step_recorded(&memory_, &input_, &result, number_++, record.data.data()) == WG_BAD_INPUT) {
      warn("input that is not finite: no compensation in this period");  // and wrench_cmd is what of it can be made
    }
    record_->publish(record);
    out.wrench.force.x = result.wrench_cmd[0];
    out.wrench.force.y = result.wrench_cmd[1];
    out.wrench.force.z = result.wrench_cmd[2];
    out.wrench.torque.x = result.wrench_cmd[3];
    out.wrench.torque.y = result.wrench_cmd[4];
    out.wrench.torque.z = result.wrench_cmd[5];
    commanded_->publish(out);
  }

  // The desired wrench as it is; the compensation forgets, and starts afresh with the next step.
  void pass(const WrenchStamped & message, const char * why)
  {
    wg_reset(&memory_);
    warn(why);
    commanded_->publish(message);
  }

  void warn(const char * why) { RCLCPP_WARN_THROTTLE(get_logger(), *get_clock(), 1000, "%s", why); }

  wg_memory memory_;
  wg_input input_{};
  bool heard_ = false, started_ = false;
  uint32_t number_ = 0;
  double seen_ = 0.0, start_ = 0.0, stale_ = 0.1, airborne_ = 0.0;
  rclcpp::Publisher<WrenchStamped>::SharedPtr commanded_;
  rclcpp::Publisher<UInt8MultiArray>::SharedPtr record_;
  rclcpp::Subscription<WrenchStamped>::SharedPtr desired_, feedback_;
  rclcpp::Subscription<Odometry>::SharedPtr odometry_;
};

int main(int argc, char ** argv)
{
  rclcpp::init(argc, argv);
  rclcpp::spin(std::make_shared<CompensatorNode>());
  rclcpp::shutdown();
  return 0;
}

"""Desired wrenches in, commanded wrenches out: a ROS 2 node (rclpy) around `wrenchgap.compensator`. See README.md.

python compensator_node.py --ros-args -p gp:=torque.gp -p model:=fitted.toml -p dt:=0.005
"""

import numpy as np
import rclpy
from geometry_msgs.msg import WrenchStamped
from nav_msgs.msg import Odometry
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data

import wrenchgap as wg
from wrenchgap.compensate import Settings
from wrenchgap.flight import UsageError, so3
from wrenchgap.plant.state import State


def seconds(stamp):
    """A stamp [s]."""
    return stamp.sec + 1e-9 * stamp.nanosec


def numbers(wrench):
    """A wrench of geometry_msgs as six numbers, force first."""
    f, t = wrench.force, wrench.torque
    return np.array([f.x, f.y, f.z, t.x, t.y, t.z])


class CompensatorNode(Node):
    """Keeps the newest odometry and feedback, and answers every desired wrench."""

    def __init__(self):
        super().__init__("compensator")
        usual = {
            "gp": "torque.gp",
            "model": "fitted.toml",
            "dt": 0.005,
            "stale": 0.1,
            "airborne": 0.0,
            "observer": False,
        }
        gp, model, dt, self.stale, self.airborne, observer = (
            self.declare_parameter(name, value).value for name, value in usual.items()
        )
        make = wg.combined if observer else wg.compensator
        self.compensator = make(wg.load_gp(gp), wg.load_model(model), Settings(dt=dt))
        self.feedback = np.zeros(6)
        self.odometry = self.start = None
        self.commanded = self.create_publisher(WrenchStamped, "commanded", qos_profile_sensor_data)
        for topic, kind, function in (
            ("desired", WrenchStamped, self.step),
            ("odometry", Odometry, self.remember),
            ("feedback", WrenchStamped, self.hear),
        ):
            self.create_subscription(kind, topic, function, qos_profile_sensor_data)

    def remember(self, message):
        """The newest pose and twist; the twist of nav_msgs/Odometry is in B."""
        self.odometry = message

    def hear(self, message):
        """Minus the estimate of an observer."""
        self.feedback = numbers(message.wrench)

    def state(self, time):
        """The state (N = 1) at a time [s], or None where there is no odometry that is young enough."""
        if self.odometry is None or not abs(time - seconds(self.odometry.header.stamp)) <= self.stale:
            return None
        pose, twist = self.odometry.pose.pose, self.odometry.twist.twist
        p, q, v, w = pose.position, pose.orientation, twist.linear, twist.angular
        self.start = time if self.start is None else self.start
        quat_EB = np.array([[q.w, q.x, q.y, q.z]])
        return State(
            time=np.array([time - self.start]),
            position_E=np.array([[p.x, p.y, p.z]]),
            quat_EB=quat_EB,
            velocity_E=so3.rotate(quat_EB, np.array([[v.x, v.y, v.z]])),
            omega_B=np.array([[w.x, w.y, w.z]]),
        )

    def step(self, message):
        """One period: the desired wrench, corrected; or as it is, where that cannot be done."""
        state = self.state(seconds(message.header.stamp))
        out, desired = message, numbers(message.wrench)
        try:
            if state is None:
                raise UsageError("no odometry, or an old one")
            if np.linalg.norm(desired[:3]) < self.airborne:  # an observer would learn the torque of the ground
                self.compensator.reset()
                self.commanded.publish(out)
                return
            wrench = self.compensator.step(desired + self.feedback, state).wrench_cmd
            f, t = out.wrench.force, out.wrench.torque
            f.x, f.y, f.z, t.x, t.y, t.z = (float(value) for value in wrench)
        except UsageError as why:
            self.compensator.reset()
            self.get_logger().warning(f"desired wrench passed on unchanged: {why}", throttle_duration_sec=1.0)
        self.commanded.publish(out)


def main():
    """Spin until told to stop."""
    rclpy.init()
    rclpy.spin(CompensatorNode())
    rclpy.shutdown()


if __name__ == "__main__":
    main()

"""When a sensor of the IMU and the odometry show one motion, and from when on its scale is wrong."""

from dataclasses import dataclass


@dataclass(frozen=True)
class ScaleThresholds:
    """How the scale of a sensor is estimated, and when it is wrong."""

    windows: tuple[float, float] = (0.15, 0.6)
    """Windows [s] over which angles are compared: up to 3 Hz and up to 0.8 Hz."""
    block: float = 8.0
    """Time [s] from which a bias and its slope are removed."""
    part: float = 2.0
    """Parts of a block [s], whose scatter says how sure the scale is."""
    margin: float = 0.1
    """Margin at a block's ends [s], for stamps that move."""
    spacing: float = 0.03
    """Time between attitudes of which angles are taken [s]: short enough for turns about changing axes to add up."""
    most_blocks: int = 60
    """Blocks, evenly spread over the flight, beyond which no more are taken."""
    fewest_parts: int = 6
    """Parts below which nothing is said."""
    loudest: float = 75.0
    """Percentile of the motion in the parts to which louder ones are turned down: a crash does not decide."""
    slowest_imu: float = 0.05
    """Period of an IMU [s] beyond which its integral misses the motion."""
    said: float = 0.02
    """How far from one a scale is said: mass and thrust that explain it come out wrong by about as much."""
    stops: float = 0.05
    """How far from one a scale stops the log."""
    askew: float = 0.15
    """How far from one the scale of an accelerometer's axis stops the log: one that is mounted askew by 15 deg, which
    is an effect, has been seen off by 0.07 in flight, and by 0.11 in one half of it against the other."""
    sure: float = 4.0
    """Standard deviations that both bounds lie on one side of one: a chance of 1 % with so few parts (Student, 5)."""
    steady: float = 0.01
    """By which bounds and bands may differ."""
    steady_share: float = 0.25
    """Or by this share of how far the scale is from one."""
    known: float = 0.1
    """Between bounds further apart a scale is not known: twice what stops a log."""
    shown: float = 0.8
    """Mean correlation over parts, by their motion, from which on an axis shows the attitude's turns."""
    unseen: float = 0.3
    """Mean correlation up to which it does not: twice that of unrelated turns in three parts of 13 windows."""
    similar: float = 0.5
    """Share of the other side's motion that the odometry has where an axis is lost; its noise alone has 1 - shown^2.
    And share of what another axis shows that one must read to read that: one askew by 20 deg reads a third."""
    perfect: float = 0.9999
    """Correlation beyond which there is none larger."""
    late: float = 2e-3
    """By how much one sensor must be later than the other [s]: half a sample at 250 Hz."""
    certain: float = 3.0
    """Standard deviations by which it is, as for other offsets (`learn.diagnose.timing`)."""
    delays: int = 6
    """Groups of blocks without each of which a delay is taken again, for its deviation."""
    steps: int = 11
    """Delays at which a search begins, 20 ms apart; with 6 or 21 the same late sensors are found, but for one in 22."""
    clearly: float = 0.7
    """Share of what the delay next to zero leaves that another one leaves at most. Half of it finds 20 late sensors of
    36 in place of 22; where any share will do, noise alone moves the delay of hovers by 20 to 90 ms."""
    settled: float = 1e-4
    """Step of the search [s] at which it ends."""
    stepped: float = 0.025
    """By how much a delay must step in flight [s] to be said: two recorded flights have 10 and 20 ms."""
    plain: float = 0.95
    """Correlation from which on a part shows plainly one motion: its bounds are 1 / 0.95^2 = 1.11 apart."""
    unit: float = 3.0
    """Factor between the scales of such parts from which on they have another unit; degrees make 57. Without the two
    furthest parts either way 84 recorded flights have 1.85 at most, after a crash, and 1.39 else."""
    longest_delay: float = 0.1
    """Delay [s] between the two beyond which they show no common motion."""


SCALE = ScaleThresholds()

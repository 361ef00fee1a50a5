"""When a sensor of the IMU and the odometry show one motion, and from when on its scale is wrong."""

from dataclasses import dataclass


@dataclass(frozen=True)
class ScaleThresholds:
    """How the scale of a sensor is estimated, and when it is wrong."""

    windows: tuple[float, float] = (0.15, 0.6)
    """Windows [s] over which angles are compared: up to 3 Hz and up to 0.8 Hz."""
    block: float = 8.0
    """Time [s] from which a bias and its slope are removed."""
    segment: float = 2.0
    """Segments of a block [s], whose scatter is the scale's standard deviation."""
    margin: float = 0.1
    """Margin at a block's ends [s], for stamps that move."""
    spacing: float = 0.03
    """Time between attitudes of which angles are taken [s]: short enough for turns about changing axes to add up."""
    most_blocks: int = 60
    """Blocks, evenly spread over the flight, beyond which no more are taken."""
    fewest_segments: int = 6
    """Segments below which nothing is said."""
    loudest_percentile: float = 75.0
    """Percentile of the motion in the segments to which louder ones are turned down: a crash does not decide."""
    slowest_imu: float = 0.05
    """Period of an IMU [s] beyond which its integral misses the motion."""
    reported: float = 0.02
    """How far from one a scale is reported: mass and thrust that explain it come out wrong by about as much."""
    refused: float = 0.05
    """How far from one a scale stops the log."""
    refused_axis: float = 0.15
    """How far from one the scale of an accelerometer's axis stops the log: one that is mounted askew by 15 deg, which
    is an effect, has been seen off by 0.07 in flight, and by 0.11 in one half of it against the other."""
    sigmas: float = 4.0
    """Standard deviations that both bounds are on one side of one: a chance of 1 % with few segments (Student, 5)."""
    tolerance: float = 0.01
    """By which bounds and bands may differ."""
    tolerance_share: float = 0.25
    """Or by this share of how far the scale is from one."""
    widest: float = 0.1
    """Between bounds further apart a scale is not known: twice what stops a log."""
    correlated: float = 0.8
    """Mean correlation over segments, by their motion, from which on an axis shows the attitude's turns."""
    uncorrelated: float = 0.3
    """Mean correlation up to which it does not: twice that of unrelated turns in three segments of 13 windows."""
    least_motion: float = 0.5
    """Share of the other side's motion that the odometry has where an axis is lost: noise alone has 1 - correlated^2.
    And share of what another axis shows that one must read to read that: one askew by 20 deg reads a third."""
    largest_correlation: float = 0.9999
    """Correlation beyond which there is none larger."""
    least_delay: float = 2e-3
    """By how much one sensor must be later than the other [s]: half a sample at 250 Hz."""
    delay_sigmas: float = 3.0
    """Standard deviations by which it is, as for other offsets (`learn.diagnose.timing`)."""
    jackknife_groups: int = 6
    """Groups of blocks without each of which a delay is taken again, for its deviation."""
    delay_starts: int = 11
    """Delays at which a search begins, 20 ms apart; with 6 or 21 the same late sensors are found, but for one in 22."""
    far_misfit: float = 0.7
    """Share of the misfit of the delay next to zero that another one has at most. Half of it finds 20 late sensors of
    36 in place of 22; where any share will do, noise alone moves the delay of hovers by 20 to 90 ms."""
    delay_tolerance: float = 1e-4
    """Step of the search [s] at which it ends."""
    least_step: float = 0.025
    """By how much a delay must step in flight [s] to be said: two recorded flights have 10 and 20 ms."""
    clear_correlation: float = 0.95
    """Correlation from which on a segment shows plainly one motion: its bounds are 1 / 0.95^2 = 1.11 apart."""
    unit_factor: float = 3.0
    """Factor between the scales of such segments from which on they have another unit; degrees make 57. Without the two
    furthest segments either way 84 recorded flights have 1.85 at most, after a crash, and 1.39 else."""
    least_corner: float = 0.02
    """Corner of a gyroscope's high-pass [Hz] from which on it stops a log: J c omega is 0.6 of a typical rotational
    drag there. Of 60 recorded flights none shows one on all axes."""
    longest_delay: float = 0.1
    """Delay [s] between the two beyond which they show no common motion."""


SCALE = ScaleThresholds()

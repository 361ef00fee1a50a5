"""The search for the mend, masks and clocks: each fault alone, and healthy logs that look like it."""

import re
import shlex
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from wrenchgap import flight
from wrenchgap.flight.check import NAMES, Check, accepted_names, accepting, stop_where_bad
from wrenchgap.flight.checks import with_checks
from wrenchgap.flight.checks.attitude import rate_check
from wrenchgap.flight.checks.motion import PERMUTATIONS, best_axes
from wrenchgap.flight.checks.remedies import _with, option
from wrenchgap.flight.clocks import relation, without_jumps
from wrenchgap.flight.errors import LogError, UsageError
from wrenchgap.flight.flight import ActuatorSeries, Flight, ImuSeries, OdometrySeries, WrenchSeries
from wrenchgap.flight.resample import resample
from wrenchgap.flight.stamps import gaps_of

SECOND = 1_000_000_000


def white(rng, count, size=1.0):
    return size * rng.standard_normal((count, 3))


def test_there_are_48_ways_to_name_three_axes():
    assert len({p.tobytes() for p in PERMUTATIONS}) == 48
    assert all(np.allclose(p @ p.T, np.eye(3)) for p in PERMUTATIONS)
    assert sum(np.linalg.det(p) > 0 for p in PERMUTATIONS) == 24
    assert np.array_equal(PERMUTATIONS[0], np.eye(3))


@pytest.mark.parametrize("number", range(1, 48, 5))
def test_each_is_found_back(number):
    rng = np.random.default_rng(number)
    truth = white(rng, 400)
    found = best_axes([(truth, truth @ PERMUTATIONS[number] + white(rng, 400, 0.3))])
    assert np.array_equal(found.matrix, PERMUTATIONS[number])


@pytest.mark.parametrize("degrees", [-45.0, 30.0, 60.0])
def test_a_rotation_between_the_axes_is_found_back(degrees):
    rng = np.random.default_rng(3)
    truth = white(rng, 400)
    turn = Rotation.from_euler("z", degrees, degrees=True)
    found = best_axes([(truth, turn.inv().apply(truth) + white(rng, 400, 0.1))])
    assert found.words == f"yaw={degrees:g}"


def test_nothing_is_proposed_for_noise_for_small_angles_or_for_what_is_right():
    rng = np.random.default_rng(4)
    truth = white(rng, 400)
    assert best_axes([(truth, white(rng, 400))]) is None
    assert best_axes([(truth, truth + white(rng, 400, 0.5))]) is None
    turn = Rotation.from_euler("x", 10.0, degrees=True)
    assert best_axes([(truth, turn.apply(truth))]) is None


def moving(seconds=12.0, rate=100.0, change=lambda name, values: values):
    """A flight whose channels all go on, each with noise; `change` spoils one by its name."""
    rng = np.random.default_rng(8)
    time = np.arange(0.0, seconds, 1.0 / rate)
    angle = 0.3 * np.sin(1.3 * time)
    quat = np.stack((np.cos(angle / 2), np.sin(angle / 2), 0 * time, 0 * time), axis=1)
    omega = np.stack((0.39 * np.cos(1.3 * time), 0 * time, 0 * time), axis=1) + white(rng, len(time), 0.01)
    force = np.stack((0 * time, 9.81 * np.sin(angle), 9.81 * np.cos(angle)), axis=1) + white(rng, len(time), 0.05)
    imu = ImuSeries("/imu", time, change("omega", omega), change("force", force))
    position = change("position", white(rng, len(time), 1e-3) + np.stack((time, time, 0 * time), axis=1))
    odometry = OdometrySeries("/odom", time, position, quat)
    wrench = np.hstack((15.0 * force / 9.81, white(rng, len(time), 0.1)))
    commanded = WrenchSeries("/w", time, change("wrench", wrench))
    return Flight("f", "f.mcap", "0" * 64, 0, commanded=commanded, imu=imu, odometry=odometry)


def test_a_sample_alone_behind_a_gap_that_is_left_out_takes_the_gap_with_it():
    """Else a series ends in a gap, behind which nothing is."""
    found = moving()
    force = found.imu.specific_force_B.copy()
    force[-1] = 1e6
    alone = {**vars(found.imu), "time": np.append(found.imu.time[:-1], 100.0), "specific_force_B": force}
    imu = ImuSeries(**{name: alone[name] for name in ("topic", "time", "omega_B", "specific_force_B")})
    imu = replace(imu, gaps=gaps_of(imu.time))
    assert imu.gaps[-1].stop == 100.0
    clean = with_checks(replace(found, imu=imu, odometry=None))
    assert len(clean.imu.time) == len(imu.time) - 1
    assert clean.imu.gaps == ()
    assert len(resample(clean, 50.0, ("commanded", "imu")).samples) == 1


def spoilt(name, rows, value=None, column=slice(None)):
    def change(which, values):
        if which == name:
            values = values.copy()
            values[rows, column] = values[rows, column][0] if value is None else value
        return values

    return change


def found_in(one):
    return {c.name: c for c in with_checks(one).checks if c.level != "ok"}


def test_a_channel_that_stands_still_is_left_out_for_so_long():
    one = with_checks(moving(change=spoilt("omega", slice(400, 700), column=1)))
    assert one.checks[0].name == "frozen"
    (left,) = one.left_out
    assert (left.start, left.stop) == pytest.approx((4.0, 6.99), abs=0.02)
    assert len(one.imu.gaps) == 1
    assert one.imu.dropped["frozen"] == pytest.approx(299, abs=2)


def test_what_may_stand_still_is_kept():
    """Quantised channels, commands at their limit, rest at either end, and everything at rest together."""
    low = moving().commanded.wrench_B[:, 2].min() - 1.0
    assert "frozen" not in found_in(moving(change=lambda n, v: np.round(v, 1) if n == "force" else v))
    assert "frozen" not in found_in(moving(change=spoilt("wrench", slice(400, 700), low, 2)))
    assert "frozen" not in found_in(moving(change=spoilt("omega", slice(0, 300))))
    still = slice(400, 700)
    every = moving(change=lambda n, v: spoilt(n, still)(n, v))
    assert "frozen" not in found_in(every)


def landing(seconds=0.8):
    """A flight of 8 s, then the ground, which carries the vehicle while a landed controller holds half of the thrust.

    What the controller asks stands still for a while, above its idle at the end; gyroscope and attitude go on.
    """

    def change(name, values):
        values = values.copy()
        if name == "wrench":
            values[800:, :3] *= 0.1
            values[820 : 820 + round(100 * seconds), :3] = 0.0, 0.0, 7.0
        return values

    return moving(change=change)


def test_a_thrust_that_is_held_on_the_ground_is_a_command_and_no_dead_channel():
    """At half of the thrust of the flight the accelerometer reads all of g: the ground carries the vehicle."""
    assert "frozen" not in found_in(landing())
    flying = found_in(moving(change=spoilt("wrench", slice(400, 500), 14.7, 2)))["frozen"].words
    assert flying.endswith("stands still for 0.99 s at 4.00 s, in mid-flight: left out.")


def test_a_sensor_that_stands_still_on_the_ground_is_not_said_to_do_so_in_mid_flight():
    idle = moving(change=lambda n, v: np.where(np.arange(len(v))[:, None] < 700, v, 0.1 * v) if n == "wrench" else v)
    rate = idle.imu.omega_B.copy()
    rate[800:1000, 1] = rate[800, 1]
    (found,) = (c for c in with_checks(replace(idle, imu=replace(idle.imu, omega_B=rate))).checks if c.name == "frozen")
    assert found.words.endswith("stands still for 1.99 s at 8.00 s: left out.")


@pytest.mark.parametrize(("slope", "noise"), [(0.7, 0.8), (1.0, 1.0)])
def test_the_scale_of_a_gyroscope_is_said_as_a_range_that_holds_it(slope, noise):
    """Noise of the truth divides the regression by 1 + noise^2, that of the reading multiplies the inverse one; where
    the range has a scale of one in it nothing is wrong.
    """
    rng = np.random.default_rng(11)
    rate = white(rng, 20_000)
    pair = rate + white(rng, 20_000, noise), slope * rate + white(rng, 20_000, 0.2 * slope)
    check = rate_check("gyroscope", moving(), pair, ("imu",), "gyro")
    assert check.level == ("ok" if slope == 1.0 else "warn")
    said = r"factor ([\d.]+) to ([\d.]+)" if slope == 1.0 else r"between ([\d.]+), if .* and ([\d.]+), if"
    low, high = (float(v) for v in re.findall(said, check.words)[0])
    assert low == pytest.approx(slope / (1.0 + noise**2), abs=0.02)
    assert high == pytest.approx(1.04 * slope, abs=0.03)
    for least, most in re.findall(r"F between ([\d.]+) and ([\d.]+)", check.words):
        assert (float(least), float(most)) == pytest.approx((1.0 / high, 1.0 / low), rel=0.02)


@pytest.mark.parametrize("name", ["omega", "force"])
def test_a_sensor_that_dies_is_left_out_to_the_end_of_the_log(name):
    one = with_checks(moving(change=spoilt(name, slice(800, None))))
    found = {c.name: c for c in one.checks}["frozen"]
    assert found.level == "warn"
    assert "at 8.00 s, to the end of the log" in found.words
    assert one.imu.time[-1] == pytest.approx(8.0)
    assert found_in(moving(change=spoilt(name, slice(400, None))))["frozen"].level == "bad"


def test_rest_after_a_landing_is_no_dead_sensor():
    """Free of noise, as in a simulator: everything but the commands stands still to the end."""
    still = slice(800, None)
    landed = moving(change=lambda n, v: v if n == "wrench" else spoilt(n, still)(n, v))
    quat = landed.odometry.quat_EB.copy()
    quat[still] = quat[800]
    assert "frozen" not in found_in(replace(landed, odometry=replace(landed.odometry, quat_EB=quat)))


def stopped(flight, start, *, attitude):
    """With an odometry that repeats its row at `start` until the end."""
    odometry, still = flight.odometry, slice(start, None)
    velocity = np.gradient(odometry.position_E, odometry.time, axis=0)
    position, quat = odometry.position_E.copy(), odometry.quat_EB.copy()
    position[still], velocity[still] = position[start], 0.0
    if attitude:
        quat[still] = quat[start]
    return replace(flight, odometry=replace(odometry, position_E=position, quat_EB=quat, velocity_E=velocity))


@pytest.mark.parametrize("attitude", [False, True])
def test_an_odometry_that_stops_while_the_imu_flies_on_is_left_out_to_the_end(attitude):
    one = with_checks(stopped(moving(), 800, attitude=attitude))
    found = {c.name: c for c in one.checks}["frozen"]
    assert found.level == "warn"
    assert "odometry (position_E 0" in found.words
    assert "at 8.00 s, to the end of the log" in found.words
    assert one.odometry.time[-1] == pytest.approx(8.0)
    half = found_in(stopped(moving(), 400, attitude=attitude))["frozen"]
    assert half.level == "bad"
    assert half.mend == "--topic odometry=none"


def test_an_odometry_at_rest_with_an_imu_that_only_has_noise_is_no_dead_one():
    """A landing in a simulator: the pose is exact, the IMU has its noise to the end."""
    rng = np.random.default_rng(2)

    def landed(name, values):
        if name in ("omega", "force"):
            values = values.copy()
            values[:800] += np.sin(np.outer(np.arange(800) / 100.0, [2.0, 3.0, 4.0]))
            values[800:] = (name == "force") * np.array([0.0, 0.0, 9.81]) + white(rng, len(values) - 800, 0.05)
        return values

    assert "frozen" not in found_in(stopped(moving(change=landed), 800, attitude=True))


@pytest.mark.parametrize(("noise", "level"), [(0.1, "ok"), (1.0, "warn")])
def test_rates_that_an_attitude_shows_by_half_do_not_agree(noise, level):
    """Noise of the attitude as large as its motion: a factor of 0.6 is not "ok", and the causes are named."""
    flight = moving()
    rng = np.random.default_rng(3)
    shaken = Rotation.from_quat(flight.odometry.quat_EB, scalar_first=True) * Rotation.from_rotvec(
        white(rng, len(flight.odometry.time), 0.03 * noise)
    )
    noisy = replace(flight.odometry, quat_EB=shaken.as_quat(scalar_first=True))
    found = {c.name: c for c in with_checks(replace(flight, odometry=noisy)).checks}["gyroscope"]
    assert found.level == level
    if level == "warn":
        assert found.mend is None
        for part in ("Noise of the attitude", "--shift odometry=SECONDS", "gyro*"):
            assert part in found.words


def test_a_gyroscope_whose_numbers_have_no_square_is_looked_at_and_no_division_by_zero():
    found = with_checks(moving(change=lambda name, v: v * 1e-300 if name == "omega" else v)).checks
    assert {c.name: c for c in found}["gyroscope"].level != "ok"


def test_an_imu_stuck_for_most_of_the_log_is_bad():
    assert found_in(moving(change=spoilt("omega", slice(200, 1000))))["frozen"].level == "bad"


def test_spikes_are_left_out_and_units_are_not_spikes():
    one = with_checks(moving(change=spoilt("force", [300, 301, 800], 1e5, 0)))
    assert one.imu.dropped["beyond what is possible"] == 3
    assert found_in(moving(change=spoilt("force", [300, 301, 800], 1e5, 0)))["spikes"].level == "warn"
    large = with_checks(moving(change=lambda n, v: 1e3 * v if n == "force" else v))
    assert len(large.imu.time) == len(moving().imu.time)


def test_stamps_that_count_something_else_are_a_unit():
    log = np.arange(0, 10 * SECOND, SECOND // 100)
    for factor in (1000, 1_000_000):
        assert relation(log, 7 + factor * log).unit == factor
    for drift in (1.0001, 0.5, 3.0, 900.0):
        assert relation(log, np.round(drift * log).astype(np.int64)).unit is None


def test_a_clock_that_is_set_goes_on_and_a_pause_is_no_jump():
    log = np.arange(0, 10 * SECOND, SECOND // 100)
    hour = 3600 * SECOND
    header = log + 5_000_000 + np.where(np.arange(len(log)) >= 500, hour, 0)
    moved, jumps = without_jumps(log, header)
    assert [index for index, _ in jumps] == [500]
    assert np.allclose(moved - log, 5_000_000, atol=1e3)
    assert relation(log, moved).rate == pytest.approx(1.0)
    paused = np.concatenate((log[:500], log[500:] + 20 * SECOND))
    assert without_jumps(paused, paused + 1000)[1] == ()
    assert without_jumps(paused, paused // 2)[1] == ()  # a simulator at half real time
    wrong = header.copy()
    wrong[:] = log
    wrong[300] += hour  # one stamp
    assert without_jumps(log, wrong)[1] == ()


def test_the_refusal_is_one_line_with_the_mend_and_the_way_to_accept():
    checks = [Check("weight", "warn", "W."), Check("body-frame", "bad", "B.", "--topic imu=/imu:frd")]
    with pytest.raises(LogError) as refused:
        stop_where_bad("x.mcap", checks)
    assert str(refused.value) == (
        "x.mcap: body-frame: B; read it with --topic imu=/imu:frd, or take it as it is with --accept body-frame"
    )
    stop_where_bad("x.mcap", accepting(checks, accepted_names(["Body Frame"])))
    with pytest.raises(UsageError, match="no check is called so"):
        accepted_names(["imu"])


def test_every_check_has_its_row_in_the_page():
    page = (Path(__file__).parents[2] / "docs" / "checks.md").read_text(encoding="utf-8")
    assert [name for name in NAMES if f"`{name}`" not in page] == []


def test_every_check_that_is_made_can_be_accepted_by_its_name():
    root = Path(__file__).parents[2]
    files = [path for top in ("flight", "learn", "replay") for path in (root / top).rglob("*.py")]
    call = r'\bCheck\(\s*"([a-z-]+)",\s*(?:level|"(?:ok|warn|bad)")'
    made = {name for path in files for name in re.findall(call, path.read_text(encoding="utf-8"))}
    assert len(made) > 30
    assert made - set(NAMES) == set()


def test_a_slow_odometry_is_no_opposite_gyroscope():
    """1 Hz: differences of the attitude are aliases of the motion."""
    for rate in (1.0, 2.0, 4.0):
        one = moving(seconds=60.0)
        every = round(100.0 / rate)
        arrays = {k: getattr(one.odometry, k)[::every] for k in ("time", "position_E", "quat_EB")}
        slow = flight.OdometrySeries("/odom", **arrays)
        assert not [c for c in found_in(replace(one, odometry=slow)).values() if c.level == "bad"]


def test_pairs_of_faults_of_an_imu_are_both_said():
    flipped = np.diag([1.0, -1.0, -1.0])  # forward-right-down

    def change(name, values):
        return values @ flipped / (9.81 if name == "force" else 1.0) if name in ("omega", "force") else values

    names = {c.name for c in with_checks(moving(change=change)).checks if c.level == "bad"}
    assert {"accelerometer-unit", "body-frame"} <= names


def test_two_vehicles_in_one_log_are_asked_for_not_guessed(logs, tmp_path):
    time, recording = np.arange(0, 6, 0.01), logs.Recording()
    for name in ("uav1", "uav2"):
        for topic in ("/command/wrench", "/imu", "/odometry"):
            kind, columns = logs.PLAIN[topic]
            recording.series(f"/{name}{topic}", kind, time, columns(time), stamp_s=True)
    path = recording.save(tmp_path / "log.mcap")
    assert flight.load(path).checks[0].name == "vehicles"
    told = flight.load(path, topics={"commanded": "/uav2/command/wrench"})
    assert "vehicles" not in {check.name for check in told.checks}
    assert {series.topic.split("/")[1] for series in told.series().values()} == {"uav2"}


@pytest.mark.parametrize("name", ["a$(id>pwned)", "a;id>pwned", "a'$(id>pwned)'", "a b"])
def test_an_option_that_names_a_topic_is_one_word_to_a_shell(logs, tmp_path, name):
    time, recording = np.arange(0, 6, 0.01), logs.Recording()
    for space in (name, f"{name}2"):
        for topic in ("/command/wrench", "/imu", "/odometry"):
            kind, columns = logs.PLAIN[topic]
            recording.series(f"/{space}{topic}", kind, time, columns(time), stamp_s=True)
    check = flight.load(recording.save(tmp_path / "log.mcap")).checks[0]
    assert check.name == "vehicles"
    assert shlex.split(check.mend) == ["--topic", f"commanded=/{name}/command/wrench"]


def test_a_follower_beside_a_leader_without_a_namespace_is_asked_for_and_never_mixed(logs, tmp_path):
    time, recording = np.arange(0, 6, 0.01), logs.Recording()
    for name in ("", "/follower"):
        for topic in ("/command/wrench", "/imu", "/odometry"):
            kind, columns = logs.PLAIN[topic]
            recording.series(f"{name}{topic}", kind, time, columns(time), stamp_s=True)
    path = recording.save(tmp_path / "log.mcap")
    guessed = flight.load(path)
    assert guessed.checks[0].name == "vehicles"
    assert {s.topic for s in guessed.series().values()} == {"/command/wrench", "/imu", "/odometry"}
    told = flight.load(path, topics={"imu": "/follower/imu"})
    assert "vehicles" not in {check.name for check in told.checks}
    assert all(series.topic.startswith("/follower/") for series in told.series().values())


@pytest.mark.parametrize(
    ("source", "by", "mended"),
    [
        ("/imu:g", 0.102, "/imu"),
        ("/imu:frd,g", 0.102, "/imu:frd"),
        ("/imu:g", 1e-3, "/imu:accel*0.00981"),
        ("/imu:accel*2", 0.5, "/imu"),
        ("/imu:frd", 0.102, "/imu:frd,accel*0.102"),
        ("/imu", 0.102, "/imu:accel*0.102"),
    ],
)
def test_a_factor_takes_the_place_of_the_word_that_it_undoes(source, by, mended):
    assert _with(source, f"accel*{by:g}") == mended


def test_what_cannot_be_accepted_is_not_offered_to_be():
    assert Check("model", "bad", "no flight").remedy == ""
    assert Check("gaps", "bad", "many").remedy == "or say --accept gaps"


@pytest.mark.parametrize("channel", ["rate", "wrench"])
def test_odometry_rates_and_a_wrench_along_z_alone_freeze_too(channel):
    """The wrench of a vehicle with fixed rotors has forces that are zero throughout: those rest at no limit."""

    def change(name, values):
        if name != channel:
            return values
        out = values.copy()
        if name == "wrench":
            out[:, :2] = 0.0
        out[400:600] = out[400]
        return out

    log = moving(change=change)
    rate = change("rate", log.imu.omega_B + white(np.random.default_rng(6), len(log.imu.time), 0.01))
    found = with_checks(replace(log, odometry=replace(log.odometry, omega_B=rate)))
    assert "frozen" in {c.name for c in found.checks if c.level == "warn"}
    (gone, *_) = found.left_out
    assert (gone.start, gone.stop) == pytest.approx((4.0, 5.99))


def test_a_command_that_leaps_to_zero_and_back_was_lost_and_one_that_came_there_rests():
    time = np.arange(0.0, 12.0, 0.01)
    rng = np.random.default_rng(2)
    speed = 500.0 + 20.0 * rng.standard_normal((len(time), 4))
    lost, clipped = speed.copy(), speed.copy()
    lost[400:550, 1] = 0.0
    clipped[:, 1] = np.clip(600.0 * np.sin(0.9 * time) + speed[:, 1] - 500.0, 0.0, None)

    def found(values):
        sent = ActuatorSeries("/a", time, np.zeros((len(time), 0)), values)
        return {c.name for c in with_checks(replace(moving(), actuators=sent)).checks if c.level == "warn"}

    assert "frozen" in found(lost)
    assert "frozen" not in found(clipped)


def test_a_flip_faster_than_half_a_turn_in_an_interval_is_no_wrong_gyroscope():
    """At 17 rad/s an interval of 0.2 s turns by 3.4 rad, which two attitudes show as 2.9 rad the other way."""
    time = np.arange(0.0, 12.0, 0.01)
    rate = 0.3 * np.sin(2.0 * time) + 17.0 * ((time > 5.0) & (time < 5.0 + 2.0 * np.pi * 3.0 / 17.0))
    angle = np.concatenate(([0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * 0.01)))
    zero = np.zeros_like(time)
    quat = np.column_stack((np.cos(angle / 2), np.sin(angle / 2), zero, zero))
    omega = np.column_stack((rate, zero, zero))
    force = Rotation.from_quat(quat, scalar_first=True).inv().apply([0.0, 0.0, 9.80665])
    odometry = OdometrySeries("/odometry", time, np.zeros((len(time), 3)), quat, np.zeros((len(time), 3)), omega)
    imu = ImuSeries("/imu", time, omega, force)
    for sensor, name in ((imu, "gyroscope"), (None, "odometry-rate")):
        found = with_checks(Flight("f", Path("f"), "0", 0, imu=sensor, odometry=odometry)).checks
        assert {c.name: c.level for c in found}.get(name, "ok") == "ok"


def test_rates_that_nobody_fills_in_are_not_those_of_a_vehicle_that_turns():
    flight = moving()
    for share, level in ((1.0, "ok"), (0.0, "bad")):
        rated = replace(flight.odometry, omega_B=share * flight.imu.omega_B)
        checks = {c.name: c for c in with_checks(replace(flight, imu=None, odometry=rated)).checks}
        found = checks.get("odometry-rate")
        assert (found.level if found else "ok") == level
    assert found.mend == "--topic twist=none"


def test_a_mend_of_an_imu_of_two_topics_names_the_sensor_that_it_is_about():
    two = replace(moving(), mapping={"imu": "/acc", "gyroscope": "/gyro"})
    assert option(two, "deg", "imu") == "--topic gyroscope=/gyro:deg"
    assert option(two, "g", "imu") == "--topic accelerometer=/acc:g"
    assert option(two, "frd", "imu") == "--topic gyroscope=/gyro:frd --topic accelerometer=/acc:frd"


def hovering(imu_down, wrench_down):
    """A hover: specific force and commanded force point up, in forward-right-down axes along -z."""
    rng = np.random.default_rng(8)
    time = np.arange(0.0, 10.0, 0.01)
    up = np.array([0.0, 0.0, 9.8])
    force = up * (-1.0 if imu_down else 1.0) + white(rng, len(time), 0.2)
    wrench = np.hstack((4.0 * up * (-1.0 if wrench_down else 1.0) + white(rng, len(time), 0.2), white(rng, len(time))))
    imu = ImuSeries("/imu", time, white(rng, len(time), 0.1), force)
    log = Flight("hover", "hover.mcap", "0" * 64, 0, commanded=WrenchSeries("/w", time, wrench), imu=imu)
    return {check.name: check for check in with_checks(log).checks if check.level == "bad"}


def test_a_wrench_that_is_opposite_to_a_wrong_imu_alone_has_no_mend_of_its_own():
    """Two mends at once would turn both, and they would be opposite again."""
    both = hovering(imu_down=True, wrench_down=False)
    assert both["body-frame"].mend.endswith(":frd")
    assert both["wrench-frame"].mend is None
    assert "follows from the IMU's axes (body-frame)" in both["wrench-frame"].words
    alone = hovering(imu_down=False, wrench_down=True)
    assert "body-frame" not in alone
    assert alone["wrench-frame"].mend.endswith(":frd")
    assert "wrench-frame" not in hovering(imu_down=True, wrench_down=True)
    assert not {"body-frame", "wrench-frame"} & set(hovering(imu_down=False, wrench_down=False))

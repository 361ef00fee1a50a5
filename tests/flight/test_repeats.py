"""The same flight under two names is known by its samples; other flights of the same vehicle are not it."""

from dataclasses import replace

import numpy as np
import pytest

from wrenchgap.flight.errors import LogError
from wrenchgap.flight.flight import ActuatorSeries, Flight, ImuSeries, WrenchSeries
from wrenchgap.flight.repeats import SKETCH, Repeats, refuse_seen, row_hashes, sketch


def flown(seed, seconds=20.0, rate=250.0):
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, seconds, 1.0 / rate)
    six = rng.standard_normal((len(time), 6))
    speed = np.round(500.0 + 20.0 * rng.standard_normal((len(time), 4)))
    return Flight(
        f"flight {seed}", f"{seed}.mcap", f"{seed:064d}", 0,
        commanded=WrenchSeries("/w", time, six),
        actuators=ActuatorSeries("/a", time, tilt=np.zeros((len(time), 0)), rotor_speed=speed),
        imu=ImuSeries("/imu", time, six[:, :3] + 1.0, six[:, 3:] - 2.0),
    )  # fmt: skip


def changed(flight, name, **how):
    """With another hash and name; `how` changes every series."""
    rows, kind, shift = how.get("rows", slice(None)), how.get("kind", float), how.get("shift", 0.0)
    out = {"content_hash": name.rjust(64, "f"), "path": name}
    for role, series in flight.series().items():
        arrays = {k: v[rows].astype(kind).astype(float) for k, v in vars(series).items() if isinstance(v, np.ndarray)}
        arrays["time"] = series.time[rows] + shift
        out[role] = replace(series, **arrays)
    return replace(flight, **out)


@pytest.mark.parametrize(
    "how",
    [
        {},
        {"shift": 1e6},
        {"rows": slice(1000, 2500)},
        {"kind": np.float32},
        {"rows": slice(4000, None), "kind": np.float32, "shift": -3.0},
    ],
    ids=["resaved", "other stamps", "cut", "single precision", "all of it"],
)
def test_a_copy_is_refused(how):
    flight = flown(1)
    with pytest.raises(LogError, match=r"b.csv: is the same flight as 1.mcap \(100 % .*\); name each flight once"):
        Repeats([flight]).refuse(changed(flight, "b.csv", **how))


def test_two_cuts_that_overlap_share_that_much():
    flight = flown(2)
    first, second = (sketch(changed(flight, "x", rows=slice(a, a + 3000))) for a in (0, 2000))
    assert first.shared(second) == pytest.approx(1 / 3, abs=0.01)


def test_neighbouring_cuts_and_other_flights_share_nothing():
    flight = flown(3)
    halves = [changed(flight, name, rows=rows) for name, rows in (("a", slice(0, 2500)), ("b", slice(2500, None)))]
    known = Repeats()
    for one in (*halves, flown(4), flown(5)):
        known.refuse(one)


def test_other_commands_with_the_same_motion_are_another_log():
    """A synthetic defect of the commands alone, on a motion that is there already."""
    flight = flown(6)
    sent = replace(flight.commanded, wrench_B=1.1 * flight.commanded.wrench_B)
    assert sketch(flight).shared(sketch(replace(flight, commanded=sent))) == 0.0


def test_a_cut_of_hours_is_found():
    rng = np.random.default_rng(7)
    long = rng.standard_normal((40 * SKETCH.kept, 2))
    cut = long[50_000:60_000]
    whole, part = (row_hashes([v]) for v in (long, cut))
    assert len(whole) == SKETCH.kept
    assert len(np.intersect1d(whole, part)) == pytest.approx(len(cut) / 40, rel=0.25)


def test_rest_is_nothing_in_common():
    """Ten seconds of one and the same sample before two flights that differ."""

    def rested(seed):
        flight = flown(seed)
        still = {"rotor_speed": np.zeros((2500, 4)), "wrench_B": np.zeros((2500, 6)), "omega_B": np.zeros((2500, 3))}
        still |= {"specific_force_B": np.tile([0.0, 0.0, 9.81], (2500, 1)), "tilt": np.zeros((2500, 0))}
        out = {}
        for role, series in flight.series().items():
            arrays = {k: np.vstack((still[k], v)) for k, v in vars(series).items() if k in still}
            out[role] = replace(series, time=np.arange(len(series.time) + 2500) / 250.0, **arrays)
        return replace(flight, **out)

    assert sketch(rested(8)).shared(sketch(rested(9))) == 0.0


def test_a_flight_that_was_fitted_does_not_test():
    flight = flown(10)
    refuse_seen([flight], [flown(11)])
    refuse_seen([flight], [])
    with pytest.raises(LogError, match="test on another flight than those that are fitted"):
        refuse_seen([flight], [changed(flight, "copy.mcap", shift=5.0)])

"""A part of the meaning suite: faults that are named, mends that mend, healthy logs that pass. Flown by MuJoCo."""

import json
from pathlib import Path

import pytest

from benchmarks.meaning import page as pages
from benchmarks.meaning.faults import FAULTS, Fault
from benchmarks.meaning.flying import HEX, QUAD, fly
from benchmarks.meaning.healthy import HEALTHY
from benchmarks.meaning.judge import Row, judge

ROOT = Path(__file__).resolve().parents[2]
SOME = (
    *("accelerometer in g", "accelerometer without gravity", "IMU forward-right-down", "IMU turned by 45 deg"),
    *("odometry NED and FRD", "odometry in mm", "wrench forward-right-down", "torque in Nmm"),
    *("rotors in another order", "rotors in another order, no wrench", "every spin turned over"),
    *("gyroscope scaled by 0.9", "gyroscope dead to the end", "accelerometer clipped"),
    *("inertia ten times too large", "gyroscope's x stuck for 3 s", "IMU at 10 Hz", "stamps in milliseconds"),
)
MASKED = ("frozen", "spikes", "clock-jump")


@pytest.fixture(scope="module")
def flown():
    return fly(HEX, 14.0, 21)


@pytest.mark.slow
@pytest.mark.parametrize("name", SOME)
def test_a_fault_is_named_and_mended(name, flown, tmp_path):
    (fault,) = [f for f in FAULTS if f.name == name]
    row = judge("hex", flown, HEX.model(), fault, tmp_path)
    assert row.named, row
    assert row.mended is not False, row
    if not set(fault.named) & set(MASKED):
        assert row.seen, row
        assert not row.stopped or "--accept" in row.stopped
        assert "\n" not in row.stopped


@pytest.mark.parametrize("name", ["the same flight under two names", "a cut of the flight beside it"])
def test_one_flight_under_two_names_is_refused_in_one_line(name, flown, tmp_path):
    (fault,) = [f for f in FAULTS if f.name == name]
    row = judge("hex", flown, HEX.model(), fault, tmp_path)
    assert row.named, row
    assert "name each flight once" in row.stopped
    assert "\n" not in row.stopped


@pytest.mark.parametrize("case", [c for c in HEALTHY if c.manner == HEALTHY[0].manner], ids=lambda c: c.name)
def test_a_healthy_log_passes(case, flown, tmp_path):
    flight = flown if case.changed is None else case.changed(flown)
    row = judge("hex", flight, HEX.model(), Fault(case.name, ()), tmp_path)
    assert not row.seen, row


def test_the_published_page_is_that_of_the_published_rows():
    rows = json.loads((ROOT / "docs/reliability.json").read_text(encoding="utf-8"))
    faults, healthy = ([Row(**{**r, "found": tuple(r["found"])}) for r in rows[k]] for k in ("faults", "healthy"))
    assert pages.page(faults, healthy, rows["seed"]) in (ROOT / "docs/reliability.md").read_text(encoding="utf-8")
    note = (ROOT / "benchmarks/notes/meaning.md").read_text(encoding="utf-8")
    assert note == pages.detail(faults, healthy, rows["seed"])
    usual = [row for row in faults if row.vehicle != pages.CALM]
    assert len(usual) >= 60
    assert len({row.vehicle for row in usual}) >= 3
    assert sum(row.named for row in usual) >= 0.95 * len(usual)
    assert not [row for row in usual if not row.seen]
    assert not [row for row in healthy if row.seen]


def test_equal_thrusts_of_the_engines_rotors_make_no_torque():
    for craft in (QUAD, HEX):
        equal = craft.allocation.sum(axis=1)
        assert equal[0] == len(craft.spin)
        assert abs(equal[1:]).max() < 1e-12

"""Slow pitching: commands answer what disturbs, the vehicle hardly turns. Flights of the independent engine."""

import pytest

from benchmarks.hidden_effects import engine
from wrenchgap import explain, open_flights

pytestmark = pytest.mark.usefixtures("without_limits")
TRIED = [
    "rotor_interference",
    "thrust_curve",
    "downwash_blockage",
    "thrust_scale",
    "servo_lag",
    "command_delay",
    "com_offset",
]


@pytest.fixture(scope="module")
def pitched(once):
    """25 s of pitching 0-60-0 deg with an effect hidden."""

    def made(hidden, seed):
        split = 0.3 if engine.HIDDEN[hidden].needs_split else 0.0
        how = {"pair_split": split}
        return once(f"slow turns {hidden}", lambda: engine.fly(hidden, None, "pitch", 25.0, seed, **how))[0]

    return made


def test_arms_that_droop_are_no_unit_of_torque(pitched, hexarotor):
    """The integral holds 35 times the torque that turns the vehicle: large at rest, alike where it turns."""
    opened = open_flights([pitched("droop", 61011)], hexarotor)
    assert not [c for c in opened[0].checks if c.name in ("torque-unit", "wrench-frame") and c.level != "ok"]


@pytest.mark.slow
def test_a_law_is_not_refused_for_a_trace_on_another_axis(pitched, hexarotor):
    """Wakes take a torque about y; that the law sees a little of it about x and z is no reason for another name."""
    found = explain(open_flights([pitched("wake", 61015)], hexarotor), hexarotor, names=TRIED, jobs=1)
    assert found.effects[0] == "rotor_interference"
    assert set(found.firm) <= {"rotor_interference", "servo_lag"}

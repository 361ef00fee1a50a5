"""Tables with the names of the Crazyflie's firmware: the model is shipped, and its order of motors is its own."""

import pytest

import wrenchgap as wg
from tests.replay.crazyflie_tables import flight, write_table
from wrenchgap.flight.errors import LogError
from wrenchgap.replay.present.health import next_command


@pytest.fixture(scope="module")
def table(once, tmp_path_factory):
    return write_table(once("crazyflie flight 1", lambda: flight(1)), tmp_path_factory.mktemp("cf") / "flight.csv")


def test_check_without_a_model_names_the_shipped_one(table):
    assert next_command(wg.check(table)) == f"wrenchgap check {table} -m crazyflie"


def test_a_draft_has_the_order_of_the_crazyflies_motors_or_is_refused(run, table, tmp_path):
    """M1 is front right and turns counter-clockwise, then clockwise around; ArduPilot's M2 is back left."""
    new = ("model", "new", "--from", table, "--mass", 0.033, "--arm", 0.046, "-o", tmp_path / "m.toml", "--frame")
    refused = run(*new, "quad_x")
    assert refused.exit_code == 2
    assert "-m crazyflie" in refused.output.replace("\n", " ")
    assert run(*new, "quad_cw_x").exit_code == 0
    drafted, shipped = (wg.load_model(name).vehicle for name in (tmp_path / "m.toml", "crazyflie"))
    assert drafted.arms.position_B == pytest.approx(shipped.arms.position_B, abs=1e-6)
    assert (drafted.rotors.spin == shipped.rotors.spin).all()


@pytest.mark.parametrize("model", ["voliro_x", "asymmetric_quadrotor"])
def test_a_model_of_another_vehicle_is_said_to_be_one(table, model):
    with pytest.raises(LogError, match="-m crazyflie") as caught:
        wg.open_flights(table, wg.load_model(model))
    assert ("voliro_x is of another vehicle: it has 12 rotors, the log commands 4" in str(caught.value)) == (
        model == "voliro_x"
    )

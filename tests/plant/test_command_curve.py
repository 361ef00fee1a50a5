"""From a command to newtons, against weights, voltages and points that are known."""

from dataclasses import replace

import numpy as np
import pytest

from wrenchgap.flight.errors import ModelError
from wrenchgap.plant import model_file
from wrenchgap.plant.actuation import nominal_wrench
from wrenchgap.plant.state import Commands
from wrenchgap.plant.vehicle import GRAVITY

VEHICLE = """schema = 1
[vehicle]
name = "quad"
mass = 1.2
inertia = [0.012, 0.012, 0.02]
[vehicle.arm]
length = 0.2
tilts = false
[vehicle.rotor]
c_f = 9.0e-6
kappa = 0.016
radius = 0.12
speed_max = 900.0
"""
ARMS = ((45.0, 1), (135.0, -1), (225.0, 1), (315.0, -1))
VEHICLE += "".join(f"[[vehicle.arms]]\nazimuth_deg = {a}\nrotors = [{{ spin = {s} }}]\n" for a, s in ARMS)


def model(command):
    return model_file.loads(f"{VEHICLE}[command]\n{command}\n")


def thrust(found, commands, voltage=None):
    """Thrust (N,) [N] of one rotor at commands (N,), through the speeds that the rest of the code sees."""
    at = np.tile(np.asarray(commands, dtype=float)[:, None], (1, 4))
    given = None if voltage is None else np.asarray(voltage, dtype=float)
    return 9.0e-6 * found.command.speeds(at, given, found.vehicle)[:, 0] ** 2


def test_hover_balances_weight():
    """A linear curve of 6 N carries 1.2 kg on four rotors at a known throttle; the wrench is the weight, no torque."""
    found = model('unit = "normalised"\nthrust_max = 6.0')
    hover = 1.2 * GRAVITY / 4 / 6.0
    speed = found.command.speeds(np.full((1, 4), hover), None, found.vehicle)
    wrench = nominal_wrench(found.vehicle, Commands(np.zeros((1, 6)), np.zeros((1, 4)), speed))
    assert wrench[0] == pytest.approx([0.0, 0.0, 1.2 * GRAVITY, 0.0, 0.0, 0.0], abs=1e-9)


def test_a_model_factor_of_one_is_a_square_and_of_zero_a_line():
    u = np.linspace(0.0, 1.0, 5)
    assert thrust(model('unit = "normalised"\nthrust_max = 8.0\nfactor = 1.0'), u) == pytest.approx(8.0 * u**2)
    assert thrust(model('unit = "normalised"\nthrust_max = 8.0'), u) == pytest.approx(8.0 * u)


def test_an_autopilot_that_inverts_the_curve_gets_the_thrust_that_it_asked_for():
    """ArduPilot's way: the share s of full thrust becomes the root u of f u^2 + (1 - f) u = s."""
    f, share = 0.65, np.linspace(0.0, 1.0, 11)
    sent = (f - 1.0 + np.sqrt((1.0 - f) ** 2 + 4.0 * f * share)) / (2.0 * f)
    found = model('unit = "pwm"\nrange = [1100.0, 1900.0]\nthrust_max = 8.0\nfactor = 0.65')
    assert thrust(found, 1100.0 + 800.0 * sent) == pytest.approx(8.0 * share)
    assert thrust(found, [1000.0]) == pytest.approx([0.0])


def test_thrust_goes_with_the_power_of_the_voltage():
    found = model('unit = "normalised"\nthrust = [0.0, 2.0, 5.0]\nvoltage = { nominal = 16.0, exponent = 2.0 }')
    full, half = thrust(found, [0.7, 0.7], [16.0, 8.0])
    assert full == pytest.approx(2.0 * 0.7 + 5.0 * 0.49)
    assert half == pytest.approx(full / 4.0)
    assert thrust(found, [0.7]) == pytest.approx([full])


def test_speeds_are_taken_as_they_are():
    found = model('unit = "normalised"\nspeed = [100.0, 800.0]')
    assert found.command.speeds(np.full((1, 4), 0.5), None, found.vehicle) == pytest.approx(np.full((1, 4), 500.0))


BENCH = "table = { command = [1000, 1500, 2000], thrust_g = [0.0, 300.0, 900.0] }"


def test_a_bench_table_goes_through_its_points_and_holds_its_ends():
    found = model('unit = "pwm"\n' + BENCH.replace("1000, 1500, 2000", "1000.0, 1500.0, 2000.0"))
    points = thrust(found, [900.0, 1000.0, 1500.0, 1750.0, 2000.0, 2100.0])
    assert points / 9.80665e-3 == pytest.approx([0.0, 0.0, 300.0, 600.0, 900.0, 900.0])
    assert found.command.share_outside(np.array([900.0, 1500.0, 2100.0, 1200.0])) == 0.5


def test_between_two_voltages_of_the_bench():
    rows = "command = [0.0, 1.0, 0.0, 1.0], thrust = [0.0, 4.0, 0.0, 6.0], voltage = [12.0, 12.0, 16.0, 16.0]"
    found = model(f'unit = "normalised"\ntable = {{ {rows} }}')
    assert thrust(found, [1.0] * 5, [11.0, 12.0, 14.0, 16.0, 17.0]) == pytest.approx([4.0, 4.0, 5.0, 6.0, 6.0])
    assert thrust(found, [1.0]) == pytest.approx([5.0])
    assert found.command.uses_voltage


def test_a_bench_file_whose_name_has_a_zero_byte_is_refused_in_a_line(tmp_path):
    (tmp_path / "quad.toml").write_text(f'{VEHICLE}[command]\nunit = "normalised"\ntable = "b\\u0000.csv"\n')
    with pytest.raises(ModelError, match=r"command\.table: .*b.*x00\.csv.* is no name of a file") as caught:
        model_file.load(tmp_path / "quad.toml")
    assert "\0" not in str(caught.value)


def test_a_bench_file_goes_with_the_model(tmp_path):
    """Written into another folder the model still has its curve."""
    (tmp_path / "bench.csv").write_text("command, rpm, voltage\n0.0, 0, 15.0\n1.0, 9000, 15.0\n")
    (tmp_path / "quad.toml").write_text(f'{VEHICLE}[command]\nunit = "normalised"\ntable = "bench.csv"\n')
    found = model_file.load(tmp_path / "quad.toml")
    assert found.command.source == "bench table bench.csv"
    (tmp_path / "elsewhere").mkdir()
    model_file.save(found, tmp_path / "elsewhere" / "copy.toml")
    again = model_file.load(tmp_path / "elsewhere" / "copy.toml")
    full = again.command.speeds(np.ones((1, 4)), None, again.vehicle)
    assert full == pytest.approx(np.full((1, 4), 9000.0 * 2.0 * np.pi / 60.0))


CURVES = ("thrust_max = 6.0\nfactor = 0.3", "speed = [0.0, 700.0]", BENCH.replace("_g", ""))


@pytest.mark.parametrize("command", CURVES)
def test_a_model_made_in_code_keeps_its_curve(command):
    found = model(
        f'unit = "pwm"\nrange = [1000.0, 2000.0]\n{command}'.replace("[1000, 1500, 2000]", "[1e3, 1.5e3, 2e3]")
    )
    again = model_file.loads(model_file.dumps(replace(found, text="")))
    at = np.full((3, 4), 1400.0)
    before, after = (one.command.speeds(at, None, one.vehicle) for one in (found, again))
    assert after == pytest.approx(before)


@pytest.mark.parametrize(
    ("command", "message"),
    [
        ('unit = "percent"\nthrust_max = 6.0', r"command.unit: got 'percent', expected \"normalised\""),
        ('unit = "pwm"\nthrust_max = 6.0', r"command: range: is missing; expected the pulse widths"),
        ('unit = "normalised"', r"command: got no curve, expected one of thrust_max, thrust, speed, table"),
        ('unit = "normalised"\nthrust_max = 6.0\nspeed = [1.0]', r"command: got thrust_max and speed, expected one of"),
        ('unit = "normalised"\nthrust_max = 6.0\nfactor = 2.0', r"command: factor: got 2, expected 0 to 1"),
        ('unit = "normalised"\nthrust_max = 6.0\nexpo = 0.6', r"command.expo: is not a known key"),
        ('unit = "normalised"\nthrust = []', r"command.thrust: got \[\], expected a list of 1 to 8 coefficients"),
        ('unit = "normalised"\nspeed = [0, 1, 2, 3, 4, 5, 6, 7, 8]', r"expected a list of 1 to 8 coefficients"),
        ('unit = "normalised"\nrange = [0.0, 1e-300]\nspeed = [1.0]', r"command: range: got"),
        (
            'unit = "normalised"\nthrust_max = 6.0\nvoltage = { nominal = 1e-15, exponent = 1e12 }',
            r"exponent: got .*expected -10 to 10",
        ),
        ('unit = "normalised"\ntable = { command = [0.0, 1.0], thrust = [1.0] }', r"got 2 of command, 1 of thrust"),
        (
            'unit = "normalised"\ntable = { command = [0.0, 1.0] }',
            r"command.table: got neither, expected one",
        ),
    ],
)
def test_says_what_is_wrong_in_one_line(command, message):
    with pytest.raises(ModelError, match=message) as caught:
        model(command)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("pwm,grams\n1000,1\n", r"bench.csv: its first line does not have the columns command, one of"),
        ("", r"bench.csv: its first line does not have the columns"),
        ("command,thrust\n0.0,0.0\n1.0,lots\n", r"bench.csv, line 3: expected a number as thrust"),
        ("command,thrust\n0.0,0.0\n1.0\n", r"bench.csv, line 3: expected a number as thrust"),
        ("command,thrust\n0.0,0.0\n1.0,5.0,7.0\n", r"bench.csv, line 3: expected 2 numbers, got 3 cells"),
        ("command,thrust,thrust\n0.0,0.0,1.0\n", r"bench.csv: .* each once"),
        ("command,thrust\n0.0," + 200_000 * "1" + "\n", r"bench.csv, line 2: expected 2 numbers, got no table"),
        ("command,thrust\n" + 2001 * "0.0,0.0\n", r"bench.csv: has more than 2000 rows"),
    ],
)
def test_a_bad_bench_file_is_told_by_line(tmp_path, text, message):
    (tmp_path / "bench.csv").write_text(text)
    (tmp_path / "quad.toml").write_text(f'{VEHICLE}[command]\nunit = "normalised"\ntable = "bench.csv"\n')
    with pytest.raises(ModelError, match=message) as caught:
        model_file.load(tmp_path / "quad.toml")
    assert "\n" not in str(caught.value)

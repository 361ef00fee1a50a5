"""What tells explanations apart: statements of physics about checks on the bench, and when nothing may be claimed."""

import itertools
import re
from dataclasses import replace

import numpy as np
import pytest

from wrenchgap.flight.errors import ModelError
from wrenchgap.learn.posterior.bench_tests import NO_CHECK, TRIALS
from wrenchgap.learn.posterior.discriminating_tests import MOST, discriminating_tests, typical
from wrenchgap.plant import effects, model_file
from wrenchgap.plant.effects import catalogue
from wrenchgap.replay.present import posterior as words

CATALOGUE = tuple(catalogue())
MOVED = {"x": 0.006, "y": 0.004}


@pytest.fixture(scope="module")
def vehicle():
    return model_file.load("tilt_hexarotor").vehicle


@pytest.fixture
def checks(vehicle):
    """checks({...}, {...}): for sets given as {effect: values or None}, equally likely unless `weights` says so."""

    def made(*sets, weights=None, on=None):
        values = [{name: v for name, v in one.items() if v is not None} for one in sets]
        return discriminating_tests([tuple(one) for one in sets], weights or [1.0] * len(sets), values, on or vehicle)

    return made


def bench(found):
    return {c.name: c for c in found if c.kind == "bench"}


def separated(check):
    """Pairs of sets that a check claims to tell apart."""
    sides = itertools.combinations(check.separates, 2)
    return {frozenset(pair) for one, other in sides for pair in itertools.product(one, other)}


def tells(found, one, other):
    """Bench checks that claim to tell two sets apart."""
    return [name for name, c in bench(found).items() if frozenset((tuple(one), tuple(other))) in separated(c)]


# What a check tells apart


def test_weighing_tells_mass_from_thrust_but_not_thrust_from_thrust(checks):
    mass, scale, loss = {"mass": {"added": 0.2}}, {"thrust_scale": {"scale": -0.05}}, {"coaxial_loss": {"eta": 0.1}}
    found = checks(mass, scale, loss)
    assert tells(found, mass, scale)[0] == "weigh"
    assert "weigh" not in tells(found, scale, loss)
    assert tells(found, scale, loss) == ["pair"]


def test_the_numbers_are_mass_plus_what_was_added(checks):
    (weigh, *_) = checks({"mass": {"added": 0.21}}, {"thrust_scale": {"scale": -0.05}})
    assert weigh.what == "Weigh the vehicle ready to fly, to 8 g: 4.210 kg if mass; 4.000 kg if not."


def test_a_small_vehicle_is_weighed_in_grams(checks):
    crazyflie = model_file.load("crazyflie").vehicle
    (weigh, *_) = checks({"mass": {"added": 0.005}}, {"thrust_scale": None}, on=crazyflie)
    assert "38.00 g if mass; 33.00 g if not" in weigh.what


@pytest.mark.parametrize(("added", "offered"), [(0.007, False), (0.010, True)])
def test_a_mass_smaller_than_the_scales_resolve_is_not_weighed(checks, added, offered):
    """0.2 % of 4 kg are 8 g."""
    found = checks({"mass": {"added": added}}, {"thrust_scale": {"scale": -added / 4.0}})
    assert ("weigh" in bench(found)) is offered


def test_a_class_of_the_same_set_in_other_words(checks):
    """A payload is mass and shift, a mass is a thrust: the scales halve the class."""
    payload = {"mass": 0.21, **{axis: r * 4.21 / 0.21 for axis, r in MOVED.items()}}
    sets = (
        {"payload": payload},
        {"mass": {"added": 0.21}, "com_offset": MOVED},
        {"thrust_scale": {"scale": -0.05}, "com_offset": MOVED},
        {"coaxial_loss": {"eta": 0.1}, "com_offset": MOVED},
    )
    found = checks(*sets)
    heavy, light = (
        (("payload",), ("mass", "com_offset")),
        (("thrust_scale", "com_offset"), ("coaxial_loss", "com_offset")),
    )
    assert found[0].name == "weigh"
    assert found[0].separates == (heavy, light)
    assert "hang" not in bench(found)  # all four have their centre of mass at the same place
    assert found[-1].kind == "flight"


def test_a_payload_near_the_centre_and_its_parts_are_the_same_on_the_bench(checks):
    """5 cm away, 0.2 kg add 0.2 x 0.05^2 = 0.5 g m^2 to 100 g m^2: no pendulum shows it, and nothing else differs."""
    payload, parts = {"payload": {"mass": 0.2, "x": 0.05}}, {"mass": {"added": 0.2}, "com_offset": {"x": 0.01 / 4.2}}
    (only,) = checks(payload, parts)
    assert only.kind == "flight"


def test_a_payload_far_out_swings_slower_than_its_parts(checks):
    """0.2 kg at 0.3 m: 0.18 kg m^2 x 4.0/4.2 = 17 g m^2 about y and z, nothing about x."""
    payload, parts = {"payload": {"mass": 0.2, "x": 0.3}}, {"mass": {"added": 0.2}, "com_offset": {"x": 0.06 / 4.2}}
    pendulum = bench(checks(payload, parts))["pendulum"]
    assert "(0.103, 0.122, 0.209) kg m^2 if payload" in pendulum.what


WEAK = {"rotor_thrust": {"rotor_3": -0.08}}


def test_swapping_tells_a_weak_rotor_from_a_centre_of_mass(checks):
    """The torque of 8 % of a rotor's thrust moves from one end of two arms to the other."""
    com, wrench = {"com_offset": MOVED}, {"constant_wrench": None}
    found = checks(WEAK, com, wrench)
    assert tells(found, WEAK, com) == ["hang", "swap"]
    hang, swap = (bench(found)[name].settles for name in ("hang", "swap"))
    assert hang + swap >= 1.0  # of three pairs each tells two, and both that of rotor and centre of mass
    assert max(hang, swap) < 1.0
    assert tells(found, WEAK, wrench) == ["swap"]
    thrust, apart = 4.0 * 9.80665 / 12, 0.6
    swap = bench(found)["swap"]
    assert f"differ by {80.0 * thrust * apart:.3g} mNm if rotor_thrust; they are the same if not" in swap.what


def test_swapped_are_the_odd_rotor_and_the_farthest_that_turns_alike(checks, vehicle):
    _, rotors = vehicle.geometry()
    swap = bench(checks(WEAK, {"constant_wrench": None}))["swap"]
    one, other = (int(k) - 1 for k in re.findall(r"\bM(\d+)", swap.what))
    assert one == 3
    assert rotors.spin[one] == rotors.spin[other]
    assert abs(int(rotors.arm[one]) - int(rotors.arm[other])) == 3  # the opposite one of six arms


def test_rotors_that_are_all_weak_alike_do_not_show_when_swapped(checks, vehicle):
    weak = {f"rotor_{r}": -0.05 for r in range(12)}
    found = checks({"rotor_thrust": weak}, {"com_offset": MOVED})
    assert "swap" not in bench(found)
    stand = bench(checks({"rotor_thrust": weak}, {"mass": {"added": 0.001}}))["thrust"]
    assert "-5.0 % on all if rotor_thrust" in stand.what


def test_scale_and_equally_weak_rotors_are_the_same_on_the_stand(checks):
    found = checks({"rotor_thrust": {f"rotor_{r}": -0.05 for r in range(12)}}, {"thrust_scale": {"scale": -0.05}})
    assert bench(found) == {}


def test_a_step_tells_dead_time_from_lag_and_up_from_down(checks):
    lag, uneven = {"motor_lag": {"tau": 0.04}}, {"asymmetric_motor_lag": {"tau_up": 0.03, "tau_down": 0.05}}
    delay, servo = {"command_delay": {"delay": 0.03}}, {"servo_lag": {"tau": 0.04}}
    found = checks(lag, uneven, delay, servo)
    (step,) = bench(found).values()
    assert len(separated(step)) == 6
    assert "63 % up 30 ms later, 63 % down 50 ms later if asymmetric_motor_lag" in step.what
    assert "first motion 30 ms after the command if command_delay" in step.what


def test_a_vehicle_without_tilt_servos_steps_no_servo(checks):
    """A delay of 28 ms against nothing: a step of either would show it."""
    sets = {"command_delay": {"delay": 0.028}}, {}
    assert "servo_step" in bench(checks(*sets))
    assert [*bench(checks(*sets, on=model_file.load("crazyflie").vehicle))] == ["rotor_step"]


def test_two_forms_that_the_camera_cannot_tell_apart_are_not_told_apart(checks):
    found = checks({"motor_lag": {"tau": 0.04}}, {"asymmetric_motor_lag": {"tau_up": 0.039, "tau_down": 0.042}})
    assert bench(found) == {}


def test_backlash_shows_by_hand_before_anything_is_filmed(checks):
    (first, *_) = checks({"backlash": {"play": 0.005}}, {"servo_lag": {"tau": 0.03}})
    assert first.name == "rock"


def test_an_inclinometer_tells_the_arm_that_is_off(checks):
    found = checks({"tilt_offset": {"arm_2": np.radians(1.0)}}, {"constant_wrench": None})
    assert "arm_2 +1.0 deg if tilt_offset; all at zero if not" in bench(found)["tilt_zero"].what
    small = checks({"tilt_offset": {"arm_2": np.radians(0.15)}}, {"constant_wrench": None})
    assert "tilt_zero" not in bench(small)


def test_sag_shows_with_an_empty_battery(checks):
    """k = 2: thrust goes with the square of the voltage, so a tenth of it costs a fifth to first order."""
    found = checks({"battery_sag": {"sensitivity": 2.0, "per_volt": 0.08}}, {"thrust_scale": {"scale": -0.1}})
    assert "thrust -20.0 % if battery_sag; the same thrust if not" in bench(found)["discharge"].what
    assert tells(found, ["battery_sag"], ["thrust_scale"]) == ["discharge"]


def test_fade_and_sag_are_one_thing_to_a_battery(checks):
    found = checks({"battery_sag": {"sensitivity": 2.0, "per_volt": 0.08}}, {"thrust_fade": {"rate": 0.03}})
    assert bench(found) == {}


def test_both_forms_of_ground_effect_lift_a_level_vehicle_alike(checks):
    """Cheeseman and Bennett two radii up with g = 3: 1 / (1 - 3/64) = 4.9 %, a little more for rotors on stalks."""
    ground = {"gain": 3.0, "ground": 0.0}
    found = checks({"ground_effect": ground}, {"ground_effect_one_height": ground}, {"mass": {"added": 0.001}})
    board = bench(found)["board"]
    assert separated(board) == {
        frozenset((("mass",), (form,))) for form in ("ground_effect", "ground_effect_one_height")
    }
    alone = bench(checks({"ground_effect_one_height": ground}, {"mass": {"added": 0.001}}))["board"]
    assert "thrust +4.9 %" in alone.what


def test_a_fan_at_the_hull_shows_its_drag_area(checks):
    """0.5 x 1.225 x 0.1 x 5^2 = 1.5 N along x; a rotor at rest has no drag."""
    found = checks({"body_drag_areas": {"area_x": 0.1}}, {"rotor_drag": None})
    assert "x 1.5 N if body_drag_areas; no force if not" in bench(found)["fan"].what


def test_a_twisting_arm_turns_by_its_twist_times_the_thrust(checks):
    """3 mrad/N and a sixth of 39 N: 1.1 deg."""
    found = checks({"arm_twist": {"twist": 0.003}}, {"tilt_offset": {"arm_0": 0.02}})
    assert (
        "twists by +1.1 deg if arm_twist"
        in bench(checks({"arm_twist": {"twist": 0.003}}, {"mass": None}, {"com_offset": None}))["load_arm"].what
    )
    assert tells(found, ["arm_twist"], ["tilt_offset"]) == ["tilt_zero"]  # unloaded, so the cheaper one does


def test_a_cable_is_looked_for_before_the_vehicle_is_hung(checks):
    found = checks({"tether": {"force_z": -1.0}}, {"com_offset": MOVED}, {"payload": {"mass": 0.1, "x": 0.2}})
    assert found[0].name == "look"
    assert all(("tether",) not in group for c in found if c.name in ("weigh", "hang") for group in c.separates)


# What may not be claimed


def test_what_fits_scatter_by_is_not_measured(checks):
    """Laws are right to a few per cent: of 30 mm, a difference of 2 mm is no prediction; of 6 mm it is one."""
    found = checks({"com_offset": {"x": 0.030}}, {"com_offset": {"x": 0.032}, "constant_wrench": None})
    assert bench(found) == {}
    found = checks({"com_offset": {"x": 0.006}}, {"com_offset": {"x": 0.008}, "constant_wrench": None})
    assert "(6, 0, 0) mm if com_offset; (8, 0, 0) mm if com_offset + constant_wrench" in bench(found)["hang"].what


def test_the_same_effects_with_the_same_values_are_never_separated(checks):
    values = {"tau": 0.05}
    found = checks({"motor_lag": values, "mass": {"added": 0.2}}, {"motor_lag": values, "thrust_scale": None})
    assert "rotor_step" not in bench(found)


def test_the_same_effect_in_two_sizes_is_told_apart_under_full_names(checks):
    """Both have a mass, so "mass" would name neither side."""
    one, other = {"mass": {"added": 0.2}}, {"mass": {"added": 0.1}, "thrust_scale": {"scale": -0.02}}
    weigh = bench(checks(one, other))["weigh"]
    assert "4.200 kg if mass; 4.100 kg if mass + thrust_scale" in weigh.what


def test_an_effect_of_unknown_size_is_told_from_none_and_from_nothing_else(checks):
    unknown, known, none = {"mass": None}, {"mass": {"added": 0.2}, "inertia": None}, {"thrust_scale": None}
    found = checks(unknown, known, none)
    assert "weigh" in tells(found, unknown, none)
    assert "weigh" not in tells(found, unknown, known)
    assert "another mass than 4.000 kg" in bench(checks(unknown, none))["weigh"].what


def test_an_effect_of_unknown_size_does_not_hide_what_known_ones_tell(checks):
    light, heavy = {"mass": {"added": 0.1}}, {"mass": {"added": 0.3}, "inertia": None}
    unknown = {"mass": None, "com_offset": None}
    assert "weigh" in tells(checks(light, heavy, unknown), light, heavy)


def test_what_the_catalogue_does_not_know_gets_a_flight_only(checks):
    found = checks({"mass": {"added": 0.2}}, {"my_effect": {"size": 1.0}})
    (flight,) = found
    assert flight.kind == "flight"
    assert "design mass my_effect" in flight.what


def test_own_effects_that_are_registered_say_what_excites_them(checks):
    class Mine(effects.WrenchEffect):
        """A test's own."""

        name = "mine"
        excited_by = "standing on one's head"

        def parameters(self, vehicle):
            return (effects.Parameter("size", "N", -1.0, 1.0, 0.1),)

        def apply(self, actuation, wrench_B, theta, context):
            return np.zeros_like(wrench_B)

    effects.register(Mine(), effects.Source("mine.py", ""))
    try:
        (flight,) = checks({"mass": {"added": 0.2}}, {"mine": {"size": 1.0}})
    finally:
        effects.forget()
    assert "mine: standing on one's head" in flight.what


def test_one_explanation_leaves_nothing_to_settle(checks):
    assert checks({"mass": None}) == ()
    assert checks({"mass": None, "inertia": None}, {"inertia": None, "mass": None}) == ()
    assert checks() == ()


def test_nothing_missing_is_an_explanation(checks):
    weigh = bench(checks({"mass": {"added": 0.2}}, {}))["weigh"]
    assert weigh.separates == ((("mass",),), ((),))


def test_frozensets_are_named_in_alphabetical_order(vehicle):
    sets = [frozenset(("thrust_scale", "com_offset")), frozenset(("mass", "com_offset"))]
    found = discriminating_tests(sets, [0.5, 0.5], [{}, {}], vehicle)
    assert found[0].separates == ((("com_offset", "thrust_scale"),), (("com_offset", "mass"),))


def test_a_parameter_that_an_effect_does_not_have_is_an_error(checks):
    with pytest.raises(ModelError, match="no parameter 'weight'"):
        checks({"mass": {"weight": 0.2}}, {"thrust_scale": None})


# The list


@pytest.mark.parametrize("seed", range(6))
def test_the_list_is_short_ordered_without_padding_and_ends_in_a_flight(vehicle, seed):
    rng = np.random.default_rng(seed)
    sets = list(
        dict.fromkeys(tuple(sorted(rng.choice(CATALOGUE, rng.integers(1, 4), replace=False))) for _ in range(6))
    )
    found = discriminating_tests(sets, rng.dirichlet(np.ones(len(sets))), [{} for _ in sets], vehicle)
    cost = {trial.name: trial.minutes for trial in TRIALS}
    listed = [c.name for c in found[:-1]]
    assert len(listed) <= MOST
    assert [cost[name] for name in listed] == sorted(cost[name] for name in listed)
    assert found[-1].kind == "flight"
    done = set()
    for check in found[:-1]:
        assert separated(check) - done
        done |= separated(check)


def test_the_flight_is_for_what_the_bench_leaves(checks):
    spinning, turning, heavy = {"rotational_drag": None}, {"constant_wrench": None}, {"mass": {"added": 0.2}}
    found = checks(spinning, turning, heavy)
    assert [c.name for c in found] == ["weigh", "flight"]
    assert found[-1].separates == ((("rotational_drag",),), (("constant_wrench",),))
    assert "rotational_drag: body rates on every axis" in found[-1].what


def test_nobody_is_sent_for_an_explanation_of_no_weight(checks):
    names = ("mass", "thrust_scale", "backlash")
    assert "rock" not in bench(checks(*({n: None} for n in names), weights=[0.5, 0.499, 0.001]))
    assert "rock" in bench(checks(*({n: None} for n in names), weights=[0.5, 0.4, 0.1]))
    assert "rock" in bench(checks({"mass": None}, {"backlash": None, "mass": None}, weights=[0.999, 0.001]))
    assert "weigh" in bench(checks({"mass": None}, {"thrust_scale": None}, weights=[1.0, 0.0]))


def test_of_equal_checks_the_one_in_which_both_sides_show(checks):
    """A step of a servo would only show the delay."""
    found = checks({"motor_lag": {"tau": 0.05}}, {"command_delay": {"delay": 0.03}})
    assert tells(found, ["motor_lag"], ["command_delay"]) == ["rotor_step"]


def test_the_flight_is_for_a_pair_that_is_open_though_others_weigh_more(checks):
    """Nothing is known of an effect of one's own: it stays with each of the others, which are told apart."""
    sets = ({"mass": None}, {"thrust_scale": None}, {"backlash": None}, {"mine": None})
    found = checks(*sets, weights=[0.4, 0.3, 0.2, 0.1])
    assert found[-1].separates[0] == (("mass",),)
    assert (("mine",),) in found[-1].separates
    left = {frozenset(pair) for pair in itertools.combinations((group[0] for group in found[-1].separates), 2)}
    assert left - set().union(*(separated(c) for c in found[:-1]))


def test_where_five_checks_would_be_needed_the_least_likely_stays_open(checks):
    names = ("mass", "com_offset", "backlash", "imu_misalignment", "wind", "drag_torque")
    found = checks(*({name: None} for name in names), weights=[0.3, 0.25, 0.2, 0.15, 0.07, 0.03])
    assert list(bench(found)) == ["weigh", "rock", "imu_level", "hang"]
    assert found[-1].separates == ((("wind",),), (("drag_torque",),))


# The table


@pytest.mark.parametrize("name", CATALOGUE)
def test_every_effect_has_a_check_or_a_reason(name):
    shown = [trial.name for trial in TRIALS if name in trial.shows]
    assert bool(shown) != bool(NO_CHECK.get(name))


@pytest.mark.parametrize(
    ("trial", "name"), [(t, n) for t in TRIALS for n in t.shows], ids=lambda x: getattr(x, "name", x)
)
def test_a_check_resolves_a_typical_effect_and_none_is_none(vehicle, trial, name):
    theta = typical(vehicle, name)
    setup = trial.setup(vehicle, [{name: theta}])
    nominal = setup.predict({})
    assert setup.same(setup.predict({name: np.zeros_like(theta)}), nominal)
    assert not setup.same(setup.predict({name: theta}), nominal)
    assert np.shape(setup.resolution) in ((), nominal.shape)
    assert setup.says(nominal)
    assert setup.changed
    assert trial.name in {"look", "air"} or re.search(r", to \d", setup.action)  # how finely to measure


def test_the_table_names_effects_that_exist_and_is_in_the_order_of_cost():
    named = {name for trial in TRIALS for name in (*trial.shows, *trial.unclear)} | set(NO_CHECK)
    assert named == set(CATALOGUE)
    assert [t.minutes for t in TRIALS] == sorted(t.minutes for t in TRIALS)
    assert not any(set(t.shows) & set(t.unclear) for t in TRIALS)


@pytest.mark.slow
@pytest.mark.parametrize("model", ["crazyflie", "tilt_hexarotor", "variable_tilt_hexacopter"])
def test_any_pair_of_effects_that_a_vehicle_can_have_gets_an_answer(model):
    vehicle = model_file.load(model).vehicle
    possible = [one for name in CATALOGUE if (one := sized(vehicle, name))]
    assert len(possible) > 10
    for one, other in itertools.combinations(possible, 2):
        for values in ([one, other], [{}, {}]):
            found = discriminating_tests([tuple(one), tuple(other)], [0.6, 0.4], values, vehicle)
            assert found[-1].kind == "flight"
            assert all(c.what.endswith(".") and "\n" not in c.what and "nan" not in c.what for c in found)


def sized(vehicle, name):
    """An effect of typical size, None where the vehicle cannot have it."""
    if catalogue()[name].needs_rotors and not vehicle.has_rotors:
        return None
    try:
        parameters = catalogue()[name].parameters(vehicle)
    except ModelError:
        return None
    return {name: {p.name: float(v) for p, v in zip(parameters, typical(vehicle, name), strict=True)}}


# In words


def test_checks_are_numbered_lines_and_json(checks):
    found = checks({"mass": {"added": 0.2}}, {"thrust_scale": None})
    head, first, last = words.settle_lines(found)
    assert "cheapest first" in head.text
    assert first.text == f"  1. on the bench: {found[0].what}"
    assert last.text.startswith(
        "  2. in flight: Fly what `wrenchgap design mass thrust_scale -m MODEL -o flight.toml` writes"
    )
    assert words.settle_json(found)[0] == {
        "kind": "bench",
        "what": found[0].what,
        "separates": [[["mass"]], [["thrust_scale"]]],
    }
    assert words.settle_lines(()) == []


def test_checks_name_rotors_and_arms_as_the_user_does(checks, vehicle):
    names = {"rotor_names": tuple(f"P{r + 1}" for r in range(12)), "arm_names": tuple("ABCDEF")}
    own = replace(vehicle, **names)
    found = bench(checks(WEAK, {"constant_wrench": None}, on=own))
    plain = bench(checks(WEAK, {"constant_wrench": None}))
    numbers = re.findall(r"\bM(\d+)", plain["swap"].what)
    assert f"Swap P{numbers[0]} and P{numbers[1]} (" in found["swap"].what
    (stand,) = (trial.setup(own, ()) for trial in TRIALS if trial.name == "thrust")
    assert stand.says(np.eye(12)[3] * -0.08) == "P4 -8.0 %"
    tilted = bench(checks({"tilt_offset": {"arm_2": np.radians(1.0)}}, {"constant_wrench": None}, on=own))
    assert "C +1.0 deg if tilt_offset" in tilted["tilt_zero"].what

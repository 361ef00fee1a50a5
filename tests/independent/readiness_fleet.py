"""How often vehicles of another engine need what `ready` says: python -m tests.independent.readiness_fleet

Vehicles hover in gusts of 1.5 s, the first rotor of each as strong as chance has it. In one kind of fleet, of forty,
that strength is known to a standard deviation, and one more vehicle flew before (`coverage`); in the other, of twenty,
each vehicle flew itself, and `add` fitted its rotors to that (`fitted_coverage`). Seeds up to 12 and 90 to 112 were
looked at while `ready` was made, others flown once.
"""

from dataclasses import replace

import numpy as np

import wrenchgap as wg
from tests.independent.flown_quadrotor import MODEL, Case, fly
from wrenchgap.learn.data.measurement import low_pass
from wrenchgap.plant.model import make_effect

SIGMA = 0.06
HOVER = {"seconds": 10.0, "gusts": 0.5}


def weak(std=SIGMA, loss=0.0):
    """The quadrotor with a thrust of its first rotor that is known to a standard deviation."""
    effect = make_effect(MODEL.vehicle, "rotor_thrust", [-loss, 0.0, 0.0, 0.0])
    return MODEL.with_effects([replace(effect, std=np.array([std, 0.0, 0.0, 0.0]))])


def stated(flights, model):
    """What the first rotor is said to need (3,) on 7 s of hover: 5, 50 and 95 %."""
    found = wg.ready(flights, model, "hover", duration=7.0)
    return next(one.needs for one in found.authority if one.part == "M1")


def needed(flight):
    """The most that the first rotor was asked for, as a share of its full thrust."""
    samples = flight.flown[0]
    share = (samples.rotor_speed_cmd[:, :1] / MODEL.vehicle.rotors.speed_max[0]) ** 2
    return low_pass(share, samples.dt, 8.0).max()


def coverage(seed, flown=3, seconds=10.0):
    """Shares of a fleet that command what is stated as 5 to 95 %, and more than that, after so many flights [s]."""
    strong = 1.0 + SIGMA * np.random.default_rng(seed).standard_normal(40)
    fleet = [Case(f"v{k}", seed=100 * seed + k, blades=(x, 1.0, 1.0, 1.0), **HOVER) for k, x in enumerate(strong)]
    known = [Case(f"known{k}", seed=10000 + 99 * seed + k, seconds=seconds, gusts=0.5) for k in range(flown)]
    flights = [*wg.open_flights(fly(known), MODEL), *wg.open_flights(fly(fleet), MODEL)]
    low, _, high = stated(flights[:flown], weak())
    needs = np.array([needed(one) for one in flights[flown:]])
    return float(np.mean((low <= needs) & (needs <= high))), float(np.mean(needs > high))


def fitted_coverage(seed, flown=1, seconds=10.0):
    """The same of vehicles with a rotor of 80 to 105 % of its thrust, each fitted to so many flights [s] of its own."""
    strong = np.random.default_rng(seed).uniform(0.8, 1.05, 20)
    blades = [(x, 1.0, 1.0, 1.0) for x in strong]
    before = [
        [
            Case(f"b{k}-{j}", seed=10**6 + 1000 * seed + 10 * k + j, seconds=seconds, gusts=0.5, blades=b)
            for k, b in enumerate(blades)
        ]
        for j in range(flown)
    ]
    after = [Case(f"v{k}", seed=100 * seed + k, blades=b, **HOVER) for k, b in enumerate(blades)]
    before, after = [fly(each) for each in before], wg.open_flights(fly(after), MODEL)
    within, more = np.zeros((2, len(blades)))
    for k, one in enumerate(after):
        flights = wg.open_flights([each[k] for each in before], MODEL)
        low, _, high = stated(flights, wg.add(MODEL, "rotor_thrust", flights).model)
        within[k], more[k] = low <= needed(one) <= high, needed(one) > high
    return float(within.mean()), float(more.mean())


if __name__ == "__main__":
    LONG, SHORT = (1, 60.0), (1, 10.0)
    for name, of, first, knowledge in (
        ("known to 6 %", coverage, 201, (SHORT, (3, 10.0), LONG, (1, 5.5))),
        ("fitted", fitted_coverage, 331, (SHORT, LONG)),
    ):
        for k, (flights, seconds) in enumerate(knowledge):
            seeds = range(first + 6 * k, first + 6 * k + 6)
            within, more = np.transpose([of(seed, flights, seconds) for seed in seeds])
            each = ", ".join(f"{x:.2f}" for x in within)
            told = f"{name}, {flights} flights of {seconds:g} s, seeds {seeds[0]} to {seeds[-1]}: "
            print(f"{told}{within.mean():.3f} within ({each}), {more.mean():.3f} need more", flush=True)

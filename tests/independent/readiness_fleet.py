"""How often vehicles of another engine need what `ready` says: python -m tests.independent.readiness_fleet

Forty vehicles hover in gusts, the first rotor of each as strong as chance has it. Before, one more vehicle flew, whose
first rotor is known to a standard deviation. Seeds up to 12 were looked at while `ready` was made, others flown once.
"""

from dataclasses import replace

import numpy as np

import wrenchgap as wg
from tests.independent.flown_quadrotor import MODEL, Case, fly
from wrenchgap.learn.data.measurement import low_pass
from wrenchgap.plant.model import make_effect

SIGMA = 0.06


def weak(std=SIGMA, loss=0.0):
    """The quadrotor with a thrust of its first rotor that is known to a standard deviation."""
    effect = make_effect(MODEL.vehicle, "rotor_thrust", [-loss, 0.0, 0.0, 0.0])
    return MODEL.with_effects([replace(effect, std=np.array([std, 0.0, 0.0, 0.0]))])


def coverage(seed, flown=3, seconds=10.0):
    """Shares of a fleet that command what is stated as 5 to 95 %, and more than that, after so many flights [s]."""
    how = {"seconds": 10.0, "gusts": 0.5}
    strong = 1.0 + SIGMA * np.random.default_rng(seed).standard_normal(40)
    fleet = [Case(f"v{k}", seed=100 * seed + k, blades=(x, 1.0, 1.0, 1.0), **how) for k, x in enumerate(strong)]
    known = [Case(f"known{k}", seed=10000 + 99 * seed + k, seconds=seconds, gusts=0.5) for k in range(flown)]
    flights = [*wg.open_flights(fly(known), MODEL), *wg.open_flights(fly(fleet), MODEL)]
    found = wg.ready(flights[:flown], weak(), "hover", duration=7.0)
    low, _, high = next(one.needs for one in found.authority if one.part == "M1")
    most = []
    for samples in (one.flown[0] for one in flights[flown:]):
        share = (samples.rotor_speed_cmd[:, :1] / MODEL.vehicle.rotors.speed_max[0]) ** 2
        most.append(low_pass(share, samples.dt, 8.0).max())
    needs = np.array(most)
    return float(np.mean((low <= needs) & (needs <= high))), float(np.mean(needs > high))


if __name__ == "__main__":
    for flights, seconds, seeds in ((1, 10.0, range(13, 19)), (3, 10.0, range(13, 19)), (1, 60.0, range(25, 31))):
        within, more = np.transpose([coverage(seed, flights, seconds) for seed in seeds])
        each = ", ".join(f"{x:.2f}" for x in within)
        print(f"{flights} flights of {seconds:.0f} s: {within.mean():.2f} within ({each}), {more.mean():.3f} need more")

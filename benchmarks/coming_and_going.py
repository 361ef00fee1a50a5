"""Seasons in which a rotor is weak on some flights and whole on others: how often `trend --parts` tells which.

    python -m benchmarks.coming_and_going --seed 102000 --seasons 20

Eight flights of eight seconds of the asymmetric quadrotor, simulated by our own plant; a rotor has lost a share of its
thrust on flights 3 and 6. Told: no step and no drift, the rotor differs between flights; apart: it names these two.
False: anything is told of another parameter. Prints a table for docs/trend.md.
"""

import argparse

import wrenchgap as wg
from wrenchgap.learn.data.opening import opened
from wrenchgap.learn.identify.steps_and_drift import Verdict

FLIGHTS, WEAK, ROTOR = 8, (2, 5), "rotor_2"


def season(seed: int, loss: float) -> tuple[bool, bool, bool]:
    """Whether the rotor was told, whether the flights were, and whether something else was."""
    model = wg.load_model("asymmetric_quadrotor")
    flights = []
    for k in range(FLIGHTS):
        hide = [f"rotor_thrust={ROTOR}:{-loss}"] if loss and k in WEAK else []
        flown = wg.simulate(
            model, "multi_axis", duration=8.0, excitation=1.0, seed=seed + k, hide=hide, name=f"{k + 1}"
        )
        flights.append(opened(flown, model))
    found = wg.trend(flights, model, parts=True)
    said = [p for p in found.parameters if p.course.verdict not in (Verdict.STEADY, Verdict.OPEN)]
    own = [p for p in said if (p.effect, p.name) == ("rotor_thrust", ROTOR) and p.course.verdict is Verdict.SCATTERED]
    return bool(own), any(p.course.apart == WEAK for p in own), len(said) > len(own)


def main() -> None:
    """The table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=102000)
    parser.add_argument("--seasons", type=int, default=20)
    given = parser.parse_args()
    print("| loss on two of eight flights | seasons | told | both flights named | something else told |")
    print("|---|---:|---:|---:|---:|")
    for row, loss in enumerate((0.0, 0.01, 0.03, 0.06)):
        first = given.seed + 1000 * row * given.seasons
        found = [season(first + 100 * k, loss) for k in range(given.seasons)]
        counts = (sum(column) for column in zip(*found, strict=True))
        print(f"| {100 * loss:g} % | {given.seasons} | {' | '.join(map(str, counts))} |", flush=True)


if __name__ == "__main__":
    main()

"""From two flights to a name: fly a vehicle whose centre of mass is off, and find that out from the flights alone."""

import numpy as np

from wrenchgap.learn.data.dataset import dataset
from wrenchgap.learn.data.opening import opened
from wrenchgap.learn.identify.explain import explain
from wrenchgap.plant import model_file, simulate, trajectory
from wrenchgap.plant.model import make_effect


def main() -> float:
    """Print what is missing; return the largest fraction of torque error that is left on the second flight."""
    model = model_file.load("tilt_hexarotor")
    hidden = make_effect(model.vehicle, "com_offset", {"x": -0.004, "y": 0.007, "z": -0.005})
    truth = model.with_effects([hidden])

    flights = []
    for name, seed in (("multi_axis", 1), ("pitch", 2)):
        path = trajectory.named(name, 16.0, 1.0 if seed == 1 else 0.0, seed)
        flown = simulate.simulate(truth, model, path, 16.0, rng=np.random.default_rng(seed), name=name)
        flights.append(dataset(opened(flown, model).records, model))
    train, test = flights

    found = explain(train, model)
    print(f"verdict: {found.verdict}, missing: {', '.join(found.effects)}")
    for (_, parameter), value, std in zip(found.fit.parameters, found.fit.theta, found.fit.std, strict=True):
        print(f"  {parameter.name} = {1e3 * value:.2f} +- {1e3 * std:.2f} mm")

    before = test.measured - test.predict(model.wrench_model)
    after = test.measured - test.predict(found.model.wrench_model)
    left = np.sqrt(np.mean(after**2, axis=0) / np.mean(before**2, axis=0))[3:]
    print("torque error left on the flight that was not used:", ", ".join(f"{100 * v:.0f} %" for v in left))
    return float(left.max())


if __name__ == "__main__":
    main()

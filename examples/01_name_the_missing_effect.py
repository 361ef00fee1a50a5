"""From two flights to a name: fly a vehicle whose centre of mass is off, and find that out from the flights alone."""

from wrenchgap import add, compare, explain, load_model, open_flights, simulate

HIDDEN = "com_offset=x:-0.004,y:0.007,z:-0.005"


def main() -> float:
    """Print what is missing; return the largest fraction of torque error that remains on the second flight."""
    model = load_model("tilt_hexarotor")
    logs = [
        simulate(model, "multi_axis", duration=16.0, excitation=1.0, seed=1, hide=[HIDDEN], name="train"),
        simulate(model, "pitch", duration=16.0, seed=2, hide=[HIDDEN], name="test"),
    ]
    train, test = open_flights(logs, model)

    found = explain(train, model)
    print(found)

    result = compare(test, model, add(model, found))
    print(result)
    nominal, fitted = (one.pooled.rms[3:] for one in result.evaluations)
    return float((fitted / nominal).max())


if __name__ == "__main__":
    main()

"""Real flights with a slung payload whose position was recorded: what the rope did, and what `explain` makes of it.

    python -m benchmarks.real_logs FOLDER [--pairs] [--json FILE] [--page docs/real-logs.md]

FOLDER holds crazyflie-payload-NNN.mcap. The payload of 5 g is a point mass on a rope of 0.51 m. Its recorded motion
gives the pull on the vehicle without any model of the vehicle,

    pull_E = T n,    n = (p_payload - p_vehicle) / L,    T = -m_p (a_payload + g e_z) . n

and so a truth that no fit has seen. The accelerometer of a multirotor reads, across its thrust,

    f_xy = (m_p / m_v) pull_xy / m_p - (D / m_v) v_xy + constant

in which thrust and its scale do not appear: the first coefficient tells the ratio of the masses, whatever the
controller believes. (Errors of the pull make it small, never large.) Coefficients by least squares, standard
deviations by a sandwich over blocks of 2 s.

With --pairs or --page, `explain` is fitted on each flight and tested on each other one.
"""

import argparse
import json
import re
import time
from itertools import permutations
from pathlib import Path

import numpy as np

from benchmarks.pages import renew
from wrenchgap import explain, flight, load_model, open_flights
from wrenchgap.flight import so3
from wrenchgap.flight.filters import smooth
from wrenchgap.learn.data.opening import open_flight
from wrenchgap.learn.diagnose.timing import timing_of
from wrenchgap.plant import model_file
from wrenchgap.replay.present.documents import plain
from wrenchgap.replay.present.timing import sentences, warnings

PAYLOAD = 0.005  # kg
BELIEVED = 0.0419  # kg: what the logs' controller assumes
PAYLOAD_TOPIC = "/payload/state_estimate"
GRAVITY = 9.80665
WINDOW = 0.3  # s, of the cubics that differentiate a position recorded to the millimetre
BLOCK = 2.0  # s
AXES = ("force_x", "force_y", "force_z", "torque_x", "torque_y", "torque_z")


def rope(path, opened):
    """Pull of the rope on the vehicle in B (K, 3) [N] at the record's times, its angle and the rope's length."""
    record = opened.records[0]
    own = opened.flight.odometry
    load = flight.load(path, {"odometry": PAYLOAD_TOPIC}).odometry
    start = max((gap.stop for gap in own.gaps), default=0.0)  # one early gap in these logs
    keep = own.time > start
    seconds = own.time[keep]
    acceleration = smooth(seconds, smooth(seconds, load.position_E[keep], WINDOW, 1), WINDOW, 1)
    line = load.position_E[keep] - own.position_E[keep]
    length = np.linalg.norm(line, axis=1)
    n = line / length[:, None]
    tension = -PAYLOAD * np.sum((acceleration + np.array([0.0, 0.0, GRAVITY])) * n, axis=1)
    pull_E = tension[:, None] * n
    at = np.stack([np.interp(record.time, seconds, column) for column in pull_E.T], axis=1)
    swing = np.degrees(np.arccos(np.clip(-n[:, 2], -1.0, 1.0)))
    return so3.rotate_inverse(record.state_kept.quat_EB, at), swing, length


def regress(columns, target, seconds):
    """Coefficients, standard deviations (blocks), share of the variance explained, residual."""
    A = np.stack(columns, axis=1)
    c, *_ = np.linalg.lstsq(A, target, rcond=None)
    left = target - A @ c
    block = ((seconds - seconds[0]) // BLOCK).astype(int)
    scores = np.zeros((block.max() + 1, A.shape[1]))
    np.add.at(scores, block, A * left[:, None])
    inverse = np.linalg.inv(A.T @ A)
    n = len(scores)
    covariance = n / (n - 1) * inverse @ (scores.T @ scores) @ inverse
    return c, np.sqrt(np.diag(covariance)), 1.0 - np.var(left) / np.var(target), left


def across(record, pull, mass):
    """What the accelerometer reads across the thrust: masses' ratio, drag, and what each alone explains."""
    velocity_B = so3.rotate_inverse(record.state_kept.quat_EB, record.state_kept.velocity_E)
    found = {}
    for axis, name in enumerate("xy"):
        f = record.measured[:, axis] / mass
        one = np.ones(len(f))
        c, std, both, left = regress([pull[:, axis] / PAYLOAD, velocity_B[:, axis], one], f, record.time)
        _, _, drag_alone, _ = regress([velocity_B[:, axis], one], f, record.time)
        _, _, rope_alone, _ = regress([pull[:, axis] / PAYLOAD, one], f, record.time)
        found[name] = {
            "mass_ratio": c[0],
            "mass_ratio_std": std[0],
            "drag_per_mass": -c[1],
            "drag_per_mass_std": std[1],
            "constant": c[2],
            "share_rope_alone": rope_alone,
            "share_drag_alone": drag_alone,
            "share_both": both,
            "share_rope_beyond_drag": both - drag_alone,
            "left_rms": float(np.std(left)),
            "residual_rms": float(np.std(f)),
            "noise_rms": record.noise[axis] / mass,
            "correlation_pull_velocity": float(np.corrcoef(pull[:, axis], velocity_B[:, axis])[0, 1]),
        }
    return found


def energy(record, pull):
    """Share of the residual's energy that the rope's pull takes off, nothing fitted: raw, and about the mean."""
    residual = record.measured - record.commanded
    out = {}
    for axis in range(3):
        r, p = residual[:, axis], pull[:, axis]
        moved = r - r.mean(), p - p.mean()
        out[AXES[axis]] = {
            "residual_mean": r.mean(),
            "residual_std": r.std(),
            "pull_mean": p.mean(),
            "pull_std": p.std(),
            "taken_off": 1.0 - np.mean((r - p) ** 2) / np.mean(r**2),
            "taken_off_about_mean": 1.0 - np.mean((moved[0] - moved[1]) ** 2) / np.mean(moved[0] ** 2),
        }
    return out


def torque(record, pull):
    """Torque that the commands do not account for: M_x = c + h v_y - z pull_y, M_y = c - h v_x + z pull_x.

    z is the height of the point at which the rope is attached, h the moment that speed makes (rotors that flap, drag
    above the centre of mass).
    """
    residual = (record.measured - record.commanded)[:, 3:]
    velocity_B = so3.rotate_inverse(record.state_kept.quat_EB, record.state_kept.velocity_E)
    found = {}
    for axis, other, sign in ((0, 1, 1.0), (1, 0, -1.0)):
        r, one = residual[:, axis], np.ones(len(residual))
        v, p = sign * velocity_B[:, other], -sign * pull[:, other]
        c, std, both, left = regress([v, p, one], r, record.time)
        found["xy"[axis]] = {
            "height": c[1],
            "height_std": std[1],
            "per_speed": c[0],
            "per_speed_std": std[0],
            "constant": c[2],
            "share_both": both,
            "share_speed_alone": regress([v, one], r, record.time)[2],
            "share_rope_alone": regress([p, one], r, record.time)[2],
            "residual_std": r.std(),
            "left_rms": float(np.std(left)),
            "noise_rms": record.noise[3 + axis],
        }
    return found


def thrust(record, pull, mass):
    """Thrust per commanded thrust, if the vehicle alone weighs `mass`, and if vehicle and payload do."""
    measured, commanded = record.measured[:, 2].mean() / mass, record.commanded[:, 2].mean()
    return {
        "vehicle_alone": (mass * measured - pull[:, 2].mean()) / commanded,
        "with_payload": ((mass - PAYLOAD) * measured - pull[:, 2].mean()) / commanded,
    }


def one(path, model):
    """Everything about one flight."""
    opened = open_flight(path, model)
    record = opened.records[0]
    mass = model.vehicle.body.mass
    pull, swing, length = rope(path, opened)
    return {
        "seconds": float(record.time[-1] - record.time[0]),
        "rope_length": [float(length.min()), float(length.max())],
        "swing_deg": float(np.percentile(swing, 99)),
        "speed": float(np.linalg.norm(record.state_kept.velocity_E, axis=1).max()),
        "energy": energy(record, pull),
        "across": across(record, pull, mass),
        "torque": torque(record, pull),
        "thrust_scale": thrust(record, pull, mass),
        "timing": sentences(timing_of(opened, model)),
        "warnings": warnings(timing_of(opened, model)),
    }


def print_one(name, r):
    """One flight as a user reads it."""
    print(f"\n{name}: {r['seconds']:.1f} s, up to {r['speed']:.2f} m/s, swing to {r['swing_deg']:.0f} deg")
    print("  force      residual mean, std [mN]   pull mean, std [mN]   pull takes off (about the mean)")
    for axis, e in r["energy"].items():
        numbers = (1e3 * e[k] for k in ("residual_mean", "residual_std", "pull_mean", "pull_std"))
        print(
            "  {:8s} {:12.1f} {:8.1f} {:16.1f} {:7.1f} {:14.0f} % ({:.0f} %)".format(
                axis, *numbers, 100 * e["taken_off"], 100 * e["taken_off_about_mean"]
            )
        )
    for axis, a in r["across"].items():
        print(
            f"  f_{axis} = ({a['mass_ratio']:.3f} +- {a['mass_ratio_std']:.3f}) pull/m_p"
            f" - ({a['drag_per_mass']:.3f} +- {a['drag_per_mass_std']:.3f}) v {a['constant']:+.3f}:"
            f" explains {100 * a['share_both']:.1f} % (drag alone {100 * a['share_drag_alone']:.0f},"
            f" rope alone {100 * a['share_rope_alone']:.0f}, rope beyond drag {100 * a['share_rope_beyond_drag']:.0f});"
            f" left {a['left_rms']:.4f} m/s^2, noise {a['noise_rms']:.4f}"
        )
    for axis, m in r["torque"].items():
        print(
            f"  M_{axis}: rope {1e3 * m['height']:.0f} +- {1e3 * m['height_std']:.0f} mm above the centre of mass,"
            f" speed makes {1e3 * m['per_speed']:.2f} +- {1e3 * m['per_speed_std']:.2f} mNm/(m/s):"
            f" explains {100 * m['share_both']:.0f} % (speed alone {100 * m['share_speed_alone']:.0f},"
            f" rope alone {100 * m['share_rope_alone']:.0f}); left {1e6 * m['left_rms']:.0f} of"
            f" {1e6 * m['residual_std']:.0f} uNm, noise {1e6 * m['noise_rms']:.1f}"
        )
    t = r["thrust_scale"]
    print(
        f"  thrust over command {t['vehicle_alone']:.3f} if 41.9 g is the vehicle, "
        f"{t['with_payload']:.3f} if it is both"
    )
    for words in r["warnings"]:
        print(f"  {words}")


def masses(flights):
    """The ratio of the masses over all flights and both axes, weighted by what each says of itself."""
    every = [a for r in flights.values() for a in r["across"].values()]
    ratio, std = (np.array([a[key] for a in every]) for key in ("mass_ratio", "mass_ratio_std"))
    weight = 1.0 / std**2
    mean = float(weight @ ratio / weight.sum())
    inflated = max(1.0, float(np.sqrt(weight @ (ratio - mean) ** 2 / (len(ratio) - 1))))
    return {"mass_ratio": mean, "mass_ratio_std": inflated / float(np.sqrt(weight.sum()))}


def pair(train, test, model):
    """Explain one flight, test on another."""
    fitted, unseen = open_flights([train, test], model)
    start = time.process_time()
    found = explain(fitted, model, validate=unseen, jobs=1)
    seconds = time.process_time() - start
    return {
        "verdict": found.verdict,
        "effects": list(found.effects),
        "firm": list(found.firm),
        "groups": [list(g) for g in found.groups],
        "parameters": [{"effect": s.effect, **v.__dict__} for s in found.fit.snapshot for v in s.values],
        "held_out_fall": found.reduction.tolist(),
        "unseen_fall": found.validation.reduction.tolist(),
        "cpu_seconds": seconds,
    }


def print_pair(train, test, r):
    """One pair in three lines."""
    falls = {k: " ".join(f"{100 * v:4.0f}" for v in r[k]) for k in ("held_out_fall", "unseen_fall")}
    print(f"\n{train} -> {test}: {r['verdict']}: {', '.join(r['effects'])}")
    print(f"  RMS reduction [%], held-out {falls['held_out_fall']}   unseen {falls['unseen_fall']}")
    clear = [p for p in r["parameters"] if abs(p["value"]) > 3 * p["std"]]
    print("  " + ", ".join(f"{p['effect']}.{p['name']} {p['value']:.3g} +- {p['std']:.1g} {p['unit']}" for p in clear))


def table(logs, pairs):
    """What each flight says and what that is worth on each other one, in Markdown."""
    out = ["| fitted on | verdict | named, firm in bold | rms reduction on an unseen flight, F_x F_y F_z M_x M_y M_z |"]
    out.append("|---|---|---|---|")
    for train in logs:
        tests = {name: pairs[f"{train}->{name}"] for name in logs if name != train}
        found = next(iter(tests.values()))
        named = ", ".join(f"**{e}**" if e in found["firm"] else e for e in found["effects"]) or "-"
        worth = "; ".join(
            f"{name}: {', '.join(f'{100 * v:.0f}' for v in r['unseen_fall'])} %" for name, r in tests.items()
        )
        out.append(f"| {train} | {found['verdict']} | {named} | {worth} |")
    return "\n".join(out)


def main():
    """Print the tables and write the JSON."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--pairs", action="store_true", help="run explain on each flight, tested on each other one")
    parser.add_argument("--json", type=Path)
    parser.add_argument("--page", type=Path, help="the page whose table is written anew")
    options = parser.parse_args()
    logs = {
        p.stem.removeprefix("crazyflie-payload-"): p for p in sorted(options.folder.glob("crazyflie-payload-*.mcap"))
    }
    if not logs:
        parser.error(f"{options.folder}: no crazyflie-payload-*.mcap there")
    shipped = load_model("crazyflie").text
    model = model_file.loads(re.sub(r"(?m)^mass = \{.*?\}", f"mass = {BELIEVED}", shipped))
    flights = {name: one(path, model) for name, path in logs.items()}
    for name, r in flights.items():
        print_one(name, r)
    m = masses(flights)
    print(f"\nall flights: m_p / m_v = {m['mass_ratio']:.4f} +- {m['mass_ratio_std']:.4f}")
    believed = model.vehicle.body.mass
    for words, value in (("41.9 g is the vehicle", PAYLOAD / believed), ("it is both", PAYLOAD / (believed - PAYLOAD))):
        print(
            f"  {value:.4f} if {words}: {(m['mass_ratio'] - value) / m['mass_ratio_std']:+.1f} standard deviations off"
        )
    pairs = {}
    if options.pairs or options.page:
        for train, test in permutations(logs, 2):
            pairs[f"{train}->{test}"] = r = pair(logs[train], logs[test], model)
            print_pair(train, test, r)
    if options.json:
        body = plain({"flights": flights, "masses": m, "pairs": pairs})
        options.json.write_text(json.dumps(body, indent=1) + "\n", encoding="utf-8")
    if options.page:
        renew(options.page, {"pairs": table(logs, pairs)})


if __name__ == "__main__":
    main()

"""A law as an effect of its own: the Python file that `--effects` reads, and the values that the search asks for.

Both are made of the same lines (`quantities`) and expressions (`atoms`), so that what was found is what is added,
simulated, compensated and exported.
"""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from wrenchgap.flight import rotate_inverse
from wrenchgap.flight.flight import Array
from wrenchgap.learn.discover.atoms import Atom
from wrenchgap.learn.discover.quantities import QUANTITIES
from wrenchgap.plant.effects.effect import force_at, pure_torque

HEAD = '''"""A law that `wrenchgap discover` found: use it as an effect of your own, with --effects FILE.py.

Beyond what the flights showed its quantities are held, and not extrapolated. The first law is the one that was chosen;
others predicted the same on those flights.
"""

import numpy as np

from wrenchgap.flight import rotate_inverse
from wrenchgap.plant import Parameter, WrenchEffect
from wrenchgap.plant.effects.effect import force_at, pure_torque
'''

CLASS = '''
class {cls}(WrenchEffect):
    """{formula}"""

    name = "{name}"
    accuracy = 0.1
    excited_by = "{excited}"
{flags}
    def parameters(self, vehicle):
        """Coefficients of the law."""
        return (
{parameters}
        )

    def apply(self, actuation, wrench_B, theta, context):
        """The added wrench (N, 6) about O."""
{lines}
        return {total}
'''

FLAGS = {"pose": "needs_pose", "air": "aerodynamic", "voltage": "needs_voltage", "rotors": "needs_rotors"}
FLAGS |= {"tilt": "needs_tilt", "rates": "needs_rates"}


def source(laws: Sequence[Atom], numbers: Mapping[str, str], limits: Sequence[tuple[str, float, float]]) -> str:
    """The file of some laws; `numbers` are its constants, `limits` hold quantities between two values."""
    held = {name: f"{low:.6g}, {high:.6g}" for name, low, high in limits}
    head = HEAD + "".join(f"{name} = {value}\n" for name, value in numbers.items())
    return head + "\n" + "\n".join(_class(law, held) for law in laws)


def _class(atom: Atom, limits: Mapping[str, str]) -> str:
    name = f"law_{atom.name}"
    flags = "".join(f"    {flag} = True\n" for key, flag in FLAGS.items() if atom.needs(key))
    parameters = "\n".join(
        f'            Parameter("k{j}", "{t.unit}", {-100 * t.scale:.4g}, {100 * t.scale:.4g}, {t.scale:.4g}),'
        for j, t in enumerate(atom.terms, 1)
    )
    lines = [f"{n} = {_held(n, limits)}" for n in atom.lines]
    total = " + ".join(f"theta[{j}] * {t.code}" for j, t in enumerate(atom.terms))
    return CLASS.format(
        cls="".join(part.capitalize() for part in name.split("_")),
        name=name,
        formula=atom.formula,
        excited=f"changes of {' and of '.join(atom.causes) or 'the command'}",
        flags=flags,
        parameters=parameters,
        lines=textwrap.indent("\n".join(lines), "        "),
        total=total,
    )


def _held(name: str, limits: Mapping[str, str]) -> str:
    code = QUANTITIES[name].code
    return f"np.clip({code}, {limits[name]})" if name in limits else code


def evaluator(numbers: Mapping[str, str]) -> Callable[..., list[list[Array]]]:
    """A function of (atoms, actuation, wrench_B, context): of each atom the wrenches (N, 6) of its terms."""
    space: dict[str, Any] = {
        "np": np,
        "rotate_inverse": rotate_inverse,
        "force_at": force_at,
        "pure_torque": pure_torque,
    }
    space |= {name: eval(value, {}) for name, value in numbers.items()}
    compiled = {name: compile(q.code, f"<{name}>", "eval") for name, q in QUANTITIES.items()}

    def values(some: Sequence[Atom], actuation: Any, wrench_B: Array, context: Any) -> list[list[Array]]:
        here = space | {"actuation": actuation, "wrench_B": wrench_B, "context": context}
        wanted = {n for a in some for n in a.lines}
        for name in (n for n in QUANTITIES if n in wanted):
            here[name] = eval(compiled[name], here)
        with np.errstate(all="ignore"):  # what is no number is no law of these flights
            return [[np.asarray(eval(t.code, here)) for t in a.terms] for a in some]

    return values

"""A vehicle from MJCF or URDF, compiled by MuJoCo (mujoco.readthedocs.io), which knows defaults, includes and units.

Of a URDF meshes are left out before it is compiled, since they carry no mass there, and the root gets a link above it:
what MuJoCo makes of a root link differs between its versions. Rotors of MJCF are actuators on sites: `gear` (0, 0, g,
0, 0, q) is a thrust g u along the site's z axis and a torque q u about it, so kappa = |q / g|; the rotor turns against
the torque. Where u is filtered to first order, the rotors lag. The IMU is at the site of the first accelerometer.
"""

import math
import os
import pickle
import signal
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path, PurePath
from typing import Any

import numpy as np

from wrenchgap._safe_path import absolute, environment
from wrenchgap.flight.errors import ModelError
from wrenchgap.flight.extras import needed_for
from wrenchgap.plant.drafts.draft import Draft, Sourced
from wrenchgap.plant.drafts.robot_tree import Joint, Link, Motor, draft_of, motors_of, refuse_negative
from wrenchgap.plant.reader import path_inside, text_of

MEMBERS = ("visual", "collision")
INCLUDING = ("include", "model")
"""Elements of MJCF whose file is a description in its turn."""
FOLDERS = ("assetdir", "meshdir", "texturedir")
"""Attributes with the folders of the others' files."""
WORLD = "wrenchgap_world"
"""Name of the link that stands in for the world in a URDF."""
REPEATING = ("replicate", "composite", "flexcomp")
"""Elements of MJCF that repeat what is in them."""
COMPILER = {"fusestatic": "false", "boundmass": "1e-9", "boundinertia": "1e-12", "discardvisual": "true"}
"""Bodies keep their names; those without mass (frames) become too light to matter."""
START = f"import sys; sys.path[:] = sys.argv[1:]; from {__name__} import serve; serve()"
"""What the process runs in which MuJoCo compiles: one line of MJCF can ask for any memory and time."""
Robot = tuple[list[Link], dict[int, Motor], Sourced | None]
"""Links of the flying tree, the root first, motors by link, and the place of the IMU."""


def from_mjcf(path: Path) -> Draft:
    """A draft of a MuJoCo model. Raises ModelError, in one line, for what MuJoCo cannot compile."""
    files_of(path)
    links, motors, imu = _asked(path, None)
    return replace(draft_of(path.stem, path.name, links, motors, "MJCF"), imu_position=imu)


def from_urdf(path: Path, document: ElementTree.Element) -> Draft:
    """A draft of a URDF. Raises ModelError, in one line, for what MuJoCo cannot compile."""
    links, _, _ = _asked(path, ElementTree.tostring(_held(document, path), encoding="unicode"))
    named = {**{one.name: k for k, one in enumerate(links)}, **{one.joint_name: k for k, one in enumerate(links)}}
    for link in document.iter("link"):
        refuse_negative(link, path.name)
    found = motors_of(document, path.name)
    return draft_of(path.stem, path.name, links, {named[n]: m for n, m in found.items() if n in named}, "URDF")


def _asked(path: Path, text: str | None, memory: int = 2_000_000_000, seconds: int = 20) -> Robot:
    """What another process makes of an MJCF file, or of the text of a URDF, with so much address space [bytes] and
    processor time [s]: a vehicle of a hundred bodies takes a hundredth of either.
    """  # noqa: D205
    _mujoco(path)  # where it is missing, that is said here
    threads = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}  # each takes address space
    command, pipe = [sys.executable, "-c", START, *absolute(sys.path)], subprocess.PIPE
    too_much = f"MuJoCo does not compile it within {memory / 1e9:g} GB and {seconds} s; take out what no vehicle needs"
    with subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=pipe, env=environment() | threads) as process:
        held, process.stdin = process.stdin, None  # `communicate` would close it, which ends the other process
        assert held is not None
        try:
            pickle.dump((path.absolute(), text, memory, seconds), held)
            held.flush()
            answered, said = process.communicate(timeout=5.0 * seconds)
        except subprocess.TimeoutExpired:
            raise ModelError(f"{path.name}: {too_much}") from None
        finally:
            process.kill()
            held.close()
    if process.returncode == 0:
        answer: Robot | ModelError = pickle.loads(answered)
        if isinstance(answer, ModelError):
            raise answer
        return answer
    if b"Traceback" in said and b"MemoryError" not in said:
        raise RuntimeError(said.decode(errors="replace"))
    crashed = process.returncode == -signal.SIGSEGV
    raise ModelError(f"{path.name}: {'MuJoCo crashes when it compiles it' if crashed else too_much}")


def serve() -> None:
    """Answer one question of `_asked`, from standard input to standard output; end where the input does."""
    path, text, memory, seconds = pickle.load(sys.stdin.buffer)
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # whatever prints, prints where errors go
    with suppress(ImportError):  # Windows
        import fcntl
        import resource

        resource.setrlimit(resource.RLIMIT_AS, (memory, memory))
        resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        fcntl.fcntl(0, fcntl.F_SETOWN, os.getpid())  # SIGIO, which ends a process, whatever MuJoCo is doing
        fcntl.fcntl(0, fcntl.F_SETFL, fcntl.fcntl(0, fcntl.F_GETFL) | os.O_ASYNC)
    try:
        answer: Robot | ModelError = _robot(path, text)
    except ModelError as error:
        answer = error
    with answers:
        pickle.dump(answer, answers)


def _robot(path: Path, text: str | None) -> Robot:
    """Of an MJCF file, or of the text of a URDF."""
    mujoco = _mujoco(path)
    if text is None:
        model = _compiled(mujoco, path, lambda: mujoco.MjModel.from_xml_path(str(path)))
    else:
        model = _compiled(mujoco, path, lambda: mujoco.MjModel.from_xml_string(text))
    links = _links(mujoco, model, path)
    numbers = {body: k for k, body in enumerate(_subtree(model, _root(mujoco, model, path)))}
    return links, _actuators(mujoco, model, numbers, links), _accelerometer(mujoco, model, numbers)


def _mujoco(path: Path) -> Any:
    with needed_for(f"{path}: URDF and MJCF", ModelError):
        import mujoco
    return mujoco


def files_of(path: Path) -> set[Path]:
    """Files that an MJCF, or what it includes, names; ModelError unless all lie in its folder (`path_inside`)."""
    folder, waiting = path.parent, [path]
    names, folders = list[tuple[str, str]](), {""}

    def checked(start: str, name: str, where: str) -> Path:
        return path_inside(folder, str(PurePath(start, name)) if start else name, where)

    for one in waiting:  # grows
        elements = _elements(one, path)
        folders |= {value for e in elements for key, value in e.items() if key.lower() in FOLDERS}
        here = "" if one is path else str(one.parent.relative_to(folder.resolve()))
        for element, key, name in ((e, key, name) for e in elements for key, name in e.items()):
            if not key.lower().startswith("file"):
                continue
            where = f"{path.name}: <{element.tag} {key}>"
            names.append((where, name))
            if element.tag.lower() in INCLUDING:
                found = [checked(start, name, where) for start in ("", here)]
                waiting += [each for each in found if each.is_file() and each not in waiting]
    return {checked(start, name, where) for where, name in names for start in sorted(folders)} | set(waiting[1:])


def _elements(one: Path, path: Path, max_copies: int = 1000) -> list[ElementTree.Element]:
    """Elements of the MJCF `one`, which `path` includes or is; MuJoCo allocates every one of the repeated bodies."""
    text = text_of(one, "as MJCF")
    if "<!DOCTYPE" in text:  # MuJoCo skips what it declares in another way than we do
        raise ModelError(f"{path.name}: {one.name} has a DOCTYPE, which MJCF does not need; take it out")
    try:
        found = list(ElementTree.fromstring(text.encode()).iter())
    except (ElementTree.ParseError, LookupError, ValueError) as error:  # the latter of its encoding
        raise ModelError(f"{path.name}: {one.name} is not XML: {error}") from None
    copies = 1
    for count in (e.get("count", "") for e in found if e.tag.lower() in REPEATING):
        copies *= math.prod(int(n) for n in count.replace("+", " ").split() if n.isdecimal() and n != "0")
    if copies > max_copies:
        raise ModelError(
            f"{path.name}: {one.name} repeats bodies {copies:,} times; a vehicle has at most {max_copies:,}"
        )
    return found


def _compiled(mujoco: Any, path: Path, make: Callable[[], Any]) -> Any:
    """The model that MuJoCo compiles from a file. Its warnings are errors; else it would write a log file here."""
    warnings: list[str] = []
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(lambda text: warnings.append(_one_line(text)))
    try:
        model = make()
    except (ValueError, RuntimeError) as error:
        raise ModelError(f"{path.name}: MuJoCo cannot compile it: {_one_line(error)}") from None
    finally:
        mujoco.set_mju_user_warning(before)
    if warnings:
        raise ModelError(f"{path.name}: MuJoCo warns: {warnings[0]}")
    return model


def _one_line(said: object) -> str:
    return " ".join(str(said).split())


def _held(document: ElementTree.Element, path: Path) -> ElementTree.Element:
    """The URDF without meshes, with its root link fixed to an added link for the world."""
    for link in document.iter("link"):
        for member in [child for child in link if child.tag in MEMBERS]:
            link.remove(member)
    children = {child.get("link") for joint in document.iter("joint") if (child := joint.find("child")) is not None}
    roots = [name for link in document.findall("link") if (name := link.get("name")) not in children and name]
    if len(roots) != 1:
        raise ModelError(f"{path.name}: got {len(roots)} root links ({', '.join(roots) or 'none'}), expected one")
    for old in document.findall("mujoco"):
        document.remove(old)
    ElementTree.SubElement(ElementTree.SubElement(document, "mujoco"), "compiler", COMPILER)
    ElementTree.SubElement(document, "link", {"name": WORLD})
    joint = ElementTree.SubElement(document, "joint", {"name": "wrenchgap_held", "type": "fixed"})
    ElementTree.SubElement(joint, "parent", {"link": WORLD})
    ElementTree.SubElement(joint, "child", {"link": roots[0]})
    return document


def _root(mujoco: Any, model: Any, path: Path) -> int:
    """The flying body: the heaviest child of the world."""
    candidates = [b for b in range(1, model.nbody) if model.body_parentid[b] == 0]
    if not candidates:
        raise ModelError(f"{path.name}: has no body that could fly")
    root = max(candidates, key=lambda b: float(model.body_subtreemass[b]))
    below = [b for b in range(1, model.nbody) if model.body_parentid[b] == root]
    return below[0] if mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_BODY, root) == WORLD and below else root


def _subtree(model: Any, root: int) -> list[int]:
    kept = [root]
    for body in range(root + 1, model.nbody):
        if int(model.body_parentid[body]) in kept:
            kept.append(body)
    return kept


def _links(mujoco: Any, model: Any, path: Path) -> list[Link]:
    """All bodies of the flying tree, the root first, in the frame of the root and at rest."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    root = _root(mujoco, model, path)
    bodies = _subtree(model, root)
    origin, turned = data.xpos[root].copy(), data.xmat[root].reshape(3, 3).copy()
    out = []
    for body in bodies:
        frame, principal = data.xmat[body].reshape(3, 3), turned.T @ data.ximat[body].reshape(3, 3)
        mass = float(model.body_mass[body])
        heavy = mass > 1e-7  # kg; lighter ones are frames, see `COMPILER`
        out.append(
            Link(
                mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_BODY, body) or f"body_{body}",
                bodies.index(int(model.body_parentid[body])) if body != root else -1,
                turned.T @ (data.xpos[body] - origin),
                turned.T @ frame,
                mass if heavy else 0.0,
                turned.T @ (data.xipos[body] - origin),
                principal @ np.diag(model.body_inertia[body]) @ principal.T if heavy else np.zeros((3, 3)),
                *(_joint(mujoco, model, data, body, turned) if body != root else _FIXED),
            )
        )
    return out


Joined = tuple[Joint, "np.ndarray[Any, Any] | None", tuple[float, float], str]
_FIXED: Joined = ("fixed", None, (-math.inf, math.inf), "")


def _joint(mujoco: Any, model: Any, data: Any, body: int, turned: Any) -> Joined:
    """The first joint of a body to its parent."""
    if not model.body_jntnum[body]:
        return _FIXED
    joint = int(model.body_jntadr[body])
    name = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_JOINT, joint) or ""
    if model.jnt_type[joint] != mujoco.mjtJoint.mjJNT_HINGE:
        return "other", None, (-math.inf, math.inf), name
    axis = turned.T @ data.xaxis[joint]
    if not model.jnt_limited[joint]:
        return "turning", axis, (-math.inf, math.inf), name
    low, high = (float(v) for v in model.jnt_range[joint])
    return "hinge", axis, (low, high), name


def _actuators(mujoco: Any, model: Any, numbers: dict[int, int], links: list[Link]) -> dict[int, Motor]:
    """Rotors from actuators on sites; each gets a body, by which `draft_of` finds its position."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    found: dict[int, Motor] = {}
    root = next(body for body, k in numbers.items() if k == 0)
    origin, turned = data.xpos[root], data.xmat[root].reshape(3, 3)
    for number in range(model.nu):
        if model.actuator_trntype[number] != mujoco.mjtTrn.mjTRN_SITE:
            continue
        gear, site = model.actuator_gear[number], int(model.actuator_trnid[number, 0])
        body = int(model.site_bodyid[site])
        if body not in numbers or abs(gear[2]) < 1e-12 or np.any(np.abs(gear[:2]) > 1e-12):
            continue
        name = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_ACTUATOR, number) or f"actuator {number}"
        frame = turned.T @ data.site_xmat[site].reshape(3, 3)
        hub = turned.T @ (data.site_xpos[site] - origin)
        links.append(Link(name, numbers[body], hub, frame, 0.0, hub, np.zeros((3, 3))))
        source, sign, ratio = f"gear of actuator {name}", np.sign(gear[2]), float(gear[5] / abs(gear[2]))
        most = float(abs(gear[2]) * np.abs(model.actuator_ctrlrange[number]).max())
        most *= float(model.actuator_gainprm[number, 0])
        limited = bool(model.actuator_ctrllimited[number]) and most > 0.0
        found[len(links) - 1] = Motor(
            spin=Sourced(-1 if ratio * sign > 0.0 else 1, source) if ratio else None,
            kappa=Sourced(abs(ratio), source) if ratio else None,
            thrust_max=Sourced(most, f"ctrlrange and {source}") if limited else None,
            number=number,
            position=hub,
            direction=sign * frame[:, 2],
            lag=_filter(mujoco, model, number),
        )
    return found


def _accelerometer(mujoco: Any, model: Any, numbers: dict[int, int]) -> Sourced | None:
    """The place of the first accelerometer on the flying tree, in the frame of its root."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    root = next(body for body, k in numbers.items() if k == 0)
    origin, turned = data.xpos[root], data.xmat[root].reshape(3, 3)
    for number in range(model.nsensor):
        site = int(model.sensor_objid[number])
        if (
            model.sensor_type[number] == mujoco.mjtSensor.mjSENS_ACCELEROMETER
            and int(model.site_bodyid[site]) in numbers
        ):
            place = np.round(turned.T @ (data.site_xpos[site] - origin), 9) + 0.0
            return Sourced(tuple(place.tolist()), "site of the accelerometer of the MJCF")
    return None


def _filter(mujoco: Any, model: Any, number: int) -> tuple[float, float] | None:
    """Time constants [s] of an actuator whose control is filtered to first order."""
    kind, kinds = model.actuator_dyntype[number], mujoco.mjtDyn
    if not (kind == kinds.mjDYN_FILTER or kind == kinds.mjDYN_FILTEREXACT):
        return None
    tau = max(float(model.actuator_dynprm[number, 0]), 0.0)
    return tau, tau

"""A vehicle from Gazebo's SDF: links, joints and motor plugins of its first model. Decision: docs/decisions/0021.

A pose is x y z roll pitch yaw, of a link in the model, of a joint in its child, of an inertial in its link, unless
`relative_to` names another frame. Included models are not fetched. Source: sdformat.org, specification 1.4 to 1.12.
"""

from dataclasses import replace
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from wrenchgap.flight.errors import ModelError
from wrenchgap.flight.flight import Array
from wrenchgap.plant.drafts.draft import Draft
from wrenchgap.plant.drafts.robot_tree import Joint, Link, draft_of, motors_of

Pose = tuple[Array, Array]
"""Position (3,) [m] and rotation (3, 3) of a frame in another."""
HERE: Pose = (np.zeros(3), np.eye(3))


def from_sdf(path: Path, document: Element) -> Draft:
    """A draft of the first model. Raises ModelError for a file without one, or with a missing reference."""
    where, notes = path.name, []
    model = document if document.tag == "model" else next(document.iter("model"), None)
    if model is None:
        raise ModelError(f"{where}: holds no <model>")
    if next(model.iter("include"), None) is not None:
        notes.append(f"{where}: models that it includes are not in: write it out with `gz sdf -p` if they carry mass.")
    elements = {str(link.get("name")): link for link in model.findall("link")}
    if not elements:
        raise ModelError(f"{where}: model {model.get('name')} has no <link>")
    children = [((joint.findtext("child") or "").strip(), joint) for joint in model.findall("joint")]
    for child, joint in children:
        if not child:
            raise ModelError(f"{where}: joint {joint.get('name')} has no <child>")
    joints = dict(children)
    poses = _poses(model, where)
    ordered = _from_root(list(elements), joints, where)
    at, turned = poses[ordered[0]]
    places = {n: _after((-turned.T @ at, turned.T), pose) for n, pose in poses.items()}
    links = [_link(n, elements[n], joints.get(n), ordered, places, where) for n in ordered]
    named = {n: k for k, n in enumerate(ordered)} | {str(j.get("name")): ordered.index(c) for c, j in joints.items()}
    motors = {named[n]: m for n, m in motors_of(document, where).items() if n in named}
    draft = draft_of(str(model.get("name") or path.stem), where, links, motors, "SDF")
    return replace(draft, notes=(*draft.notes, *notes))


def _numbers(text: str | None, count: int, what: str) -> Array:
    try:
        values = np.array((text or "").split(), dtype=float)
    except ValueError:
        values = np.empty(0)
    if values.shape != (count,) or not np.all(np.isfinite(values)):
        raise ModelError(f"{what}: got {text!r}, expected {count} numbers")
    return values


def _pose(element: Element | None, what: str) -> Pose:
    from scipy.spatial.transform import Rotation  # here: others need not wait for it

    if element is None or not (element.text or "").strip():
        return HERE
    if element.get("rotation_format") == "quat_xyzw":
        values = _numbers(element.text, 7, f"{what}: pose")
        return values[:3], Rotation.from_quat(values[3:]).as_matrix()
    values = _numbers(element.text, 6, f"{what}: pose")
    degrees = element.get("degrees") == "true"
    return values[:3], Rotation.from_euler("xyz", values[3:], degrees=degrees).as_matrix()


def _after(first: Pose, second: Pose) -> Pose:
    """The product of two poses: a frame given in a second one that is given in a first."""
    return first[0] + first[1] @ second[0], first[1] @ second[1]


def _poses(model: Element, where: str, max_depth: int = 100) -> dict[str, Pose]:
    """Poses of all links, joints and frames in the model's frame; a vehicle has a few frames within one another."""
    given: dict[str, tuple[str, Pose]] = {}
    for kind in ("link", "joint", "frame"):
        for element in model.findall(kind):
            name, at = str(element.get("name")), element.find("pose")
            usual = {"joint": (element.findtext("child") or "").strip(), "frame": element.get("attached_to") or ""}
            relative = (at.get("relative_to") if at is not None else None) or usual.get(kind, "")
            given[name] = (relative, _pose(at, f"{where}: {kind} {name}"))
    done: dict[str, Pose] = {"": HERE, "__model__": HERE, "world": HERE}

    def resolved(name: str, waiting: tuple[str, ...] = ()) -> Pose:
        if name not in done:
            if name not in given or name in waiting:
                raise ModelError(f"{where}: the frame {name!r} is {'circular' if name in waiting else 'not there'}")
            if len(waiting) >= max_depth:
                raise ModelError(f"{where}: {max_depth} frames stand on one another at {name!r}; expected a few")
            relative, pose = given[name]
            done[name] = _after(resolved(relative, (*waiting, name)), pose)
        return done[name]

    for name in given:
        resolved(name)
    return done


def _from_root(names: list[str], joints: dict[str, Element], where: str) -> list[str]:
    """The names of links from the root on, parents first."""
    parents = {c: (j.findtext("parent") or "").strip() for c, j in joints.items()}
    roots = [n for n in names if parents.get(n, "world") in ("world", "")]
    if not roots:
        raise ModelError(f"{where}: every link has a parent; expected one root")
    below: dict[str, list[str]] = {}
    for name in names:
        below.setdefault(parents.get(name, ""), []).append(name)
    out = [roots[0]]
    for name in out:  # grows
        out += [n for n in below.get(name, []) if n not in out]
    missing = [n for n in names if n not in out]
    if missing:
        raise ModelError(f"{where}: {', '.join(missing)} hang on no joint from {roots[0]}; join them")
    return out


def _link(
    name: str, element: Element, joint: Element | None, ordered: list[str], places: dict[str, Pose], where: str
) -> Link:
    """One link and its joint; `places` are the poses of all frames in that of the root."""
    mass, centre, inertia = _inertial(element, places[name], f"{where}: link {name}")
    body = Link(name, -1, *places[name], mass, centre, inertia)
    if joint is None or name == ordered[0]:
        return body
    parent, called = ordered.index((joint.findtext("parent") or "").strip()), str(joint.get("name"))
    kind, axis, limits = _joined(joint, places[called][1], f"{where}: joint {called}")
    return replace(body, parent=parent, joint=kind, axis=axis, limits=limits, joint_name=called)


def _inertial(element: Element, place: Pose, what: str) -> tuple[float, Array, Array]:
    """Mass, centre and inertia about it, in the root's frame; SDF's default is a kilogram, which is refused."""
    inertial = element.find("inertial")
    if inertial is None:
        return 0.0, place[0], np.zeros((3, 3))
    at = _after(place, _pose(inertial.find("pose"), what))
    mass = float(_numbers(inertial.findtext("mass"), 1, f"{what}: mass")[0])
    own = np.zeros((3, 3))
    for i, k in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)):
        key = f"i{'xyz'[i]}{'xyz'[k]}"
        text = inertial.findtext(f"inertia/{key}")
        if text is None and i == k:
            raise ModelError(f"{what}: inertia has no <{key}>")
        own[i, k] = own[k, i] = 0.0 if text is None else float(_numbers(text, 1, f"{what}: {key}")[0])
    return mass, at[0], at[1] @ own @ at[1].T


def _joined(joint: Element, rotation: Array, what: str) -> tuple[Joint, Array | None, tuple[float, float]]:
    kind = joint.get("type") or ""
    if kind == "fixed":
        return "fixed", None, (-np.inf, np.inf)
    if kind not in ("revolute", "continuous"):
        return "other", None, (-np.inf, np.inf)
    axis = rotation @ _numbers(joint.findtext("axis/xyz") or "0 0 1", 3, f"{what}: axis")
    axis = axis / max(float(np.linalg.norm(axis)), 1e-12)
    low, high = (
        float(_numbers(joint.findtext(f"axis/limit/{end}") or usual, 1, f"{what}: limit")[0])
        for end, usual in (("lower", "-1e16"), ("upper", "1e16"))
    )
    free = kind == "continuous" or max(-low, high) > 1e3  # rad: no stop is so many turns away
    return ("turning" if free else "hinge"), axis, (-np.inf, np.inf) if free else (low, high)

"""Which topic plays which role.

A role is made of one or more *parts*, each played by one topic: a pose and a twist make an odometry, tilt angles and
rotor speeds make the actuators. A message type offers *quantities* (wrench, pose, twist, ...); a part needs one.
Among the topics that offer it, words in the topic's name decide; ties go to the topic whose name shares most with the
topics already chosen, then to the one with more messages.

Overrides: `{"imu": "/my/imu"}`. The topic may be followed by a field and by columns, for arrays:

    tilt=/plot/tilt_angle                  all columns of the array
    rotor_speed=/esc[3,2,1,0]              columns in this order
    rotor_speed=/state.velocity[6:18]      columns 6 to 17 of the field `velocity`
    commanded=/debug.data[0:6]             force x y z, torque x y z
    desired=none                           nobody plays this role

What the numbers mean stands behind it: a factor, and words for units, axes and stamps (`flight.mapping_units`):

    rotor_speed=/esc.rpm*0.10472           everything times a factor
    imu=/imu:frd,g                         axes forward-right-down, accelerometer in g
    gyroscope=/gyro  accelerometer=/acc    one role from two topics: parts of `imu` that are only played when asked

Columns of a vector that is taken from an array: wrench = force, torque; imu = angular velocity, specific force;
pose = position x y z, quaternion x y z w; twist and acceleration = linear, angular.
"""

import shlex
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from wrenchgap.flight.errors import LogError, UsageError, meant
from wrenchgap.flight.flight import ROLES
from wrenchgap.flight.formats import Selection, Table
from wrenchgap.flight.mapping_units import Meaning, Said, meaning, parse_source, topic_of
from wrenchgap.flight.topic_names import TYPES, apart, by_fields, fleet, namespace, no_command, score, twins, within

ROLE_PARTS: dict[str, tuple[str, ...]] = {
    "commanded": ("commanded",),
    "desired": ("desired",),
    "actuators": ("tilt", "rotor_speed"),
    "imu": ("imu", "gyroscope", "accelerometer"),
    "odometry": ("pose", "twist"),
    "reference": ("reference_pose", "reference_twist", "reference_acceleration"),
    "battery": ("battery",),
}
"""The parts of every role, in the order in which they are chosen."""

PART_QUANTITY: dict[str, str] = {
    **dict.fromkeys(("commanded", "desired"), "wrench"),
    **{part: part for part in ("tilt", "rotor_speed", "imu", "gyroscope", "accelerometer", "pose", "twist")},
    "reference_pose": "pose",
    "reference_twist": "twist",
    "reference_acceleration": "acceleration",
    "battery": "voltage",
}

FLOWN = ("commanded", "actuators", "imu", "odometry")
"""Roles of which every vehicle in a log has topics of its own."""
ASKED = ("gyroscope", "accelerometer")
"""Parts that nobody plays without being asked: what they say goes before the `imu`."""
ASKED_FIELDS = {"gyroscope": "angular_velocity", "accelerometer": "linear_acceleration"}
"""Where an Imu message has them."""

SPEED_FIELDS = ("motor_speed", "motor_speeds", "rotor_speed", "rotor_speeds", "angular_velocities")
"""Array fields by which a custom type is recognised as rotor speeds, e.g. RotorS' mav_msgs/MotorSpeed."""


AS_IT_IS = Meaning()


@dataclass(frozen=True)
class Source:
    """Where a part's numbers come from: a topic, a field of its messages, and columns of that field (None: all)."""

    topic: str
    field: str
    columns: tuple[int, ...] | None = None
    asked: bool = False  # the field was named by the user and does not follow from the type
    meaning: Meaning = AS_IT_IS

    def __str__(self) -> str:
        """As in an override."""
        field = f".{self.field}" if self.asked else ""
        columns = "" if self.columns is None else f"[{','.join(map(str, self.columns))}]"
        return f"{self.topic}{field}{columns}{self.meaning}"


@dataclass(frozen=True)
class Assignment:
    """Who plays what: `sources` by part.

    `candidates` by part are the other topics that could, best first: those whose name suits, or, where none was
    chosen, all of the right type. `vehicles` are part and topic of each of several vehicles that the log may be of,
    where nobody said which.
    """

    sources: dict[str, Source]
    candidates: dict[str, tuple[str, ...]] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    vehicles: tuple[tuple[str, str], ...] = ()

    def as_topics(self) -> dict[str, str]:
        """The assignment in the syntax of overrides, for a model file."""
        return {part: str(source) for part, source in self.sources.items()}


def quantities(kind: str, fields: list[str]) -> dict[str, str]:
    """Quantities that a type offers, with their fields; custom types are recognised by their field names."""
    if kind in TYPES:
        return TYPES[kind]
    speeds = [name for name in SPEED_FIELDS if name in fields]
    own = {} if "/msg/" in kind else by_fields(fields)
    return own | ({"rotor_speed": speeds[0]} if speeds else {})


def is_none(value: str) -> bool:
    """Whether an override says that no topic plays the role."""
    return value.strip().lower() in ("none", "")


def selection(topics: Mapping[str, str]) -> Selection:
    """What to decode of a log: topics that offer something, and those that are named."""
    named = {topic_of(value) for value in topics.values()}
    return lambda topic, kind, fields: topic in named or bool(quantities(kind, fields))


def propose(tables: Mapping[str, Table], topics: Mapping[str, str] | None = None, where: str = "log") -> Assignment:
    """Choose a topic for every part that the log can play; `topics` overrides by role or by part.

    Raises UsageError where an override names no role, LogError where it names a topic that the log lacks, or one that
    cannot play the role.
    """
    named = _overrides(topics or {}, tables, where)
    chosen = {part: source for part, source in named.items() if source is not None}
    proposer = _Proposer(tables, chosen, fleet(_likely(tables)))
    for part in PART_QUANTITY:
        if part not in named and part not in ASKED:
            proposer.choose(part)
    proposer.one_wrench(closed=set(named))
    return Assignment(
        {part: proposer.sources[part] for part in PART_QUANTITY if part in proposer.sources},
        proposer.candidates,
        tuple(proposer.notes),
        tuple(proposer.asked(any(named.values()))),
    )


class _Proposer:
    def __init__(self, tables: Mapping[str, Table], named: dict[str, Source], fleet: tuple[str, ...] = ()) -> None:
        self.tables, self.fleet = tables, fleet
        self.sources = dict(named)
        self.told = self._vehicle() is not None
        self.candidates: dict[str, tuple[str, ...]] = {}
        self.notes: list[str] = []
        self.vehicles: list[tuple[str, str]] = []

    def choose(self, part: str, alike: float = 0.95) -> None:
        """Give a part to the best topic, if any is good enough; a share `alike` of its messages decides nothing."""
        scored = [
            (own + self._kinship(part, topic), len(table), topic, place)
            for topic, table, own, place in _offers(self.tables, part)
        ]
        full = alike * max((entry[1] for entry in scored), default=0)
        scored.sort(key=lambda entry: (-entry[0], -min(entry[1], full), entry[2]))
        good = [entry for entry in scored if entry[0] > 0 and self._free(part, entry[2])]
        good = self._of_one(part, good)
        if good:
            _, _, topic, place = good[0]
            vehicles = [entry[2] for entry in good if twins(topic, entry[2])]
            if len(vehicles) > 1 and not self.vehicles and not self.sources:
                self.vehicles = [(part, other) for other in sorted(vehicles)]
            self.sources[part] = Source(topic, place)
        others = tuple(entry[2] for entry in (good[1:] if good else scored))
        if others:
            self.candidates[part] = others

    def _vehicle(self) -> str | None:
        """The namespace of the vehicle that is chosen already, of those in the log."""
        spaces = (within(source.topic, self.fleet) for source in self.sources.values())
        return next((space for space in spaces if space is not None), None)

    def _of_one(self, part: str, good: list[Any]) -> list[Any]:
        """Without the topics of other vehicles than the one that is chosen."""
        own = self._vehicle()
        if own is None:
            return good
        kept = [entry for entry in good if within(entry[2], self.fleet) in (own, None)]
        if good and not kept:
            self.notes.append(
                f"{good[0][2]} could be the {part}, but it is of another vehicle than /{own}: left out; if it is not, "
                f"say --topic {shlex.quote(f'{part}={good[0][2]}')}."
            )
        return kept

    def asked(self, named: bool) -> list[tuple[str, str]]:
        """Part and topic of each of several vehicles, where nobody said which; `named`: some topic was."""
        if self.told or (named and not self.fleet):
            return []
        if not self.fleet:
            return self.vehicles
        for part, source in self.sources.items():
            own = within(source.topic, self.fleet)
            others = [t for t in self.candidates.get(part, ()) if (apart(source.topic, t) or ("",))[0] == own]
            if own is not None and others:
                return [(part, topic) for topic in (source.topic, *others)]
        return self.vehicles

    def _free(self, part: str, topic: str) -> bool:
        """The vehicle's motion and its reference are different topics; so are commanded and desired wrench."""
        apart = {"desired": ("commanded",), "reference_pose": ("pose",), "reference_twist": ("twist",)}
        if any(self.sources[p].topic == topic for p in apart.get(part, ()) if p in self.sources):
            return False
        if part in ("reference_twist", "reference_acceleration"):
            return "reference_pose" in self.sources
        return part != "twist" or "pose" in self.sources

    def _kinship(self, part: str, topic: str) -> float:
        """Up to one point for a shared name: a twist belongs to its pose, a vehicle's topics to one another."""
        partner = {"twist": "pose", "reference_twist": "reference_pose", "reference_acceleration": "reference_pose"}
        chosen = self.sources.get(partner.get(part, ""))
        if chosen is not None and chosen.topic == topic:
            return 3.0
        leader = chosen or next(iter(self.sources.values()), None)
        return 0.5 if leader and namespace(topic) and namespace(topic) == namespace(leader.topic) else 0.0

    def one_wrench(self, closed: set[str]) -> None:
        """A desired wrench stands in for a commanded one that was not logged."""
        if "commanded" in self.sources or "commanded" in closed or "desired" not in self.sources:
            return
        self.sources["commanded"] = self.sources["desired"]
        self.notes.append(
            f"No topic holds a commanded wrench: {self.sources['desired'].topic} (desired) is used for both."
        )


def _likely(tables: Mapping[str, Table]) -> dict[str, list[str]]:
    """Topics whose type and name suit a role, of roles that every vehicle in a log has topics of its own for."""
    return {
        role: [
            topic
            for part in ROLE_PARTS[role]
            if part not in ASKED
            for topic, _, own, _ in _offers(tables, part)
            if own > 0
        ]
        for role in FLOWN
    }


def _offers(tables: Mapping[str, Table], part: str) -> Iterator[tuple[str, Table, float, str]]:
    """Topics that offer what a part needs, with how well their names suit it, and the field in which it lies."""
    for topic, table in tables.items():
        place = _offered(table, part)
        if place is not None and not (part in ("commanded", "desired") and no_command(topic)):
            yield topic, table, score(part, topic, table.type), place


def _offered(table: Table, part: str) -> str | None:
    """The field in which a table offers what a part needs, or None."""
    quantity = PART_QUANTITY[part]
    place = quantities(table.type, list(table.columns)).get(quantity)
    if place is None or not table.columns:
        return None
    first = table.columns.get(place)
    if part == "rotor_speed" and "normalized" in table.columns and (first is None or not first.shape[-1]):
        place, first = "normalized", table.columns["normalized"]  # an Actuators message without speeds
    if quantity in ("tilt", "rotor_speed") and (first is None or first.ndim != 2 or not first.shape[1]):
        return None
    below = f"{place}." if place else ""
    present = place in table.columns or any(name.startswith(below) for name in table.columns)
    return place if present else None


def _overrides(topics: Mapping[str, str], tables: Mapping[str, Table], where: str) -> dict[str, Source | None]:
    named: dict[str, Source | None] = {}
    for role, value in topics.items():
        if role not in ROLE_PARTS and role not in PART_QUANTITY:
            valid = ", ".join(dict.fromkeys((*ROLES, *PART_QUANTITY)))
            raise UsageError(f"topic mapping {role}={value}: no role is called {role!r}; roles: {valid}")
        parts = tuple(part for part in ROLE_PARTS.get(role, (role,)) if part == role or part not in ASKED)
        if is_none(value):
            named |= dict.fromkeys(parts)
            continue
        found = {part: source for part in parts if (source := _named_source(value, part, tables, where, parts))}
        if not found:
            topic = topic_of(value)
            raise LogError(
                f"{where}: {topic} ({tables[topic].type}) cannot play {role!r}: "
                f"{tables[topic].problem or 'it holds no ' + ' or '.join(PART_QUANTITY[p] for p in parts)}; "
                f"for an array name field and columns, as in {role}={topic}.data[0:6]"
            )
        said = parse_source(value)
        meant = meaning(said.words, said.factor, value, [PART_QUANTITY[part] for part in found])
        named |= {part: replace(source, meaning=meant) for part, source in found.items()}
    return named


def _named_source(
    value: str, part: str, tables: Mapping[str, Table], where: str, parts: tuple[str, ...]
) -> Source | None:
    said = parse_source(value)
    topic, place, columns = said.topic, said.field, said.columns
    if topic not in tables:
        raise LogError(f"{where}: no topic {topic!r}{meant(topic, tables)}; topics: {', '.join(tables) or 'none'}")
    table = tables[topic]
    asked = place is not None
    if place is None and part in ASKED:  # three numbers: of an Imu, or the one vector of another message
        fields = (ASKED_FIELDS[part], "vector", "vector3", "")
        whole = (f for f in fields if all((f"{f}.{axis}" if f else axis) in table.columns for axis in "xyz"))
        place = next(whole, None)
    elif place is None:
        place = _offered(table, part)
    if place is None and len(parts) == 1:  # an array without a name of its own can only play a role of one part
        arrays = [name for name, values in table.columns.items() if values.ndim == 2 and values.dtype.kind in "fiu"]
        place = arrays[0] if len(arrays) == 1 and (columns is not None or arrays[0] == "data") else None
    if place is None:
        return None
    array = table.columns.get(place)
    if columns is not None and (array is None or array.ndim != 2 or max(columns) >= array.shape[1]):
        width = "no array" if array is None or array.ndim != 2 else f"{array.shape[1]} columns"
        raise LogError(f"{where}: {value} asks for column {max(columns)}, but {topic} field {place!r} has {width}")
    if not any(name == place or name.startswith(f"{place}.") for name in table.columns) and place:
        raise LogError(f"{where}: {topic} has no field {place!r}; fields: {', '.join(table.columns)}")
    return Source(topic, place, columns, asked)


def assignment(
    tables: Mapping[str, Table], topics: Mapping[str, str] | None, preferred: Mapping[str, str] | None, where: str
) -> Assignment:
    """Who plays what under `topics` and, where the log can follow them, `preferred`, those of a model file.

    Where this log has the role but not the topic of a model file, the notes say what is used instead, and what the
    file says of that topic's numbers. Errors as of `propose`.
    """
    topics, preferred = topics or {}, preferred or {}
    said = {role: None if is_none(value) else parse_source(value) for role, value in preferred.items()}
    followed = {role: preferred[role] for role, own in said.items() if own is None or own.topic in tables}
    found = propose(tables, {**followed, **topics}, where)
    lost, plain = [], []
    for role, own in said.items():
        played = [found.sources[p].topic for p in ROLE_PARTS.get(role, (role,)) if p in found.sources]
        if own is None or own.topic in tables or role in topics or not played:
            continue
        if own == Said(own.topic, own.field, None, 1.0, ""):
            plain.append(f"{role} from {played[0]}, not {own.topic}")
            continue
        words = f"this log has no {own.topic}, {played[0]} is used as it is."
        lost.append(f"The model file maps {role} to {preferred[role]}; {words}")
    all_plain = [f"This log lacks topics that the model file names; read are {'; '.join(plain)}."] if plain else []
    return replace(found, notes=(*found.notes, *lost, *all_plain))

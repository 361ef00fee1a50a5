"""PX4 logs (`.ulg`; https://docs.px4.io/main/en/dev_log/ulog_file_format.html), through pyulog.

Every message becomes a table under PX4's own name, further instances under `name/1`, in PX4's frames and units; what
plays a role is made of them by `flight.formats.px4`.
"""

import re
import struct
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from wrenchgap.flight.autopilot import Autopilot, changes_of
from wrenchgap.flight.budget import LIMITS, Account, Budget
from wrenchgap.flight.errors import LogError
from wrenchgap.flight.extras import needed_for
from wrenchgap.flight.formats.reader import Columns, Selection, Table, TableReader, in_order, readable

LATEST = 2**63 // 1000 - 1
"""No stamp [us] is later: it would not fit into nanoseconds."""


@dataclass
class UlogReader(TableReader):
    """Reads one PX4 log. `autopilot` is known once the tables are."""

    name: ClassVar[str] = "PX4 ULog"
    expected: ClassVar[str] = "PX4 ULog (.ulg)"
    magic: ClassVar[bytes] = b"ULog\x01\x12\x35"

    autopilot: Autopilot | None = None

    def tables(self, selection: Selection) -> dict[str, Table]:
        """All messages by topic; raises LogError where nothing can be read."""
        log = _opened(self.path, self.account)
        if log.file_corruption:
            self.damage.append(f"{self.path.name} is damaged: what could be read around the damage was.")
        lost = sum(dropout.duration for dropout in log.dropouts) * 1e-3
        about = log.msg_info_dict
        number = isinstance(about.get("ver_sw_release"), int)  # in a damaged log it may be bytes
        firmware = (log.get_version_info_str() if number else None) or str(about.get("ver_sw", ""))[:10]
        hardware, name = str(about.get("ver_hw", "")), str(about.get("sys_name", "PX4"))
        serial = str(about.get("sys_uuid", ""))
        every = _last_values(log)
        rows = ((1000 * int(time), name, value) for time, name, value in log.changed_parameters)
        changes = changes_of(rows, log.initial_parameters)
        self.autopilot = Autopilot(name, firmware, hardware, "", every, len(log.dropouts), lost, serial, changes)
        if log.dropouts:
            self.notes.append(f"{len(log.dropouts)} dropouts: the logger lost {lost:.2f} s of messages in all.")
        found = []
        for data in log.data_list:
            self.account.check_time()
            if "timestamp" in data.data:
                self.account.take(
                    LIMITS.ulog_field * len(data.data) + 2 * data.data["timestamp"].base.nbytes, "messages"
                )
                found.append(_table(data, self.notes))
        if log.logged_messages:
            found.append(_logged_messages(log.logged_messages, self))
        if (silent := sum("timestamp" not in data.data for data in log.data_list)) > 0:
            self.notes.append(f"{silent} topic(s) have no timestamp: left out.")
        return {table.topic: table for table in found if len(table)}


def parameters(path: str | Path, budget: Budget | str | None = None) -> dict[str, float | int]:
    """The autopilot's parameters as they were in the end, by name. Raises LogError where the file is no PX4 log."""
    with Path(path).open("rb") as file:
        if not file.read(7) == UlogReader.magic:
            raise LogError(f"{path}: not a PX4 log (.ulg); parameters are read from those")
    return _last_values(_opened(Path(path), Budget.of(budget).account(Path(path), Path(path).stat().st_size)))


def _last_values(log: Any) -> dict[str, float | int]:
    every = {**log.initial_parameters, **{name: value for _, name, value in log.changed_parameters}}
    return {name: v for name, v in every.items() if isinstance(v, int | float) and np.isfinite(v)}  # else damaged


def _opened(path: Path, account: Account) -> Any:
    with needed_for(f"{path}: PX4 .ulg logs", LogError):
        import pyulog
    account.take(path.stat().st_size, "messages")
    with readable(path, "PX4 log"):
        return _counted(pyulog.ULog, account)(str(path))


def _counted(kind: Any, account: Account) -> Any:
    """Pyulog's reader, which asks at every message, and before it lays out fields: formats may hold formats."""

    class Header(kind._MessageHeader):  # type: ignore[misc]
        def initialize(self, data: bytes) -> None:
            account.check_time()
            super().initialize(data)

    class Subscription(kind._MessageAddLogged):  # type: ignore[misc]
        def _parse_format(self, message_formats: Mapping[str, Any]) -> None:
            number, letters = _fields(self.message_name, message_formats, {})
            account.take(LIMITS.ulog_field * number + 2 * letters, f"the {number:,} fields of {self.message_name:.100}")
            account.check_time()
            super()._parse_format(message_formats)

    class Data(kind._MessageData):  # type: ignore[misc]
        def initialize(self, *of_message: Any) -> bool:
            with too_short():
                return bool(super().initialize(*of_message))

    class Log(kind):  # type: ignore[misc]
        _MessageHeader, _MessageAddLogged, _MessageData = Header, _whole(Subscription), Data
        _MessageInfo, _MessageParameterDefault = _whole(kind._MessageInfo), _whole(kind._MessageParameterDefault)
        MessageLogging, MessageLoggingTagged = _whole(kind.MessageLogging), _whole(kind.MessageLoggingTagged)
        MessageDropout = _whole(kind.MessageDropout)

        def _check_packet_corruption(self, header: Any) -> bool:
            """What reaches beyond the end is the last message: pyulog would go back from there for ever."""
            ended = self._file_handle.tell() == account.path.stat().st_size
            return bool(super()._check_packet_corruption(header)) and not ended

    return Log


@contextmanager
def too_short() -> Iterator[None]:
    """Of one message: pyulog takes `struct.error` for the end of the file, and ValueError for damage to go on after."""
    try:
        yield
    except struct.error as error:
        raise ValueError(str(error)) from error


def _whole(kind: Any) -> Any:
    class Whole(kind):  # type: ignore[misc]
        def __init__(self, *of_message: Any, **how: Any) -> None:
            with too_short():
                super().__init__(*of_message, **how)

    return Whole


def _fields(name: str, formats: Mapping[str, Any], known: dict[str, tuple[int, int]]) -> tuple[int, int]:
    """Fields of a format with those of the formats within, and the letters of their names, in which those of the fields
    around them stand again; of a format that contains itself pyulog says what is wrong.
    """  # noqa: D205
    if name not in known:
        known[name] = 0, 0
        for kind, size, field in formats[name].fields if name in formats else ():
            number, letters = _fields(kind, formats, known) if kind in formats else (1, 0)
            all_fields, all_letters = known[name]
            more = max(size, 1) * (letters + number * len(field))
            known[name] = all_fields + max(size, 1) * number, all_letters + more
    return known[name]


def _logged_messages(said: list[Any], reader: UlogReader, most: int = 200) -> Table:
    """What PX4 said in words as a topic `logged_messages`, of `most` bytes each, with the levels as logged."""
    reader.account.take(2 * most * len(said), "logged messages")
    said = [one for one in said if one.timestamp <= LATEST]
    stamps = np.array([one.timestamp for one in said], dtype=np.int64) * 1000
    order = in_order(stamps, "logged_messages", reader.notes, far=np.inf)  # texts come in any order
    texts = np.array([one.message.encode(errors="replace")[:most] for one in said], dtype=f"S{most}")
    columns: Columns = {"log_level": np.array([one.log_level for one in said])[order], "message": texts[order]}
    return Table("logged_messages", "px4_msgs/msg/LogMessage", stamps[order], stamps[order], columns)


def _table(data: Any, notes: list[str]) -> Table:
    name = data.name if not data.multi_id else f"{data.name}/{data.multi_id}"
    known = np.flatnonzero(np.asarray(data.data["timestamp"]) <= LATEST)
    stamps = np.asarray(data.data["timestamp"]).astype(np.int64) * 1000
    order = known[in_order(stamps[known], name, notes)]
    kind = "px4_msgs/msg/" + "".join(word.capitalize() for word in data.name.split("_"))
    columns = {key: values[order] for key, values in _arrays(data.data).items()}
    return Table(name, kind, stamps[order], stamps[order], columns)


def _arrays(fields: Mapping[str, NDArray[Any]]) -> Columns:
    """Fields `q[0]`, `q[1]`, ... as the columns of one array `q`; `esc[0].rpm` as `esc.0.rpm`."""
    grouped: dict[str, list[NDArray[Any]]] = {}
    for name, values in fields.items():
        plain = re.sub(r"\[(\d+)\]\.", r".\1.", name)
        grouped.setdefault(re.sub(r"\[\d+\]$", "", plain), []).append(values)
    several = {re.sub(r"\[\d+\]$", "", name) for name in fields if name.endswith("]")}
    return {name: np.stack(parts, 1) if name in several else parts[0] for name, parts in grouped.items()}

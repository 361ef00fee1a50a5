"""CSV and Parquet tables: one row an instant, one column a number, meaning by the header (`flight.formats.headers`).

The whole table is one topic, `/table`: its columns under their names, series of numbered or xyz columns as one array
(`motor` for motor_1 to motor_4), all numbers together as `data`. What the header tells plays the roles, as `/imu`,
`/odometry`, `/command/actuators` and so on; what it does not tell is mapped by hand, as in
`--topic imu=/table.data[4:10]`.
"""

from __future__ import annotations

import csv
import re
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, NoReturn

import numpy as np

from wrenchgap._escaping import file_word
from wrenchgap.flight.budget import LIMITS, Account
from wrenchgap.flight.errors import LogError
from wrenchgap.flight.extras import needed_for
from wrenchgap.flight.flight import Array, Stamps
from wrenchgap.flight.formats.headers import UNITS, listed, meaning
from wrenchgap.flight.formats.named_columns import tables_of_columns
from wrenchgap.flight.formats.reader import Columns, Selection, Table, TableReader, in_order, one_line

if TYPE_CHECKING:
    import pandas as pd

DELIMITERS = ",;\t|"
SUFFIXES = (".csv", ".tsv", ".txt")
PIECE = 2**24
"""Bytes of a file that are looked at at once."""
STEPS = ((1.0, "s"), (1e3, "ms"), (1e6, "us"))
"""A column of times without a unit whose usual step is below the first number is in the unit."""
EPOCHS = ((1e17, "ns"), (1e14, "us"), (1e11, "ms"))
"""Times above these count from 1970 in the unit."""


@dataclass
class CsvReader(TableReader):
    """Reads a text table with a header line; lines that begin with # or % before it are skipped."""

    name: ClassVar[str] = "CSV table"
    expected: ClassVar[str] = "CSV table (.csv)"
    magic: ClassVar[bytes] = b""

    @classmethod
    def accepts(cls, path: Path, head: bytes) -> bool:
        """Printable text with a delimiter in its first line."""
        text = head.decode("utf-8-sig", errors="ignore")
        if not path.is_file() or not text or not all(c.isprintable() or c in "\r\n\t" for c in text):
            return False
        first = text.splitlines()[0]
        plain = bool(first) and first[0] not in "{[<" and any(d in first for d in DELIMITERS)
        return path.suffix.lower() in SUFFIXES or plain

    def tables(self, selection: Selection) -> dict[str, Table]:
        """The table, and what its header tells."""
        with needed_for(f"{self.path}: CSV tables", LogError):
            import pandas as pd  # here and below: others need not wait for it

        longest, so_far, cells = 0, 0, dict.fromkeys(DELIMITERS, 0)
        with self.path.open("rb") as raw:
            while block := raw.read(PIECE):
                end, *others = block.split(b"\n")
                longest = max(longest, so_far + len(end), *map(len, others))
                so_far = len(others[-1]) if others else so_far + len(end)
                for delimiter in DELIMITERS:
                    cells[delimiter] += block.count(delimiter.encode()) + len(others)
                self.account.check_time()
        self.account.ask(LIMITS.table_letter * longest, f"a line of {longest:,} letters")
        with self.path.open(encoding="utf-8-sig", errors="replace") as file:
            lines = [file.readline() for _ in range(100)]
        skipped = next((i for i, line in enumerate(lines) if line.strip() and line.lstrip()[0] not in "#%"), 0)
        header, first = lines[skipped], next((line for line in lines[skipped + 1 :] if line.strip()), "")
        delimiter = max(DELIMITERS, key=header.count)
        width = header.count(delimiter) + 1
        self.account.take(LIMITS.table_column * width, f"a header of {width:,} columns")
        self.account.take(LIMITS.table_cell * cells[delimiter], "the cells of the table")
        decimal = "," if delimiter != "," and re.search(rf"(^|{re.escape(delimiter)})-?\d+,\d", first) else "."
        if delimiter not in header or all(_is_number(cell) for cell in header.split(delimiter)):
            raise LogError(
                f"{self.path}: no header line; expected the names of the columns in the first line, as in time,gyro_x"
            )
        options: dict[str, Any] = {"sep": delimiter, "encoding": "utf-8-sig", "encoding_errors": "replace"}
        options |= {"skipinitialspace": True, "header": None}  # blackbox_decode writes a space behind each comma
        try:
            (cells_of_header,) = (
                pd.read_csv(self.path, nrows=1, skiprows=skipped, dtype=str, keep_default_na=False, **options)
                .to_numpy()
                .tolist()
            )
            names = [cell or f"Unnamed: {i}" for i, cell in enumerate(cells_of_header)]
            surplus = _surplus(lines[skipped:], delimiter)
            if surplus == 1:  # as R and pandas write names of rows, for which the header has no name
                names = ["row", *names]
            elif surplus:
                raise LogError(f"{self.path}: rows have {surplus} cells more than the header has names")
            options |= {"names": range(len(names)), "index_col": False, "skiprows": skipped + 1}
            with warnings.catch_warnings():  # a delimiter at the end of each line
                warnings.simplefilter("ignore", pd.errors.ParserWarning)
                frame = pd.read_csv(self.path, decimal=decimal, on_bad_lines="skip", low_memory=False, **options)
        except (ValueError, pd.errors.ParserError, OSError) as error:
            raise LogError(f"{self.path}: not a readable CSV table ({one_line(error)})") from error
        frame = frame.set_axis(names, axis="columns")
        with self.path.open("rb") as raw:
            lost = sum(1 for line in raw if line.strip()) - 1 - len(frame) - skipped
        if lost > 0:
            self.notes.append(f"{lost} line(s) of {self.path.name} have more cells than the header: left out.")
        return tables_of(frame, self)


@dataclass
class ParquetReader(TableReader):
    """Reads one Parquet file."""

    name: ClassVar[str] = "Parquet table"
    expected: ClassVar[str] = "Parquet table (.parquet)"
    magic: ClassVar[bytes] = b"PAR1"

    def tables(self, selection: Selection) -> dict[str, Table]:
        """The table, and what its columns' names tell."""
        with needed_for(f"{self.path}: Parquet tables", LogError):
            import pyarrow.parquet

        try:
            metadata = pyarrow.parquet.read_metadata(self.path)
            _count(metadata, self.account)
            texts = [leaf.path for leaf in _leaves(metadata) if leaf.physical_type == "BYTE_ARRAY"]
            with pyarrow.parquet.ParquetFile(self.path, read_dictionary=texts) as file:
                table = file.read(use_threads=False)
            frame = _plain(table, self.account).replace_schema_metadata(None).to_pandas()  # it may say anything
        except (pyarrow.ArrowException, OSError, ValueError) as error:
            raise LogError(f"{self.path}: not a readable Parquet table ({one_line(error)})") from error
        return tables_of(frame.rename(columns={"__index_level_0__": "index"}), self)


class BlackboxReader(TableReader):
    """A log of Betaflight or INAV (`.bbl`, `.bfl`), by its first line: says how to convert it to a table."""

    name: ClassVar[str] = "blackbox log"
    magic: ClassVar[bytes] = b"H Product:Blackbox"

    def tables(self, selection: Selection) -> NoReturn:
        """None: raises LogError."""
        raise LogError(
            f"{self.path}: a blackbox log of Betaflight or INAV; convert it with `blackbox_decode "
            f"{file_word(self.path)}` and give the .csv that it writes"
        )


def _leaves(metadata: Any) -> list[Any]:
    """The columns of a Parquet file as it stores them, of which a column of lists or tables has several."""
    return [metadata.schema.column(i) for i in range(metadata.num_columns)]


def _count(metadata: Any, account: Account) -> None:
    """Ask for a Parquet file's cells and texts before they are unfolded: a run of equal ones is a few bytes in it."""
    leaves, total = _leaves(metadata), 0
    account.take(LIMITS.table_column * len(leaves), f"{len(leaves):,} columns")
    for i in range(metadata.num_row_groups):
        group = metadata.row_group(i)
        account.check_time()
        for j, leaf in enumerate(leaves):
            flat = leaf.max_repetition_level == 0 and "." not in leaf.path
            size = LIMITS.table_cell + leaf.length if flat else LIMITS.table_nested
            texts = 2 * group.column(j).total_uncompressed_size if leaf.physical_type == "BYTE_ARRAY" else 0
            total += size * max(group.column(j).num_values, group.num_rows) + texts
    account.take(total, f"a table of {metadata.num_rows:,} rows and {len(leaves):,} columns")


def _plain(table: Any, account: Account) -> Any:
    """A table whose texts are written out, if there is room: the file holds each of them once, and says where it is."""
    import pyarrow.compute

    for i, one in enumerate(table.schema):
        if pyarrow.types.is_dictionary(one.type):
            column = table.column(i)
            for chunk in column.chunks:
                sizes = pyarrow.compute.binary_length(chunk.dictionary).take(chunk.indices)
                account.take(2 * (pyarrow.compute.sum(sizes).as_py() or 0), f"the texts of column {one.name:.100}")
            try:
                texts = column.cast(pyarrow.large_string())
            except pyarrow.ArrowInvalid:  # bytes that are no text
                texts = pyarrow.nulls(len(column), pyarrow.large_string())
            table = table.set_column(i, one.name, texts)
    return table


def tables_of(frame: pd.DataFrame, reader: TableReader) -> dict[str, Table]:
    """Topics of a table of columns; notes go to the reader. Raises LogError where no column holds times."""
    path, notes = reader.path, reader.notes
    frame = _own_names(frame, reader)
    known = {str(header): meaning(str(header)) for header in frame.columns}
    time = next((header for header, found in known.items() if found is not None and found.field == "time"), None)
    if time is None:
        raise LogError(
            f"{path}: no column of times; columns: {listed(list(known))}. Name one time, t or timestamp, with its unit "
            "as in t_ms or time [us]"
        )
    columns: Columns = {}
    spoilt = 0
    for header in known:
        reader.account.check_time()
        if header != time:
            expanded, count = _numeric(header, frame[header])
            columns |= expanded
            spoilt += count
    if spoilt:
        notes.append(f"{spoilt} cell(s) of {path.name} hold no number: left out.")
    stated = known[time]
    stamps, finite, said = _stamps(frame[time], "" if stated is None else stated.unit, time, reader.account)
    notes.append(said)
    strange = np.flatnonzero(~finite & frame[time].notna().to_numpy())
    if len(strange) > 0.1 * len(finite):  # decimal commas in some rows, say: the others are not the flight
        raise LogError(
            f"{path}: {len(strange)} of {len(finite)} rows have no time: column {time} of row {strange[0] + 1} "
            f"is {str(frame[time].iloc[strange[0]])[:40]!r}, 12.34 or a date was expected; mend or delete these rows"
        )
    if lost := int((~finite).sum()):
        notes.append(f"{lost} row(s) of {path.name} have no time: left out.")
    order = np.flatnonzero(finite)[in_order(stamps[finite], path.name, notes)]
    columns, stamps = {name: values[order] for name, values in columns.items()}, stamps[order]
    if not len(stamps):
        return {}
    made, words = tables_of_columns("/table", columns, stamps, path)
    notes += words
    return made


def _surplus(lines: Sequence[str], delimiter: str) -> int:
    """How many cells all rows have beyond the header, the first line; of one that ends all rows, empty, none."""
    try:
        header, *rows = (row for row in csv.reader(lines, delimiter=delimiter, skipinitialspace=True) if row)
    except csv.Error:  # a cell of endless letters
        return 0
    surplus = min(map(len, rows), default=0) - len(header)
    return max(0, surplus - (surplus > 0 and not any(row[-1].strip() for row in rows)))


def _own_names(frame: pd.DataFrame, reader: TableReader) -> pd.DataFrame:
    """The table with a name of its own for each column: endless ones by their place, others of one name counted."""
    names = [str(header) for header in frame.columns]
    called = {i: f"column_{i}" for i, name in enumerate(names) if len(name) > LIMITS.header_letters}
    if called:
        words = f"have names of more than {LIMITS.header_letters} letters: called {listed(list(called.values()))}."
        reader.notes.append(f"{len(called)} column(s) {words}")
    own = dict[str, int]()
    counts = dict[str, int]()
    for name in (called.get(i, name) for i, name in enumerate(names)):
        unlike = name
        while unlike in own:
            counts[name] = counts.get(name, 0) + 1
            unlike = f"{name}.{counts[name]}"
        own[unlike] = len(own)
    return frame.set_axis([*own], axis="columns")


def _numeric(header: str, column: Any) -> tuple[Columns, int]:
    """A column as numbers, a column of lists as several; and how many cells that are not empty hold none."""
    import pandas as pd

    if column.dtype == object and len(column) and isinstance(column.iloc[0], list | tuple | np.ndarray):
        width = len(column.iloc[0])
        try:
            rows = np.array(column.tolist(), dtype=float).reshape(len(column), width)
        except (TypeError, ValueError):  # words, or lists of several lengths
            return {}, len(column)
        return {f"{header}_{i}": rows[:, i] for i in range(width)}, 0
    if isinstance(column.dtype, np.dtype) and column.dtype.kind in "iuf":
        return {header: column.to_numpy(dtype=float)}, 0
    if pd.api.types.is_datetime64_any_dtype(column):
        return {}, 0
    values = _numbers(column).to_numpy(dtype=float, na_value=np.nan)
    count = int((np.isnan(values) & column.notna().to_numpy()).sum())
    return ({}, 0) if count == len(values) else ({header: values}, count)  # a column of words is none of numbers


def _numbers(column: Any) -> Any:
    """The cells that are numbers, NaN for others; also for whole numbers that no float holds."""
    import pandas as pd

    try:
        return pd.to_numeric(column, errors="coerce")
    except OverflowError:
        return pd.to_numeric(column.astype(str), errors="coerce").replace([np.inf, -np.inf], np.nan)


def _dates(column: Any, account: Account) -> Any:
    """The cells that are dates; of a form that pandas guesses one by one, so many at a time."""
    import pandas as pd
    from pandas.tseries.api import guess_datetime_format

    first = column.dropna().head(1)
    guessed = first.empty or guess_datetime_format(str(first.iloc[0])) is not None
    size = max(len(column), 1) if guessed else LIMITS.table_dates
    found = []
    for start in range(0, max(len(column), 1), size):
        account.check_time()
        found.append(pd.to_datetime(column.iloc[start : start + size], errors="coerce", utc=True))
    return pd.concat(found)


def _stamps(column: Any, unit: str, header: str, account: Account) -> tuple[Stamps, Any, str]:
    """Times [ns], where they are known (N,), and how they were read."""
    import pandas as pd

    numbers = None if pd.api.types.is_datetime64_any_dtype(column) else _numbers(column)
    if numbers is None or numbers.notna().sum() < 0.5 * len(column):
        with warnings.catch_warnings():  # dates in several forms: pandas says that it reads them one by one
            warnings.simplefilter("ignore", UserWarning)
            dates = _dates(column, account)
        first, last = (stamp.tz_localize("UTC") for stamp in (pd.Timestamp.min, pd.Timestamp.max))  # of int64 ns
        dates = dates.where((dates >= first) & (dates <= last)).astype("datetime64[ns, UTC]")
        known = dates.notna().to_numpy()
        stamps = np.where(known, dates.astype("int64").to_numpy(), 0)
        return stamps, known, f"Times are the dates of column {header}."
    values = numbers.to_numpy(dtype=float, na_value=np.nan)
    known = np.isfinite(values)
    words = f"Times are column {header}, in {unit}."
    if not unit:
        unit = _unit_of(values[known])
        words = f"Times are column {header}, which says no unit: by size and step {unit}. To be sure: {header}_{unit}."
    factor = UNITS["time"][unit] * 1e9
    known &= np.abs(np.where(known, values, 0.0)) * factor < 9e18
    if numbers.dtype.kind in "iu" and factor >= 1.0:
        return np.where(known, numbers.to_numpy(dtype=np.int64, na_value=0), 0) * round(factor), known, words
    return np.round(np.where(known, values, 0.0) * factor).astype(np.int64), known, words


def _unit_of(values: Array) -> str:
    """The unit of times that say none, by their size and usual step."""
    for least, unit in EPOCHS:
        if len(values) and np.median(values) > least:
            return unit
    step = float(np.median(np.abs(np.diff(values)))) if len(values) > 1 else 0.0
    return next((unit for limit, unit in STEPS if step < limit), "ns")


def _is_number(cell: str) -> bool:
    try:
        float(cell.strip().strip('"').replace(",", "."))
    except ValueError:
        return not cell.strip()
    return True

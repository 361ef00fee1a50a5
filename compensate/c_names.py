"""What the parts of `compensate.tables` and `compensate.allocation_tables` are called in C, and their sizes."""

from typing import Any, get_args, get_type_hints

from wrenchgap.compensate import allocation_tables, tables
from wrenchgap.compensate.c_expressions import INT, REAL, Type

CONSTANT = {
    "Compensation": "",
    "Gate": "",
    "ReachTable": "reach_",
    "Process": "process_",
    "Observer": "observer_",
    "AllocationTable": "",
}
"""Tuples whose parts are tables and macros, with what stands before their names."""
MAYBE_NONE = ("WG_POINTS", "WG_WHITENER", "WG_TILTING", "WG_ACTUATORS", "WG_FIXED")
"""Sizes that may be zero, where C has no array."""


def type_of(hint: Any) -> Type:
    """The type of an annotation of `tables`, or of an argument."""
    if hint in (int, bool):
        return INT
    if hint is float:
        return REAL
    if hasattr(hint, "_fields"):
        return Type(hint.__name__)
    sizes = [str(size) for size in getattr(hint, "__metadata__", ("?",)) if size != "int"]
    whole = get_args(hint)[:1] == (tables.Ints,) or "int" in getattr(hint, "__metadata__", ())
    return Type("int" if whole else "wg_real", tuple(sizes))


def fields_of(name: str) -> dict[str, Type]:
    """Fields of a tuple with their types."""
    owner = tables if hasattr(tables, name) else allocation_tables
    hints = get_type_hints(getattr(owner, name), include_extras=True)
    return {field: type_of(hint) for field, hint in hints.items()}


def bounds(sizes: tuple[str, ...]) -> str:
    """The brackets of a declaration."""
    return "".join(f"[WG_SIZE({size})]" if size in MAYBE_NONE else f"[{size}]" for size in sizes)


def name_of_constant(owner: str, part: str, kind: Type) -> str:
    """What a part of a tuple of constants is called in C."""
    name = CONSTANT[owner] + part
    return f"wg_{name}" if kind.sizes else f"WG_{name.upper()}"

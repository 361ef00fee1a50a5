"""Effects that are not tried, and why: in sentences."""

from __future__ import annotations

from collections.abc import Sequence

from wrenchgap.learn.data.candidates import Lack, Untried


def not_tried(untried: Sequence[Untried]) -> dict[str, list[str]]:
    """Effects that these logs or this model do not allow, by reason."""
    by_reason: dict[str, list[str]] = {}
    for one in untried:
        by_reason.setdefault(reason(one), []).append(one.effect)
    return by_reason


def reason(one: Untried) -> str:
    """Why an effect is not tried, without its name."""
    return f"could not be fitted ({one.detail})" if one.lack is Lack.FIT else one.reason

"""The tables of docs/scale.md."""

from pathlib import Path

RESULTS = Path(__file__).parent / "results" / "runs.jsonl"


def renew() -> None:
    """Later."""

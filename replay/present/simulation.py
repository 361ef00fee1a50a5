"""How a simulated flight went, for the terminal and as JSON."""

from dataclasses import asdict
from pathlib import Path
from typing import Any

from wrenchgap.flight.flight import Flight
from wrenchgap.plant.simulation.flight_plan import Plan, Summary, provenance


def line(log: Path, plan: Plan, summary: Summary) -> str:
    """One line for the terminal."""
    return (
        f"{log.name}: {plan.trajectory}, {summary.duration_s:.1f} s, largest tilt {summary.tilt_max_deg:.1f} deg, "
        f"position error {1e3 * summary.position_error_rms_m:.1f} mm rms, "
        f"attitude error {summary.attitude_error_rms_deg:.2f} deg rms"
    )


def to_json(log: Path, plan: Plan, flown: Flight, summary: Summary) -> dict[str, Any]:
    """The body of the JSON."""
    return {"log": str(log), **provenance(plan), **asdict(summary), "notes": list(flown.notes)}

"""What a flight is and how it is read and written; no physics of vehicles."""

from flight.errors import FitError, LogError, ModelError, UsageError, WrenchgapError
from flight.flight import (
    AXES,
    ROLES,
    ActuatorSeries,
    BatterySeries,
    Flight,
    Gap,
    ImuSeries,
    OdometrySeries,
    ReferenceSeries,
    Samples,
    Series,
    WrenchSeries,
)
from flight.load import load

__all__ = [
    "AXES",
    "ROLES",
    "ActuatorSeries",
    "BatterySeries",
    "FitError",
    "Flight",
    "Gap",
    "ImuSeries",
    "LogError",
    "ModelError",
    "OdometrySeries",
    "ReferenceSeries",
    "Samples",
    "Series",
    "UsageError",
    "WrenchSeries",
    "WrenchgapError",
    "load",
]

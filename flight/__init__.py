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
from flight.inspection import Inspection, inspect
from flight.load import load
from flight.resample import Resampling, resample, uniform
from flight.shift import shifted
from flight.write import Named, write

__all__ = [
    "AXES",
    "ROLES",
    "ActuatorSeries",
    "BatterySeries",
    "FitError",
    "Flight",
    "Gap",
    "ImuSeries",
    "Inspection",
    "LogError",
    "ModelError",
    "Named",
    "OdometrySeries",
    "ReferenceSeries",
    "Resampling",
    "Samples",
    "Series",
    "UsageError",
    "WrenchSeries",
    "WrenchgapError",
    "inspect",
    "load",
    "resample",
    "shifted",
    "uniform",
    "write",
]

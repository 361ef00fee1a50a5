"""What a flight is and how it is read and written; no physics of vehicles."""

from wrenchgap.flight.command_units import in_si
from wrenchgap.flight.errors import FitError, LogError, ModelError, UsageError, WrenchgapError
from wrenchgap.flight.flight import (
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
from wrenchgap.flight.inspection import Inspection, inspect
from wrenchgap.flight.load import load
from wrenchgap.flight.resample import Resampling, resample, uniform
from wrenchgap.flight.topic_offsets import shifted
from wrenchgap.flight.unmeasured import unmeasured_axes, without_axes
from wrenchgap.flight.write import Named, write

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
    "in_si",
    "inspect",
    "load",
    "resample",
    "shifted",
    "uniform",
    "unmeasured_axes",
    "without_axes",
    "write",
]

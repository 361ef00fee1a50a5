"""A recorded flight, re-simulated: the control law, what the recording adds to it, and the plant with its disturbance.

    W_des = law(state, reference) + e(t)  ->  compensator  ->  W_cmd  ->  allocation + a(t)  ->  plant + d(t)

with d, e and a of `learn.identify.disturbance`. The reference is the recorded one, feedback is on the re-simulated
state.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from wrenchgap.flight.flight import Array, Flight
from wrenchgap.learn.data.candidates import check_effects
from wrenchgap.learn.data.recording import Recording
from wrenchgap.learn.identify.disturbance import Inference
from wrenchgap.plant import Model, Vehicle
from wrenchgap.plant.controller import ControllerGains
from wrenchgap.plant.simulation.closed_loop import (
    LoopFlight,
    disturbance_stage,
    fly,
    loss_of_control,
    loss_of_control_stage,
)
from wrenchgap.plant.simulation.flight_computer import Compensating, Correction, FlightComputer
from wrenchgap.plant.simulation.simulate import as_flight
from wrenchgap.plant.simulation.tracking import Deviation, Tracking, TrackingErrors, deviation, tracking_errors


@dataclass(frozen=True)
class Reflight:
    """A re-simulated flight: `flown` (K periods), the desired wrench (K, 6), the compensator's steps, what flew."""

    recording: Recording
    flown: LoopFlight
    desired: Array
    steps: tuple[Correction, ...]
    model: Model

    @property
    def commanded(self) -> Array:
        """W_cmd (K, 6)."""
        return self.flown.commands.wrench_B

    @property
    def tracking_errors(self) -> TrackingErrors:
        """Errors against the recorded reference."""
        state, r = self.flown.state, self.recording
        rows = slice(r.first, r.first + len(state.time))
        return tracking_errors(state.time, state.position_E, state.quat_EB, r.reference.take(rows))

    @property
    def tracking(self) -> Tracking:
        """How well it follows the recorded reference."""
        return Tracking.of(self.tracking_errors)

    @property
    def deviation(self) -> Deviation:
        """How far it is from the recorded odometry."""
        return deviation(self.flown.state, self.recording.odometry, self.recording.dt)

    @property
    def log(self) -> Flight:
        """The re-flight as a log: ideal sensors, the recorded reference, times and start of the recorded flight."""
        r, lost = self.recording, self.flown.lost
        return as_flight(
            f"{r.flight.name} again",
            self.flown,
            self.model,
            self.desired,
            r.reference.take(r.window),
            start_ns=r.flight.start_ns,
            path=r.flight.path,
            notes=() if lost is None else (f"{lost}; the flight ends there",),
        )


def refly(
    inference: Inference,
    plant: Model | None = None,
    *,
    gains: ControllerGains | None = None,
    believed: Vehicle | None = None,
    compensator: Compensating | None = None,
    progress: Callable[[float], None] | None = None,
    compiled: bool = True,
) -> Reflight:
    """Re-simulate the recorded flight; with nothing but the inference this is the null run.

    plant        what flies, with the inferred disturbance; the model of the inference by default
    gains        of the control law; the model's by default
    believed     vehicle that controller and allocation assume; the model's by default
    compensator  in the loop instead of the recorded correction
    compiled     False calls everything in numpy, as is done anyhow with effects of the plant that cannot be compiled

    Raises FitError where an effect of the plant needs what the log lacks.
    """
    r, known = inference.recording, inference.model
    model = known if plant is None else plant
    check_effects(model.effects, model, [r.record])
    reference = r.reference.take(r.window)
    computer = FlightComputer(
        known.controller if gains is None else gains,
        known.vehicle if believed is None else believed,
        reference,
        r.clock,
        compensator=compensator,
        recorded=inference.pilot,
    )
    forgiven = loss_of_control(r.motion.state.take(r.window), reference)[0] > 0.0
    flown, loop = fly(
        model.wrench_model,
        r.start,
        r.clock,
        [
            loss_of_control_stage(reference, r.clock, forgiven),
            *computer.stages,
            disturbance_stage(inference.disturbance),
        ],
        computer.signals,
        memory=inference.memory,
        compiled=compiled,
        progress=progress,
    )
    desired = loop.logged("law", "desired", len(flown.commands.wrench_B))
    return Reflight(r, flown, desired, tuple(computer.steps), model)

"""Sliders on the parameters of a model's effects, in units that a hand can set: millimetres, milliseconds, degrees."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np

from wrenchgap.plant.effects.effect import Parameter
from wrenchgap.plant.wrench_model import ModelEffect
from wrenchgap.viewer.host import Host
from wrenchgap.viewer.scene_drawing import tidy

FINER: dict[str, tuple[str, float]] = {
    "m": ("mm", 1e3),
    "s": ("ms", 1e3),
    "kg": ("g", 1e3),
    "rad": ("deg", float(np.degrees(1.0))),
    "Nm": ("mNm", 1e3),
    "N": ("mN", 1e3),
    "kg m^2": ("g m^2", 1e3),
}


class EffectSliders:
    """One folder an effect: a slider a parameter and a button that takes the effect out.

    `on_set(effect, parameter, value)` and `on_remove(effect)` are called under the page's lock. While a slider is
    dragged its values come faster than they can be evaluated: only the newest counts.
    """

    def __init__(self, host: Host, on_set: Callable[[str, str, float], None], on_remove: Callable[[str], None]) -> None:
        self.host, self.on_set, self.on_remove = host, on_set, on_remove
        self.place = host.gui.add_folder(None)
        self._folders: dict[str, Any] = {}
        self.handles: dict[tuple[str, str], tuple[Any, float]] = {}
        """Sliders by effect and parameter, and the factor from SI to what they show."""
        self._wanted: dict[tuple[str, str], float] = {}

    def show(self, installed: Sequence[ModelEffect]) -> None:
        """Show these effects; what is there already only moves."""
        names = {i.name for i in installed}
        for name in [n for n in self._folders if n not in names]:
            self._folders.pop(name).remove()
            self.handles = {key: h for key, h in self.handles.items() if key[0] != name}
        for item in installed:
            if item.name not in self._folders:
                self._make(item)
            for parameter, value in self._values(item):
                handle, factor = self.handles[item.name, parameter.name]
                shown = _on(handle.step, factor * value, handle.min, handle.max)
                if abs(handle.value - shown) > 0.5 * handle.step:
                    handle.value = shown

    def _values(self, item: ModelEffect) -> list[tuple[Parameter, float]]:
        parameters = item.effect.parameters(self.host.session.vehicle)
        return [(p, float(value)) for p, value in zip(parameters, item.theta, strict=True)]

    def _make(self, item: ModelEffect) -> None:
        gui, values = self.host.gui, self._values(item)
        with self.place:
            folder = self._folders[item.name] = gui.add_folder(item.name, expand_by_default=len(values) <= 6)
        with folder:
            for parameter, value in values:
                self._slider(item.name, parameter, value)
            remove = gui.add_button(f"Remove {item.name}", color="gray")
            remove.on_click(self.host.guarded(lambda _: self.on_remove(item.name)))

    def _slider(self, effect: str, parameter: Parameter, value: float, reach: float = 4.0) -> None:
        """About 400 steps, over `reach` typical sizes on either side of zero and of the value, where plausible."""
        unit, factor = finer(parameter)
        low = factor * max(parameter.low, min(0.0, value) - reach * parameter.scale)
        high = factor * min(parameter.high, max(0.0, value) + reach * parameter.scale)
        step = tidy((high - low) / 400)
        low, high = step * np.ceil(low / step - 1e-9), step * np.floor(high / step + 1e-9)
        label = parameter.name if unit == "1" else f"{parameter.name} [{unit}]"
        shown = _on(step, factor * value, float(low), float(high))
        handle = self.host.gui.add_slider(label, float(low), float(high), step, shown)
        handle.on_update(partial(self._moved, effect, parameter.name))
        self.handles[effect, parameter.name] = handle, factor

    def _moved(self, effect: str, parameter: str, event: Any) -> None:
        """A client moved a slider; when the page did, the model is there already."""
        if event.client_id is None:
            return
        found = self.handles.get((effect, parameter))
        if found is None:  # removed meanwhile
            return
        handle, factor = found
        self._wanted[effect, parameter] = float(handle.value) / factor
        self.host.guarded(lambda _: self._apply(effect, parameter))(event)

    def _apply(self, effect: str, parameter: str) -> None:
        value = self._wanted.pop((effect, parameter), None)
        if value is not None:  # else a later call has seen to it
            self.on_set(effect, parameter, value)


def finer(parameter: Parameter) -> tuple[str, float]:
    """The unit in which a parameter is shown, and the factor from SI to it; finer for angles and small sizes."""
    if parameter.unit == "rad" or parameter.scale < 0.5:
        return FINER.get(parameter.unit, (parameter.unit, 1.0))
    return parameter.unit, 1.0


def _on(step: float, value: float, low: float, high: float) -> float:
    """The place of a slider that is nearest to a value."""
    return float(np.clip(step * round(value / step), low, high))

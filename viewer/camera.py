"""Cameras of the clients. Each client has its own; the page places it only on request."""

from __future__ import annotations

from typing import Any

import numpy as np

from wrenchgap.flight.flight import Array

DIRECTIONS: dict[str, tuple[float, float, float]] = {
    "oblique": (-3.5, -4.0, 2.5),
    "top": (-0.001, 0.0, 6.6),
    "side": (0.0, -6.6, 0.4),
    "front": (6.6, 0.0, 0.4),
}
"""From what is looked at to the camera, in sizes of the vehicle (of the path, for the whole of it)."""


class Cameras:
    """Places the cameras of all present and later clients around a vehicle of `size` [m].

    `fov` is their vertical field of view [rad], narrower than viser's, so that frames are not distorted.
    """

    def __init__(self, server: Any, size: float, fov: float = 0.75) -> None:
        self._server, self._size, self._fov = server, size, fov
        server.initial_camera.fov = fov
        server.initial_camera.near = 0.02 * size

    def look(self, direction: str, focus: Array, extent: float | None = None, clients: Any = None) -> None:
        """Look at `focus` (3,) from one of `DIRECTIONS`, from so far away that `extent` [m] (the vehicle) is seen."""
        size = extent or self._size
        self.place(focus + size * np.array(DIRECTIONS[direction]), focus, clients)

    def place(self, position: Array, look_at: Array, clients: Any = None) -> None:
        """Put the cameras at `position` (3,), looking at `look_at` (3,); of `clients`, or of everybody."""
        initial = self._server.initial_camera
        initial.position, initial.look_at = position, look_at
        for client in self._server.get_clients().values() if clients is None else clients:
            with client.atomic():
                client.camera.position = position
                client.camera.look_at = look_at
                client.camera.fov = self._fov

    def shift(self, by: Array) -> None:
        """Move all cameras by `by` (3,) [m], as they look."""
        initial = self._server.initial_camera
        initial.position, initial.look_at = initial.position + by, initial.look_at + by
        for client in self._server.get_clients().values():
            client.camera.position = client.camera.position + by  # takes what it looks at along

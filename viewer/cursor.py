"""The cursor of the page: an instant on the flight's clock, which advances while the flight plays."""

import threading
import time as clock
from collections.abc import Callable
from typing import Any

import numpy as np

from wrenchgap.flight.flight import Array


class Cursor:
    """An instant of a flight; functions in `listeners` are called when it moves.

    time [s]            the instant, always within the flight
    playing             whether it moves by itself, `speed` seconds of flight per second
    loop                (start, stop) [s] that playing repeats, None for the whole flight
    rate                updates per second while playing [Hz]
    """

    def __init__(self, lock: Any, rate: float = 30.0) -> None:
        self._lock, self._rate = lock, rate
        self._clock: Array = np.zeros(1)
        self.time = 0.0
        self.speed = 1.0
        self.loop: tuple[float, float] | None = None
        self.listeners: list[Callable[[float], None]] = []
        self._playing, self._over = threading.Event(), threading.Event()
        self._player: threading.Thread | None = None

    @property
    def start(self) -> float:
        """First instant of the flight [s]."""
        return float(self._clock[0])

    @property
    def stop(self) -> float:
        """Last instant of the flight [s]."""
        return float(self._clock[-1])

    @property
    def index(self) -> int:
        """Index of the last instant of the flight that is not after the cursor."""
        return max(int(np.searchsorted(self._clock, self.time + 1e-9, side="right")) - 1, 0)

    @property
    def playing(self) -> bool:
        """Whether the flight plays."""
        return self._playing.is_set()

    @playing.setter
    def playing(self, on: bool) -> None:
        (self._playing.set if on else self._playing.clear)()

    def open(self, time: Array) -> None:
        """Take the clock (K,) [s] of another flight and go to its start, without calling listeners."""
        with self._lock:
            self._clock, self.loop, self.playing = time, None, False
            self.time = self.start

    def go(self, time: float) -> None:
        """Move to `time` [s], within the flight, and call listeners. A nan has no effect."""
        if not np.isfinite(time):
            return
        with self._lock:
            self.time = float(np.clip(time, self.start, self.stop))
            for listener in self.listeners:
                listener(self.time)

    def step(self, instants: int) -> None:
        """Move by whole instants of the flight, forwards or back."""
        with self._lock:
            self.go(float(self._clock[np.clip(self.index + instants, 0, len(self._clock) - 1)]))

    def run(self) -> None:
        """Start the thread that plays."""
        self._player = threading.Thread(target=self._play, name="playback", daemon=True)
        self._player.start()

    def close(self) -> None:
        """End the thread that plays."""
        self._over.set()
        self._playing.set()
        if self._player is not None:
            self._player.join(timeout=2.0)

    def advance(self, seconds: float) -> None:
        """Advance as playing for `seconds` does; from the end of loop or flight it continues at the start."""
        with self._lock:
            start, stop = self.loop or (self.start, self.stop)
            ahead = self.time + self.speed * seconds
            self.go(ahead if start <= ahead <= stop else start)

    def _play(self) -> None:
        """Advance by the time that passed, so that a slow machine shows fewer frames and not a slower flight."""
        last = clock.monotonic()
        while True:
            if not self._playing.is_set():
                self._playing.wait()
                last = clock.monotonic()
            if self._over.is_set():
                return
            due = last + 1.0 / self._rate
            self._over.wait(max(due - clock.monotonic(), 0.001))
            now = clock.monotonic()
            if self._playing.is_set() and not self._over.is_set():
                self.advance(min(now - last, 0.25))
            last = now

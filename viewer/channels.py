"""Any channel of the log as a plot: a tab in which channels are found by name, added and removed."""

from collections.abc import Mapping
from dataclasses import replace

from wrenchgap.flight.errors import UsageError
from wrenchgap.flight.flight import Array
from wrenchgap.viewer.host import Host
from wrenchgap.viewer.panel import Part
from wrenchgap.viewer.plot_board import Board
from wrenchgap.viewer.plots import CHANNELS, Plot, channel_plot
from wrenchgap.viewer.session import ReadChannels, Scene
from wrenchgap.viewer.view_state import MOST_CHANNELS, ViewState

NONE = "(no channel of that name)"


class ChannelPicker(Part):
    """The names of the plotted channels, which stay when the flight changes; channels are read on first use."""

    def __init__(self, host: Host, board: Board, read: ReadChannels | None) -> None:
        super().__init__(host)
        self._read_all = read
        self.names: tuple[str, ...] = ()
        self._read: dict[str, Mapping[str, tuple[Array, Array]]] = {}
        self._reading: set[str] = set()
        gui, connect = host.gui, host.connect
        with board.tab(CHANNELS):
            self.list = connect(gui.add_button("List the channels of the log"), lambda _: self.read())
            self.filter = gui.add_text("filter", "", visible=False, hint="part of a name")
            connect(self.filter, lambda _: self._offer())
            self.choice = gui.add_dropdown("channel", (NONE,), visible=False)
            self.action = gui.add_button_group("plot", ("add", "remove", "remove all"), visible=False)
            connect(self.action, lambda _: self._act(self.action.value))

    def opened(self, scene: Scene) -> None:
        """Another flight is shown: read its channels if some are plotted."""
        if self.names:
            self.read()
        self._offer()

    def plots(self) -> list[Plot]:
        """Plots of the chosen channels that this log has and that have been read."""
        known = self._known()
        return [channel_plot(name, known[name]) for name in self.names if name in known]

    def viewed(self, view: ViewState) -> None:
        """Plot the channels of the view."""
        if view.channels != self.names:
            self.names = view.channels
            self.opened(self.host.scene)
            self.host.replot()

    def read(self) -> None:
        """Read all channels of the flight in the background, once."""
        flight, read = self.host.scene.name, self._read_all
        if flight in self._read or flight in self._reading:
            self._offer()
            return
        if read is None:
            self.host.notify("This session has no log to look channels up in.", "warning")
            return
        self._reading.add(flight)
        self.list.label, self.list.disabled = "reading the log ...", True

        def done(found: Mapping[str, tuple[Array, Array]]) -> None:
            self._read = {flight: found}  # of one flight only: a long log has a hundred megabytes of channels
            self._ready(flight)
            self.host.replot()

        def failed(error: Exception) -> None:
            self._ready(flight)
            self.host.fail(error)

        self.host.background(lambda report: read(flight), lambda share, words: None, done, failed)

    def _ready(self, flight: str) -> None:
        self._reading.discard(flight)
        self.list.label, self.list.disabled = "List the channels of the log", False
        self._offer()

    def _known(self) -> Mapping[str, tuple[Array, Array]]:
        return self._read.get(self.host.scene.name, {})

    def _offer(self) -> None:
        known, wanted = self._known(), self.filter.value.strip().lower()
        found = [name for name in known if wanted in name.lower()][:400]  # the filter finds the others
        self.choice.options = found or (NONE,)
        for handle in (self.filter, self.choice, self.action):
            handle.visible = bool(known)
        self.list.visible = not known and not self.host.scene.is_empty

    def _act(self, what: str) -> None:
        name, names = self.choice.value, self.names
        if what == "add" and len(names) >= MOST_CHANNELS:
            raise UsageError(f"{MOST_CHANNELS} channels are plotted already; remove one first")
        if what == "add" and name not in names and name != NONE:
            names = (*names, name)
        elif what == "remove":
            names = tuple(n for n in names if n != name)
        elif what == "remove all":
            names = ()
        self.host.show(replace(self.host.view, channels=names))

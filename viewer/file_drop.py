"""A place on the page to drop files on: they go to the disk piece by piece as they arrive, whatever their size.

viser keeps an upload in memory, at its end twice; a log may have a gigabyte. The inbox gives the pieces of an upload to
the drop that its button belongs to (`viewer.inbox`), and viser never has them. A browser puts a file that is dropped on
an input for files into it by itself; viser's is hidden, and the style sheet shows it, so that no script is needed.
"""

import re
import tempfile
import threading
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import IO, Any, ClassVar

from wrenchgap.flight.errors import UsageError
from wrenchgap.viewer import markup
from wrenchgap.viewer.host import Host
from wrenchgap.viewer.serving import acknowledge

NAME = re.compile(r"(?!\.)[\w .()+=,@-]{1,200}")
"""What a file may be called: no way out of the folder, nothing hidden."""
LONGEST_NAME = 255
"""Bytes of a name on most file systems."""


class FileDrop:
    """Files that are dropped here, or chosen, are put into new folders below `folder`, and `received` gets their path.

    `received` is called under the page's lock; a file for which it raises an error goes. One file arrives at a time:
    another one ends it, and so does `end`; until `received` has the last one no other begins.
    `largest` and `most` are bytes of one file, and of all that are kept.
    """

    largest: ClassVar[int] = 2**30
    most: ClassVar[int] = 2**32

    def __init__(self, host: Host, words: str, folder: Path, received: Callable[[Path], None]) -> None:
        self.host, self._folder, self._received = host, folder, received
        host.gui.add_html(markup.render("drop", words=words))
        self.button: Any = host.gui.add_upload_button("Choose a file")
        self._words: Any = host.gui.add_html("")
        self._uuid = str(self.button._impl.uuid)  # viser has no public way to the id of an element
        host.drops[self._uuid] = self
        self._transfer, self._size, self._done, self._path = "", 0, 0, folder
        self._file: IO[bytes] | None = None
        self._closed = False
        self._handing = threading.Thread()
        self._lock = threading.RLock()  # pieces come by the thread of the connections, `end` by any other

    def start(self, transfer: str, name: str, size: int) -> None:
        """A file of this name and size [bytes] begins to arrive; called by the inbox, of any client."""
        with self._lock:
            if self._closed:
                return
            self.end()
            self._transfer, self._size, self._done = transfer, size, 0
            try:
                self._check(name, size)
                self._path = Path(tempfile.mkdtemp(dir=self._folder)) / name
                self._file = self._path.open("xb")
            except (UsageError, OSError) as error:
                self._refuse(error)
            else:
                self._written(b"")

    def part(self, transfer: str, content: bytes) -> None:
        """The next piece of it; those of a file that was refused, or ended by another, are dropped."""
        with self._lock:
            if transfer == self._transfer and self._file is not None:
                self._written(content)

    def end(self) -> None:
        """The page changes, or another file comes: what has come of one that is on its way goes, and that is said."""
        with self._lock:
            if self._file is not None:
                words = "did not come whole before the page changed, or before another file; drop it again"
                self._refuse(UsageError(f"{self._path.name}: {words}"))

    def close(self) -> None:
        """End for good, before the page takes its controls away; a client may still send a file to it."""
        with self._lock:
            self.end()
            self._closed = True

    def _written(self, content: bytes) -> None:
        assert self._file is not None
        try:
            if self._done + len(content) > self._size:
                raise UsageError(f"{self._path.name}: is longer than the browser said; drop it again")
            self._file.write(content)
            self._done += len(content)
            if self._done == self._size:
                self._file.close()
                self._file = None
        except (UsageError, OSError) as error:
            self._refuse(error)
            return
        acknowledge(self.host.server, self._uuid, self._transfer, self._done, self._size)
        part = 20 * self._done // max(self._size, 1) * 5
        said = "" if self._done == self._size else markup.sentences(f"{self._path.name}: {part} % is here")
        if self._words.content != said:
            self._words.content = said
        if self._done == self._size:
            self._handing = threading.Thread(target=self._hand_over, args=(self._path,))
            self._handing.start()

    def _hand_over(self, path: Path) -> None:
        """Give a file to whoever waits for it, once the page has time."""
        try:
            with self.host.lock, self.host.server.atomic():
                if self._closed:
                    raise UsageError(f"{path.name}: came while the page changed; drop it again")
                self._received(path)
        except Exception as error:  # the boundary between the page and whatever a user may do
            discard(path)
            self.host.fail(error)

    def _check(self, name: str, size: int) -> None:
        if self._handing.is_alive():
            raise UsageError(f"{name}: the page has not taken the last file yet; drop {name} again in a moment")
        if NAME.fullmatch(name) is None or len(name.encode()) > LONGEST_NAME:
            raise UsageError(
                "a file whose name is no plain one was dropped; give it letters, digits and ._- and drop it again"
            )
        if size > self.largest:
            raise UsageError(
                f"{name}: {size / 2**30:.1f} GiB, of which the page takes {self.largest / 2**30:g}; start it with the "
                "log, `wrenchgap view LOG`"
            )
        kept = sum(file.stat().st_size for file in self._folder.rglob("*") if file.is_file())
        if kept + size > self.most:
            raise UsageError(f"{name}: more than {self.most / 2**30:g} GiB would be kept; start the page again")

    def _refuse(self, error: Exception) -> None:
        """Say why, and let the browser see the end of it, so that another file can be dropped."""
        acknowledge(self.host.server, self._uuid, self._transfer, self._size, self._size)
        self._words.content = ""
        self._forget()
        said = error if isinstance(error, UsageError) else UsageError(f"the file cannot be kept: {error}")
        self.host.fail(said)

    def _forget(self) -> None:
        """Remove what arrived of a file that does not arrive any more."""
        if self._file is not None:
            with suppress(OSError):  # of a disk that is full
                self._file.close()
            discard(self._path)
        self._transfer, self._file = "", None


def discard(path: Path) -> None:
    """Remove a file that was dropped, and the folder that it has for itself."""
    with suppress(OSError):
        path.unlink(missing_ok=True)
        path.parent.rmdir()

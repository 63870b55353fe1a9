"""A file as HDF5 sees it: one that always takes what it is given.

HDF5 ends the process, or leaves a file that nothing opens, when the disk refuses while it arranges things. So it is not told.
What the disk refuses is kept in memory in its order, and tried again; until then the file is as it was before, which is as if
the run had been killed there.
"""

from __future__ import annotations

import io
from io import FileIO

from explicitfe.platform.host import files


class DiskFile:
    """An open file for h5py's "fileobj" driver.

    Parameters
    ----------
    number : of a file that is open for reading and writing; it is closed with this.
    """

    def __init__(self, number: int) -> None:
        self._file = FileIO(number, "r+b")
        self._place = 0
        self._end = self._file.seek(0, io.SEEK_END)  # with what is kept
        self._kept: list[tuple[int, bytes | None]] = []  # (place, data), or (length, None) for a truncation
        self._refusal: OSError | KeyboardInterrupt | None = None

    def settle(self) -> None:
        """Write what the disk has refused so far.

        Raises
        ------
        OSError : it still does; nothing is lost as long as the process lives.
        KeyboardInterrupt : Ctrl-C has come while HDF5 was writing.
        """
        while self._kept:
            self._change(*self._kept[0])
            del self._kept[0]
        refusal, self._refusal = self._refusal, None
        if isinstance(refusal, KeyboardInterrupt):
            raise refusal

    def reserve(self, size: int) -> None:
        """Have room for ``size`` bytes more, all or nothing; OSError if the disk has none."""
        if self._refusal is not None:
            raise self._refusal
        files.reserve(self._file.fileno(), size)
        self._end = self._file.seek(0, io.SEEK_END)

    def close(self) -> None:
        """Close the file; what the disk has refused is lost with this."""
        self._kept = []
        self._file.close()

    def fileno(self) -> int:
        """The number of the open file."""
        return self._file.fileno()

    # ---- what h5py asks a file for ----

    def seek(self, place: int, whence: int = io.SEEK_SET) -> int:
        """Go to a place."""
        self._place = place + {io.SEEK_SET: 0, io.SEEK_CUR: self._place, io.SEEK_END: self._end}[whence]
        return self._place

    def tell(self) -> int:
        """Where the next byte goes."""
        return self._place

    def read(self, size: int = -1) -> bytes:
        """Some bytes from here on."""
        data = bytearray(self._end - self._place if size < 0 else size)
        return bytes(data[: self.readinto(data)])

    def readinto(self, buffer: bytearray | memoryview) -> int:
        """Fill a buffer from here on, with what is kept where that is newer."""
        view = memoryview(buffer).cast("B")
        start, size = self._place, max(0, min(len(view), self._end - self._place))
        self._file.seek(start)
        got = 0
        while got < size:
            count = self._file.readinto(view[got:size])
            if not count:
                view[got:size] = bytes(size - got)
                break
            got += count
        for place, data in self._kept:
            if data is None:
                cut = max(0, min(size, place - start))
                view[cut:size] = bytes(size - cut)
                continue
            first, last = max(start, place), min(start + size, place + len(data))
            if first < last:
                view[first - start : last - start] = data[first - place : last - place]
        self._place += size
        return size

    def write(self, data: bytes | memoryview) -> int:
        """Write bytes here, now or later."""
        view = memoryview(data).cast("B")
        self._make(self._place, view)
        self._place += len(view)
        self._end = max(self._end, self._place)
        return len(view)

    def truncate(self, size: int | None = None) -> int:
        """Shorten or lengthen the file, now or later."""
        size = self._place if size is None else size
        if size != self._end:
            self._make(size, None)
            self._end = size
        return size

    def flush(self) -> None:
        """Nothing waits here."""

    # ---- inside ----

    def _make(self, place: int, data: memoryview | None) -> None:
        """Make a change, or keep it for later behind those that are kept already."""
        if self._refusal is None:
            try:
                self._change(place, data)
            except (OSError, KeyboardInterrupt) as error:  # HDF5 bears neither
                self._refusal = error
            else:
                return
        self._kept.append((place, None if data is None else bytes(data)))

    def _change(self, place: int, data: memoryview | bytes | None) -> None:
        if data is None:
            self._file.truncate(place)
            return
        self._file.seek(place)
        view = memoryview(data)
        while view:
            view = view[self._file.write(view) :]

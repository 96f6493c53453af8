"""Edge: receiver of a live face, ``/fap/1/frame`` on a UDP port, for a window."""

import socket
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fapengine.errors import DataError, ResourceError
from fapengine.files.profiles import load_profile
from fapengine.mpeg4 import fap
from fapengine.speaking import DEFAULT_PROFILE
from fapengine.trajectory.high_level import HighLevelFaps
from fapengine.wire import osc
from fapengine.wire.fap_osc import FRAME, FapFrame, parse_frame

Faps = NDArray[np.int32]

MAX_DATAGRAM_BYTES = 65_535
SILENT_S = 2.0
"""Time without a frame after which a port is silent."""


@dataclass(slots=True)
class ViewerCounts:
    """Counts of received frames.

    Stateful.
    """

    frames: int = 0
    missed: int = 0
    """Frame numbers that did not arrive."""
    refused: int = 0
    """Messages of another kind."""


class OscViewer:
    """Receiver of ``/fap/1/frame`` on a UDP port. Close it.

    Stateful. Raises ResourceError if the port is taken.

    Parameters
    ----------
    host, port : str, int
        Address to listen on.
    session : str, optional
        Session of the frames; by default that of the first frame.
    clock : callable
        The monotonic clock.
    """

    def __init__(
        self, host: str, port: int, *, session: str | None = None, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self.session = session
        self.counts = ViewerCounts()
        self._clock, self._heard_s = clock, -np.inf
        self._frame: FapFrame | None = None
        self._values = np.zeros(fap.FAP_COUNT, np.int32)
        self._high_level: HighLevelFaps | None = None
        try:
            family, kind, _, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
            with ExitStack() as failed:
                self._socket = failed.enter_context(socket.socket(family, kind))
                self._socket.bind(address)
                failed.pop_all()
        except OSError as error:
            raise ResourceError(f"osc://{host}:{port}: got {error}, expected a port that is free") from error
        self._socket.setblocking(False)

    @property
    def port(self) -> int:
        """Port that it listens on."""
        return int(self._socket.getsockname()[1])

    @property
    def is_silent(self) -> bool:
        """Whether no frame has arrived for :data:`SILENT_S`."""
        return self._clock() - self._heard_s > SILENT_S

    def faps(self) -> Faps:
        """Return the newest frame, (68,) FAPU; late ones are dropped, FAPs that are not sent keep their values."""
        while True:
            try:
                data = self._socket.recv(MAX_DATAGRAM_BYTES)
            except OSError:  # no more packets
                return self._values.copy()
            try:
                for message in osc.parse_packet(data):
                    self._take(message)
            except DataError:
                self.counts.refused += 1

    def close(self) -> None:
        """Close the port."""
        self._socket.close()

    def _take(self, message: osc.Message) -> None:
        if message.address != FRAME:
            self.counts.refused += 1
            return
        frame = parse_frame(message)
        if self.session is None:
            self.session = frame.session
        if frame.session != self.session:
            return
        before, self._heard_s = self._frame, self._clock()
        if before is not None and 0 <= before.number - frame.number < 1000 and frame.time_us <= before.time_us:
            return
        if before is not None and frame.number > before.number:
            self.counts.missed += frame.number - before.number - 1
        self.counts.frames += 1
        self._frame = frame
        values, mask = frame.values, frame.mask
        if self._high_level is None and mask[: fap.column(3)].any():
            self._high_level = HighLevelFaps(load_profile(DEFAULT_PROFILE))
        if self._high_level is not None:
            values, mask = self._high_level.show(values, mask, frame.visemes, frame.expressions)
        self._values = np.where(mask, values, self._values).astype(np.int32)

"""Edge: sound in through PortAudio, in pieces that wait until they are taken."""

from collections import deque
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from fapengine.audio.device import plain, portaudio, supported_rate_hz
from fapengine.errors import ResourceError

RATES_HZ = (16_000, 48_000, 44_100)
"""Rates that are tried before the device's own."""
PIECE_S = 0.02
MAX_PIECES = 100
"""Pieces that wait, 2 s; then the oldest is dropped."""
DEFAULT = "default"
"""Name of the system's microphone."""


class Microphone:
    """Sound of an input device. Use it as a context manager, or close it. Stateful.

    Parameters
    ----------
    device : str, optional
        Its number, or a part of its name; None or :data:`DEFAULT`: the system's.

    Raises
    ------
    ResourceError
        If PortAudio is missing, or the device cannot be opened.
    """

    def __init__(self, device: str | None = None) -> None:
        sounddevice = portaudio()
        chosen: int | str | None = None if device in (None, DEFAULT) else device
        if isinstance(chosen, str) and chosen.isdecimal():
            chosen = int(chosen)
        if chosen is None and sounddevice.default.device[0] < 0:
            raise ResourceError("microphone: there is no input device; `fapengine doctor` tells more")
        self._pieces: deque[NDArray[np.int16]] = deque(maxlen=MAX_PIECES)
        self.dropped = 0
        try:
            about = sounddevice.query_devices(chosen, "input")
            self.rate_hz = supported_rate_hz("input", chosen, RATES_HZ, about)
            self._stream = sounddevice.InputStream(
                samplerate=self.rate_hz, channels=1, dtype="int16", device=chosen, latency="low",
                blocksize=round(PIECE_S * self.rate_hz), callback=self._take,
            )  # fmt: skip
            self._stream.start()
        except (sounddevice.PortAudioError, ValueError) as error:
            raise ResourceError(f"microphone: {plain(error)}; `fapengine doctor` lists the devices") from error
        self.description = f"{about['name']}, {self.rate_hz} Hz"

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def take(self) -> NDArray[np.int16]:
        """Return the samples since the last call, (N,) int16, mono, at ``rate_hz``."""
        pieces = [np.zeros(0, np.int16)]
        while self._pieces:
            pieces.append(self._pieces.popleft())
        return np.concatenate(pieces)

    def close(self) -> None:
        """Close the device."""
        self._stream.close()

    def _take(self, data: NDArray[np.int16], frames: int, times: Any, status: Any) -> None:
        """PortAudio's own thread calls this."""
        self.dropped += len(self._pieces) == MAX_PIECES
        self._pieces.append(data[:, 0].copy())

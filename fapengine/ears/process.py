"""An ear in a process of its own: nobody else's frames wait for it.

Theory of operation
-------------------
PocketSphinx holds Python's lock for as long as it hears, 20 ms for 80 ms of sound and more on a busy machine; a face
shows a frame every 17 ms. So the ear is another process (``python -m fapengine.ears.process``). Sound goes in through
its standard input, phones come out of its standard output; neither end of :class:`EarProcess` ever waits. What the
process was not handed yet (all but :data:`HANDED_S`) waits here, so that it can be forgotten at once. It ends with its
input, so it outlives nobody.

A message in is a head, ``<BIII``: kind, number of the stream, rate in Hz, bytes; then int16 samples, little-endian. A
message out is a line of JSON. A stream is one sound; a new number forgets the stream before.
"""

import contextlib
import json
import os
import signal
import struct
import subprocess
import sys
from collections import deque
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from fapengine.ears.choice import check_installed, new_ear
from fapengine.ears.loudness import RunningSoundings
from fapengine.ears.protocol import RATE_HZ, Ear, Heard
from fapengine.errors import FapEngineError, ResourceError
from fapengine.speech.phone_track import Phone
from fapengine.speech.prosody import RunningProsody

HEAD = struct.Struct("<BIII")
SOUND, END = 1, 2
HANDED_S = 0.5
"""Length of sound that the process is handed before it has heard it."""
PIECE_S = 0.08
"""Length of sound that is handed over at a time: the ear's block."""


@dataclass(slots=True, eq=False)
class EarProcess:
    """The other end of an ear's process; opened by :meth:`open`. Stateful.

    Nothing here waits: :meth:`poll` is to be called about once a frame.
    """

    process: "subprocess.Popen[bytes]"
    is_ready: bool = False
    """True when the ear is there; sound that comes before is kept."""
    look_ahead_s: float = 0.0
    """Time behind the sound at which its phones are told; known when it is ready."""
    waiting_s: float = 0.0
    """Length of sound that was not heard yet."""
    _stream: int = 0
    _messages: deque[tuple[int, float, bytes]] = field(default_factory=deque)
    """Messages to be handed over: stream, seconds of sound, bytes."""
    _handed_s: float = 0.0
    _heard_s: float = 0.0
    _out: bytes = b""
    _in: bytes = b""

    @classmethod
    def open(cls, model: Path | None = None) -> "EarProcess":
        """Start a process; it is ready after about a second.

        Parameters
        ----------
        model : Path, optional
            Name of an ear, or a learned one (:mod:`.choice`).

        Raises
        ------
        ResourceError
            If PocketSphinx is asked for and not installed, or no process can be started.
        """
        check_installed(model)
        try:
            process = subprocess.Popen(
                [sys.executable, "-m", "fapengine.ears.process", *([str(model)] if model else [])],
                stdin=subprocess.PIPE, stdout=subprocess.PIPE, bufsize=0, process_group=0,
            )  # fmt: skip
        except OSError as error:
            raise ResourceError(f"ear: its process cannot be started: {error.strerror or error}") from error
        for pipe in (process.stdin, process.stdout):
            os.set_blocking(_number(pipe), False)
        return cls(process)

    @property
    def stream(self) -> int:
        """Number of the stream that is heard now; 0 before the first."""
        return self._stream

    def begin(self) -> int:
        """Forget what was not heard yet, and begin a stream; returns its number."""
        self._stream += 1
        self._messages.clear()
        self.waiting_s = self._handed_s = self._heard_s = 0.0
        return self._stream

    def push(self, samples: NDArray[np.int16], rate_hz: int) -> None:
        """Add sound to the stream: (N,) int16, mono; ``rate_hz`` is the same in all of a stream."""
        step = max(round(PIECE_S * rate_hz), 1)
        for start in range(0, len(samples), step):
            piece = samples[start : start + step].astype("<i2").tobytes()
            message = HEAD.pack(SOUND, self._stream, rate_hz, len(piece)) + piece
            self._messages.append((self._stream, len(piece) / 2 / rate_hz, message))
        self.waiting_s += len(samples) / rate_hz

    def end(self) -> None:
        """Say that the stream is over."""
        self._messages.append((self._stream, 0.0, HEAD.pack(END, self._stream, 0, 0)))

    def poll(self) -> list[Heard]:
        """Hand over what the process can take, and return what it has told of this stream.

        Raises
        ------
        ResourceError
            If the process has ended.
        """
        told = self._read()
        self._write()
        return told

    def close(self) -> None:
        """End the process. To close again does nothing."""
        self.process.kill()  # it has nothing to save, and would first hear what it was handed
        self.process.wait()
        for pipe in (self.process.stdin, self.process.stdout):
            _pipe(pipe).close()

    def _write(self) -> None:
        while self.is_ready:
            if not self._out:
                if not self._messages or self._handed_s - self._heard_s > HANDED_S:
                    return
                _, length_s, self._out = self._messages.popleft()
                self._handed_s += length_s
            try:
                self._out = self._out[os.write(_number(self.process.stdin), self._out) :]
            except BlockingIOError:
                return
            except OSError as error:
                raise ResourceError(f"ear: its process has ended (code {self.process.poll()})") from error

    def _read(self) -> list[Heard]:
        with contextlib.suppress(BlockingIOError):
            while True:
                data = os.read(_number(self.process.stdout), 1 << 16)
                if not data:
                    raise ResourceError(f"ear: its process has ended (code {self.process.poll()})")
                self._in += data
        *lines, self._in = self._in.split(b"\n")
        told = []
        for line in lines:
            entry = json.loads(line)
            if "ready" in entry:
                self.is_ready, self.look_ahead_s = True, entry["look_ahead_s"]
                continue
            heard = Heard(
                entry["stream"],
                entry["position_s"],
                tuple(
                    Phone(label, start_s, end_s, stress, confidence=sure, loudness_db=loudness_db)
                    for label, start_s, end_s, stress, sure, loudness_db in entry["phones"]
                ),
                entry["is_over"],
            )
            if heard.stream == self._stream:
                self.waiting_s = max(self.waiting_s - (heard.position_s - self._heard_s), 0.0)
                self._heard_s = heard.position_s
                told.append(heard)
        return told


def _pipe(pipe: Any) -> BinaryIO:
    found: BinaryIO = pipe
    return found


def _number(pipe: Any) -> int:
    return _pipe(pipe).fileno()


# The process itself -------------------------------------------------------------------------------------------------


class _Stream:
    """One sound on its way to the ear, at the ear's rate. Stateful."""

    def __init__(self, ear: Ear, number: int, rate_hz: int) -> None:
        self.number, self._ear, self._rate_hz = number, ear, rate_hz
        self._came = 0
        self._prosody = RunningProsody()
        self._soundings = RunningSoundings()
        self._resampler: Any = None
        if rate_hz != RATE_HZ:
            from av import AudioResampler

            self._resampler = AudioResampler(format="s16", layout="mono", rate=RATE_HZ)
        ear.reset()

    def push(self, samples: NDArray[np.int16]) -> Heard:
        self._came += len(samples)
        phones = [phone for piece in self._resampled(samples) for phone in self._push(piece)]
        return Heard(self.number, self._came / self._rate_hz, tuple(self._as_said(phones)))

    def end(self) -> Heard:
        phones = [phone for piece in self._resampled(None) for phone in self._push(piece)] + self._ear.end()
        return Heard(self.number, self._came / self._rate_hz, tuple(self._as_said(phones)), is_over=True)

    def _push(self, piece: NDArray[np.int16]) -> list[Phone]:
        self._soundings.push(piece)
        return self._ear.push(piece)

    def _as_said(self, phones: list[Phone]) -> list[Phone]:
        """Give phones loudness and stress."""
        return self._prosody.push(phones, self._soundings.of(phones))

    def _resampled(self, samples: NDArray[np.int16] | None) -> list[NDArray[np.int16]]:
        if self._resampler is None:
            return [] if samples is None else [samples]
        frame = None
        if samples is not None:
            from av import AudioFrame

            frame = AudioFrame.from_ndarray(samples[None], format="s16", layout="mono")
            frame.sample_rate = self._rate_hz
        return [out.to_ndarray()[0] for out in self._resampler.resample(frame)]


class DirectEar:
    """An ear of this process as a :class:`.protocol.StreamEar`: it hears while it is given sound, and waits meanwhile.

    Stateful. For tests and for sound that is not live; a face that is, wants :class:`EarProcess`.

    Parameters
    ----------
    ear : Ear
    """

    def __init__(self, ear: Ear) -> None:
        self.is_ready, self.look_ahead_s, self.waiting_s = True, ear.look_ahead_s, 0.0
        self._ear = ear
        self._number = 0
        self._stream: _Stream | None = None
        self._told: list[Heard] = []

    def begin(self) -> int:
        """Begin a stream."""
        self._number += 1
        self._stream = None
        self._told.clear()
        return self._number

    def push(self, samples: NDArray[np.int16], rate_hz: int) -> None:
        """Hear more: (N,) int16."""
        self._stream = self._stream or _Stream(self._ear, self._number, rate_hz)
        self._told.append(self._stream.push(samples))

    def end(self) -> None:
        """Hear the end."""
        self._told.append(self._stream.end() if self._stream else Heard(self._number, 0.0, is_over=True))
        self._stream = None

    def poll(self) -> list[Heard]:
        """Return what was heard."""
        told, self._told = self._told, []
        return told

    def close(self) -> None:
        """Do nothing."""


def serve(reads: BinaryIO, writes: BinaryIO, ear: Ear) -> None:
    """Hear what comes in, until it ends."""
    _tell(writes, {"ready": True, "look_ahead_s": ear.look_ahead_s})
    stream: _Stream | None = None
    while len(head := reads.read(HEAD.size)) == HEAD.size:
        kind, number, rate_hz, size = HEAD.unpack(head)
        data = reads.read(size)
        if len(data) < size:
            return
        if kind == SOUND:
            if stream is None or stream.number != number:
                stream = _Stream(ear, number, rate_hz)
            _tell_heard(writes, stream.push(np.frombuffer(data, "<i2").astype(np.int16)))
        elif stream is not None and stream.number == number:
            _tell_heard(writes, stream.end())
            stream = None
        else:
            _tell_heard(writes, Heard(number, 0.0, is_over=True))


def _tell_heard(writes: BinaryIO, heard: Heard) -> None:
    phones = [
        (phone.label, phone.start_s, phone.end_s, phone.stress, phone.confidence, phone.loudness_db)
        for phone in heard.phones
    ]
    _tell(
        writes,
        {"stream": heard.stream, "position_s": heard.position_s, "phones": phones, "is_over": heard.is_over},
    )


def _tell(writes: BinaryIO, entry: dict[str, Any]) -> None:
    writes.write(json.dumps(entry).encode() + b"\n")
    writes.flush()


def main() -> None:
    """Be the process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent is told, and tells
    try:
        ear = new_ear(Path(sys.argv[1]) if len(sys.argv) > 1 else None)
    except FapEngineError as error:
        sys.exit(f"fapengine: {error}")
    with contextlib.suppress(BrokenPipeError):
        serve(sys.stdin.buffer, sys.stdout.buffer, ear)


if __name__ == "__main__":
    main()

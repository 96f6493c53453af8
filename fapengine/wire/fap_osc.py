"""FAP frames over OSC: one message per frame for programs, one address per FAP for patches.

``/fap/1/frame`` (1 is the schema's version) holds a whole frame, so that no part of a frame is lost alone::

    s session       1..32 bytes UTF-8
    i number        0, 1, 2, ... without gaps: a receiver counts lost frames and drops late ones
    h time_us       time to show it, microseconds of the session's clock, >= 0
    b mask          9 bytes: FAP n is sent if bit n - 1 is set, from the most significant bit of byte 0; the last 4
                    bits are 0
    i ...           for each FAP of the mask, in rising order: FAP 1 viseme_select1, viseme_select2, viseme_blend,
                    viseme_def; FAP 2 expression_select1, expression_intensity1, expression_select2,
                    expression_intensity2, init_face, expression_def; FAP 3 to 68 one value in FAPU (AU for angles)
    [i epoch]       if a server has several processes: the one with the highest epoch shows the session

A FAP that is not in the mask keeps its value, as in the standard. Further arguments are ignored.

In the named form each FAP is a message of its own, ``/fap/<n> i value`` for n = 3..68, ``/fap/viseme iiii`` and
``/fap/expression iiiiii``, in as few bundles as fit the datagrams; there is no session, number or time.
"""

import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import cast

import numpy as np
from numpy.typing import NDArray

from fapengine._arrays import frozen
from fapengine.errors import DataError, TruncatedError, UsageError
from fapengine.mpeg4 import fap
from fapengine.mpeg4.track import FapTrack
from fapengine.wire import osc

FRAME = "/fap/1/frame"
VISEME, EXPRESSION = "/fap/viseme", "/fap/expression"
MAX_SESSION_BYTES = 32
MAX_DATAGRAM = 1200
"""Bytes; passes any internet path without fragmentation."""
VISEME_WIDTH, EXPRESSION_WIDTH = 4, 6
MASK_BYTES = 9
_FIXED = struct.Struct(">iqi9s3x")
_EPOCH = struct.Struct(">i")
_HEAD_TAGS = "sihb"
_NUMBERS = 2**31 - 1
"""Largest frame number, after which they wrap around: 414 days at 60 Hz."""
_WIDTHS = np.array([VISEME_WIDTH, EXPRESSION_WIDTH] + [1] * (fap.FAP_COUNT - 2))
_LOW_LEVEL = fap.FAP_COUNT - fap.column(3)
"""Number of low-level FAPs."""
_LOW_LEVEL_MASK = np.packbits(np.arange(fap.FAP_COUNT) >= fap.column(3)).tobytes()


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FapFrame:
    """One frame of one session. Arrays are read-only."""

    session: str
    number: int
    """0..2**31 - 1."""
    time_us: int
    """Microseconds of the session's clock."""
    values: NDArray[np.int32]
    """(68,) int32, as a row of :attr:`FapTrack.values`; 0 where the mask is False."""
    mask: NDArray[np.bool_]
    """(68,) bool: the FAPs that are sent."""
    visemes: NDArray[np.int32]
    """(4,) int32, as a row of :attr:`FapTrack.visemes`."""
    expressions: NDArray[np.int32]
    """(6,) int32, as a row of :attr:`FapTrack.expressions`."""
    epoch: int = 0
    """Number that grows when the session moves to another process; 0 if the server is one process."""

    def __post_init__(self) -> None:
        _head(self.session, 0)
        if not (0 <= self.number < 2**31 and 0 <= self.time_us < 2**63):
            raise UsageError(f"frame: got number {self.number} at {self.time_us} us, expected both from 0 on")
        if not 0 <= self.epoch < 2**31:
            raise UsageError(f"frame: got epoch {self.epoch}, expected 0 to {2**31 - 1}")
        for field, width, dtype in (
            ("values", fap.FAP_COUNT, np.int32),
            ("mask", fap.FAP_COUNT, np.bool_),
            ("visemes", VISEME_WIDTH, np.int32),
            ("expressions", EXPRESSION_WIDTH, np.int32),
        ):
            object.__setattr__(self, field, frozen(getattr(self, field), field, (width,), dtype))


def encode_frame(frame: FapFrame) -> bytes:
    """Encode one frame as a ``/fap/1/frame`` message."""
    row = np.concatenate([frame.visemes, frame.expressions, frame.values[fap.column(3) :]])
    sent = row[np.repeat(frame.mask, _WIDTHS)]
    head = _head(frame.session, len(sent), has_epoch=frame.epoch > 0)
    fixed = _FIXED.pack(frame.number, frame.time_us, MASK_BYTES, np.packbits(frame.mask).tobytes())
    return head + fixed + sent.astype(">i4").tobytes() + (_EPOCH.pack(frame.epoch) if frame.epoch else b"")


def encode_track(track: FapTrack, *, session: str, start_us: int = 0, first_number: int = 0) -> list[bytes]:
    """Encode each frame of a track as a ``/fap/1/frame`` message, numbered without gaps.

    Raises UsageError if session, number or time cannot be sent.

    Parameters
    ----------
    track : FapTrack
        Its frame numbers set the times.
    session : str
        1 to 32 bytes of UTF-8.
    start_us : int
        Time of the track's frame number 0 on the session's clock, microseconds.
    first_number : int
        Number of the first message.
    """
    times_us = np.rint(track.times_s * 1e6).astype(np.int64) + start_us
    frames = (
        FapFrame(
            session=session, number=first_number + step, time_us=int(times_us[step]), values=track.values[step],
            mask=track.mask[step], visemes=track.visemes[step], expressions=track.expressions[step],
        )
        for step in range(len(track))
    )  # fmt: skip
    return [encode_frame(frame) for frame in frames]


class SessionFrames:
    """Encoder of ``/fap/1/frame`` messages with all low-level FAPs of many sessions, numbered from 0 in every session.

    Stateful.

    Names and tags are encoded once, so 500 sessions cost little more than joining their bytes.

    Parameters
    ----------
    epochs : mapping of str to int, optional
        Epochs of the sessions; may change. By default none is sent.
    """

    def __init__(self, epochs: Mapping[str, int] | None = None) -> None:
        self._epochs = epochs
        self._sessions: tuple[str, ...] = ()
        self._heads: list[bytes] = []
        self._next: list[int] = []

    def begin_at(self, numbers: Mapping[str, int]) -> None:
        """Set the next frame number of these sessions, and forget all others."""
        self._sessions, self._next = tuple(numbers), list(numbers.values())
        self._heads = [self._head_of(session) for session in self._sessions]

    def encode(self, sessions: tuple[str, ...], faps: NDArray[np.int32], time_us: int) -> list[bytes]:
        """Encode one frame of every session.

        Raises UsageError if a session's name cannot be sent.

        Parameters
        ----------
        sessions : tuple of str
            A session that was missing begins at 0 again.
        faps : (S, 68) int32
            FAPU.
        time_us : int
            Microseconds of the sessions' clock, >= 0.
        """
        if sessions != self._sessions:
            numbers = dict(zip(self._sessions, self._next, strict=True))
            self._heads = [self._head_of(session) for session in sessions]
            self._next = [numbers.get(session, 0) for session in sessions]
            self._sessions = sessions
        width, values = 4 * _LOW_LEVEL, faps[:, -_LOW_LEVEL:].astype(">i4").tobytes()
        mask, pack = _LOW_LEVEL_MASK, _FIXED.pack
        views = [
            head + pack(number & _NUMBERS, time_us, MASK_BYTES, mask) + values[row * width : (row + 1) * width]
            for row, (head, number) in enumerate(zip(self._heads, self._next, strict=True))
        ]
        self._next = [number + 1 for number in self._next]
        if self._epochs is not None:
            epochs = [self._epochs.get(session, 0) for session in sessions]
            views = [view + _EPOCH.pack(epoch & _NUMBERS) for view, epoch in zip(views, epochs, strict=True)]
        return views

    def _head_of(self, session: str) -> bytes:
        return _head(session, _LOW_LEVEL, has_epoch=self._epochs is not None)


def decode_frame(data: bytes) -> FapFrame:
    """Decode a datagram with one ``/fap/1/frame`` message. Raises DataError if it contains anything else."""
    messages = osc.parse_packet(data)
    if len(messages) != 1:
        raise DataError(f"{FRAME}: got {len(messages)} messages, expected 1")
    return parse_frame(messages[0])


def parse_frame(message: osc.Message) -> FapFrame:
    """Decode a ``/fap/1/frame`` message.

    Raises TruncatedError if values of the mask are missing; DataError if address, types or ranges are not those of the
    schema.
    """
    if message.address != FRAME or not message.tags.startswith(_HEAD_TAGS):
        raise DataError(f"got {message.address:.40} ,{message.tags:.8}, expected {FRAME} ,{_HEAD_TAGS}...")
    session, number, time_us, bits = cast("tuple[str, int, int, bytes]", message.arguments[:4])
    if len(bits) != MASK_BYTES or bits[-1] & 0x0F:
        raise DataError(f"{FRAME}: got mask {bits!r:.60}, expected {MASK_BYTES} bytes that end in 4 zero bits")
    mask = np.unpackbits(np.frombuffer(bits, np.uint8))[: fap.FAP_COUNT].astype(np.bool_)
    sent = np.repeat(mask, _WIDTHS)
    count = int(sent.sum())
    tags = message.tags[4 : 4 + count]
    if len(tags) < count:
        raise TruncatedError(f"{FRAME}: got {len(tags)} values, expected {count} by its mask")
    if tags != "i" * count:
        raise DataError(f"{FRAME}: got tags {tags:.80}, expected {count} x i")
    row = np.zeros(len(sent), np.int32)
    row[sent] = np.array(message.arguments[4 : 4 + count], dtype=np.int32)
    values = np.concatenate([[0, 0], row[VISEME_WIDTH + EXPRESSION_WIDTH :]])
    epoch = max(cast("int", message.arguments[4 + count]), 0) if message.tags[4 + count :].startswith("i") else 0
    try:
        return FapFrame(
            session=session, number=number, time_us=time_us, values=values, mask=mask, visemes=row[:VISEME_WIDTH],
            expressions=row[VISEME_WIDTH : VISEME_WIDTH + EXPRESSION_WIDTH], epoch=epoch,
        )  # fmt: skip
    except UsageError as error:
        raise DataError(f"{FRAME}: {error}") from error


def encode_named(frame: FapFrame, *, limit: int = MAX_DATAGRAM) -> list[bytes]:
    """Encode the FAPs of a frame's mask, one message each, in bundles of at most ``limit`` bytes."""
    messages: list[bytes] = []
    for number in (np.flatnonzero(frame.mask) + 1).tolist():
        if number == fap.VISEME_FAP:
            messages.append(osc.message(VISEME, "iiii", *frame.visemes.tolist()))
        elif number == fap.EXPRESSION_FAP:
            messages.append(osc.message(EXPRESSION, "iiiiii", *frame.expressions.tolist()))
        else:
            messages.append(osc.head(f"/fap/{number}", "i") + struct.pack(">i", frame.values[fap.column(number)]))
    return osc.bundles(messages, limit=limit)


@lru_cache(maxsize=4096)
def _head(session: str, count: int, *, has_epoch: bool = False) -> bytes:
    """Encode address, type tags and session: everything before the numbers."""
    size = len(session.encode(errors="replace"))
    if not 1 <= size <= MAX_SESSION_BYTES:
        raise UsageError(f"session: got {session!r:.40} of {size} bytes, expected 1 to {MAX_SESSION_BYTES}")
    count += has_epoch
    values: Sequence[osc.Argument] = (session, 0, 0, bytes(MASK_BYTES), *[0] * count)
    return osc.message(FRAME, _HEAD_TAGS + "i" * count, *values)[: -(_FIXED.size + 4 * count)]

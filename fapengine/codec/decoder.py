"""From bytes to frames: incremental, total, and able to find its way back after damage.

Theory of operation
-------------------
Bits wait in a buffer until a plane is *settled*: whatever follows, it decodes the same. So feeding byte by byte gives
what feeding at once gives. For any bytes at all the decoder returns frames or raises :class:`DataError`; its time and
memory grow with the length of the data alone.

A body beside the face (:mod:`fapengine.codec.bodies`) is decoded and dropped: planes with BAPs leave the fast loop and
are taken one by one. A plane with BAPs alone is a frame in which the face stands still, so it counts as a skipped one.

With ``errors="resync"`` an error is noted as a :class:`Loss`, and decoding goes on at the next I plane that proves
itself (:mod:`fapengine.codec.resync`). Damage is seen a few planes late: each wrong plane header passes for a right one
with a chance of 1/8. So the last :data:`HELD` frames are held back until what follows them has been decoded, and thrown
away if it cannot be; the search then begins behind the first of them. Frames from before the damage stay what they
are, so each damage costs a bounded number of new beginnings.
"""

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from fapengine.codec import bits
from fapengine.codec import kernels as k
from fapengine.codec.bits import BitReader, Bits, place, unpack
from fapengine.codec.bodies import BodyState, read_body_header
from fapengine.codec.fields import FIELD_COUNT, FIELD_FAPS, FIELD_NAMES, Ints, track_of
from fapengine.codec.header import (
    BODY,
    FACE,
    FrameRate,
    IntraHeader,
    PlaneStart,
    read_face_header,
    read_plane_start,
    read_skip,
)  # fmt: skip
from fapengine.codec.planes import Frame, Loss, Planes, PlaneState
from fapengine.codec.resync import find_intact_intra
from fapengine.errors import ConformanceError, DataError, TruncatedError
from fapengine.mpeg4.track import FapTrack

Errors = Literal["strict", "resync"]
Floats = np.ndarray[tuple[int], np.dtype[np.float64]]
HELD = 4
"""Frames held back while resynchronising is on: a wrong plane passes for a right one that often with chance 8**-4."""
DEFAULT_RATE = FrameRate(30)
"""Frame rate before any was sent (FBA section 10)."""
AT_ONCE = 256
CODE_BITS = 32
SEARCHED_BITS = 1 << 20
"""Bits of a live stream that are searched for an I plane at most, again with every piece that is fed."""
CLAUSES = {
    k.BAD_MASK: "FBA section 2", k.BAD_STUFFING: "FBA section 7",
    k.BAD_VALUE: "FBA section 9", k.BAD_SKIP: "FBA section 10",
}  # fmt: skip


class Decoder:
    """Bytes in, frames out.

    Stateful.

    Parameters
    ----------
    errors : "strict" or "resync"
        Whether damage ends the stream with an error, or costs frames and is listed in ``losses``.
    with_costs : bool
        Count the bits that each field costs, in ``costs``; slower.

    Examples
    --------
    >>> worked_example = bytes.fromhex(
    ...     "000001BA B19001B5 8000924B 24802988 3E848614 006C7D28 52D17D70 05A17F00 0001B1")
    >>> decoder = Decoder()
    >>> [frame.fap(48) for frame in decoder.feed(worked_example)]
    [-1020, -680, -680]
    """

    def __init__(self, *, errors: Errors = "strict", with_costs: bool = False) -> None:
        self.losses: list[Loss] = []
        self.ended = False
        """The end code was read; whatever follows is ignored."""
        self.rate: FrameRate | None = None
        """First frame rate that was sent."""
        self.costs = np.zeros(FIELD_COUNT if with_costs else 0)
        """(73,) float64, bits: information of all symbols of each field."""
        self._resync = errors == "resync"
        self.body_planes = 0
        """Planes that carried body parameters, which were left out."""
        self._state = PlaneState()
        self._body = BodyState()
        self._bits: Bits = np.zeros(0, np.uint8)
        self._at = 0
        self._origin = 0
        self._begun = False
        self._header: IntraHeader | None = None
        self._fresh = False
        self._searching_from: int | None = None
        self._trouble: DataError | None = None
        self._number = 0
        self._anchor = (0, 0.0)
        self._rate_hz = DEFAULT_RATE.hz
        self._out: list[Planes] = []
        self._safe: list[Planes] = []
        """Decoded before the last damage, and far enough from it: nothing takes these back."""
        self._dropped_to = 0
        """Bit behind the last plane that was thrown away; planes before it were counted as lost already."""
        self._found: Ints = np.zeros((4, FIELD_COUNT), np.int64)
        self._flags: Ints = np.zeros(3, np.int64)

    def feed(self, data: bytes) -> list[Frame]:
        """Take more bytes, and return the frames that they complete.

        Raises
        ------
        DataError
            If the stream is damaged: at the call after the one that returned the last good frames.
        """
        return [frame for planes in self.feed_planes(data) for frame in planes.frames()]

    def close(self) -> list[Frame]:
        """Say that no more bytes come; behind the last one, bits read as 0.

        Raises
        ------
        TruncatedError
            If there was no end code; with ``errors="resync"`` that is a loss instead.
        """
        return [frame for planes in self.close_planes() for frame in planes.frames()]

    def feed_planes(self, data: bytes) -> list[Planes]:
        """Do as :meth:`feed`, with frames in blocks of arrays."""
        if self._trouble is not None:
            raise self._trouble
        if not self.ended and data:
            self._bits = np.concatenate([self._bits, unpack(data)])
            self._run(final=False)
        ready = self._hand_out(everything=self.ended or not self._resync)
        if self._resync:
            self._trim()
        return ready

    def close_planes(self) -> list[Planes]:
        """Do as :meth:`close`, with frames in blocks of arrays."""
        if self._trouble is not None:
            raise self._trouble
        if not self.ended:
            self._run(final=True)
            if self._trouble is not None and not (self._out or self._safe):
                raise self._trouble
        self.ended = True
        return self._hand_out(everything=True)

    @property
    def trouble(self) -> DataError | None:
        """The error that the next call will raise."""
        return self._trouble

    @property
    def waiting_bits(self) -> int:
        """Bits kept for later: what is not yet decoded, and what may have to be searched again."""
        return len(self._bits)

    @property
    def rate_hz(self) -> float:
        """First frame rate of the stream; 30 until one is sent."""
        return (self.rate or DEFAULT_RATE).hz

    def _hand_out(self, *, everything: bool) -> list[Planes]:
        safe, self._safe = self._safe, []
        if everything:
            ready, self._out = self._out, []
            return safe + ready
        kept: list[Planes] = []
        room = HELD
        while self._out and room:
            last = self._out.pop()
            head, tail = last.split(max(0, len(last) - room))
            kept.insert(0, tail)
            room -= len(tail)
            if len(head):
                self._out.append(head)
        ready, self._out = self._out, kept
        return safe + ready

    def _run(self, *, final: bool) -> None:
        while not self.ended and self._trouble is None:
            try:
                if not (self._search(final=final) if self._searching_from is not None else self._step(final=final)):
                    return
            except DataError as error:
                self._lose(error)

    def _lose(self, error: DataError) -> None:
        """Note an error; when resynchronising, drop what is held and search from there."""
        if not self._resync:
            self._trouble = error
            return
        start = self._origin + self._at
        if isinstance(error, TruncatedError):  # nothing speaks against what was decoded
            end = self._origin + len(self._bits)
            self.losses.append(Loss(start_bit=start, end_bit=end, frames_dropped=0, reason=str(error)))
            self.ended = True
            return
        self._safe = self._hand_out(everything=False)
        held, self._out = self._out, []
        extents = np.concatenate([np.zeros((0, 3), np.int64), *(planes.extents for planes in held)])
        dropped = int((extents[:, 0] >= self._dropped_to).sum())
        if len(extents):
            start = int(extents[0, 0])
            self._dropped_to = max(self._dropped_to, int(extents[-1, 1]))
        last = self.losses[-1] if self.losses else None
        if last is not None and last.end_bit is not None and start <= last.end_bit:  # the same damage, met again
            last.end_bit, last.frames_dropped = None, last.frames_dropped + dropped
        else:
            self.losses.append(Loss(start_bit=start, end_bit=None, frames_dropped=dropped, reason=str(error)))
        self._searching_from = max(start + 1 - self._origin, 0)

    def _step(self, *, final: bool) -> bool:
        """Do one thing; False when more bytes are needed."""
        if not self._begun:
            return self._begin(final=final)
        if self._header is None:
            return self._first_intra(final=final)
        return self._planes(final=final)

    def _begin(self, *, final: bool) -> bool:
        try:
            self._at = 8 * bits.skip_preamble(np.packbits(self._bits).tobytes())
        except TruncatedError:
            if not final:
                return False
            raise
        self._begun = self._fresh = True
        return True

    def _first_intra(self, *, final: bool) -> bool:
        left = len(self._bits) - self._at
        if not left:
            if final:
                raise TruncatedError("contains no plane", where=self._where())
            return False
        if self._bits[self._at]:
            return self._intra(final=final)
        if self._body.begun and left >= 2 and self._bits[self._at + 1]:
            return self._with_body(final=final)
        code = k.code_behind(self._bits, self._at)
        if code == -2 and not final:
            return False
        if code < 0:
            raise ConformanceError("first plane: got a P plane, expected an I plane", where=self._where(),
                                   clause="FBA section 1")  # fmt: skip
        self._start_code(code)
        return True

    def _planes(self, *, final: bool) -> bool:
        values = np.zeros((AT_ONCE, FIELD_COUNT), np.int64)
        flags, extents = np.zeros((AT_ONCE, 3), np.int64), np.zeros((AT_ONCE, 3), np.int64)
        state = self._state
        count, self._at, status, detail = k.decode_predicted(
            self._bits, self._at, self._fresh, final, state.fields, state.previous, state.models.decoding,
            self._found, self._flags, self.costs, values, flags, extents,
        )  # fmt: skip
        if count:
            self._fresh = False
            extents[:, :2] += self._origin
            self._emit(values[:count].copy(), flags[:count].copy(), extents[:count].copy(), intra=False)
        if status == k.NEED_MORE:
            if not self._resync:
                self._trim()
            if final:
                raise TruncatedError("stream: ends without its end code", where=self._where(), clause="FBA section 1")
            return False
        if status == k.INTRA_NEXT:
            return self._intra(final=final)
        if status == k.WITH_BODY or (status == k.AT_CODE and self._is_body_plane()):
            return self._with_body(final=final)
        if status == k.AT_CODE:
            self._start_code(detail)
        elif status != k.FULL:
            raise self._error(status, detail)
        if not self._resync:
            self._trim()
        return True

    def _start_code(self, code: int) -> None:
        if code in (bits.PLANE_START, bits.OLD_PLANE_START):
            self._at = (self._at // 8 + 1) * 8 + 32
            self._fresh = True
        elif 0xB0 <= code <= 0xBF:
            self.ended = True
        else:
            raise ConformanceError(f"first plane: got start code {code:02x}, expected a plane", where=self._where())

    def _intra(self, *, final: bool) -> bool:
        reader = BitReader(self._bits, self._at + 1, self._origin)
        try:
            start = read_plane_start(reader)
            header = read_face_header(reader, start) if start.objects & FACE else None
        except TruncatedError:
            if final:
                raise
            return False
        state = self._state
        before = None if state.ranges is None else state.ranges.copy()
        costs = np.zeros_like(self.costs)
        status, end = k.DONE, reader.position
        if header is not None:
            state.begin_intra(header)
            status, end = self._decode_face(True, end, costs)
        if status == k.DONE and start.objects & BODY:
            status, end = self._begin_body(end)
        if status == k.NEED_MORE:
            state.ranges = before
            if final:
                raise TruncatedError("I plane: cut off", where=self._where(), clause="FBA section 4")
            return False
        if status != k.DONE:
            raise self._error(status, end)
        self._take_times(start)
        self._keep(True, start.objects, header, end, start.skip, costs)
        return True

    def _begin_body(self, at: int) -> tuple[int, int]:
        """Read the I data of a body; status and end as the loops give them."""
        reader = BitReader(self._bits, at, self._origin)
        try:
            header = read_body_header(reader)
        except TruncatedError:
            return k.NEED_MORE, at
        self._body.begin_intra(header, self._where())
        return self._body.decode(True, self._bits, reader.position)

    def _is_body_plane(self) -> bool:
        """Tell a P plane with a body from stuffing before a start code: stuffing is a 0 and ones."""
        stuffing = self._bits[self._at : (self._at // 8 + 1) * 8]
        return self._body.begun and len(stuffing) > 2 and bool(stuffing[1]) and not stuffing[1:].all()

    def _with_body(self, *, final: bool) -> bool:
        """Take a P plane that carries BAPs."""
        reader = BitReader(self._bits, self._at + 1, self._origin)
        try:
            objects, skip = reader.read(2, "fba_object_mask"), read_skip(reader)
        except TruncatedError:
            if final:
                raise
            return False
        if not self._body.begun or (objects & FACE and self._header is None):
            raise ConformanceError(
                f"P plane: got fba_object_mask {objects}, of which no I plane was sent", where=self._where(),
                clause="FBA section 2",
            )  # fmt: skip
        costs = np.zeros_like(self.costs)
        status, end = k.DONE, reader.position
        if objects & FACE:
            status, end = self._decode_face(False, end, costs)
        if status == k.DONE:
            status, end = self._body.decode(False, self._bits, end)
        if status == k.NEED_MORE:
            if final:
                raise TruncatedError("P plane: cut off", where=self._where(), clause="FBA section 8")
            return False
        if status != k.DONE:
            raise self._error(status, end)
        self._keep(False, objects, self._header if objects & FACE else None, end, skip, costs)
        return True

    def _decode_face(
        self, intra: bool, at: int, costs: np.ndarray[tuple[int], np.dtype[np.float64]]
    ) -> tuple[int, int]:
        state = self._state
        status, end = k.decode_settled(
            intra, self._bits, at, state.fields, state.previous, state.models.decoding, self._found, self._flags, costs
        )
        return int(status), int(end)

    def _keep(self, intra: bool, objects: int, header: IntraHeader | None, end: int, skip: int, costs: Floats) -> None:
        """Take a plane that is settled for good."""
        if objects & BODY:
            self._body.keep(intra)
            self.body_planes += 1
        extent = np.array([[self._origin + self._at, self._origin + end, skip]], np.int64)
        self._at = end
        self._fresh = False
        if header is None:
            self._number += skip + 1
            return
        if len(self.costs):
            self.costs += costs
        state = self._state
        k.keep_plane(intra, self._found, state.fields, state.previous, state.models.decoding)
        self._header = header
        self._emit(self._found[:1].copy(), self._flags[None].copy(), extent, intra=intra)

    def _take_times(self, start: PlaneStart) -> None:
        # Deviation: a time code sets the clock at its plane and time goes on from there; a decoder of the reference
        # family gives all later planes the same time. 1000/1001 is applied exactly, where that decoder gets rate 0.

        now_s = self._time_s(self._number)
        if start.time_code is not None:
            now_s = float(start.time_code.total_s)
        if start.rate is not None:
            self._rate_hz = start.rate.hz
            self.rate = self.rate or start.rate
        if start.time_code is not None or start.rate is not None:
            self._anchor = (self._number, now_s)

    def _time_s(self, number: int) -> float:
        return self._anchor[1] + (number - self._anchor[0]) / self._rate_hz

    def _emit(self, values: Ints, flags: Ints, extents: Ints, *, intra: bool) -> None:
        assert self._header is not None
        numbers = self._number + np.concatenate([[0], np.cumsum(extents[:-1, 2] + 1)]).astype(np.int64)
        self._number = int(numbers[-1] + extents[-1, 2] + 1)
        times_s = self._anchor[1] + (numbers - self._anchor[0]) / self._rate_hz
        self._out.append(
            Planes(header=self._header, intra=intra, values=values, flags=flags, extents=extents, numbers=numbers,
                   times_s=times_s)
        )  # fmt: skip

    def _error(self, status: int, detail: int) -> DataError:
        where, clause = self._where(), CLAUSES[status]
        if status == k.BAD_MASK:
            return ConformanceError("fba_object_mask: got 0, expected 1 to 3", where=where, clause=clause)
        if status == k.BAD_SKIP:
            return ConformanceError(f"frames to skip: got more than {k.SKIP_LIMIT}", where=where, clause=clause)
        if status == k.BAD_STUFFING:
            return ConformanceError("arithmetic data: got 23 zeros, expected a stuffed one", where=where, clause=clause)
        name = f"FAP {FIELD_FAPS[detail]} ({FIELD_NAMES[detail]})"
        return ConformanceError(f"{name}: got a value that it cannot have", where=where, clause=clause)

    def _search(self, *, final: bool) -> bool:
        start = self._searching_from
        assert start is not None
        intact = find_intact_intra(self._bits, start, self._state, self._header, bodies=self._body.begun, final=final)
        if intact is None:
            if final:
                self.losses[-1].end_bit = self._origin + len(self._bits)
                self.ended = True
            return False
        self.losses[-1].end_bit = self._origin + intact
        self._searching_from, self._at = None, intact
        self._begun = True
        self._header = None
        self._fresh = True
        return True

    def _trim(self) -> None:
        """Forget what has been decoded; where resynchronising is on, only what can no longer be searched."""
        done = self._at
        if self._searching_from is not None:
            done = self._searching_from = max(self._searching_from, len(self._bits) - SEARCHED_BITS)
        elif self._resync:
            done = min([done, *(int(part.extents[0, 0]) - self._origin for part in self._out[:1])])
        whole = max(done - CODE_BITS if self._resync else done, 0) // 8 * 8
        if whole:
            self._bits = self._bits[whole:]
            self._origin += whole
            self._at = max(self._at - whole, 0)
            if self._searching_from is not None:
                self._searching_from -= whole

    def _where(self) -> str:
        return place(self._origin + self._at)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Decoded:
    """A whole stream."""

    track: FapTrack
    """Track as sent: what no mask selects is 0, blends are not clamped."""
    planes: tuple[Planes, ...]
    losses: tuple[Loss, ...] = ()
    body_planes: int = 0
    """Planes that carried body parameters, which are left out."""
    costs: np.ndarray[tuple[int], np.dtype[np.float64]] = field(default_factory=lambda: np.zeros(0))
    """(73,) float64, bits a field; empty unless asked for."""


def decode(data: bytes, *, errors: Errors = "strict", with_costs: bool = False) -> Decoded:
    """Decode a whole stream.

    Parameters
    ----------
    data : bytes
        From the first start code on.
    errors, with_costs
        As :class:`Decoder`.
    """
    decoder = Decoder(errors=errors, with_costs=with_costs)
    planes = decoder.feed_planes(data)
    planes += decoder.close_planes()
    if decoder.trouble is not None:
        raise decoder.trouble
    if not planes:
        raise DataError("contains no frame", where=place(0))
    values = np.concatenate([part.values for part in planes])
    flags = np.concatenate([part.flags for part in planes])
    numbers = np.concatenate([part.numbers for part in planes])
    mask = np.concatenate([np.broadcast_to(part.header.mask, (len(part), 68)) for part in planes])
    track = track_of(values, flags, mask, numbers, rate_hz=decoder.rate_hz)
    return Decoded(
        track=track, planes=tuple(planes), losses=tuple(decoder.losses), body_planes=decoder.body_planes,
        costs=decoder.costs,
    )  # fmt: skip

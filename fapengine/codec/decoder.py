"""The decoder: bytes to frames, incrementally, and with recovery after damage.

Theory of operation
-------------------
Bits stay in a buffer until a plane is *settled*: it decodes the same whatever follows. So feeding byte by byte gives
the same frames as feeding everything at once. For any bytes the decoder returns frames or raises :class:`DataError`;
its time and memory are linear in the length of the data.

A body next to the face (:mod:`fapengine.codec.planes`) is decoded and ignored: planes with BAPs leave the fast loop and
are decoded one by one. A plane with BAPs only is a frame in which the face does not move; it counts as skipped.

With ``errors="resync"`` an error becomes a :class:`Loss`, and decoding continues at the next I plane that can be
trusted (see below). Damage is detected a few planes late: noise passes for a plane header with a
probability of 1/8. So the last :data:`HELD` frames are held back until the planes after them have been decoded, and
discarded if that fails; the search then starts after the first of them. Frames from before the damage are kept, so
each damage causes a bounded number of searches.

Search for the next I plane after damage
----------------------------------------
An I plane may follow a plane start code, which is a byte pattern. Without one, it may start at any bit, and noise
matches the fixed bits of a header with a probability of about 1/16,000. A candidate is accepted if a start code
precedes it, if its quantiser and masks equal those of the last good header (at least 35 bits), or if a run of planes
decodes after it; noise decodes as one more plane with a probability of 1/8.
"""

import copy
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from fapengine._strict_toml import checked
from fapengine.codec import bits
from fapengine.codec import header as headers
from fapengine.codec import kernels as k
from fapengine.codec.bits import PLANE_START, BitReader, Bits, place, unpack
from fapengine.codec.fields import FIELD_COUNT, Ints, track_of
from fapengine.codec.header import BODY, IntraHeader, read_face_header, read_plane_start
from fapengine.codec.planes import BodyState, FieldState, Frame, Loss, Planes, PlaneState
from fapengine.errors import ConformanceError, DataError, TruncatedError, UsageError
from fapengine.mpeg4.track import FapTrack

Errors = Literal["strict", "resync"]
Floats = NDArray[np.float64]
HELD = 4
"""Frames held back with ``errors="resync"``: four wrong planes in a row decode with a probability of 8**-4."""
DEFAULT_RATE = headers.FrameRate(30)
"""Frame rate until one is sent (FBA section 10)."""
AT_ONCE = 256
"""Greatest number of planes that one call of the fast loop decodes."""
CODE_BITS = 32
NO_COSTS: Floats = np.zeros(0)
SEARCHED_BITS = 1 << 20
"""Greatest number of bits of a live stream that are searched for an I plane; each piece that is fed repeats it."""
REASONS = {
    k.BAD_MASK: ("fba_object_mask: got 0, expected 1 to 3", "FBA section 2"),
    k.BAD_STUFFING: ("arithmetic data: got 23 zeros, expected a stuffed one", "FBA section 7"),
    k.BAD_SKIP: (f"frames to skip: got more than {k.SKIP_LIMIT}", "FBA section 10"),
}
"""Message and clause for each status of the loops that is an error whatever the field."""


class Decoder:
    """Decodes a stream as its bytes arrive.

    Stateful.

    Parameters
    ----------
    errors : "strict" or "resync"
        Damage ends the stream with an error, or costs frames and is listed in ``losses``.
    with_costs : bool
        Count the bits of each field in ``costs``; slower.

    Examples
    --------
    >>> worked_example = bytes.fromhex(
    ...     "000001BA B19001B5 8000924B 24802988 3E848614 006C7D28 52D17D70 05A17F00 0001B1")
    >>> decoder = Decoder()
    >>> [frame.fap(48) for frame in decoder.feed(worked_example)]
    [-1020, -680, -680]
    """

    @checked
    def __init__(self, *, errors: Errors = "strict", with_costs: bool = False) -> None:
        self.losses: list[Loss] = []
        self.ended = False
        """The end code was read; bytes after it are ignored."""
        self.rate: headers.FrameRate | None = None
        """First frame rate that was sent."""
        self.costs = np.zeros(FIELD_COUNT if with_costs else 0)
        """(73,) float64, bits: information of all symbols of each field."""
        self.body_planes = 0
        """Planes with body parameters, which are ignored."""
        self._resync = errors == "resync"
        self._state = PlaneState()
        self._body = BodyState()
        self._bits: Bits = np.zeros(0, np.uint8)
        self._at = 0
        self._origin = 0
        """Bits of the stream before ``_bits``."""
        self._begun = False
        self._header: headers.IntraHeader | None = None
        self._fresh = False
        """A start code was just read."""
        self._searching_from: int | None = None
        self.trouble: DataError | None = None
        """The error that the next call will raise."""
        self._number = 0
        self._anchor = (0, 0.0)
        """Frame number and time from which times count."""
        self._rate_hz = DEFAULT_RATE.hz
        self._out: list[Planes] = []
        self._safe: list[Planes] = []
        """Decoded before the last damage and far enough from it to be certain."""
        self._dropped_to = 0
        """Bit after the last plane that was discarded; planes before it are already counted as lost."""

    def feed(self, data: bytes) -> list[Frame]:
        """Add bytes, and return the frames that they complete.

        Raises
        ------
        DataError
            If the stream is damaged: at the call after the one that returned the last good frames.
        """
        return [frame for planes in self.feed_planes(data) for frame in planes.frames()]

    def close(self) -> list[Frame]:
        """Declare the end of the data: bits after it read as 0. Returns the last frames.

        Raises
        ------
        TruncatedError
            If there was no end code; with ``errors="resync"`` that is a loss instead.
        """
        return [frame for planes in self.close_planes() for frame in planes.frames()]

    def feed_planes(self, data: bytes) -> list[Planes]:
        """Like :meth:`feed`, but returns frames in blocks of arrays."""
        if not isinstance(data, bytes | bytearray | memoryview):
            raise UsageError(f"data: got {data!r:.40}, expected bytes")
        if self.trouble is not None:
            raise self.trouble
        if not self.ended and data:
            self._bits = np.concatenate([self._bits, unpack(data)])
            self._run(final=False)
        ready = self._hand_out(everything=self.ended or not self._resync)
        if self._resync:
            self._trim()
        return ready

    def close_planes(self) -> list[Planes]:
        """Like :meth:`close`, but returns frames in blocks of arrays."""
        self._run(final=True)
        if self.trouble is not None and not (self._out or self._safe):
            raise self.trouble
        self.ended = True
        return self._hand_out(everything=True)

    @property
    def waiting_bits(self) -> int:
        """Number of bits in the buffer: not yet decoded, or needed if a search starts."""
        return len(self._bits)

    @property
    def rate_hz(self) -> float:
        """First frame rate of the stream; 30 until one is sent."""
        return (self.rate or DEFAULT_RATE).hz

    def _hand_out(self, *, everything: bool) -> list[Planes]:
        """Return the planes decoded so far, and hold the last frames back unless ``everything`` is wanted."""
        safe, ready, self._safe, self._out = self._safe, self._out, [], []
        room = 0 if everything else HELD
        while ready and room:
            last = ready.pop()
            head, tail = last.split(max(0, len(last) - room))
            self._out.insert(0, tail)
            room -= len(tail)
            if len(head):
                ready.append(head)
        return safe + ready

    def _run(self, *, final: bool) -> None:
        """Decode until more bytes are needed; :class:`TruncatedError` says so."""
        while not self.ended and self.trouble is None:
            try:
                if self._searching_from is not None:
                    self._search(final=final)
                elif not self._begun:
                    self._at = 8 * bits.skip_preamble(np.packbits(self._bits).tobytes())
                    self._begun = self._fresh = True
                elif self._header is None:
                    self._first_plane(final=final)
                else:
                    self._planes(final=final)
            except TruncatedError as error:
                if not final:
                    return
                self._lose(error)
            except DataError as error:
                self._lose(error)

    def _lose(self, error: DataError) -> None:
        """Record an error; with resynchronisation, drop the frames held back and start a search."""
        if not self._resync:
            self.trouble = error
            return
        start = self._origin + self._at
        if isinstance(error, TruncatedError):  # nothing is wrong with what was decoded
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
        if last is not None and last.end_bit is not None and start <= last.end_bit:  # the same damage again
            last.end_bit, last.frames_dropped = None, last.frames_dropped + dropped
        else:
            self.losses.append(Loss(start_bit=start, end_bit=None, frames_dropped=dropped, reason=str(error)))
        self._searching_from = max(start + 1 - self._origin, 0)

    def _search(self, *, final: bool) -> None:
        """Look for an I plane from which decoding can continue."""
        assert self._searching_from is not None
        intact = find_intact_intra(
            self._bits, self._searching_from, self._state, self._header, bodies=self._body.begun, final=final
        )
        if intact is None and not final:
            raise TruncatedError("I plane: not found yet")
        self.losses[-1].end_bit = self._origin + (len(self._bits) if intact is None else intact)
        if intact is None:
            self.ended = True
            return
        self._searching_from, self._at, self._header = None, intact, None
        self._begun = self._fresh = True

    def _first_plane(self, *, final: bool) -> None:
        """Decode what comes first, or first after damage: an I plane, a body, or a start code."""
        left = len(self._bits) - self._at
        if not left:
            raise TruncatedError("contains no plane", where=self._where())
        code = k.code_after(self._bits, self._at)
        if self._bits[self._at]:
            self._intra()
        elif self._body.begun and left >= 2 and self._bits[self._at + 1]:
            self._with_body()
        elif code == -2 and not final:
            raise TruncatedError("first plane: cut off", where=self._where())
        elif code < 0:
            raise ConformanceError("first plane: got a P plane, expected an I plane", where=self._where(),
                                   clause="FBA section 1")  # fmt: skip
        else:
            self._start_code(code)

    def _planes(self, *, final: bool) -> None:
        """Decode P planes in the fast loop, and then what stopped it."""
        state = self._state
        values = np.zeros((AT_ONCE, FIELD_COUNT), np.int64)
        flags, extents = np.zeros((AT_ONCE, 3), np.int64), np.zeros((AT_ONCE, 3), np.int64)
        count, self._at, status, detail = k.loops.decode_predicted(
            self._bits, self._at, self._fresh, final, state.fields, state.previous, state.decoding, state.found,
            state.flags, self.costs, values, flags, extents,
        )  # fmt: skip
        if count:
            self._fresh = False
            extents[:, :2] += self._origin
            self._emit(values[:count].copy(), flags[:count].copy(), extents[:count].copy(), intra=False)
        if status == k.INTRA_NEXT:
            self._intra()
        elif status == k.WITH_BODY or (status == k.AT_CODE and self._is_body_plane()):
            self._with_body()
        elif status == k.AT_CODE:
            self._start_code(detail)
        elif status not in (k.FULL, k.NEED_MORE):
            raise self._error(status, state, detail)
        if not self._resync:
            self._trim()
        if status == k.NEED_MORE:
            raise TruncatedError("stream: ends without its end code", where=self._where(), clause="FBA section 1")

    def _start_code(self, code: int) -> None:
        if code in (bits.PLANE_START, bits.OLD_PLANE_START):
            self._at, self._fresh = (self._at // 8 + 1) * 8 + CODE_BITS, True
        elif 0xB0 <= code <= 0xBF:
            self.ended = True
        else:
            raise ConformanceError(f"first plane: got start code {code:02x}, expected a plane", where=self._where())

    def _intra(self) -> None:
        """Decode an I plane."""
        reader = BitReader(self._bits, self._at + 1, self._origin)
        start = headers.read_plane_start(reader)
        header = headers.read_face_header(reader, start) if start.objects & headers.FACE else None
        before, costs = self._state.ranges, np.zeros_like(self.costs)
        try:
            if header is not None:
                self._state.begin_intra(header)
                reader.position = self._decode(self._state, True, reader.position, costs)
            if start.objects & headers.BODY:
                self._body.begin_intra(reader)
                reader.position = self._decode(self._body, True, reader.position)
        except TruncatedError:
            self._state.ranges = before
            raise
        self._take_times(start)
        self._keep(True, start.objects, header, reader.position, start.skip, costs)

    def _is_body_plane(self) -> bool:
        """Distinguish a P plane with a body before a start code from stuffing, which is a 0 and ones."""
        stuffing = self._bits[self._at : (self._at // 8 + 1) * 8]
        return self._body.begun and len(stuffing) > 2 and bool(stuffing[1]) and not stuffing[1:].all()

    def _with_body(self) -> None:
        """Decode a P plane with BAPs."""
        reader = BitReader(self._bits, self._at + 1, self._origin)
        objects, skip = reader.read(2, "fba_object_mask"), headers.read_skip(reader)
        header = self._header if objects & headers.FACE else None
        if not self._body.begun or (objects & headers.FACE and header is None):
            raise ConformanceError(
                f"P plane: got fba_object_mask {objects}, of which no I plane was sent", where=self._where(),
                clause="FBA section 2",
            )  # fmt: skip
        costs, end = np.zeros_like(self.costs), reader.position
        if header is not None:
            end = self._decode(self._state, False, end, costs)
        end = self._decode(self._body, False, end)
        self._keep(False, objects, header, end, skip, costs)

    def _decode(self, state: FieldState, intra: bool, at: int, costs: Floats = NO_COSTS) -> int:
        """Decode the arithmetic data of one plane; returns the bit after them."""
        status, end = state.decode(intra, self._bits, at, costs)
        if status == k.NEED_MORE:
            raise TruncatedError(f"{'I' if intra else 'P'} plane: cut off", where=self._where(), clause="FBA section 8")
        if status != k.DONE:
            raise self._error(status, state, end)
        return end

    def _keep(
        self, intra: bool, objects: int, header: headers.IntraHeader | None, end: int, skip: int, costs: Floats
    ) -> None:
        """Keep a plane that is settled; without a ``header`` it has a body only."""
        if objects & headers.BODY:
            self._body.keep(intra)
            self.body_planes += 1
        extent = np.array([[self._origin + self._at, self._origin + end, skip]], np.int64)
        self._at, self._fresh = end, False
        if header is None:
            self._number += skip + 1
            return
        if len(self.costs):
            self.costs += costs
        state = self._state
        state.keep(intra)
        self._header = header
        self._emit(state.found[:1].copy(), state.flags[None].copy(), extent, intra=intra)

    def _take_times(self, start: headers.PlaneStart) -> None:
        """Set the clock and the frame rate from an I plane."""
        # Deviation: a time code sets the clock at its plane and time goes on from there; a decoder of the reference
        # family gives all later planes the same time. 1000/1001 is applied exactly, where that decoder gets rate 0.

        now_s = self._anchor[1] + (self._number - self._anchor[0]) / self._rate_hz
        if start.time_code is not None:
            now_s = float(start.time_code.total_s)
        if start.rate is not None:
            self._rate_hz = start.rate.hz
            self.rate = self.rate or start.rate
        if start.time_code is not None or start.rate is not None:
            self._anchor = (self._number, now_s)

    def _emit(self, values: Ints, flags: Ints, extents: Ints, *, intra: bool) -> None:
        assert self._header is not None
        numbers = self._number + np.concatenate([[0], np.cumsum(extents[:-1, 2] + 1)]).astype(np.int64)
        self._number = int(numbers[-1] + extents[-1, 2] + 1)
        times_s = self._anchor[1] + (numbers - self._anchor[0]) / self._rate_hz
        self._out.append(
            Planes(header=self._header, intra=intra, values=values, flags=flags, extents=extents, numbers=numbers,
                   times_s=times_s)
        )  # fmt: skip

    def _error(self, status: int, state: FieldState, field: int) -> DataError:
        if status in REASONS:
            message, clause = REASONS[status]
        else:
            message, clause = f"{state.names[field]}: got a value that it cannot have", "FBA section 9"
        return ConformanceError(message, where=self._where(), clause=clause)

    def _trim(self) -> None:
        """Drop bits that were decoded; with resynchronisation, only those that no search can need."""
        done = self._at
        if self._searching_from is not None:
            done = self._searching_from = max(self._searching_from, len(self._bits) - SEARCHED_BITS)
        elif self._resync:
            done = min([done, *(int(part.extents[0, 0]) - self._origin for part in self._out[:1])])
        whole = max(done - CODE_BITS if self._resync else done, 0) // 8 * 8
        self._bits, self._origin, self._at = self._bits[whole:], self._origin + whole, max(self._at - whole, 0)
        if self._searching_from is not None:
            self._searching_from -= whole

    def _where(self) -> str:
        return place(self._origin + self._at)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Decoded:
    """A whole stream."""

    track: FapTrack
    """Track as sent: FAPs that are not sent are 0, blends are not clamped."""
    planes: tuple[Planes, ...]
    losses: tuple[Loss, ...]
    body_planes: int
    """Planes with body parameters, which are ignored."""
    costs: Floats
    """(73,) float64, bits of each field; empty unless asked for."""


def decode(data: bytes, *, errors: Errors = "strict", with_costs: bool = False) -> Decoded:
    """Decode a whole stream.

    Parameters
    ----------
    data : bytes
        From the first start code on.
    errors, with_costs
        See :class:`Decoder`.
    """
    decoder = Decoder(errors=errors, with_costs=with_costs)
    planes = decoder.feed_planes(data) + decoder.close_planes()
    if decoder.trouble is not None:
        raise decoder.trouble
    if not planes:
        raise DataError("contains no frames", where=place(0))
    values, flags, numbers, mask = (
        np.concatenate(parts)
        for parts in zip(
            *((p.values, p.flags, p.numbers, np.broadcast_to(p.header.mask, (len(p), 68))) for p in planes), strict=True
        )
    )
    track = track_of(values, flags, mask, numbers, rate_hz=decoder.rate_hz)
    return Decoded(
        track=track, planes=tuple(planes), losses=tuple(decoder.losses), body_planes=decoder.body_planes,
        costs=decoder.costs,
    )  # fmt: skip


PROOF = 8
"""Planes that must decode after a candidate with an unknown header: noise does so with probability 8**-8."""
PLANE_CODE_BITS = np.unpackbits(np.array([0, 0, 1, PLANE_START], np.uint8))


def find_intact_intra(
    bits: Bits, start: int, state: PlaneState, last: IntraHeader | None, *, bodies: bool, final: bool
) -> int | None:
    """Return the first bit of the next I plane that can be trusted; None if it has not come yet.

    Parameters
    ----------
    bits : (N,) uint8
        One bit per byte, whole bytes of the stream.
    start : int
        First bit to try.
    state : PlaneState
        Its ranges stay in force; it is not changed.
    last : IntraHeader or None
        Last good header.
    bodies : bool
        Planes may carry a body after the face. Such a plane is accepted by its start code or its masks only.
    final : bool
        No more bits will come.
    """
    candidate = k.loops.find_intra(bits, start, bodies)
    while candidate >= 0:
        verdict = _is_intact(bits, int(candidate), state, last, final=final)
        if verdict is not False:
            return int(candidate) if verdict else None
        candidate = k.loops.find_intra(bits, candidate + 1, bodies)
    return None


def _is_intact(bits: Bits, at: int, state: PlaneState, last: IntraHeader | None, *, final: bool) -> bool | None:
    """Check a candidate; None where more bits are needed."""
    reader = BitReader(bits, at + 1)
    try:
        start = read_plane_start(reader)
        header = read_face_header(reader, start)
    except DataError:
        return False
    trial = copy.deepcopy(state)
    trial.begin_intra(header)
    no_costs = np.zeros(0)
    status, end = trial.decode(True, bits, reader.position, no_costs)
    if status == k.NEED_MORE and not final:
        return None
    if status != k.DONE:
        return False
    is_announced = at % 8 == 0 and at >= 32 and np.array_equal(bits[at - 32 : at], PLANE_CODE_BITS)
    if is_announced or (last is not None and _shape(header) == _shape(last)):
        return True
    if start.objects & BODY:
        return False
    trial.keep(True)
    values, flags, extents = (np.zeros((PROOF, n), np.int64) for n in (FIELD_COUNT, 3, 3))
    count, _, status, _ = k.loops.decode_predicted(
        bits, end, False, final, trial.fields, trial.previous, trial.decoding, trial.found, trial.flags, no_costs,
        values, flags, extents,
    )  # fmt: skip
    if status == k.NEED_MORE and not final:
        return None
    return bool(count == PROOF or status == k.AT_CODE)


def _shape(header: IntraHeader) -> tuple[int, tuple[int, ...], bytes, int]:
    return header.quant, header.mask_types, header.mask.tobytes(), header.gender

"""The encoder: tracks and live frames to streams, with every choice that the format leaves open.

Theory of operation
-------------------
A stream consists of groups: an I plane and the P planes up to the next one. Whole tracks are coded group by group. Each
group may be coded several times: with ranges from the table or fitted to it, with coarser or finer quantisers; the
shortest result within the limits is written. Live frames are coded once: their ranges come from a sliding window, and
the quantiser follows the size of the last group. Every decoder can read the result.
"""

import copy
import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fapengine._strict_toml import check_fields, checked
from fapengine.codec import kernels as k
from fapengine.codec.fields import (
    FIELD_COUNT,
    LOW_LEVEL_FIELDS,
    MAX_SENT,
    UNIT,
    Bools,
    Ints,
    SentRanges,
    default_ranges,
    rows_of,
)
from fapengine.codec.header import FrameRate, IntraHeader, mask_types_of
from fapengine.codec.planes import BLENDS, STEPS, PlaneState
from fapengine.codec.writer import StreamWriter, check_selects
from fapengine.errors import UsageError
from fapengine.mpeg4 import fap
from fapengine.mpeg4.fapu import Fapu
from fapengine.mpeg4.track import FapTrack

SECONDS_A_GROUP = 10.0
"""Default I plane period of rate control: short enough to react, long enough for the models to adapt."""
SOONEST_S, PATIENCE_S = 1.0, 3.0
"""Shortest live group; and a live group ends early when it exceeds its bits by this many seconds' worth."""
WINDOW_S = 20.0
"""Live ranges contain the values of this time before now."""
MARGIN = 1.5
"""Factor by which live ranges are wider than those values."""
FIRST_QUANT = 12
"""Quantiser of the first live group with rate control."""
FLOOR = 3
"""Live ranges of P planes are at least the table's divided by this, so that no FAP lags by more than a few frames."""
FAR = 10_000
"""Greater than every symbol."""


@dataclass(frozen=True, slots=True, kw_only=True)
class EncoderOptions:
    """Options of the encoder."""

    quant: int = 1
    """fap_quant, 0 (off) to 31."""
    intra_every: int = 0
    """Frames from one I plane to the next; 0: only where masks change."""
    ranges: Literal["table", "fitted"] = "table"
    """``fitted``: ranges are sent where that makes a group shorter than the table's ranges do."""
    kbit_s: float | None = None
    """Target rate: the quantiser is chosen for each group, and ``quant`` is the finest one allowed."""
    moving_only: bool = False
    """Do not send FAPs that keep the value which the decoder shows."""
    max_error_mm: float | None = None
    """Greatest error of a feature point: the coarsest quantiser that keeps it replaces ``quant``; requires ``fapu``."""
    fapu: Fapu | None = None
    """Units of the face for which ``max_error_mm`` holds."""
    plane_start_codes: Literal["none", "intra", "all"] = "none"
    """``all`` costs 40 bits per plane; each live frame then has whole bytes."""
    unsent: Literal["keep", "interpolate"] = "keep"
    """What decoders do with FAPs that are not sent: mask types 0 and 1, or 2."""

    def __post_init__(self) -> None:
        check_fields(self)
        if not 0 <= self.quant <= MAX_QUANT:
            raise UsageError(f"quant: must be 0 to {MAX_QUANT}, got {self.quant}")
        if self.intra_every < 0:
            raise UsageError(f"intra_every: must be 0 or more frames, got {self.intra_every}")
        if self.kbit_s is not None and not (np.isfinite(self.kbit_s) and self.kbit_s > 0):
            raise UsageError(f"kbit_s: must be a positive rate, got {self.kbit_s}")
        if self.max_error_mm is not None and (self.fapu is None or not self.max_error_mm > 0):
            raise UsageError(f"max_error_mm: got {self.max_error_mm} with fapu {self.fapu}, expected mm > 0 and a face")
        if self.max_error_mm is not None and self.kbit_s is not None:
            raise UsageError("max_error_mm and kbit_s: got both, expected one")

    def group_frames(self, rate_hz: float) -> int:
        """Frames from one I plane to the next, with the default of rate control."""
        if self.intra_every == 0 and self.kbit_s is not None:
            return max(1, round(SECONDS_A_GROUP * rate_hz))
        return self.intra_every


def encode(track: FapTrack, options: EncoderOptions | None = None) -> bytes:
    """Encode a whole track.

    Examples
    --------
    >>> still = FapTrack.from_values([[0] * 68] * 25, rate_hz=25.0)
    >>> len(encode(still, EncoderOptions(moving_only=True)))
    34
    """
    options = options or EncoderOptions()
    if not len(track):
        raise UsageError("track: contains no frames")
    values, flags = rows_of(track)
    values[:, BLENDS] = np.clip(values[:, BLENDS], 0, 63)
    check_selects(values[track.mask[:, 0]], True, False)
    check_selects(values[track.mask[:, 1]], False, True)
    skips = np.append(np.diff(track.frame_numbers) - 1, 0)
    writer = StreamWriter(clamp=True)
    budget = None if options.kbit_s is None else 0.0
    for first, end in _groups(track.mask, options.group_frames(track.rate_hz)):
        group = _Group(values[first:end], flags[first:end], skips[first:end], track.mask[first], options)
        if options.plane_start_codes != "none" and first:
            writer.plane_start_code()
        if budget is not None and options.kbit_s is not None:  # bits that a group leaves over go to the next one
            budget += 1000 * options.kbit_s / track.rate_hz * (end - first + int(skips[first:end].sum()))
        before = writer.bits
        group.code(writer, FrameRate.nearest(track.rate_hz) if first == 0 else None, budget)
        if budget is not None:
            budget -= writer.bits - before
    writer.finish()
    return writer.take()


def _groups(mask: Bools, every: int) -> list[tuple[int, int]]:
    """First frame and end of each group: a new one starts where masks change, and after ``every`` frames."""
    changes = 1 + np.flatnonzero((mask[1:] != mask[:-1]).any(1))
    pieces: list[tuple[int, int]] = []
    for start, end in itertools.pairwise([0, *changes.tolist(), len(mask)]):
        pieces += itertools.pairwise([*range(start, end, every or end - start), end])
    return pieces


@dataclass(frozen=True, slots=True, eq=False)
class _Group:
    """One I plane and its P planes, not yet coded."""

    values: Ints
    flags: Ints
    skips: Ints
    mask: Bools
    options: EncoderOptions

    def code(self, writer: StreamWriter, rate: FrameRate | None, budget: float | None) -> None:
        """Write the group in the shortest way; with a budget, with the finest quantiser that fits."""
        options = self.options
        mask = self.mask.copy()
        if options.moving_only:
            mask &= moving(self.values, writer.state.previous)
        quant = options.quant
        if options.max_error_mm is not None and options.fapu is not None:
            low_level = self.values[:, LOW_LEVEL_FIELDS]
            quant = coarsest_quant(low_level, mask[2:], options.fapu, options.max_error_mm)
        best = self._shortest(writer.state, mask, quant, rate, count=budget is not None)
        if budget is not None and best[1] > budget:
            low, high = max(quant, 1), MAX_QUANT
            best = self._shortest(writer.state, mask, high, rate)
            while high - low > 1:
                middle = (low + high) // 2
                trial = self._shortest(writer.state, mask, middle, rate)
                if trial[1] <= budget:
                    best, high = trial, middle
                else:
                    low = middle
        self._write(writer, best[0])

    def _shortest(
        self, state: PlaneState, mask: Bools, quant: int, rate: FrameRate | None, *, count: bool = True
    ) -> tuple[IntraHeader, int]:
        """Try the choices of ranges; returns the best header and its bits. Choices that clamp a value come last."""
        types = mask_types_of(mask, 2 if self.options.unsent == "interpolate" else 1)
        header = IntraHeader(quant, mask, types, rate=rate, skip=int(self.skips[0]))
        is_from_table = state.ranges is None or (
            state.quant == quant and np.array_equal(state.ranges, default_ranges(quant))
        )
        choices = [SentRanges()] if is_from_table else [SentRanges(), table_ranges()]
        if self.options.ranges == "fitted":
            levels, _ = quantise(self.values[:, LOW_LEVEL_FIELDS], quant)
            choices += [fit_ranges(levels, quant), fit_ranges(levels, quant, predicted_only=True)]
        if len(choices) == 1 and not count:
            return header, 0
        tried = []
        for index, ranges in enumerate(choices):
            candidate = replace(header, ranges=ranges)
            for clamp in (False, True):
                trial = StreamWriter(clamp=clamp)
                trial.state = copy.deepcopy(state)
                try:
                    self._write(trial, candidate)
                except UsageError:
                    continue
                tried.append((clamp, trial.bits, index, candidate))
                break
        _, bits, _, chosen = min(tried, key=lambda entry: entry[:3])
        return chosen, bits

    def _write(self, writer: StreamWriter, header: IntraHeader) -> None:
        writer.intra(header, self.values[0], self.flags[0])
        if self.options.plane_start_codes != "all":
            writer.predicted(self.values[1:], self.flags[1:], self.skips[1:])
            return
        for t in range(1, len(self.values)):
            writer.plane_start_code()
            writer.predicted(self.values[t : t + 1], self.flags[t : t + 1], self.skips[t : t + 1])


class Encoder:
    """Encodes live frames.

    Stateful.

    Parameters
    ----------
    rate_hz : float
        Frame rate.
    faps : sequence of int
        FAP numbers to send; all low-level ones by default.
    options : EncoderOptions
        ``kbit_s`` and fitted ranges have an effect from the second I plane on, since they need past frames. An I plane
        is sent at once when a FAP that is not sent begins to move, and within a second when a value leaves a fitted
        range.

    Examples
    --------
    >>> encoder = Encoder(rate_hz=25.0)
    >>> stream = encoder.frame([0] * 68) + encoder.frame([0] * 68) + encoder.finish()
    >>> stream[:4].hex(), stream[-4:].hex()
    ('000001ba', '000001b1')
    """

    @checked
    def __init__(
        self, *, rate_hz: float, faps: Sequence[int] = tuple(range(3, 69)), options: EncoderOptions | None = None
    ) -> None:
        self.options = options or EncoderOptions()
        self._rate: FrameRate | None = FrameRate.nearest(rate_hz)
        self._rate_sent = self._rate
        self._rate_hz = rate_hz
        self._mask = np.zeros(fap.FAP_COUNT, bool)
        self._mask[fap.columns(*faps)] = True
        self._writer = StreamWriter(clamp=True)
        self._window: list[Ints] = []
        self._group_bits = self._group_planes = self._spent_bits = self._spent_planes = 0
        self._since_intra = 0
        self._intra_wanted = True
        self.quant = self.options.quant if self.options.kbit_s is None else max(self.options.quant, FIRST_QUANT)
        if self.options.max_error_mm is not None and self.options.fapu is not None:
            self.quant = guaranteed_quant(self._mask[2:], self.options.fapu, self.options.max_error_mm)
        self._ranges_quant = self.quant

    def request_intra(self) -> None:
        """Make the next frame an I plane with the frame rate, so that a new viewer can start with it."""
        self._intra_wanted, self._rate = True, self._rate_sent

    def frame(
        self,
        values: ArrayLike,
        *,
        viseme: Sequence[int] = (0, 0, 0, 0),
        expression: Sequence[int] = (0, 0, 0, 0, 0, 0),
        skip: int = 0,
    ) -> bytes:
        """Encode one frame.

        Parameters
        ----------
        values : (68,) array_like of int, FAPU
            Columns of FAP 1 and 2 are ignored.
        viseme, expression : sequence of 4 and of 6 int
            As in :class:`FapTrack`; used where FAP 1 and 2 are sent.
        skip : int
            Number of frames skipped after this one.

        Returns
        -------
        bytes
            Whole bytes; up to 7 bits are kept for the next call, unless ``plane_start_codes`` is "all".

        Raises
        ------
        UsageError
            If shapes are wrong, or a viseme or expression does not exist.
        """
        row, flags = self._lay_out(values, viseme, expression)
        if skip < 0:
            raise UsageError(f"skip: must be 0 or more, got {skip}")
        every = self.options.group_frames(self._rate_hz)
        intra = self._intra_wanted or (every > 0 and self._since_intra >= every)
        begun = self._writer.state.ranges is not None
        intra = intra or self._needs_intra(row) or self._overspent()
        if begun and (self.options.plane_start_codes == "all" or (intra and self.options.plane_start_codes == "intra")):
            self._writer.plane_start_code()
        before = self._writer.bits
        if intra:
            self._writer.intra(self._header(row, skip), row, flags)
            self._intra_wanted, self._since_intra = False, 0
            self._group_bits = self._group_planes = 0
        else:
            self._writer.predicted(row[None], flags[None], np.array([skip], np.int64))
        bits, planes = self._writer.bits - before, 1 + skip
        self._since_intra += 1
        self._group_bits, self._group_planes = self._group_bits + bits, self._group_planes + planes
        self._spent_bits, self._spent_planes = self._spent_bits + bits, self._spent_planes + planes
        self._window = [*self._window, row][-max(2, round(WINDOW_S * self._rate_hz)) :]
        if self.options.plane_start_codes == "all":
            self._writer.align()
        return self._writer.take()

    def finish(self) -> bytes:
        """End the stream; at least one frame must have been encoded."""
        self._writer.finish()
        return self._writer.take()

    def _lay_out(self, values: ArrayLike, viseme: Sequence[int], expression: Sequence[int]) -> tuple[Ints, Ints]:
        array = np.asarray(values)
        if array.shape != (fap.FAP_COUNT,) or array.dtype.kind not in "iu":
            raise UsageError(f"values: got shape {array.shape} of {array.dtype}, expected (68,) of integers")
        if len(viseme) != 4 or len(expression) != 6:
            raise UsageError(f"viseme, expression: got {len(viseme)} and {len(expression)} numbers, expected 4 and 6")
        row = np.zeros(FIELD_COUNT, np.int64)
        row[:3], row[3:7], row[LOW_LEVEL_FIELDS] = viseme[:3], expression[:4], array[2:]
        row[list(BLENDS)] = np.clip(row[list(BLENDS)], 0, 63)
        check_selects(row[None], bool(self._mask[0]), bool(self._mask[1]))
        return row, np.array([viseme[3], *expression[4:]], np.int64)

    def _header(self, row: Ints, skip: int) -> IntraHeader:
        options, state = self.options, self._writer.state
        seen = np.array([*self._window, row])
        mask = self._mask & moving(seen, state.previous) if options.moving_only and self._window else self._mask
        quant = self._next_quant()
        ranges = SentRanges()
        if options.ranges == "fitted" and len(self._window) > 1:
            levels, _ = quantise(seen[:, LOW_LEVEL_FIELDS], quant)
            fitted, table = fit_ranges(levels, quant, margin=MARGIN), table_ranges()
            predicted = (
                None if mine is None or wide is None else np.maximum(mine, -(-wide // FLOOR))
                for mine, wide in zip(fitted[2:], table[2:], strict=True)
            )
            ranges = SentRanges(*table[:2], *predicted)  # an I plane must hold any pose
        elif state.ranges is not None and quant != self._ranges_quant:
            ranges, self._ranges_quant = table_ranges(), quant
        self.quant = quant
        rate, self._rate = self._rate, None
        types = mask_types_of(mask, 2 if options.unsent == "interpolate" else 1)
        return IntraHeader(quant, mask, types, ranges=ranges, rate=rate, skip=skip)

    def _needs_intra(self, row: Ints) -> bool:
        """Check for values that P planes cannot follow: outside a fitted range, or of a FAP that is not sent."""
        state, fields = self._writer.state, self._writer.state.fields
        if self.options.ranges == "table" and not self.options.moving_only:
            return False
        step, first, count = (fields[LOW_LEVEL_FIELDS, column] for column in (k.STEP, k.P_MIN, k.P_COUNT))
        sent = fields[LOW_LEVEL_FIELDS, k.ON] != 0
        wanted = (row - state.previous)[LOW_LEVEL_FIELDS]
        half = step // 2
        rationed = self.options.kbit_s is not None or self._since_intra < SOONEST_S * self._rate_hz
        if rationed:  # a few frames of lag cost less than many I planes
            first, count = first - FAR, count + 2 * FAR
        late = (wanted < first * step - half) | (wanted > (first + count - 1) * step + half)
        left_out = self._mask[2:] & ~sent & (np.abs(wanted) > half)
        new_viseme = self._mask[:2] & ~self._writer.state.mask[:2]
        moved = moving(row[None], state.previous)[:2]
        return bool((late & sent).any() or left_out.any() or (new_viseme & moved).any())

    def _overspent(self) -> bool:
        """Check for a group that must end early, because its quantiser is far too fine for the target rate."""
        if self.options.kbit_s is None or self.quant >= MAX_QUANT or self._since_intra < SOONEST_S * self._rate_hz:
            return False
        allowed = 1000 * self.options.kbit_s * (self._group_planes / self._rate_hz + PATIENCE_S)
        return self._group_bits > allowed

    def _next_quant(self) -> int:
        if self.options.kbit_s is None or not self._group_planes:
            return self.quant
        wanted = 1000 * self.options.kbit_s / self._rate_hz
        debt = (self._spent_bits - wanted * self._spent_planes) / self._group_planes  # paid back over the next group
        ratio = self._group_bits / self._group_planes / max(wanted - debt, wanted / 4)
        if 0.9 < ratio < 1.05:  # a change costs new ranges
            return self.quant
        return int(np.clip(round(max(self.quant, 1) * ratio**1.5), max(self.options.quant, 1), MAX_QUANT))


EYE_LEVER_MM = 12.0
"""Radius of an eyeball: how far a gaze error carries the pupil."""
HEAD_LEVER_MM = 120.0
"""Distance from the centre of head rotation to the farthest feature point of an adult head."""
TONGUE_LEVER = 0.25
"""Half the tongue's width as a fraction of the mouth width: the lever of tongue_roll."""
_EYES, _HEAD, _TONGUE_ROLL = slice(23 - 3, 27 - 3), slice(48 - 3, 51 - 3), 47 - 3
"""Rotations among FAP 3 to 68."""
MAX_QUANT = 31


def quantise(values: Ints, quant: int) -> tuple[Ints, Ints]:
    """Quantise low-level FAPs as an I plane and the P planes after it (FBA section 6), ignoring ranges.

    Parameters
    ----------
    values : (T, 66) int64, FAPU
    quant : int
        fap_quant, 0 to 31.

    Returns
    -------
    levels : (T, 66) int64
        Row 0 absolute, the others differences.
    reconstructed : (T, 66) int64, FAPU
    """
    steps = STEPS * quant if quant else np.ones_like(STEPS)
    half = steps // 2
    levels, reconstructed = np.zeros_like(values), np.zeros_like(values)
    previous = np.zeros(values.shape[1], np.int64)
    for t, row in enumerate(values):
        wanted = row - previous
        size = np.abs(wanted)
        levels[t] = np.where(size <= half, 0, np.sign(wanted) * ((size + half) // steps))
        previous = previous + levels[t] * steps
        reconstructed[t] = previous
    return levels, reconstructed


def fit_ranges(levels: Ints, quant: int, *, margin: float = 1.0, predicted_only: bool = False) -> SentRanges:
    """Return the narrowest ranges that contain the levels of :func:`quantise`.

    Parameters
    ----------
    margin : float
        Factor on every bound, for future values.
    predicted_only : bool
        Leave the ranges of I planes unchanged.
    """
    scale = max(quant, 1) * margin
    intra, predicted = levels[:1], levels[1:]
    if not len(predicted):
        predicted = np.zeros_like(intra)
    bounds = np.array([intra.max(0), -intra.min(0), predicted.max(0), -predicted.min(0)])
    lists = np.clip(np.ceil(np.maximum(bounds, 0) * scale / UNIT), 0, MAX_SENT).astype(np.int64)
    column = fap.column(4) - 2
    lists[0, column] = max(lists[0, column], 1)  # a decoder of the reference family takes 0..0 for "not yet set"
    return SentRanges(None, None, *lists[2:]) if predicted_only else SentRanges(*lists)


def table_ranges() -> SentRanges:
    """Ranges of the table of FAPs, to be sent when the quantiser changes: a decoder keeps its ranges otherwise."""
    intra = [row.intra_limit for row in fap.FAPS]
    predicted = [row.predicted_limit for row in fap.FAPS]
    return SentRanges.covering(intra, np.negative(intra), predicted, np.negative(predicted))


def moving(values: Ints, held: Ints) -> Bools:
    """Find the FAPs that must be sent.

    Parameters
    ----------
    values : (T, 73) int64
    held : (73,) int64
        Values that the decoder shows now.

    Returns
    -------
    (68,) bool
        FAPs with a value other than the one shown.
    """
    differs = (values != held).any(0)
    return np.concatenate([[differs[:3].any(), differs[3:7].any()], differs[LOW_LEVEL_FIELDS]])


def point_errors_mm(errors: NDArray[np.float64], fapu: Fapu) -> NDArray[np.float64]:
    """Return the greatest possible error of each feature point.

    The FAPs of one point move it along different axes: their errors add as squares. Head rotation moves all points.

    Parameters
    ----------
    errors : (..., 66) float64, FAPU
        Errors of FAP 3 to 68.
    fapu : Fapu
        Units of the face that will be animated.

    Returns
    -------
    (..., 66) float64, mm
        For each FAP, the error of its feature point.
    """
    sizes = fapu.steps()[fap.column(3) :].copy()
    sizes[_EYES] *= EYE_LEVER_MM
    sizes[_HEAD] *= HEAD_LEVER_MM
    sizes[_TONGUE_ROLL] *= TONGUE_LEVER * fapu.mw0_mm
    mm = np.abs(errors) * sizes
    head = np.sqrt((mm[..., _HEAD] ** 2).sum(-1, keepdims=True))
    mm[..., _HEAD] = 0
    total: NDArray[np.float64] = np.sqrt(mm**2 @ _SAME_POINT) + head
    return total


_POINTS = np.array([row.point for row in fap.FAPS])
_SAME_POINT = (_POINTS[:, None] == _POINTS[None, :]).astype(np.float64)


def coarsest_quant(values: Ints, mask: Bools, fapu: Fapu, max_error_mm: float) -> int:
    """Return the largest fap_quant that keeps every feature point within ``max_error_mm``.

    Parameters
    ----------
    values : (T, 66) int64, FAPU
    mask : (66,) bool
        FAPs that are sent.

    Returns
    -------
    int
        1 to 31, or 0 (no quantiser) where even 1 is too coarse.
    """
    return _largest_quant(lambda quant: values - quantise(values, quant)[1], mask, fapu, max_error_mm)


def guaranteed_quant(mask: Bools, fapu: Fapu, max_error_mm: float) -> int:
    """Like :func:`coarsest_quant` for unknown values: every error may be half a step."""
    return _largest_quant(lambda quant: STEPS * quant // 2, mask, fapu, max_error_mm)


def _largest_quant(errors_at: Callable[[int], Ints], mask: Bools, fapu: Fapu, max_error_mm: float) -> int:
    for quant in range(MAX_QUANT, 0, -1):
        errors = np.where(mask, errors_at(quant), 0).astype(np.float64)
        if point_errors_mm(errors, fapu).max(initial=0.0) <= max_error_mm:
            return quant
    return 0

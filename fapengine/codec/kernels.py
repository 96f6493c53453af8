"""The adaptive arithmetic coder and the loops over fields and planes: all code that runs for every bit.

Theory of operation
-------------------
A symbol ``y`` of an alphabet of ``n`` has an interval of the sums ``c[j] = f[j] + ... + f[n-1]``; symbol 0 is at the
top. Counted from the other end, with rank ``r = n - 1 - y``, the interval is ``[prefix(r), prefix(r) + f[r])``. A
Fenwick tree keeps the prefix sums of changing counts: coding, finding and counting a symbol take log2(n) steps, not n.
A plane has up to 73 fields (:mod:`fapengine.codec.fields`) in up to three segments, each with its own flush. A table of
another length belongs to a body (:mod:`fapengine.codec.planes`), which has one segment and no flags.

Invariants: ``low <= V <= high``; the tree of every model contains the prefix sums of its counts; models change only
after a whole plane was decoded, so that an incomplete plane can be decoded again.

This module is the reference. :data:`loops` are these functions, or the same in C where ``fapengine[fast]`` is
installed; its ``src/codec.c`` has them by the same names, and gives the same bytes.
"""

import sys
from importlib import import_module
from typing import Any

import numpy as np

from fapengine.codec.fields import EXPRESSION_FIELDS, FIELD_COUNT, VISEME_FIELDS
from fapengine.mpeg4 import fap

HALF, QUARTER, THREE_QUARTERS, TOP = 32768, 16384, 49152, 65535
LIMIT = 16383
"""Largest total of a model's counts (FBA section 7)."""
ZERO_RUN = 22
"""Number of consecutive zeros of the coder after which a one is stuffed (FBA section 7)."""
SKIP_LIMIT = 100_000
"""Deviation: more skipped frames than this in one plane (over an hour at 25 Hz) count as damage; it limits the
time of a decoder that is fed byte by byte."""
MIN_PLANE_BITS = 5
"""Least number of bits of a P plane: three fixed, one for skipped frames, and one of data."""
LOOK_AHEAD = 14
"""Number of data bits that the decoder has read too far at the end of a segment."""
GROUP_SIZES = tuple(len(group) for group in fap.GROUPS)

A_END, B_END = VISEME_FIELDS.stop, EXPRESSION_FIELDS.stop

ON, STEP, I_MIN, I_COUNT, P_MIN, P_COUNT, MIN_VALUE, MAX_VALUE = range(8)
"""Columns of the (F, 8) table of fields: coded or not, quantiser step, first symbol and alphabet size of I and of P
planes, and the limits of the reconstruction."""

LOW, HIGH, PENDING, ZEROS, VALUE, READ, TAKEN, BAD = range(8)
"""Registers of the coder; encoding uses the first four."""

DONE, NEED_MORE, AT_CODE, INTRA_NEXT, FULL = 0, 1, 2, 3, 4
BAD_MASK, BAD_STUFFING, BAD_VALUE, WITH_BODY, BAD_SKIP = 5, 6, 7, 8, 9
"""Reasons why a decoding loop stopped."""


def reset_models(fields: Any, base: Any, counts: Any, tree: Any, totals: Any) -> None:
    """Make the P models of all coded fields uniform (FBA section 8)."""
    for field in range(fields.shape[0]):
        size = fields[field, P_COUNT] if fields[field, ON] else 0
        start = base[field]
        totals[field] = size
        for i in range(1, size + 1):
            counts[start + i] = 1
            tree[start + i] = i & -i


def _count(field: int, rank: int, fields: Any, base: Any, counts: Any, tree: Any, totals: Any) -> None:
    size = fields[field, P_COUNT]
    start = base[field]
    if totals[field] == LIMIT:
        total = 0
        for i in range(1, size + 1):
            counts[start + i] = (counts[start + i] + 1) >> 1
            total += counts[start + i]
            tree[start + i] = counts[start + i]
        for i in range(1, size + 1):
            parent = i + (i & -i)
            if parent <= size:
                tree[start + parent] += tree[start + i]
        totals[field] = total
    counts[start + rank + 1] += 1
    totals[field] += 1
    i = rank + 1
    while i <= size:
        tree[start + i] += 1
        i += i & -i


def _prefix(start: int, rank: int, tree: Any) -> int:
    total = 0
    while rank > 0:
        total += tree[start + rank]
        rank &= rank - 1
    return total


def _put(bit: int, out: Any, at: int, coder: Any) -> int:
    if coder[ZEROS] == ZERO_RUN:
        out[at] = 1
        at += 1
        coder[ZEROS] = 0
    out[at] = bit
    coder[ZEROS] = 0 if bit else coder[ZEROS] + 1
    return at + 1


def _emit(bit: int, out: Any, at: int, coder: Any) -> int:
    at = _put(bit, out, at, coder)
    for _ in range(coder[PENDING]):
        at = _put(1 - bit, out, at, coder)
    coder[PENDING] = 0
    return at


def _encode_symbol(under: int, over: int, total: int, out: Any, at: int, coder: Any) -> int:
    low, high = coder[LOW], coder[HIGH]
    length = high - low + 1
    high = low - 1 + length * over // total
    low += length * under // total
    while True:
        if high < HALF:
            at = _emit(0, out, at, coder)
        elif low >= HALF:
            at = _emit(1, out, at, coder)
            low -= HALF
            high -= HALF
        elif low >= QUARTER and high < THREE_QUARTERS:
            coder[PENDING] += 1
            low -= QUARTER
            high -= QUARTER
        else:
            break
        low = 2 * low
        high = 2 * high + 1
    coder[LOW], coder[HIGH] = low, high
    return at


def _flush(out: Any, at: int, coder: Any) -> int:
    coder[PENDING] += 1
    at = _emit(0 if coder[LOW] < QUARTER else 1, out, at, coder)
    coder[LOW], coder[HIGH], coder[PENDING], coder[ZEROS] = 0, TOP, 0, 0
    return at


def encode_plane(
    intra: bool, target: Any, flags: Any, fields: Any, previous: Any, models: Any, clamp: bool, out: Any, at: int
) -> int:
    """Write the arithmetic data of one plane (FBA sections 6 to 8) to ``out``, one bit per byte.

    Parameters
    ----------
    target : (F,) int64
        Values of the 73 fields of a face.
    flags : (3,) int64
        viseme_def, init_face, expression_def.
    previous : (F,) int64
        Last reconstruction; replaced by this plane's.
    models : tuple of arrays
        base, counts, tree, totals, coder.

    Returns
    -------
    int
        Bits in ``out``; or ``-1 - field`` if a symbol is out of range and ``clamp`` is off. Models are then invalid.
    """
    base, counts, tree, totals, coder = models
    coder[LOW], coder[HIGH], coder[PENDING], coder[ZEROS] = 0, TOP, 0, 0
    face = fields.shape[0] == FIELD_COUNT
    for field in range(fields.shape[0]):
        if face and field == A_END and fields[0, ON]:
            at = _flush(out, at, coder)
            out[at] = flags[0]
            at += 1
        if face and field == B_END and fields[A_END, ON]:
            at = _flush(out, at, coder)
            out[at] = flags[1]
            out[at + 1] = flags[2]
            at += 2
        if not fields[field, ON]:
            continue
        step = fields[field, STEP]
        first = fields[field, I_MIN] if intra else fields[field, P_MIN]
        size = fields[field, I_COUNT] if intra else fields[field, P_COUNT]
        before = 0 if intra else previous[field]
        wanted = target[field] - before
        half = step // 2
        magnitude = abs(wanted)
        level = 0 if magnitude <= half else (magnitude + half) // step
        if wanted < 0:
            level = -level
        symbol = level - first
        if symbol < 0 or symbol >= size:
            if not clamp:
                return -1 - field
            symbol = min(max(symbol, 0), size - 1)
        previous[field] = before + (symbol + first) * step
        rank = size - 1 - symbol
        if intra:
            at = _encode_symbol(rank, rank + 1, size, out, at, coder)
        else:
            start = base[field]
            under = _prefix(start, rank, tree)
            at = _encode_symbol(under, under + counts[start + rank + 1], totals[field], out, at, coder)
            _count(field, rank, fields, base, counts, tree, totals)
    return _flush(out, at, coder)


def encode_predicted(
    targets: Any, flags: Any, skips: Any, fields: Any, previous: Any, models: Any, clamp: bool, out: Any, at: int
) -> int:
    """Write P planes with their headers to ``out``; returns like :func:`encode_plane`."""
    for t in range(targets.shape[0]):
        out[at], out[at + 1], out[at + 2] = 0, 0, 1
        out[at + 3] = 1 if skips[t] else 0
        at += 4
        left = skips[t]
        while left >= 0 and skips[t]:
            part = min(left, 15)
            for k in range(4):
                out[at + k] = (part >> (3 - k)) & 1
            at += 4
            left = left - 15
        at = encode_plane(False, targets[t], flags[t], fields, previous, models, clamp, out, at)
        if at < 0:
            return at
    return at


def _raw(bits: Any, position: int, pad: int) -> int:
    return bits[position] if position < bits.shape[0] else pad


def _take(bits: Any, pad: int, coder: Any, positions: Any) -> int:
    position = coder[READ]
    if coder[ZEROS] == ZERO_RUN:
        if _raw(bits, position, pad):
            position += 1
        elif coder[BAD] < 0:
            coder[BAD] = coder[TAKEN]  # only an error if this data bit is still inside the segment
        coder[ZEROS] = 0
    bit = _raw(bits, position, pad)
    coder[READ] = position + 1
    coder[ZEROS] = 0 if bit else coder[ZEROS] + 1
    positions[coder[TAKEN] & 15] = position + 1
    coder[TAKEN] += 1
    return bit


def _open_segment(bits: Any, position: int, pad: int, coder: Any, positions: Any) -> None:
    coder[LOW], coder[HIGH], coder[VALUE] = 0, TOP, 0
    coder[READ], coder[TAKEN], coder[ZEROS], coder[BAD] = position, 0, 0, -1
    for _ in range(16):
        coder[VALUE] = 2 * coder[VALUE] + _take(bits, pad, coder, positions)


def _close_segment(coder: Any, positions: Any) -> int:
    end = coder[TAKEN] - LOOK_AHEAD
    if 0 <= coder[BAD] < end:
        return -1
    return int(positions[(end - 1) & 15])


def _narrow(under: int, over: int, total: int, bits: Any, pad: int, coder: Any, positions: Any) -> None:
    low, high, value = coder[LOW], coder[HIGH], coder[VALUE]
    length = high - low + 1
    high = low - 1 + length * over // total
    low = low + length * under // total
    while True:
        if high < HALF:
            shift = 0
        elif low >= HALF:
            shift = HALF
        elif low >= QUARTER and high < THREE_QUARTERS:
            shift = QUARTER
        else:
            break
        low = 2 * (low - shift)
        high = 2 * (high - shift) + 1
        value = 2 * (value - shift) + _take(bits, pad, coder, positions)
    coder[LOW], coder[HIGH], coder[VALUE] = low, high, value


def decode_plane(
    intra: bool, bits: Any, at: int, pad: int, fields: Any, previous: Any, models: Any, found: Any, flags: Any,
    costs: Any,
) -> tuple[int, int, int]:  # fmt: skip
    """Decode the arithmetic data of one plane; only ``found``, ``flags``, ``costs`` and the registers change.

    Parameters
    ----------
    bits : (N,) uint8
        One bit per byte; every bit after its end reads as ``pad``.
    found : (2, F) int64
        Receives the reconstruction and the ranks of the symbols.
    costs : (F,) float64, or empty
        The bits of each field are added to it.

    Returns
    -------
    status, end, read : int
        Why it stopped; the bit after the plane, or the wrong field; and the furthest bit that was read.
    """
    base, counts, tree, totals, coder, positions = models
    furthest = at
    opened = False
    count = fields.shape[0]
    face = count == FIELD_COUNT
    for field in range(count + 1):
        if field == count or (face and ((field == A_END and fields[0, ON]) or (field == B_END and fields[A_END, ON]))):
            if not opened:
                _open_segment(bits, at, pad, coder, positions)
            at = _close_segment(coder, positions)
            furthest = max(furthest, coder[READ])
            opened = False
            if at < 0:
                return BAD_STUFFING, field, furthest
            if face and field == A_END:
                flags[0] = _raw(bits, at, pad)
                at += 1
            elif face and field == B_END:
                flags[1] = _raw(bits, at, pad)
                flags[2] = _raw(bits, at + 1, pad)
                at += 2
        if field == count or not fields[field, ON]:
            continue
        if not opened:
            _open_segment(bits, at, pad, coder, positions)
            opened = True
        length = coder[HIGH] - coder[LOW] + 1
        if intra:
            size = fields[field, I_COUNT]
            rank = ((coder[VALUE] - coder[LOW] + 1) * size - 1) // length
            under, over, total = rank, rank + 1, size
        else:
            size, total, start = fields[field, P_COUNT], totals[field], base[field]
            sought = ((coder[VALUE] - coder[LOW] + 1) * total - 1) // length
            rank, under, jump = 0, 0, 4096
            while jump:
                if rank + jump <= size and under + tree[start + rank + jump] <= sought:
                    rank += jump
                    under += tree[start + rank]
                jump >>= 1
            over = under + counts[start + rank + 1]
        _narrow(under, over, total, bits, pad, coder, positions)
        first = fields[field, I_MIN] if intra else fields[field, P_MIN]
        value = (size - 1 - rank + first) * fields[field, STEP]
        if not intra:
            value += previous[field]
        if value < fields[field, MIN_VALUE] or value > fields[field, MAX_VALUE]:
            return BAD_VALUE, field, max(furthest, coder[READ])
        found[0, field] = value
        found[1, field] = rank
        if costs.shape[0]:
            costs[field] += np.log2(total / (over - under))
    return DONE, at, max(furthest, at)


def keep_plane(intra: bool, found: Any, fields: Any, previous: Any, models: Any) -> None:
    """Keep a decoded plane: the next one is predicted from it, and its symbols are counted."""
    for field in range(fields.shape[0]):
        if fields[field, ON]:
            previous[field] = found[0, field]
            if not intra:
                _count(field, found[1, field], fields, models[0], models[1], models[2], models[3])


def code_after(bits: Any, at: int) -> int:
    """Look for a start code after a plane (FBA section 3): at the next byte boundary, one byte later if already there.

    Like the reference family, this does not check the stuffing. But if the bits before the code begin like a P plane
    (0 0 1) and have room for the shortest one, they are a plane: stuffing is a 0 and ones. (Decoders of the reference
    family take it for stuffing, and lose the last frame of a face that does not move.)

    Returns
    -------
    int
        The last byte of the code; -1 if there is no code; -2 if more bits are needed to decide.
    """
    n = bits.shape[0]
    start = (at // 8 + 1) * 8
    for k in range(24):
        if start + k >= n:
            return -2
        if bits[start + k] != (1 if k == 23 else 0):
            return -1
    if start + 32 > n:
        return -2
    if start - at >= MIN_PLANE_BITS and not bits[at] and not bits[at + 1] and bits[at + 2]:
        return -1
    code = 0
    for k in range(24, 32):
        code = 2 * code + int(bits[start + k])
    return code


def decode_settled(
    intra: bool, bits: Any, at: int, fields: Any, previous: Any, models: Any, found: Any, flags: Any, costs: Any
) -> tuple[int, int]:  # fmt: skip
    """Decode a plane if the given bits settle it: the result is the same whatever follows them.

    Paddings of zeros and of ones bound every continuation, because the coder is monotone in its code value. ``found``
    is (4, F).

    Returns
    -------
    status, end : int
        ``NEED_MORE`` if the plane is not settled.
    """
    n = bits.shape[0]
    status, end, read = decode_plane(intra, bits, at, 0, fields, previous, models, found, flags, costs)
    if read <= n:
        return status, end
    if status != DONE or end > n:
        return NEED_MORE, end
    status, other, read = decode_plane(intra, bits, at, 1, fields, previous, models, found[2:], flags, costs)
    if status != DONE or other != end:
        return NEED_MORE, end
    for field in range(fields.shape[0]):
        if fields[field, ON] and found[0, field] != found[2, field]:
            return NEED_MORE, end
    return DONE, end


def decode_predicted(
    bits: Any, at: int, fresh: bool, final: bool, fields: Any, previous: Any, models: Any, found: Any, flags: Any,
    costs: Any, values: Any, value_flags: Any, extents: Any,
) -> tuple[int, int, int, int]:  # fmt: skip
    """Decode P planes until something else follows or ``values`` is full.

    Parameters
    ----------
    fresh : bool
        A start code was just read, so no other is expected before the first plane.
    values, value_flags, extents : (N, 73), (N, 3), (N, 3) int64
        Receive the reconstruction, the flags, and the first bit, the bit after the last, and the frames skipped.

    Returns
    -------
    count, at, status, detail : int
        Number of planes decoded, the bit after them, why it stopped, and the start code or the wrong field.
    """
    count = 0
    n = bits.shape[0]
    while count < values.shape[0]:
        code = -1 if fresh and count == 0 else code_after(bits, at)
        if code == 0xBB or code == 0x03 or 0xB0 <= code <= 0xBF:
            return count, at, AT_CODE, code
        if (code == -2 and not final) or at + 4 > n:
            return count, at, NEED_MORE, at
        if bits[at]:
            return count, at, INTRA_NEXT, at
        if bits[at + 1] or not bits[at + 2]:
            status = NEED_MORE if code == -2 else WITH_BODY if bits[at + 1] else BAD_MASK
            return count, at, status, at
        data = at + 4
        skip = 0
        more = bits[at + 3] == 1
        while more:
            if data + 4 > n:
                return count, at, NEED_MORE, at
            part = 8 * bits[data] + 4 * bits[data + 1] + 2 * bits[data + 2] + bits[data + 3]
            data += 4
            skip += int(part)
            more = part == 15
            if skip > SKIP_LIMIT:
                return count, at, BAD_SKIP, skip
        status, end = decode_settled(False, bits, data, fields, previous, models, found, flags, costs)
        if status != DONE:
            return count, at, NEED_MORE if code == -2 else status, end
        keep_plane(False, found, fields, previous, models)
        for field in range(FIELD_COUNT):
            values[count, field] = found[0, field]
        for k in range(3):
            value_flags[count, k] = flags[k]
        extents[count, 0], extents[count, 1], extents[count, 2] = at, end, skip
        at = end
        count += 1
    return count, at, FULL, at


def find_intra(bits: Any, start: int, bodies: bool) -> int:
    """Find the next bit at which the fixed bits of an I plane header are right; -1 if there is none.

    Headers cut off by the end do not count. Planes may have a body only if ``bodies`` is on.
    """
    n = bits.shape[0]
    for first in range(start, n - 40):
        if not bits[first] or (bits[first + 1] and not bodies) or not bits[first + 2]:
            continue
        at = first + 3
        at += 14 if bits[at] else 1
        if bits[at]:
            if not bits[at + 12]:
                continue
            at += 18
        at += 1
        if bits[at]:
            more = True
            at += 1
            while more and at + 4 <= n:
                more = bits[at] + bits[at + 1] + bits[at + 2] + bits[at + 3] == 4
                at += 4
        else:
            at += 1
        at += 5
        good = True
        for group in range(10):
            if at + 3 > n or not bits[at]:
                good = False
                break
            kind = 2 * bits[at + 1] + bits[at + 2]
            at += 3
            if kind == 1 or kind == 2:
                at += GROUP_SIZES[group]
        if good and at + 6 <= n and not bits[at + 1]:
            return first
    return -1


def _fastest() -> Any:
    try:
        return import_module("fapengine_native.codec")
    except (ImportError, OSError):  # not installed, an older one, or one for another system
        return sys.modules[__name__]


loops = _fastest()
"""Where the encoder and the decoder find the functions above."""

"""Finding the next I plane after damage, without mistaking noise for one.

Theory of operation
-------------------
A plane start code is a byte pattern; behind it an I plane must follow. Without one, every bit is a possible start, and
the fixed bits of a header leave one chance in some 16,000 for noise. A candidate proves itself by a start code right
before it, by the same quantiser and masks as the last good header (at least 35 bits), or by a run of planes
that decode behind it, each of which noise survives with a chance of 1/8.
"""

import copy

import numpy as np

from fapengine.codec import kernels as k
from fapengine.codec.bits import PLANE_START, BitReader, Bits
from fapengine.codec.fields import FIELD_COUNT
from fapengine.codec.header import BODY, IntraHeader, read_face_header, read_plane_start
from fapengine.codec.planes import PlaneState
from fapengine.errors import DataError

PROOF = 8
"""Planes that must decode behind a candidate of unknown shape: noise does so with chance 8**-8."""
PLANE_CODE_BITS = np.unpackbits(np.array([0, 0, 1, PLANE_START], np.uint8))


def find_intact_intra(
    bits: Bits, start: int, state: PlaneState, last: IntraHeader | None, *, bodies: bool, final: bool
) -> int | None:
    """Find the first bit of an I plane that proves itself.

    Parameters
    ----------
    bits : (N,) uint8
        One bit a byte, whole bytes of the stream.
    start : int
        Where to begin.
    state : PlaneState
        Its ranges hold on; it is not changed.
    last : IntraHeader or None
        Last good header.
    bodies : bool
        Planes may carry a body behind the face; such a plane proves itself by its start code or its masks alone.
    final : bool
        No more bits will come.
    """
    candidate = k.find_intra(bits, start, bodies)
    while candidate >= 0:
        verdict = _proves_itself(bits, int(candidate), state, last, final=final)
        if verdict is None:
            return None
        if verdict:
            return int(candidate)
        candidate = k.find_intra(bits, candidate + 1, bodies)
    return None


def _proves_itself(bits: Bits, at: int, state: PlaneState, last: IntraHeader | None, *, final: bool) -> bool | None:
    """Judge a candidate; None where more bits are needed."""
    reader = BitReader(bits, at + 1)
    try:
        start = read_plane_start(reader)
        header = read_face_header(reader, start)
    except DataError:
        return False
    trial = copy.deepcopy(state)
    trial.begin_intra(header)
    symbols, flags, costs = np.zeros((4, FIELD_COUNT), np.int64), np.zeros(3, np.int64), np.zeros(0)
    status, end = k.decode_settled(
        True, bits, reader.position, trial.fields, trial.previous, trial.models.decoding, symbols, flags, costs
    )
    if status == k.NEED_MORE and not final:
        return None
    if status != k.DONE:
        return False
    announced = at % 8 == 0 and at >= 32 and np.array_equal(bits[at - 32 : at], PLANE_CODE_BITS)
    if announced or (last is not None and _same_shape(header, last)):
        return True
    if start.objects & BODY:
        return False
    k.keep_plane(True, symbols, trial.fields, trial.previous, trial.models.decoding)
    values, plain, extents = (np.zeros((PROOF, n), np.int64) for n in (FIELD_COUNT, 3, 3))
    count, _, status, _ = k.decode_predicted(
        bits, end, False, final, trial.fields, trial.previous, trial.models.decoding, symbols, flags, costs, values,
        plain, extents,
    )  # fmt: skip
    if status == k.NEED_MORE and not final:
        return None
    return bool(count == PROOF or status == k.AT_CODE)


def _same_shape(header: IntraHeader, last: IntraHeader) -> bool:
    return (
        header.quant == last.quant
        and header.mask_types == last.mask_types
        and np.array_equal(header.mask, last.mask)
        and header.gender == last.gender
    )

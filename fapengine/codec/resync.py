"""Search for the next I plane after damage, without mistaking noise for one.

Theory of operation
-------------------
An I plane may follow a plane start code, which is a byte pattern. Without one, it may start at any bit, and noise
matches the fixed bits of a header with a probability of about 1/16,000. A candidate is accepted if a start code
precedes it, if its quantiser and masks equal those of the last good header (at least 35 bits), or if a run of planes
decodes after it; noise decodes as one more plane with a probability of 1/8.
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
"""Planes that must decode after a candidate with an unknown header: noise does so with probability 8**-8."""
PLANE_CODE_BITS = np.unpackbits(np.array([0, 0, 1, PLANE_START], np.uint8))


def find_intact_intra(
    bits: Bits, start: int, state: PlaneState, last: IntraHeader | None, *, bodies: bool, final: bool
) -> int | None:
    """Return the first bit of the next I plane that can be trusted; None if there is none yet.

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

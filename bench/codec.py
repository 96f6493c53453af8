"""Speed of the codec, as ratios in one run: against plain Python, and against the memory that must be moved.

Run ``python -m bench.codec``. 66 FAPs, q = 1. The lower limit: reading every value once and writing every byte of the
stream once, and the 9 steps of a Fenwick tree of 4-byte counts for each symbol, all at the speed of a memory copy.
"""

import json
import sys
import time
from collections.abc import Callable

import numpy as np

from bench import plain_codec
from bench.talking import talking_face
from fapengine.codec import kernels
from fapengine.codec.decoder import decode
from fapengine.codec.encoder import Encoder, encode

FRAMES, PLAIN_FRAMES = 15_000, 200
TREE_BYTES = 3 * 9 * 4
"""Three walks of a tree a symbol: look up, count, and the way back of the rarer ones."""
REFERENCE = {"encode": 38_700, "decode": 25_300}
"""Frames a second of the C++ programs derived from the reference software, on a machine of this kind."""
FLOOR = 20.0
"""Ratio to plain Python under which something is broken."""


def best(function: Callable[[], object], times: int = 5) -> float:
    """Shortest of several runs, seconds."""
    taken = []
    for _ in range(times):
        start = time.perf_counter()
        function()
        taken.append(time.perf_counter() - start)
    return min(taken)


def main() -> None:
    track = talking_face(FRAMES)
    stream = encode(track)
    rows = track.values[:PLAIN_FRAMES, 2:].tolist()
    bits = plain_codec.encode(rows)
    shown = plain_codec.decode(bits, PLAIN_FRAMES)
    assert shown == decode(stream).track.values[:PLAIN_FRAMES, 2:].tolist(), "the yardstick codes something else"
    plain_encode, plain_decode = best(lambda: plain_codec.encode(rows), 2), best(
        lambda: plain_codec.decode(bits, PLAIN_FRAMES), 2
    )  # fmt: skip
    moved = np.zeros(FRAMES * 66 * (8 + TREE_BYTES) + len(stream), np.uint8)
    limit = FRAMES / best(moved.copy)
    ours = {
        "encode": FRAMES / best(lambda: encode(track)),
        "decode": FRAMES / best(lambda: decode(stream)),
        "plain encode": PLAIN_FRAMES / plain_encode,
        "plain decode": PLAIN_FRAMES / plain_decode,
        "memory-bound limit": limit,
    }
    encoder = Encoder(rate_hz=25.0)
    live = []
    for row in track.values[:2000]:
        start = time.perf_counter()
        encoder.frame(row)
        live.append(1000 * (time.perf_counter() - start))
    result = {
        "compiled": kernels.COMPILED,
        "frames_s": {name: round(value) for name, value in ours.items()},
        "ratio_to_plain": {name: round(ours[name] / ours[f"plain {name}"], 1) for name in ("encode", "decode")},
        "ratio_to_reference": {name: round(ours[name] / REFERENCE[name], 2) for name in REFERENCE},
        "part_of_limit": {name: round(ours[name] / limit, 4) for name in REFERENCE},
        "live_frame_ms": {"median": round(float(np.median(live)), 3), "p99": round(float(np.percentile(live, 99)), 3),
                          "first": round(live[0], 3)},
    }  # fmt: skip
    print(json.dumps(result, indent=2))
    if kernels.COMPILED and min(result["ratio_to_plain"].values()) < FLOOR:
        sys.exit(f"slower than {FLOOR} times plain Python")


if __name__ == "__main__":
    main()

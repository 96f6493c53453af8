"""The inner loops give the same bytes with and without the compiler, and importing the package does not load it."""

import subprocess
import sys
from dataclasses import replace
from hashlib import sha256

from fapengine.codec.decoder import decode
from fapengine.codec.encoder import EncoderOptions, encode
from fapengine.mpeg4.track import FapTrack

PROGRAM = """
from tests.unit.codec.test_uncompiled import digest
from fapengine.codec import kernels
print(type(kernels.encode_plane).__name__, digest())
"""


def digest() -> str:
    values = [[0, 0, *[(7 * n * k) % 61 - 30 for k in range(66)]] for n in range(12)]
    track = replace(
        FapTrack.from_values(values, rate_hz=25.0), frame_numbers=[*range(7), *range(400, 405)]
    )  # a skip over 255
    stream = encode(track, EncoderOptions(intra_every=5, ranges="fitted"))
    return sha256(
        stream + decode(stream).track.values.tobytes() + decode(stream).track.frame_numbers.tobytes()
    ).hexdigest()


def test_uncompiled_loops_give_the_same_bytes() -> None:
    import os

    done = subprocess.run(
        [sys.executable, "-c", PROGRAM], env={**os.environ, "NUMBA_DISABLE_JIT": "1"}, capture_output=True, check=True
    )
    assert done.stdout.decode().split() == ["function", digest()]


def test_importing_the_package_loads_no_compiler() -> None:
    program = "import sys, fapengine, fapengine.codec, fapengine.codec.fapfile; sys.exit('numba' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", program], check=False).returncode == 0

"""Coverage-guided fuzzing of everything that reads bytes: value or DataError, nothing else.

Run ``python -m tests.fuzz.fuzz_decoder out/fuzz tests/fuzz/corpus -max_total_time=20``; the first folder takes what it
finds, the second is only read. An input that breaks the law is left
beside it as ``crash-*``. The inner loops run in Python, so that they are seen too; tests.native.fuzz_codec tries those
in C.
"""

import sys

import atheris

with atheris.instrument_imports(include=["fapengine.codec"]):
    from fapengine.codec import kernels
    from fapengine.codec.decoder import Decoder, decode
    from fapengine.codec.epf import parse_epf
    from fapengine.codec.fapfile import parse_fap
from fapengine.errors import DataError

kernels.loops = kernels


def one_input(data: bytes) -> None:
    """Give the bytes to every reader; the stream decoder also gets them in two pieces."""
    for read in (decode, parse_epf, parse_fap, lambda data: decode(data, errors="resync")):
        try:
            read(data)
        except DataError:
            continue
    rows = []
    for pieces in ((data,), (data[: len(data) // 2], data[len(data) // 2 :])):
        decoder, frames = Decoder(), []
        try:
            for piece in pieces:
                frames += decoder.feed(piece)
            frames += decoder.close()
        except DataError:
            pass
        rows.append([frame.row.tolist() for frame in frames])
    if rows[0] != rows[1]:
        raise AssertionError(f"whole and pieces differ: {len(rows[0])} and {len(rows[1])} frames")


if __name__ == "__main__":
    atheris.Setup(sys.argv, one_input)
    atheris.Fuzz()

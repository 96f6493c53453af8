"""Streams of every kind, damaged, decoded by the loops in C with the address and undefined-behaviour sanitizers.

    python -m tests.native.fuzz_codec [--cases 3000] [--seed 1] [--python-every 50]

Every case is a stream of up to 40 planes: whole, then ten times damaged, then its header with noise after it; each is
decoded strictly and with resynchronisation, at once or in pieces. A decoder returns frames or raises DataError. One
case of ``python-every`` is coded and decoded by the loops in Python too, which must say the same. The first fault ends
the run.
"""

import argparse
import importlib
import sys

import numpy as np

from fapengine.codec import kernels
from tests.native import built
from tests.native.codec_streams import answers, damaged, random_stream
from tests.native.fuzz import FLAGS, start_with_sanitizers


def run(cases: int, seed: int, python_every: int) -> None:
    built.imported(FLAGS)
    compiled = importlib.import_module("fapengine_native.codec")
    decoded = compared = 0
    for case in range(cases):
        rng = np.random.default_rng([seed, case])
        frames, pieces = int(rng.integers(1, 40)), int(rng.choice([60, 1000, 100_000]))
        kernels.loops = compiled
        stream = random_stream(rng, frames)
        noise = stream[: rng.integers(5, 60)] + rng.bytes(int(rng.integers(200)))
        streams = [stream, *(damaged(stream, rng) for _ in range(10)), noise]
        said = [list(answers(each, pieces)) for each in streams]
        decoded += 2 * len(streams)
        if case % python_every == 0:
            kernels.loops = kernels
            again = random_stream(np.random.default_rng([seed, case, 1]), frames)
            by_python = [list(answers(each, pieces)) for each in streams]
            kernels.loops = compiled
            if by_python != said or again != random_stream(np.random.default_rng([seed, case, 1]), frames):
                sys.exit(f"case {case} of seed {seed}: Python and C differ")
            compared += 2 * len(streams)
    print(f"seed {seed}: {cases} streams, {decoded} times decoded: no fault; {compared} times as in Python")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cases", type=int, default=3000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--python-every", type=int, default=50)
    options = parser.parse_args()
    start_with_sanitizers("tests.native.fuzz_codec")
    run(options.cases, options.seed, options.python_every)


if __name__ == "__main__":
    main()

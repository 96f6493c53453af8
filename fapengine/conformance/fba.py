"""The suites for decoders and encoders: programs that convert files with the streams of docs/fba-format.md."""

import shlex
import subprocess
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from fapengine.codec.decoder import decode
from fapengine.codec.encoder import EncoderOptions, encode
from fapengine.codec.fapfile import format_fap, parse_fap
from fapengine.conformance.cases import BreachError, Case, demand
from fapengine.mpeg4 import fap
from fapengine.mpeg4.track import FapTrack, to_codable

PROGRAM_S = 60.0
"""Longest time for a second of motion."""
FRAMES, RATE_HZ = 30, 25.0


@dataclass(frozen=True, slots=True)
class Program:
    """A command that contains ``{in}`` and ``{out}``."""

    command: str

    def run(self, data: bytes, source: str, target: str) -> bytes:
        """Run it on a file; returns the file that it writes."""
        with tempfile.TemporaryDirectory() as folder:
            places = {"{in}": str(Path(folder) / f"in{source}"), "{out}": str(Path(folder) / f"out{target}")}
            Path(places["{in}"]).write_bytes(data)
            words = [places.get(word, word) for word in shlex.split(self.command)]
            try:
                done = subprocess.run(words, capture_output=True, timeout=PROGRAM_S, check=False)
            except (OSError, subprocess.TimeoutExpired) as error:
                raise BreachError(f"the program does not run: {error}") from error
            out = Path(places["{out}"])
            if done.returncode or not out.is_file():
                said = done.stderr.decode(errors="replace").strip()[-200:]
                wrote = "a file" if out.is_file() else "no file"
                raise BreachError(f"the program ended with {done.returncode} and wrote {wrote}: {said}")
            return out.read_bytes()


def motion(*faps: int, size: int = 200, every: int = 1, seed: int = 1) -> FapTrack:
    """Make about a second of smooth motion of some FAPs, clamped to the ranges of the format."""
    rng = np.random.default_rng(seed)
    values = np.zeros((FRAMES, fap.FAP_COUNT), np.int32)
    at = np.arange(FRAMES)[:, None] * rng.uniform(0.1, 0.4, len(faps)) + rng.uniform(0, 6, len(faps))
    values[:, fap.columns(*faps)] = np.round(size * np.sin(at))
    values = to_codable(values.astype(np.float64))
    mask = np.zeros((FRAMES, fap.FAP_COUNT), bool)
    mask[:, fap.columns(*faps)] = True
    return replace(FapTrack.from_values(values, rate_hz=RATE_HZ), mask=mask, frame_numbers=every * np.arange(FRAMES))


MOUTH = tuple(range(4, 13))
PLANES = EncoderOptions(moving_only=True)
STREAMS: tuple[tuple[str, str, str, FapTrack, EncoderOptions], ...] = (
    ("1.1", "4 I planes", "one FAP, quantiser 1", motion(4), PLANES),
    ("1.2", "4 I planes", "nine FAPs of the mouth", motion(*MOUTH), PLANES),
    ("1.3", "4 I planes", "all FAPs from 3 to 68", motion(*range(3, 69)), PLANES),
    ("1.4", "6 Quantiser and prediction", "quantiser 0, which is off", motion(*MOUTH), replace(PLANES, quant=0)),
    ("1.5", "6 Quantiser and prediction", "quantiser 8", motion(*MOUTH), replace(PLANES, quant=8)),
    ("1.6", "6 Quantiser and prediction", "quantiser 31, the coarsest", motion(*MOUTH), replace(PLANES, quant=31)),
    ("1.7", "6 Quantiser and prediction", "an I plane every 10 frames", motion(*MOUTH),
     replace(PLANES, intra_every=10)),
    ("1.8", "5 Symbol ranges", "ranges that are sent", motion(*MOUTH, size=20), replace(PLANES, ranges="fitted")),
    ("1.9", "3 Start codes and stuffing", "a start code before each I plane", motion(*MOUTH),
     replace(PLANES, intra_every=10, plane_start_codes="intra")),
    ("1.10", "10 Time", "skipped frames", motion(*MOUTH, every=2), PLANES),
    ("1.11", "7 The arithmetic coder", "values that jump", motion(*MOUTH, size=900, seed=3), replace(PLANES, quant=2)),
)  # fmt: skip


def _reads(track: FapTrack, options: EncoderOptions) -> Callable[[Program], None]:
    def check(program: Program) -> None:
        stream = encode(track, options)
        true = decode(stream).track
        found = parse_fap(program.run(stream, ".fba", ".fap"))
        demand(len(found) == len(true), f"got {len(found)} frames, expected {len(true)}")
        wrong = np.argwhere((found.values != true.values) & true.mask)
        for row, column in wrong[:1]:
            got, expected = found.values[row, column], true.values[row, column]
            demand(False, f"frame {row}, FAP {column + 1}: got {got}, expected {expected}; {len(wrong)} are wrong")

    return check


def _writes(track: FapTrack) -> Callable[[Program], None]:
    def check(program: Program) -> None:
        stream = program.run(format_fap(track).encode(), ".fap", ".fba")
        demand(stream.startswith(b"\0\0\1"), f"the stream starts with {stream[:4].hex(' ')}, expected a start code")
        found = decode(stream).track
        demand(len(found) == len(track), f"got {len(found)} frames, expected {len(track)}")
        demand((found.mask >= track.mask).all(), "some of the given FAPs are not sent")
        step = np.abs(found.values - track.values)[:, track.mask.any(axis=0)]
        size = np.abs(track.values).max()
        demand(step.max() <= 0.2 * size, f"the largest error is {step.max()}, of values up to {size}")

    return check


def _refuses(data: bytes) -> Callable[[Program], None]:
    def check(program: Program) -> None:
        try:
            program.run(data, ".fba", ".fap")
        except BreachError as breach:
            demand("does not run" not in str(breach), str(breach))
            return
        raise BreachError("it was accepted without an error")

    return check


_CUT = encode(motion(*MOUTH), PLANES)[:40]
DECODER_CASES: tuple[Case[Program], ...] = (
    *(Case(number, f"docs/fba-format.md: {at}", f"reads {what}", _reads(track, options))
      for number, at, what, track, options in STREAMS),
    Case("2.1", "docs/fba-format.md: 1 A stream", "refuses bytes that are not a stream", _refuses(b"text")),
    Case("2.2", "docs/fba-format.md: 7 The arithmetic coder", "refuses a stream that is cut", _refuses(_CUT)),
)  # fmt: skip
ENCODER_CASES: tuple[Case[Program], ...] = tuple(
    Case(number, f"docs/fba-format.md: {at}", f"writes {what}", _writes(track))
    for number, at, what, track in (
        ("1.1", "4 I planes", "one FAP", motion(4)),
        ("1.2", "4 I planes", "nine FAPs of the mouth", motion(*MOUTH)),
        ("1.3", "8 The data of a plane", "twenty FAPs, 3 to 22", motion(*range(3, 23))),
        ("1.4", "7 The arithmetic coder", "values that jump", motion(*MOUTH, size=900, seed=3)),
    )
)

"""Streams of every kind of header and plane, whole and damaged, and what a decoder says to them."""

from collections.abc import Iterator
from hashlib import sha256

import numpy as np

from fapengine.codec.decoder import Decoder
from fapengine.codec.encoder import Encoder, EncoderOptions, encode
from fapengine.errors import DataError
from fapengine.mpeg4 import fap
from fapengine.mpeg4.fapu import Fapu
from fapengine.mpeg4.track import FapTrack
from tests.unit.codec.test_bodies import Body, face, with_body

FACE = Fapu(irisd0_mm=11, es0_mm=62, ens0_mm=47, mns0_mm=22, mw0_mm=51.2)


def random_track(rng: np.random.Generator, frames: int) -> FapTrack:
    """Values that walk, jump or rest; any mask, which may change; visemes, expressions and skipped frames."""
    size = 10 ** rng.uniform(0, 4)
    steps = rng.normal(0, size, (frames, fap.FAP_COUNT)) * (rng.random((frames, fap.FAP_COUNT)) < rng.uniform(0, 1))
    values = np.clip(np.cumsum(steps, axis=0), -(10**6), 10**6).astype(np.int64)
    values[:, :2] = 0
    mask = np.repeat(rng.random((1, fap.FAP_COUNT)) < rng.uniform(0, 1.2), frames, axis=0)
    if rng.random() < 0.3:
        mask[frames // 2 :] = rng.random(fap.FAP_COUNT) < 0.5
    mask[:, 2] |= ~mask.any(axis=1)
    visemes = rng.integers(0, (15, 15, 64, 2), (frames, 4)) * mask[:, :1]
    expressions = rng.integers(0, (7, 64, 7, 64, 2, 2), (frames, 6)) * mask[:, 1:2]
    numbers = np.cumsum(rng.choice([1, 1, 1, 2, 16, 17, 31, 400], frames))
    return FapTrack(
        values=np.where(mask, values, 0), mask=mask, visemes=visemes, expressions=expressions, frame_numbers=numbers,
        rate_hz=float(rng.choice([10, 23.976, 25, 29.97, 60])),
    )  # fmt: skip


def random_options(rng: np.random.Generator) -> EncoderOptions:
    bound = rng.choice(["none", "kbit_s", "max_error_mm"], p=[0.7, 0.15, 0.15])
    return EncoderOptions(
        quant=int(rng.integers(0, 32)), intra_every=int(rng.choice([0, 1, 5, 12])),
        ranges=str(rng.choice(["table", "fitted"])), moving_only=bool(rng.random() < 0.3),
        kbit_s=float(rng.uniform(0.5, 8)) if bound == "kbit_s" else None,
        max_error_mm=float(rng.uniform(0.05, 3)) if bound == "max_error_mm" else None,
        fapu=FACE if bound == "max_error_mm" else None,
        plane_start_codes=str(rng.choice(["none", "intra", "all"])), unsent=str(rng.choice(["keep", "interpolate"])),
    )  # fmt: skip


def random_stream(rng: np.random.Generator, frames: int) -> bytes:
    """A track coded at once, or frame by frame as live, or a face beside a body."""
    kind = rng.choice(["track", "live", "body"], p=[0.6, 0.25, 0.15])
    if kind == "body":
        return with_body(face(frames, 7), Body(), codes=bool(rng.random() < 0.5))
    track, options = random_track(rng, frames), random_options(rng)
    if kind == "track":
        return encode(track, options)
    encoder = Encoder(rate_hz=25.0, options=options)
    sent = [encoder.frame(row, skip=int(rng.choice([0, 0, 0, 20]))) for row in track.values]
    return b"".join((*sent, encoder.finish()))


def damaged(stream: bytes, rng: np.random.Generator) -> bytes:
    """The stream with bits flipped, bytes put in or left out, its end cut off, or followed by noise."""
    data = bytearray(stream)
    for _ in range(rng.integers(1, 6)):
        at, count = int(rng.integers(len(data) + 1)), int(rng.integers(1, 30))
        match rng.integers(6):
            case 0 | 1 if at < len(data):
                data[at] ^= 1 << int(rng.integers(8))
            case 2:
                data[at:at] = rng.bytes(count)
            case 3:
                del data[at : at + count]
            case 4 if len(data) > 40:
                del data[max(at, 40) :]
            case 5:
                data[at:at] = bytes(count) if rng.random() < 0.5 else b"\xff" * count
    return bytes(data)


def answers(stream: bytes, pieces: int) -> Iterator[str]:
    """Digests of everything that a decoder says to a stream that is fed in pieces of a length, strict and not.

    Any other error than a DataError goes on to the caller.
    """
    for errors in ("strict", "resync"):
        decoder = Decoder(errors=errors, with_costs=True)
        digest = sha256()
        try:
            planes = [
                each for at in range(0, len(stream), pieces) for each in decoder.feed_planes(stream[at : at + pieces])
            ]
            planes += decoder.close_planes()
            for each in planes:
                for array in (each.values, each.flags, each.extents, each.numbers, each.times_s):
                    digest.update(array.tobytes())
        except DataError as error:
            digest.update(str(error).encode())
        losses = [(loss.start_bit, loss.end_bit, loss.frames_dropped, loss.reason) for loss in decoder.losses]
        digest.update(repr((losses, np.round(decoder.costs, 6).tolist(), decoder.body_planes)).encode())
        yield digest.hexdigest()

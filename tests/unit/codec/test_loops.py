"""The loops in Python and those in C: the same bytes, frames, losses and errors, whatever is sent, cut off or hurt."""

import numpy as np
import pytest

from fapengine.codec import kernels
from fapengine.codec.decoder import Decoder
from fapengine.codec.encoder import EncoderOptions, encode
from fapengine.errors import DataError
from fapengine.mpeg4 import fap
from fapengine.mpeg4.track import FapTrack

pytestmark = pytest.mark.skipif(kernels.loops is kernels, reason="only the loops in Python are installed")
FRAMES = 14
HIGHEST = np.array([0, 0, *(row.predicted_limit * row.quantiser_step for row in fap.FAPS)])
"""What a P plane may add at most, FAPU."""


def moved(rng: np.random.Generator, kind: str) -> FapTrack:
    """Steps of every size, or each the greatest one up or down: long runs of zeros and ones; visemes; gaps; masks."""
    if kind == "small":
        values = np.cumsum(rng.integers(-9, 10, (FRAMES, fap.FAP_COUNT)), axis=0)
    else:
        choices = [-1, 1] if kind == "extreme" else [-1, 0, 1]
        values = HIGHEST * rng.choice(
            choices, (FRAMES, fap.FAP_COUNT), p=None if kind == "extreme" else [0.02, 0.9, 0.08]
        )
    mask = np.repeat(rng.random((2, fap.FAP_COUNT)) < 0.8, FRAMES // 2, axis=0)
    values[:, :2] = 0
    return FapTrack(
        values=np.where(mask, values, 0), mask=mask,
        visemes=rng.integers(0, [15, 15, 64, 2], (FRAMES, 4)) * mask[:, :1],
        expressions=rng.integers(0, [7, 64, 7, 64, 2, 2], (FRAMES, 6)) * mask[:, 1:2],
        frame_numbers=np.cumsum(rng.choice([1, 1, 2, 6, 11, 16, 27, 40], FRAMES)), rate_hz=25.0,
    )  # fmt: skip


def read(data: bytes, piece: int, errors: str) -> tuple[list[object], str]:
    """Frames and losses, and what was wrong."""
    decoder, told = Decoder(errors=errors), ""
    frames = []
    try:
        for at in range(0, len(data), piece):
            frames += decoder.feed(data[at : at + piece])
        frames += decoder.close()
    except DataError as error:
        told = str(error)
    return [(one.number, one.row.tolist(), one.viseme, one.expression) for one in frames], f"{told} {decoder.losses}"


@pytest.mark.parametrize("kind", ["small", "extreme", "mostly still"])
@pytest.mark.parametrize("seed", range(3))
def test_both_write_and_read_the_same(seed: int, kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(seed)
    track = moved(rng, kind)
    options = EncoderOptions(
        quant=int(rng.choice([0, 1, 5, 31])), ranges=str(rng.choice(["table", "fitted"])), intra_every=[0, 4, 7][seed],
        plane_start_codes=["none", "intra", "all"][seed],
    )  # fmt: skip
    written, loops = [], (kernels.loops, kernels)
    for each in loops:
        monkeypatch.setattr(kernels, "loops", each)
        written.append(encode(track, options))
    stream = written[0]
    assert written[1] == stream
    at, end = (int(place) for place in rng.integers(len(stream) // 4, len(stream), 2))
    hurt = stream[:at] + rng.bytes(3) + stream[at + 3 :]
    for data, piece, errors in (
        (stream, len(stream), "strict"), (stream, 3, "strict"), (stream[:end], 50, "resync"), (hurt, 64, "resync"),
        (hurt, len(hurt), "strict"), *((stream[:-cut], len(stream), "strict") for cut in range(1, 7)),
    ):  # fmt: skip
        results = []
        for each in loops:
            monkeypatch.setattr(kernels, "loops", each)
            results.append(read(data, piece, errors))
        assert results[0] == results[1]

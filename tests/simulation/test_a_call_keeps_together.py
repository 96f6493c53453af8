"""Pictures and sound of a call on virtual time, on machines that have too much to do: the sound never waits."""

import asyncio
from collections.abc import Coroutine
from dataclasses import dataclass, field
from itertools import pairwise
from math import ceil
from typing import Any

import numpy as np
import pytest

from fapengine.server.calls.tracks import MAX_BLOCKS, MAX_LATE_S, SEEN_S, VIDEO_HZ, FilmTracks, PictureEncoder
from fapengine.server.film.film import SHOW_AFTER_S
from fapengine.server.film.soundtrack import BLOCK_S
from tests.leaping import LeapingLoop

SIZE = (16, 16)
PIXELS = bytes(3 * SIZE[0] * SIZE[1])
TALK_S = 20.0
TICK_S = 1 / 60


@dataclass
class Seen:
    """What left the tracks: of each the time that it is stamped with, and the time at which it left."""

    pictures: list[tuple[float, float, float]] = field(default_factory=list)
    """Third: the time of the engine that it shows."""
    sounds: list[tuple[float, float]] = field(default_factory=list)
    dropped: int = 0


def run(work: Coroutine[Any, Any, Seen]) -> Seen:
    loop = LeapingLoop()
    try:
        return loop.run_until_complete(work)
    finally:
        loop.close()


async def talk(draw_s: float, encode_s: float, seed: int) -> Seen:
    """One picture is drawn at a time and one encoded, each for a time of that mean; sound comes in time."""
    clock, rng = asyncio.get_running_loop().time, np.random.default_rng(seed)
    seen = Seen()

    class Encoder(PictureEncoder):
        """Takes a time of that mean, and sends the pixels as they are."""

        async def _encode(self, pixels: bytes, stamp: int, is_key: bool) -> list[bytes]:
            seen.pictures.append((stamp / VIDEO_HZ, clock(), int.from_bytes(pixels[:3], "big") / 60))
            await asyncio.sleep(rng.gamma(4.0, encode_s / 4.0))
            return [pixels]

    encoder = Encoder(SIZE, clock)
    viewer = encoder.join()
    tracks = FilmTracks(encoder, clock, lambda _: None)

    async def draw() -> None:
        while True:
            begun_s = TICK_S * ceil(clock() / TICK_S + 1e-6)
            await asyncio.sleep(begun_s - clock())
            await asyncio.sleep(rng.gamma(4.0, draw_s / 4.0))
            tracks.picture(begun_s, round(60 * begun_s).to_bytes(3, "big") + PIXELS[3:])

    async def speak() -> None:
        for number in range(int(TALK_S / BLOCK_S)):
            await asyncio.sleep(max(0.0, (number + 1) * BLOCK_S - clock()))
            tracks.sound(number * BLOCK_S, np.zeros(960, np.int16))

    async def show() -> None:
        while True:
            await viewer.recv()

    async def play() -> None:
        while True:
            frame = await tracks.audio.recv()
            seen.sounds.append((float(frame.pts * frame.time_base), clock()))

    tasks = [asyncio.ensure_future(each) for each in (draw(), show(), play())]
    await speak()
    await asyncio.sleep(SHOW_AFTER_S)
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)
    encoder.leave(viewer)
    assert viewer.sent >= len(seen.pictures) - 1  # the last one may not have been encoded yet
    seen.dropped = encoder.dropped
    return seen


@pytest.mark.parametrize(("draw_s", "encode_s"), [(0.02, 0.005), (0.06, 0.04), (0.12, 0.12), (0.3, 0.1), (0.05, 0.4)])
@pytest.mark.parametrize("seed", [1, 2])
def test_sound_never_waits_and_no_picture_is_late_but_one_in_half_a_second(
    draw_s: float, encode_s: float, seed: int
) -> None:
    seen = run(talk(draw_s, encode_s, seed))
    assert [of_s for of_s, _ in seen.sounds] == pytest.approx([BLOCK_S * number for number in range(1000)], abs=1e-4)
    assert max(abs(at_s - of_s - SHOW_AFTER_S) for of_s, at_s in seen.sounds) < 1e-3
    before_s = -SEEN_S
    for of_s, at_s, made_s in seen.pictures:
        assert -1e-3 < at_s - of_s - SHOW_AFTER_S <= MAX_LATE_S + 1e-3  # by its stamp none is late
        late_s = at_s - made_s - SHOW_AFTER_S
        assert late_s <= MAX_LATE_S + 1e-3 or at_s - before_s >= SEEN_S
        before_s = at_s
    of = [of_s for of_s, _, _ in seen.pictures]
    assert of == sorted(set(of))
    longest_s = max(later - at_s for (_, at_s, _), (_, later, _) in pairwise(seen.pictures))
    assert longest_s < SEEN_S + 5 * (draw_s + encode_s)


def test_what_is_in_time_is_shown() -> None:
    seen = run(talk(0.02, 0.005, 1))
    assert len(seen.pictures) > 25 * TALK_S
    assert seen.dropped < 0.01 * len(seen.pictures)
    late = run(talk(0.3, 0.1, 1))
    assert 1.5 * TALK_S < len(late.pictures) < 4 * TALK_S


def test_a_call_that_takes_long_to_connect_does_not_begin_with_a_burst() -> None:
    async def connect() -> Seen:
        clock = asyncio.get_running_loop().time
        tracks, seen = FilmTracks(None, clock, lambda _: None), Seen()
        for number in range(40):
            tracks.sound(number * BLOCK_S, np.zeros(960, np.int16))
        await asyncio.sleep(0.71)
        while not seen.sounds or seen.sounds[-1][0] < 39 * BLOCK_S:
            frame = await tracks.audio.recv()
            seen.sounds.append((float(frame.pts * frame.time_base), clock()))
        return seen

    seen = run(connect())
    assert len(seen.sounds) == MAX_BLOCKS
    assert all(at_s - of_s < SHOW_AFTER_S + BLOCK_S for of_s, at_s in seen.sounds)

"""The sound of a session in blocks: where the face is, whole, at any rate, and without clicks."""

from math import inf

import numpy as np
import pytest

from fapengine.server.film.soundtrack import BLOCK, BLOCK_S, FADE, KEPT_S, LEAP_S, RATE_HZ, Soundtrack


def tone(rate_hz: int, seconds: float, hz: float = 440.0) -> np.ndarray:
    return np.rint(10_000 * np.sin(2 * np.pi * hz * np.arange(round(rate_hz * seconds)) / rate_hz)).astype(np.int16)


def heard(track: Soundtrack, blocks: int, start_s: float = 0.0) -> np.ndarray:
    return np.concatenate([track.block(start_s + number * BLOCK_S) for number in range(blocks)])


@pytest.mark.parametrize("rate_hz", [8000, 11_025, 16_000, 22_050, 24_000, 44_100, 48_000, 96_000])
def test_a_sound_of_any_rate_comes_out_as_it_is(rate_hz: int) -> None:
    track = Soundtrack()
    track.clip(1, rate_hz, lambda now_s: now_s).push(tone(rate_hz, 0.5))
    out = heard(track, 20)
    error = out - 10_000 * np.sin(2 * np.pi * 440 * np.arange(len(out)) / RATE_HZ)
    assert np.sqrt(np.mean(error[FADE:] ** 2)) < 20  # 51 dB below


def test_what_would_fold_back_is_taken_out() -> None:
    track = Soundtrack()
    track.clip(1, 96_000, lambda now_s: now_s).push(tone(96_000, 0.3, hz=40_000.0))
    assert np.abs(heard(track, 10)[FADE:]).max() < 500


def test_the_face_leads_and_the_sound_is_never_far_from_it() -> None:
    """A ramp says which of its samples was played: its place is read off."""
    ramp = np.arange(24_000, dtype=np.int16)
    places = {n: n * BLOCK_S + (0.01 if n > 5 else 0.0) + (0.2 if n > 40 else 0.0) for n in range(60)}
    track = Soundtrack()
    track.clip(1, 16_000, lambda now_s: places[round(now_s / BLOCK_S)]).push(ramp)
    for number in range(60):
        block = track.block(number * BLOCK_S)
        at_s = block[FADE + 10] / 16_000 - (FADE + 10) / RATE_HZ
        assert abs(at_s - places[number]) <= LEAP_S + 1e-4
        if number in (35, 59):  # 30 blocks later what is 10 ms is made up for, a leap at once
            assert abs(at_s - places[number]) < 5e-4


def test_a_leap_and_an_end_are_faded() -> None:
    track, over = Soundtrack(), [False]
    track.clip(1, 48_000, lambda now_s: None if over[0] else now_s + (0.1 if now_s > 0.15 else 0.0)).push(
        np.full(48_000, 10_000, np.int16)
    )
    sound = heard(track, 15)
    over[0] = True
    sound = np.concatenate([sound, heard(track, 2, 15 * BLOCK_S)])
    assert np.abs(np.diff(sound.astype(int))).max() < 60  # 10 000 over 5 ms is 42 a sample
    assert not sound[-BLOCK:].any()
    assert len(track) == 0


def test_what_stands_still_is_silent_and_goes_on_where_it_was() -> None:
    track, place = Soundtrack(), [-inf]
    track.clip(1, 48_000, lambda now_s: place[0]).push(np.arange(20_000, dtype=np.int16))
    assert not track.block(0.0).any()
    place[0] = 0.1
    assert track.block(0.02)[-1] == 4800 + BLOCK - 1


def test_an_endless_sound_keeps_little_and_one_that_is_joined_late_has_its_place() -> None:
    track = Soundtrack()
    clip = track.clip("microphone", 16_000, lambda now_s: now_s - 0.5, is_endless=True, first_s=7.0)
    piece = np.full(320, 1000, np.int16)
    for number in range(2000):
        track.clip("microphone", 16_000, lambda now_s: None, is_endless=True, first_s=0.0).push(piece)
        block = track.block(7.0 + number * BLOCK_S)
        assert (np.abs(block).max() > 900) == (number >= 25)
    assert (clip.samples.end - clip.samples.first) / 16_000 < 0.5 + 0.5 + KEPT_S + 0.1


def test_two_sounds_are_added_and_the_loudest_is_cut() -> None:
    track = Soundtrack()
    for key in (1, 2):
        track.clip(key, 48_000, lambda now_s: now_s).push(np.full(9600, 20_000, np.int16))
    assert track.block(0.0)[-1] == 32_767

"""Sound over a network that loses, on a virtual clock: nothing moves from its place, and the lips go on."""

import numpy as np
import pytest
from numpy.typing import NDArray

from fapengine.recognition.protocol import RATE_HZ
from fapengine.recognition.sphinx_recognizer import SphinxRecognizer
from fapengine.speech.phone_track import PhoneTrack
from fapengine.wire.speech_osc.receive_window import HOLD_S, MIRROR_S
from tests.simulation.network import Channel, Clock
from tests.simulation.world import World
from tests.unit.recognition.speech import BABY, POPPIES, closures, met, opening_mm, spoken

LOSSY = Channel(loss=0.05, burst_s=0.15, burst_share=0.05, late=0.05, twice=0.02)
"""5 % lost one by one, a twentieth of the time nothing for 0.15 s, 5 % overtaken, 2 % doubled."""
PIECE = RATE_HZ // 50
PAUSE = np.zeros(RATE_HZ // 2, np.int16)


class Streamed:
    """Sound as it is spoken, 20 ms at a time, and what the receiver's ear is given."""

    def __init__(self, samples: NDArray[np.int16], channel: Channel, *, seed: int = 1, reliable: bool = False) -> None:
        clocks = {"sender_clock": Clock(5.0, 40e-6), "engine_clock": Clock(1000.0, -40e-6)}
        self.world = World(seed, channel, options={"reliable": reliable}, **clocks)
        self._samples, self._sent = samples, 0
        self._number: int | None = None
        self.pieces: list[NDArray[np.int16]] = []
        self.delays_s: list[float] = []
        """Time by which the end of what was given to the ear was behind what was spoken."""
        self.is_over = False
        self.world.run(1.0 + len(samples) / RATE_HZ + 1.5, self)
        self.came = np.concatenate(self.pieces)
        self.lost = self.world.receiver.counts.sound_lost

    def __call__(self, now_s: float) -> None:
        true_s = self.world.steps * 0.005
        sender, position = self.world.sender, round((true_s - 1.0) * RATE_HZ)
        if position > 0 and self._number is None:
            self._number = sender.begin(now_s, anchor="sound")
        while self._number is not None and self._sent + PIECE <= min(position, len(self._samples)):
            piece = self._samples[self._sent : self._sent + PIECE]
            sender.sound(self._number, piece, RATE_HZ, now_s)
            self._sent += PIECE
            if self._sent + PIECE > len(self._samples):
                sender.end(self._number)
        for request in self.world.receiver.sounds(self.world.engine_clock(true_s)):
            self.pieces.append(request.samples)
            self.is_over = self.is_over or request.is_last
            if position < len(self._samples):
                self.delays_s.append((position - sum(map(len, self.pieces))) / RATE_HZ)


@pytest.fixture(scope="module")
def talk() -> NDArray[np.int16]:
    parts = [spoken("rms", text).samples for text in (BABY, POPPIES)]
    whole = np.concatenate([parts[0], PAUSE, parts[1], PAUSE])
    return whole[: len(whole) // PIECE * PIECE]


@pytest.fixture(scope="module")
def lossy(talk: NDArray[np.int16]) -> Streamed:
    return Streamed(talk, LOSSY)


@pytest.mark.parametrize(("reliable", "least", "most"), [(True, 0.04, 0.25), (False, 0.005, 0.12)])
def test_what_is_lost_has_its_length_and_all_else_its_place(
    talk: NDArray[np.int16], lossy: Streamed, reliable: bool, least: float, most: float
) -> None:
    """``reliable`` sends each datagram once, as other programs may."""
    streamed = Streamed(talk, LOSSY, reliable=True) if reliable else lossy
    assert streamed.is_over
    assert len(streamed.came) == len(talk)  # no drift: the last sample is where it was
    assert least * len(talk) < streamed.lost < most * len(talk)
    same = (streamed.came.reshape(-1, PIECE) == talk.reshape(-1, PIECE)).all(axis=1)
    assert (~same).sum() * PIECE <= streamed.lost + 2 * PIECE  # what came is as it was sent, in its place
    gap = np.flatnonzero(~same)
    longest = max((len(run) for run in np.split(gap, np.flatnonzero(np.diff(gap) > 1) + 1)), default=0) * PIECE
    assert longest > round(MIRROR_S * RATE_HZ)  # a burst: behind the mirrored part there is silence
    quiet = streamed.came.reshape(-1, PIECE)[gap]
    assert (quiet == 0).all(axis=1).any()


def test_the_ear_is_never_far_behind(lossy: Streamed) -> None:
    delays_s = np.array(lossy.delays_s)
    assert np.median(delays_s) < 0.05
    assert delays_s.max() < 2 * HOLD_S
    first, last = delays_s[: len(delays_s) // 3], delays_s[-len(delays_s) // 3 :]
    assert abs(np.median(first) - np.median(last)) < 0.02


def test_the_lips_go_on(talk: NDArray[np.int16], lossy: Streamed) -> None:
    def lips(samples: NDArray[np.int16]) -> tuple[NDArray[np.float64], list[float]]:
        ear = SphinxRecognizer()
        track = PhoneTrack.from_phones(ear.push(samples) + ear.end())
        return opening_mm(track, len(samples) / RATE_HZ), closures(track)

    clean, heard = lips(talk), lips(lossy.came)
    assert np.corrcoef(clean[0], heard[0])[0, 1] > 0.8
    assert met(clean[1], heard[1]) >= 0.8 * len(clean[1])


def test_a_network_that_loses_nothing_changes_nothing(talk: NDArray[np.int16]) -> None:
    streamed = Streamed(talk, Channel())
    np.testing.assert_array_equal(streamed.came, talk)
    assert streamed.lost == 0

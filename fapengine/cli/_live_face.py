"""A face that speaks here and now, for the verbs that show one: an engine, a voice's sound, and sinks."""

import asyncio
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from math import inf

import numpy as np
from numpy.typing import NDArray

from fapengine.errors import UsageError
from fapengine.files.profiles import load_profile
from fapengine.live.engine.commands import Cancel, Command, Express
from fapengine.live.engine.engine import Engine
from fapengine.live.loudspeaker import Loudspeaker
from fapengine.live.server.hub import Hub
from fapengine.live.server.pacer import FramePacer
from fapengine.live.server.sinks import DatagramSink, SinkAddress, parse_sink
from fapengine.live.sound import open_output
from fapengine.trajectory.expression import Mood
from fapengine.trajectory.style import Style
from fapengine.voices.protocol import Speech

SESSION = "face"
SLEEP_MARGIN_S = 0.001
"""A sleep may end so late."""


@dataclass(slots=True)
class _Waiting:
    """Expressions that come with an utterance, once its sound has a place."""

    utterance: int
    moods: Sequence[Mood]
    duration_s: float


@dataclass(slots=True)
class Errors:
    """Stateful: how far the face was from its sound, frame by frame."""

    off_s: list[float] = field(default_factory=list)

    def as_dict(self) -> dict[str, float]:
        """Milliseconds, of the absolute value: median, 95th percentile, most."""
        if not self.off_s:
            return {}
        off_ms = 1e3 * np.abs(self.off_s)
        return {"p50": float(np.median(off_ms)), "p95": float(np.percentile(off_ms, 95)), "max": float(off_ms.max())}


class LiveFace:
    """Stateful: one session of an engine of its own. Close it.

    Parameters
    ----------
    profile : str
        Whose way of speaking.
    style : Style
    seed : int
    rate_hz : float
        Frames a second.
    device : str, optional
        Where sound goes out; a number, or a part of its name.
    silent : bool
        No sound.
    sinks : sequence of str
        URLs, see :mod:`fapengine.live.server.sinks`.

    Raises
    ------
    UsageError
        If the profile, a sink or the rate cannot be.
    """

    def __init__(
        self,
        profile: str,
        *,
        style: Style,
        seed: int = 1,
        rate_hz: float = 60.0,
        device: str | None = None,
        silent: bool = False,
        sinks: Sequence[str] = (),
    ) -> None:
        addresses = [_datagrams(url) for url in sinks]
        engine = Engine(load_profile(profile), rng=np.random.default_rng(seed), style=style)
        self.hub = Hub(engine, rate_hz=rate_hz)
        self.hub.open(SESSION)
        self.speaker = Loudspeaker(
            self.hub, SESSION, opens=lambda sample_rate_hz: open_output(sample_rate_hz, device=device, silent=silent)
        )
        self.errors = Errors()
        self._sinks = [DatagramSink(self.hub, address) for address in addresses]
        self._waiting: list[_Waiting] = []
        self._shown_s = -inf

    def say(self, speech: Speech, text: str, moods: Sequence[Mood] = ()) -> int:
        """Say what was spoken, behind what is being said; return the utterance's number."""
        spoken = self.hub.say(SESSION, speech, text=text)
        if moods:
            self._waiting.append(_Waiting(spoken.utterance, moods, speech.duration_s))
        return spoken.utterance

    def tell(self, command: Command) -> None:
        """Tell the face something."""
        self.hub.apply(SESSION, command)

    def stop(self) -> None:
        """Fall silent, and come to rest."""
        self.speaker.stop()
        self._waiting.clear()
        self.tell(Cancel())

    @property
    def is_speaking(self) -> bool:
        """Whether something is being said, or waits."""
        return self.speaker.is_playing or self.hub.engine.state(SESSION) != "idle"

    def frame(self, lead_s: float = 0.0) -> NDArray[np.int32]:
        """FAPs, (68,) FAPU, of what is to be seen ``lead_s`` from now; the sinks get them too."""
        now_s = self.hub.clock()
        self.speaker.follow(now_s)
        self._express()
        if self.speaker.off_s is not None:
            self.errors.off_s.append(self.speaker.off_s)
        self._shown_s = max(self._shown_s, now_s + lead_s)
        frames = self.hub.tick(self._shown_s)
        faps: NDArray[np.int32] = frames.faps[frames.sessions.index(SESSION)]
        return faps

    def close(self) -> None:
        """Let sound, sinks and session go; receivers see a face at rest."""
        self.speaker.close()
        self.hub.close(SESSION)
        self.hub.tick(max(self.hub.clock(), self._shown_s))
        for sink in self._sinks:
            asyncio.run(sink.close())

    def _express(self) -> None:
        for waiting in tuple(self._waiting):
            zero_s = self.speaker.zero_s(waiting.utterance)
            if zero_s is None:
                continue
            self._waiting.remove(waiting)
            for mood in waiting.moods:
                stop_s = min(mood.stop_s, waiting.duration_s)
                hold_s = max(stop_s - mood.release_s - mood.start_s - mood.attack_s, 0.0)
                self.tell(
                    Express(
                        mood.expression, mood.strength, zero_s + mood.start_s, mood.attack_s, hold_s, mood.release_s
                    )
                )


@dataclass(slots=True)
class Ticks:
    """Stateful: waits for each frame's time, by the monotonic clock."""

    rate_hz: float
    frames: int = 0
    skipped: int = 0
    _pacer: FramePacer | None = None
    _clock: Callable[[], float] = time.monotonic

    def wait(self) -> None:
        """Sleep until the next frame is due."""
        if self._pacer is None:
            self._pacer = FramePacer(self.rate_hz, self._clock())
        while (due := self._pacer.due(self._clock())) is None:
            time.sleep(max(self._pacer.next_s - self._clock() - SLEEP_MARGIN_S / 2, 0.0))
        self.frames += 1
        self.skipped += due[1]


def has_display() -> bool:
    """Whether a window could be opened: a session of X11, Wayland, macOS or Windows."""
    import os
    import sys

    return sys.platform in ("darwin", "win32") or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def _datagrams(url: str) -> SinkAddress:
    address = parse_sink(url)
    if address.kind.endswith("+tcp"):
        raise UsageError(f"--sink: got {url!r}, expected one that sends datagrams; `fapengine serve` has streams")
    return address

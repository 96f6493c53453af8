"""A face that speaks now: an engine, the sound card, and sinks."""

import asyncio
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from math import inf
from pathlib import Path
from typing import Self

import numpy as np
from numpy.typing import NDArray

from fapengine._strict_toml import check_value, checked
from fapengine.app.manner import Expressions, moods_of
from fapengine.app.performance import Performance
from fapengine.audio.device import open_output
from fapengine.engine.commands import COMMANDS, Cancel, Command, Express, GestureMethods, Pause, Resume
from fapengine.engine.engine import Engine
from fapengine.errors import UsageError
from fapengine.expressions import EXPRESSIONS
from fapengine.files.profiles import load_profile
from fapengine.host.hub import FramePacer, Hub
from fapengine.host.playback import Playback
from fapengine.profiles import Profile
from fapengine.server.sinks.kinds import parse_sink
from fapengine.speaking import DEFAULT_PROFILE, Seed
from fapengine.speech.marks import read_marks
from fapengine.trajectory.expression import mood_ramps
from fapengine.trajectory.planner import rest_s
from fapengine.trajectory.ramps import Ramp
from fapengine.trajectory.style import Style
from fapengine.voices.choice import VoiceChoice, loaded
from fapengine.voices.protocol import Speech, Voice

SESSION = "face"
REST_S = 0.4
"""Time for which a face is still shown when its sound is over, so that it is seen coming to rest."""
LEAD_S, TAIL_S = 0.15, 0.25
"""Silence around a text that the face's own voice speaks."""
SLEEP_MARGIN_S = 0.001
"""Time by which a sleep may end too late."""


@dataclass(slots=True)
class _Waiting:
    """Expressions of an utterance whose sound has not begun."""

    utterance: int
    ramps: Sequence[Ramp]
    rest_s: float | None
    """Time in the utterance by which gestures return to neutral, if it is the last."""


@dataclass(slots=True)
class SoundErrors:
    """Distances of the face from its sound, frame by frame. Stateful."""

    sync_error_s: list[float] = field(default_factory=list)
    """Time by which each frame was ahead of the sound."""

    def as_dict(self) -> dict[str, float]:
        """Return the median, 95th percentile and maximum of the absolute values, ms."""
        if not self.sync_error_s:
            return {}
        off_ms = 1e3 * np.abs(self.sync_error_s)
        return {"p50": float(np.median(off_ms)), "p95": float(np.percentile(off_ms, 95)), "max": float(off_ms.max())}


class Face(GestureMethods):
    """A face in this program that speaks now and follows the sound card. Stateful; close it, or use it in ``with``.

    Call :meth:`frame` for each image, or let :meth:`frames` keep the time. Only the thread that uses it first may
    use it.

    Parameters
    ----------
    profile : str, Path or Profile
        Speaker profile.
    style : Style, optional
        Style of speaking, and automatic movement.
    seed : int
        Random seed of blinks, glances and head motion.
    rate_hz : float
        Frame rate, 1 to 1000 Hz.
    voice : str or Voice
        Speaks texts: a language of espeak-ng, or anything with ``speak(text)`` that gives sound and phones.
    device : str, optional
        Sound output: a number, or part of a device's name; by default the system's.
    silent : bool
        Play no sound; the face follows the system clock, as on a machine without a sound card.
    sinks : sequence of str
        URLs that frames are also sent to, such as ``"vmc://127.0.0.1"``: see :mod:`fapengine.server.sinks.kinds`.
    clock : callable
        Monotonic clock, s.

    Raises
    ------
    UsageError
        For an invalid profile, sink or rate.

    Examples
    --------
    >>> with Face(silent=True) as face:
    ...     number = face.say("Hello.")
    ...     face.express("joy", 0.6)
    ...     face.frame().shape
    (68,)
    """

    @checked
    def __init__(
        self,
        profile: str | Path | Profile = DEFAULT_PROFILE,
        *,
        style: Style | None = None,
        seed: Seed = 1,
        rate_hz: float = 60.0,
        voice: str | VoiceChoice | Voice = "en-us",
        device: str | None = None,
        silent: bool = False,
        sinks: Sequence[str] = (),
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        from fapengine.server.sinks.opening import datagram_sink  # most faces have no sinks

        addresses = [parse_sink(url) for url in sinks]
        self._profile = profile if isinstance(profile, Profile) else load_profile(profile)
        engine = Engine(self._profile, rng=np.random.default_rng(seed), style=style or Style())
        self.rate_hz = rate_hz
        self.hub = Hub(engine, rate_hz=rate_hz, clock=clock)
        self.hub.open(SESSION)
        self.speaker = Playback(
            self.hub, SESSION, opens=lambda sample_rate_hz: open_output(sample_rate_hz, device=device, silent=silent)
        )
        self.errors = SoundErrors()
        self._voice = voice
        self._sinks = [datagram_sink(self.hub, address) for address in addresses]
        self._waiting: list[_Waiting] = []
        self._shown_s = -inf
        self._owner: int | None = None
        self._is_closed = False

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @checked
    def say(
        self,
        speech: str | Performance | Speech,
        *,
        text: str = "",
        expressions: Expressions = (),
        is_last: bool = False,
    ) -> int:
        """Say something, after what is being said.

        Parameters
        ----------
        speech : str, Performance or Speech
            A text, which the face's voice speaks first (this call waits for it); or finished speech.
        text : str
            Words of the speech, for programs that show them.
        expressions : mapping or sequence
            As of :func:`fapengine.speak`; their times count from the beginning of the sound.
        is_last : bool
            Come to rest at its end, as a file does, and make no more gestures.

        Returns
        -------
        int
            Number of the utterance.

        Raises
        ------
        UsageError
            If there is nothing to speak, a performance has no sound, an expression is invalid, the face is closed, or
            another thread uses it.
        ResourceError
            If the voice is not installed.
        """
        self._check_use()
        if isinstance(speech, str):
            spoken = loaded(self._voice).speak(speech).padded(lead_s=LEAD_S, tail_s=TAIL_S)
            text = spoken.text or read_marks(speech).text
        else:
            spoken = speech.speech if isinstance(speech, Performance) else speech
        moods = moods_of(expressions, spoken.phones)
        utterance = self.hub.say(SESSION, spoken, text=text or spoken.text).utterance
        end_s = rest_s(spoken.phones, spoken.duration_s)
        ramps = mood_ramps(moods, self._profile, end_s)
        self._waiting.append(_Waiting(utterance, ramps, end_s if is_last else None))
        return utterance

    def send_command(self, command: Command) -> None:
        """Apply a command of :mod:`fapengine.engine.commands`."""
        self._check_use()
        if not isinstance(command, COMMANDS):
            raise UsageError(f"command: got {command!r:.60}, expected one of fapengine.engine.commands")
        self.hub.host(SESSION).apply(command, self.hub.clock())

    def pause(self) -> None:
        """Pause sound and face, the mouth at neutral."""
        self.send_command(Pause())

    def resume(self) -> None:
        """Resume from where it was paused."""
        self.send_command(Resume())

    def stop(self) -> None:
        """Stop the sound, and return to neutral."""
        self._check_use()
        self.speaker.stop()
        self._waiting.clear()
        self.send_command(Cancel())

    @property
    def is_speaking(self) -> bool:
        """True while something is being said or waits."""
        return self.speaker.is_playing or self.hub.engine.state(SESSION) != "idle"

    @property
    def sound(self) -> str:
        """Name of the sound device, or why there is none; empty before the first utterance."""
        return self.speaker.description

    @property
    def sync_error_s(self) -> float | None:
        """Time by which the last frame was ahead of the sound; None while nothing sounds."""
        return self.speaker.sync_error_s

    def frame(self, display_latency_s: float = 0.0) -> NDArray[np.int32]:
        """Return the FAPs that are due now; the sinks get them too.

        Parameters
        ----------
        display_latency_s : float
            Time from now until the frame is seen.

        Returns
        -------
        (68,) int32, FAPU
            Column ``number - 1`` is the FAP of that number.
        """
        self._check_use()
        check_value("display_latency_s", display_latency_s, float)
        now_s = self.hub.clock()
        self.speaker.follow(now_s)
        self._express()
        if self.speaker.sync_error_s is not None:
            self.errors.sync_error_s.append(self.speaker.sync_error_s)
        self._shown_s = max(self._shown_s, now_s + display_latency_s)
        frames = self.hub.tick(self._shown_s)
        faps: NDArray[np.int32] = frames.faps[frames.sessions.index(SESSION)]
        return faps

    def frames(self) -> Iterator[NDArray[np.int32]]:
        """Yield each frame, (68,) int32 FAPU, when it is due, until the speech is over and the face is at rest."""
        ticks = Ticks(self.rate_hz, clock=self.hub.clock)
        while self.is_speaking:
            ticks.wait()
            yield self.frame()
        rests_s = self.hub.clock() + REST_S
        while self.hub.clock() < rests_s:
            ticks.wait()
            yield self.frame()

    def close(self) -> None:
        """Close sound, sinks and session; receivers get a face at rest. Closing again does nothing."""
        if self._is_closed:
            return
        self._is_closed = True
        self.speaker.close()
        self.hub.close(SESSION)
        self.hub.tick(max(self.hub.clock(), self._shown_s))
        for sink in self._sinks:
            asyncio.run(sink.close())

    def _check_use(self) -> None:
        """Raise UsageError if the face is closed, or another thread used it first."""
        if self._is_closed:
            raise UsageError("face: it is closed")
        thread = threading.get_ident()
        self._owner = self._owner or thread
        if thread != self._owner:
            raise UsageError("face: another thread uses it; a face belongs to the thread that uses it first")

    def _express(self) -> None:
        for waiting in tuple(self._waiting):
            zero_s = self.speaker.zero_s(waiting.utterance)
            if zero_s is None:
                continue
            self._waiting.remove(waiting)
            for ramp in waiting.ramps:
                self.send_command(Express(EXPRESSIONS[ramp.channel], ramp.goal, zero_s + ramp.at_s, ramp.over_s))
            if waiting.rest_s is not None:
                self.hub.engine.rest(SESSION, zero_s + waiting.rest_s, self.hub.clock())


@dataclass(slots=True)
class Ticks:
    """Waits for each frame's time, by the monotonic clock. Stateful."""

    rate_hz: float
    frames: int = 0
    """Count of frames that were waited for."""
    skipped: int = 0
    """Count of frames whose time was over before they were asked for."""
    _pacer: FramePacer | None = None
    clock: Callable[[], float] = time.monotonic
    sleep: Callable[[float], None] = time.sleep

    def wait(self) -> None:
        """Sleep until the next frame is due."""
        if self._pacer is None:
            self._pacer = FramePacer(self.rate_hz, self.clock())
        while (due := self._pacer.due(self.clock())) is None:
            self.sleep(max(self._pacer.next_s - self.clock() - SLEEP_MARGIN_S / 2, 0.0))
        self.frames += 1
        self.skipped += due[1]


def has_display() -> bool:
    """Whether a window could be opened: a session of X11, Wayland, macOS or Windows."""
    import os
    import sys

    return sys.platform in ("darwin", "win32") or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))

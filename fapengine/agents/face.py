"""The common part of the plug-ins: a host with recognizer, painter and inline cues, and the timing of frames.

Theory of operation
-------------------
A plug-in passes on the events of its framework (:meth:`AgentFace.sound`, :meth:`AgentFace.word`, ...) and calls
:meth:`AgentFace.wait_s` and :meth:`AgentFace.frame` in a loop. Frames are made in real time; during speech up to
:data:`AHEAD_S` early, so that a late frame does not interrupt the audio. Time is an argument.

The loop forwards a frame's audio by the clock alone: :meth:`AgentFace.show` begins its image (:mod:`.pictures`),
:meth:`AgentFace.drawn` waits for it until the next frame at most. Painter and recognizer are started again when they
end. An utterance that has lost its recognizer continues with its words; the next one is recognized again, unless three
recognizers in a row have ended before the end of any utterance.
"""

import asyncio
import contextlib
import logging
from dataclasses import dataclass
from html import escape
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from fapengine._child import Restarts
from fapengine.agents.attention import Attention, State
from fapengine.agents.pictures import Picture, Pictures
from fapengine.engine.gestures import commands_of
from fapengine.errors import DataError, ResourceError, UsageError
from fapengine.files.profiles import load_profile
from fapengine.host.stream import Pronounce, StreamEvent, StreamFrame, StreamHost
from fapengine.host.words import MarkTimer, TimedWord
from fapengine.recognition.process import RecognizerProcess
from fapengine.render.drawing import RenderOptions, parse_edges
from fapengine.server.film.painter import FilmCounts, Painter
from fapengine.speaking import DEFAULT_PROFILE
from fapengine.speech.marks import TimedMark, read_marks
from fapengine.trajectory.style import Style
from fapengine.voices.choice import VoiceChoice, pronouncer_of

AHEAD_S = 0.2
"""Time by which frames with audio are made early."""
EAR_STARTS_S = 15.0
"""Time that a recognizer may take to start; after it the face begins without recognizer."""
FEELS_S = 3.0
"""Duration of a delivery whose end is not known."""
MAX_LATE_S = 0.5
"""Lateness beyond which missed frames are skipped."""

log = logging.getLogger("fapengine.agents")


@dataclass(frozen=True, slots=True, kw_only=True)
class AgentOptions:
    """Options of an agent's face."""

    head: str = "default"
    """Name or folder of a head; see :func:`fapengine.files.heads.load.load_head_for_calls`."""
    size: tuple[int, int] = (512, 512)
    """Width and height in pixels."""
    edges: str = "soft"
    """Antialiasing: ``soft``, ``fine`` or ``none``, see docs/how-to/render.md; ``none`` renders a quarter faster."""
    frame_rate_hz: float = 25.0
    profile: str = DEFAULT_PROFILE
    """Speaker profile: a shipped name, or a folder."""
    voice: str = "en-us"
    """Language of words with times, or another name of :class:`fapengine.voices.choice.VoiceChoice`."""
    style: Style = Style()  # noqa: RUF009  frozen
    seed: int = 1
    hears: bool = True
    """True if a recognizer processes the audio; otherwise only words with times move the mouth."""

    def __post_init__(self) -> None:
        RenderOptions(size=self.size, samples=parse_edges(self.edges))  # it checks them
        if not 1.0 <= self.frame_rate_hz <= 60.0:
            raise UsageError(f"frame_rate_hz: got {self.frame_rate_hz:g}, expected 1 to 60")


class AgentFace:
    """The face of an agent: :meth:`open` makes one with its processes, :meth:`close` ends them. Stateful.

    Parameters
    ----------
    host : StreamHost
    frame_rate_hz : float
    attention : Attention, optional
        How it looks while it listens and thinks.
    """

    def __init__(self, host: StreamHost, frame_rate_hz: float, attention: Attention | None = None) -> None:
        self.host, self.dt_s = host, 1.0 / frame_rate_hz
        self.marks = MarkTimer()
        self.attention = attention or Attention(np.random.default_rng(1))
        self.painter: Painter | None = None
        self.recognizer: RecognizerProcess | None = None
        self.pictures = Pictures(FilmCounts())
        self._restarts = Restarts()
        self._is_gone = False
        """True if the recognizer has ended, and the next one is not started yet."""
        self._retry_s = 0.0
        """Time from which on the recognizer may be started again."""
        self._due_s: float | None = None
        self._ahead_s = 0.0
        """Time by which frames are early now: it grows during speech."""
        self._half = b""
        self._has_words = False
        self.plays_s = 0.0
        """Time at which the audio of the last frame begins to be heard."""
        self._until_s = 0.0
        """Time until which the audio of past frames is played."""

    @classmethod
    def open(cls, options: AgentOptions) -> "AgentFace":
        """Make a face with its processes, which are :meth:`ready` after a second or two.

        Raises UsageError if the profile or the voice is unknown; ResourceError if a process cannot be started.
        """
        profile = load_profile(Path(options.profile) if "/" in options.profile else options.profile)
        pronounce = _pronounce(VoiceChoice(options.voice))
        recognizer = RecognizerProcess.open() if options.hears else None
        host = StreamHost(
            profile, rng=np.random.default_rng(options.seed), style=options.style, recognizer=recognizer,
            pronounce=pronounce,
        )  # fmt: skip
        attention = Attention(np.random.default_rng(options.seed), gaze=options.style.gaze)
        face = cls(host, options.frame_rate_hz, attention)
        face.recognizer = recognizer
        face.painter = Painter(options.head, options.size, options.edges, face.pictures.counts)
        return face

    async def ready(self) -> None:
        """Wait until painter and recognizer are ready. Raises ``ResourceError`` if nothing can be rendered."""
        if self.painter is not None:
            await self.painter.ready()
        await self.hears()

    async def hears(self) -> None:
        """Wait until the recognizer is ready, :data:`EAR_STARTS_S` at most."""
        with contextlib.suppress(ResourceError):  # it has ended, which the first frame notices
            for _ in range(round(EAR_STARTS_S / self.dt_s)):
                if self.recognizer is None or self.recognizer.is_ready:
                    return
                self.recognizer.poll()
                await asyncio.sleep(self.dt_s)

    def close(self) -> None:
        """End the processes."""
        self.pictures.close()
        if self.painter is not None:
            self.painter.close()
        if self.recognizer is not None:
            self.recognizer.close()

    # Events of the framework -----------------------------------------------------------------------------------------

    def sound(self, data: bytes | ArrayLike, rate_hz: int, channels: int = 1) -> None:
        """Add audio of the TTS.

        Raises DataError if the number of channels is not 1 to 8; UsageError if the samples have another form.

        Parameters
        ----------
        data : bytes or array_like
            Little-endian int16, channels interleaved, split anywhere; or samples, (N,) or (N, channels), as
            :func:`fapengine.save` takes them.
        rate_hz : int
        channels : int
            Of bytes.
        """
        if not isinstance(data, bytes | bytearray | memoryview):
            self.host.push(data, rate_hz)
            return
        if not 1 <= channels <= 8:
            raise DataError(f"channels: got {channels}, expected 1 to 8")
        data = self._half + data
        whole = len(data) // (2 * channels) * 2 * channels
        self._half = data[whole:]
        self.host.push(np.frombuffer(data[:whole], "<i2").reshape(-1, channels), rate_hz)

    def word(self, text: str, start_s: float, end_s: float | None = None) -> None:
        """Add a word with its times, counted from the first audio of the utterance."""
        self._has_words = True
        self.host.words([TimedWord(text, start_s, end_s)])
        for at_s, command in self.marks.word(text, start_s):
            self.host.cue(command, at_s)

    def feel(self, delivery: str) -> None:
        """Show a delivery, such as "say happily", from now on for :data:`FEELS_S`; nothing while it does not speak."""
        if self.host.is_speaking:
            marks = read_marks(f'<expr type="expression" label="{escape(delivery)}"/> so').marks  # cues need a text
            for _, command in commands_of(TimedMark(0.0, mark.act, FEELS_S) for mark in marks):
                self.host.send_command(command)

    def attend(self, state: State, is_so: bool = True) -> None:
        """Look at the user who speaks (``"listening"``), or aside (``"thinking"``), until it speaks.

        Raises UsageError if there is no such state.

        Parameters
        ----------
        state : str
        is_so : bool
            False ends the state, if it is the present one.
        """
        if not is_so:
            self.attention.end(state)
        else:
            self.attention.attend(state if state == "listening" or not self.host.is_speaking else "speaking")

    def end(self) -> None:
        """End the utterance."""
        self._half = b""
        self.host.end()

    def interrupt(self, now_s: float) -> None:
        """Stop speaking at once."""
        self.marks.clear()
        self._half = b""
        self._has_words = False
        self.host.interrupt(self.unplayed_s(now_s))
        self._until_s = 0.0
        self._due_s = None

    def unplayed_s(self, now_s: float) -> float:
        """Return the length of the audio of past frames that is not played yet, s."""
        return max(self._until_s - now_s, 0.0)

    # Timing ----------------------------------------------------------------------------------------------------------

    def wait_s(self, now_s: float, ahead_s: float = AHEAD_S) -> float:
        """Return the time until the next frame is due, s; if its audio is there, it is ``ahead_s`` early at most."""
        if self._due_s is None or now_s > self._due_s + MAX_LATE_S:
            self._due_s, self._ahead_s = now_s, 0.0
        early_s = min(self._ahead_s, ahead_s) if self.host.is_ready(self.dt_s) else 0.0
        return max(self._due_s - early_s - now_s, 0.0)

    def image_wait_s(self, now_s: float) -> float:
        """Return the time to wait for the image, s: until the next frame is due, or this one's audio is to be heard."""
        wait_s = self.wait_s(now_s)
        return min(wait_s, self.plays_s - now_s) if self.plays_s > now_s else wait_s

    def frame(self, now_s: float) -> tuple[StreamFrame, list[StreamEvent]]:
        """Make the next frame; return it, and the events of utterances."""
        self._supervise(now_s)
        for command in self.attention.due(now_s):
            self.host.send_command(command)
        frame = self.host.next(self.dt_s)
        events = self.host.events()
        if self._due_s is None or (frame.sounds and self._until_s <= now_s):  # it is heard from now on
            self._due_s, self._ahead_s = now_s, 0.0
        self._due_s += self.dt_s
        self.plays_s = now_s
        if frame.sounds:
            self._ahead_s = min(self._ahead_s + self.dt_s / 2, AHEAD_S)
            self.plays_s = max(self._until_s, now_s)
            self._until_s = self.plays_s + sum(sound.duration_s for sound in frame.sounds)
        elif not self.host.is_speaking:
            self._ahead_s = 0.0
        for event in events:
            if event.kind == "started":
                self.attention.attend("speaking")
            else:
                self.attention.end("speaking")
            if event.kind == "started" and not self._has_words:
                for at_s, command in self.marks.estimated():
                    self.host.cue(command, at_s)
            elif event.kind == "finished":
                self._has_words = False
        return frame, events

    def _supervise(self, now_s: float) -> None:
        """Start a recognizer again that has ended; the host has it once it is ready."""
        if self.host.hears:
            if self.host.has_recognized:
                self._restarts.worked()
            return
        if self.recognizer is None or now_s < self._retry_s:
            return
        try:
            if self._is_gone:
                self.recognizer, self._is_gone = RecognizerProcess.open(), False
            self.recognizer.poll()
        except ResourceError as error:
            self.recognizer.close()
            wait_s = self._restarts.failed()
            if wait_s is None:
                log.error("no more recognition, only words move the mouth: %s", error)
                self.recognizer = None
                return
            log.warning("%s; a new one is started", error)
            self._is_gone, self._retry_s = True, now_s + wait_s
            return
        if self.recognizer.is_ready:
            self.host.listen_with(self.recognizer)

    # Images ----------------------------------------------------------------------------------------------------------

    def show(self, frame: StreamFrame) -> None:
        """Begin to draw a frame, or skip it if an image is in flight; needs the event loop."""
        if self.painter is not None:
            self.pictures.show(frame.faps, self.plays_s, self.painter, is_still=not self.host.is_speaking)

    async def drawn(self, most_s: float) -> Picture | None:
        """Wait for the image in flight, ``most_s`` at most; return the newest finished image, once."""
        await self.pictures.wait(most_s)
        return self.pictures.take()


def _pronounce(voice: VoiceChoice) -> Pronounce | None:
    """Return the pronunciation of a voice; None if espeak-ng is not installed, because there is a recognizer too."""
    try:
        return pronouncer_of(voice).words
    except ResourceError:
        if not voice.is_language:
            raise
        return None

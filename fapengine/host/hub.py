"""Many hosts on one engine and one clock: commands come in from any source, frames go out to listeners.

Theory of operation
-------------------
Everything happens on one thread, that of the event loop; only voices, which take tens of milliseconds, run in threads
(:mod:`.speaker`) and return audio and phones. :meth:`Hub.tick` asks the engine for one frame of all sessions and hands
it out: whole to listeners of all sessions (sinks), and row by row to listeners of one (a web page, a window). A
listener that raises is dropped, logged and counted; the other faces do not notice.

Each session has a :class:`.host.Host`. A session stays open while it is held (:meth:`Hub.hold`) or receives commands;
after ``idle_close_s`` without either it is closed.
"""

import asyncio
import logging
import math
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import count

import numpy as np

from fapengine.engine.commands import VOICE_UTTERANCES, Anchor, Audio, Cancel, Command
from fapengine.engine.engine import Engine
from fapengine.errors import UsageError
from fapengine.host.host import Host
from fapengine.host.listeners import HubCounts, HubFrames, Listeners, Spoken, Unsubscribe
from fapengine.host.speaker import PieceVoice, Speaker, ThreadVoice
from fapengine.speaking import DEFAULT_RATE_WPM, DEFAULT_VOICE
from fapengine.speech.marks import read_marks
from fapengine.voices.choice import VoiceChoice
from fapengine.voices.protocol import Speech

RATE_HZ = 60.0
MAX_RATE_HZ = 1000.0
IDLE_CLOSE_S = 120.0
DOZE_S = 0.1
"""Time between two frames of no session."""
LOOK_EVERY_S = 1.0
"""Interval of the search for idle sessions."""
MAX_TEXT, MAX_SOUND_S = 4000, 590.0
"""Longest text, in characters and in seconds of audio; an utterance may last 600 s (``Limits.queued_s``)."""
LEAD_S, TAIL_S = 0.15, 0.25
"""Silence around a voice: the mouth opens from neutral and returns to it."""

log = logging.getLogger("fapengine.server")


@dataclass(slots=True)
class FramePacer:
    """A counter of frames at a steady rate, by absolute times, so that delays do not add up.

    A frame whose successor is due already is skipped.

    Stateful. Raises UsageError if the rate is not in 1..1000.

    Examples
    --------
    >>> pacer = FramePacer(rate_hz=10.0, start_s=0.0)
    >>> pacer.due(0.05), pacer.due(0.101), pacer.due(0.47)
    ((0, 0), (1, 0), (4, 2))
    >>> pacer.due(0.48) is None, round(pacer.next_s, 6)
    (True, 0.5)
    """

    rate_hz: float
    start_s: float
    """Time of frame 0."""
    skipped: int = 0
    """Frames that were never shown, because the caller came too late for them."""
    _next: int = 0

    def __post_init__(self) -> None:
        if not 1 <= self.rate_hz <= MAX_RATE_HZ:
            raise UsageError(f"rate_hz: got {self.rate_hz}, expected 1 to {MAX_RATE_HZ:g}")

    @property
    def next_s(self) -> float:
        """When the next frame is due."""
        return self.start_s + self._next / self.rate_hz

    def due(self, now_s: float) -> tuple[int, int] | None:
        """Return the frame that is due: its number, and how many before it were skipped; None if none is due."""
        number = math.floor((now_s - self.start_s) * self.rate_hz + 1e-6)  # a clock that says 0.0999999 means 0.1
        if number < self._next:
            return None
        skipped = number - self._next
        self.skipped += skipped
        self._next = number + 1
        return number, skipped


class Hub:
    """The engine, its listeners and its voice.

    Stateful.

    Parameters
    ----------
    engine : Engine
        Driven by the hub alone.
    rate_hz : float
        Frames per second.
    clock : callable
        Monotonic seconds; the engine's time.
    idle_close_s : float
        Time without holder and commands after which a session is closed.
    voice : PieceVoice, optional
        Speaks texts; by default espeak-ng in a thread.
    most_sound_s : float
        Longest audio of a text; the rest of an utterance's limit is left to the silence around it.
    """

    def __init__(
        self,
        engine: Engine,
        *,
        rate_hz: float = RATE_HZ,
        clock: Callable[[], float] = time.monotonic,
        idle_close_s: float = IDLE_CLOSE_S,
        voice: PieceVoice | None = None,
        most_sound_s: float = MAX_SOUND_S,
    ) -> None:
        self.engine = engine
        self.counts = HubCounts()
        self.clock = clock
        self.pacer = FramePacer(rate_hz, clock())
        self._idle_close_s = idle_close_s
        self._look_s = -np.inf
        self.listeners = Listeners(self.counts)
        self._utterances = count(VOICE_UTTERANCES)
        self._holders: set[tuple[str, object]] = set()
        """A session and a token of its own for each that holds it."""
        self._hosts: dict[str, Host] = {}
        self.speaker = Speaker(voice or ThreadVoice(), most_sound_s)
        self._stopped = False
        self._opened = asyncio.Event()
        self.engine.open_listeners.append(self._opened.set)
        self.engine.event_listeners.append(lambda event: self.listeners.tell("event", event.session, event))
        self.engine.command_listeners.append(self._tell_command)

    # Sessions and commands

    def open(self, session: str) -> None:
        """Begin a session; one that is open already stays as it is."""
        if session not in self.engine:
            self.engine.open(session, self.clock())

    def close(self, session: str) -> None:
        """End a session; one that is not open stays so."""
        if session in self.engine:
            self.engine.close(session, self.clock())

    def hold(self, session: str) -> Unsubscribe:
        """Open a session if it is not open, and keep it open until the returned function is called."""
        self.open(session)
        holder = session, object()
        self._holders.add(holder)
        return lambda: self._holders.discard(holder)

    def release_all(self) -> None:
        """Release all sessions: the server ends."""
        self._holders.clear()

    def apply(self, session: str, command: Command) -> None:
        """Apply a command to a session now. Raises UsageError if the session is not open."""
        self.engine.apply(session, command, self.clock())

    def new_number(self) -> int:
        """Return the number of a new utterance of the server's own."""
        return next(self._utterances)

    def host(self, session: str) -> Host:
        """Return the host of a session; it is dropped when the session is closed."""
        return self._hosts.setdefault(session, Host(self.engine, session))

    # Voices

    def say(self, session: str, speech: Speech, *, text: str = "", anchor: Anchor | None = None) -> Spoken:
        """Say what a voice spoke; the audio goes to its listeners.

        Raises UsageError if the session is not open, or has too many utterances.

        Parameters
        ----------
        session : str
            An open session.
        speech : Speech
            Audio, and phones in its time.
        text : str
            Text for listeners that show it.
        anchor : Anchor, optional
            When the face begins; by default with the audio if a listener plays it, else now or after the queue.
        """
        if anchor is None:
            anchor = "audio" if self.listeners.plays(session) else "now"
        spoken = Spoken(session, self.new_number(), text, speech, anchor)
        self.host(session).say(spoken.utterance, speech, anchor, self.clock())
        self.listeners.tell("speech", session, spoken)
        return spoken

    async def speak(
        self,
        session: str,
        text: str,
        *,
        voice: str = DEFAULT_VOICE,
        rate_wpm: int = DEFAULT_RATE_WPM,
        ssml: bool = False,
    ) -> Spoken | None:
        """Speak a text, in turn with other sessions; then the session says it, unless it was cancelled.

        Raises UsageError if the session is not open or has too many texts waiting, the text is empty or too long, in
        characters or in seconds, or the voice is unknown; ResourceError if the voice is not installed.
        """
        if len(text) > MAX_TEXT:
            raise UsageError(f"text: must have at most {MAX_TEXT} characters, got {len(text)}")
        speech = await self.speaker.speak(session, text, VoiceChoice(voice, rate_wpm, ssml))
        if speech is None:
            return None
        for remark in speech.remarks:
            log.warning("%s", remark, extra={"session": session})
        shown = read_marks(text, ssml=ssml).text
        return self.say(session, speech.padded(lead_s=LEAD_S, tail_s=TAIL_S), text=shown)

    async def say_words(
        self,
        session: str,
        words: Sequence[tuple[str, float, float]],
        *,
        voice: str = DEFAULT_VOICE,
        anchor: Anchor = "now",
        at_s: float = 0.0,
        utterance: int | None = None,
        is_last: bool = True,
        duration_s: float = 0.0,
    ) -> int | None:
        """Say words with known times, as a TTS reports them; their audio is played elsewhere.

        Raises UsageError if the session is not open or its queue is full, the times are out of order, or the voice is
        unknown; ResourceError if the voice is not installed.

        Parameters
        ----------
        session : str
            An open session.
        words : sequence of (str, float, float)
            Word, start and end in s from the utterance's beginning.
        voice : str
            Language that they are pronounced in.
        anchor : Anchor
            When it begins.
        at_s : float
            Engine time, for ``"at"``.
        utterance : int, optional
            Number of the utterance that they continue; by default they begin one.
        is_last : bool
            Whether no word of it follows.
        duration_s : float
            With the last: the utterance's length, if longer than its words.

        Returns
        -------
        int or None
            Number of the utterance; None if it has finished, or was cancelled in the meantime.
        """
        host = self.host(session)
        if utterance is not None:
            async with self.speaker.turn(session, utterance):
                phones = await self.speaker.pronounce(session, words, voice) if words else []
                if phones is not None:
                    host.phones(utterance, phones, self.clock(), is_last=is_last, duration_s=duration_s)
            return None if self.engine.utterance(session, utterance) is None else utterance
        phones = await self.speaker.pronounce(session, words, voice)
        if phones is None:
            return None
        number, now_s = self.new_number(), self.clock()
        host.begin(number, now_s, anchor=anchor, at_s=at_s)
        host.phones(number, phones, now_s, is_last=is_last, duration_s=duration_s)
        return number

    # Time

    def tick(self, now_s: float, number: int | None = None) -> HubFrames:
        """Make one frame of every session and hand it out. Times rise from call to call."""
        self._hosts = {session: host for session, host in self._hosts.items() if session in self.engine}
        self.counts.unheard += sum(host.tick(now_s) for host in tuple(self._hosts.values()))
        if now_s >= self._look_s:
            self._look_s = now_s + LOOK_EVERY_S
            self._close_idle(now_s)
        shown = self.engine.frame(now_s)
        self._tell_faults(now_s)
        self.engine.collect()
        sessions, faps = tuple(shown.sessions), shown.faps
        for host in self._hosts.values():
            if host.is_overlaid and host.session in sessions:
                host.overlay(faps[sessions.index(host.session)], now_s)  # the engine has a copy of its own
        if number is None:
            number = self.counts.frames + self.counts.skipped
        frames = HubFrames(number, now_s, sessions, faps)
        self.counts.frames += 1
        self.listeners.tell_frames(frames)
        return frames

    async def run(
        self, before: Callable[[float, float], None] | None = None, after: Callable[[float], None] | None = None
    ) -> None:
        """Tick at the rate until :meth:`stop`; less often while there is no session.

        Parameters
        ----------
        before : callable, optional
            Called before each frame with the time, and the time at which it was due, to process input.
        after : callable, optional
            Called with the time when a frame has been handed out.
        """
        pacer = self.pacer = FramePacer(self.pacer.rate_hz, self.clock())
        is_empty = False
        while not self._stopped:
            due_s, due = pacer.next_s, pacer.due(self.clock())
            if due is None:
                await asyncio.sleep(max(0.0, due_s - self.clock()))
                continue
            number, skipped = due
            self.counts.skipped += 0 if is_empty else skipped
            if before is not None:
                before(self.clock(), due_s)
            self.tick(self.clock(), number)
            if after is not None:
                after(self.clock())
            is_empty = not self.engine.sessions
            await (self._doze() if is_empty else asyncio.sleep(0))

    async def _doze(self) -> None:
        """Wait until a session is opened, or a while."""
        self._opened.clear()
        with suppress(TimeoutError):
            async with asyncio.timeout(DOZE_S):
                await self._opened.wait()

    def stop(self) -> None:
        """End :meth:`run` after its frame."""
        self._stopped = True

    def _tell_faults(self, now_s: float) -> None:
        """Log faults; a session that is held is opened again, at neutral."""
        for fault in self.engine.faults():
            self.counts.faulted += 1
            log.error(
                "%s: ended, its frame could not be made", fault.session,
                exc_info=fault.error, extra={"session": fault.session},
            )  # fmt: skip
            if fault.session in {session for session, _ in self._holders}:
                self.engine.open(fault.session, now_s)

    def _close_idle(self, now_s: float) -> None:
        held = {session for session, _ in self._holders}
        for session in self.engine.sessions:
            quiet_s = now_s - self.engine.touched_s.get(session, now_s)
            is_still = self.engine.state(session) in ("idle", "paused")
            if quiet_s > self._idle_close_s and session not in held and is_still:
                self.counts.idle_closed += 1
                self.engine.close(session, now_s)

    def _tell_command(self, session: str, command: Command, now_s: float) -> None:
        if isinstance(command, Audio | Cancel) and session in self._hosts:
            self._hosts[session].note(command, now_s)
        if isinstance(command, Cancel) and command.utterance is None:
            self.speaker.cancel(session)
        self.listeners.tell("command", session, session, command, now_s)

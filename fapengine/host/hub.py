"""Many hosts on one engine and one clock: commands come in from anywhere, frames go out to the listeners.

Theory of operation
-------------------
Everything happens on one thread, that of the event loop; only voices, which take tens of milliseconds, speak beside it
(:mod:`.speaker`) and come back with sound and phones. :meth:`Hub.tick` asks the engine for one frame of all sessions
and hands it out: once, whole, to those who take all sessions (sinks), and row by row to those who watch one (a page, a
window). A listener that raises is dropped, logged and counted; the other faces do not notice.

Each session has a :class:`.host.Host`. A session stays open while it is held (:meth:`Hub.hold`) or gets commands; after
``idle_close_s`` of neither it is closed.
"""

import asyncio
import logging
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from itertools import count

import numpy as np

from fapengine.engine.commands import VOICE_UTTERANCES, Anchor, Audio, Cancel, Command
from fapengine.engine.engine import Engine
from fapengine.errors import UsageError
from fapengine.host.host import Host
from fapengine.host.listeners import HubCounts, HubFrames, Listeners, Spoken, Unsubscribe
from fapengine.host.pacer import FramePacer
from fapengine.host.speaker import PieceVoice, Speaker, ThreadVoice
from fapengine.speaking import DEFAULT_RATE_WPM, DEFAULT_VOICE
from fapengine.speech.marks import read_marks
from fapengine.voices.choice import VoiceChoice
from fapengine.voices.protocol import Speech

RATE_HZ = 60.0
IDLE_CLOSE_S = 120.0
DOZE_S = 0.1
"""Time between two frames of no session."""
LOOK_EVERY_S = 1.0
"""Interval at which idle sessions are searched."""
MAX_TEXT, MAX_SOUND_S = 4000, 590.0
"""Characters that are spoken at once, and seconds of their sound: an utterance may have 600 (``Limits.queued_s``)."""
LEAD_S, TAIL_S = 0.15, 0.25
"""Silence around a voice: the mouth opens from neutral and returns to it."""

log = logging.getLogger("fapengine.server")


class Hub:
    """The engine, its listeners and its voice.

    Stateful.

    Parameters
    ----------
    engine : Engine
        The hub alone drives it; others reach it through ``engine``.
    rate_hz : float
        Frames a second.
    clock : callable
        Monotonic seconds; the engine's time.
    idle_close_s : float
        A session that nobody holds or talks to is closed after so long.
    voice : PieceVoice, optional
        Speaks texts; by default espeak-ng in a thread.
    most_sound_s : float
        Length of a text's sound; the rest of what an utterance may have is left to the silence around it.
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
        self._holders: dict[str, int] = {}
        self._hosts: dict[str, Host] = {}
        self.speaker = Speaker(voice or ThreadVoice(), most_sound_s)
        self._stopped = False
        self._opened = asyncio.Event()
        self.engine.open_listeners.append(self._opened.set)
        self.engine.event_listeners.append(self.listeners.tell_event)
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
        self._holders[session] = self._holders.get(session, 0) + 1
        released = False

        def release() -> None:
            nonlocal released
            if not released and session in self._holders:
                self._holders[session] -= 1
                if not self._holders[session]:
                    del self._holders[session]
            released = True

        return release

    def release_all(self) -> None:
        """Release all sessions: the server ends."""
        self._holders.clear()

    def apply(self, session: str, command: Command) -> None:
        """Apply a command to a session now.

        Raises
        ------
        UsageError
            If the session is not open.
        """
        self.engine.apply(session, command, self.clock())

    def new_number(self) -> int:
        """Return the number of a new utterance of the server's own."""
        return next(self._utterances)

    def host(self, session: str) -> Host:
        """Return what a session says and holds; it is forgotten when the session is closed."""
        return self._hosts.setdefault(session, Host(self.engine, session))

    # Voices

    def say(self, session: str, speech: Speech, *, text: str = "", anchor: Anchor | None = None) -> Spoken:
        """Say what was spoken; the sound goes to its listeners.

        Parameters
        ----------
        session : str
            An open one.
        speech : Speech
            Sound, and phones in its time.
        text : str
            For those who show it.
        anchor : Anchor, optional
            When the face begins; by default with the sound, if somebody plays it, else now or behind what is queued.

        Raises
        ------
        UsageError
            If the session is not open, or has as many utterances as there may be.
        """
        if anchor is None:
            anchor = "audio" if self.listeners.plays(session) else "now"
        spoken = Spoken(session, self.new_number(), text, speech, anchor)
        self.host(session).say(spoken.utterance, speech, anchor, self.clock())
        self.listeners.tell_speech(spoken)
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
        """Speak a text, in turn with other sessions; then the session says it, unless it was cancelled meanwhile.

        Raises
        ------
        UsageError
            If the session is not open or has too many texts that wait, the text is empty, or too long in letters or in
            sound, or the voice unknown.
        ResourceError
            If the voice is not installed.
        """
        if len(text) > MAX_TEXT:
            raise UsageError(f"text: got {len(text)} letters, expected at most {MAX_TEXT}")
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
        """Say words with known times, as a TTS reports them; their sound is played elsewhere.

        Parameters
        ----------
        session : str
            An open one.
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
            Number of the utterance; None if it is over, or the session was told to stop meanwhile.

        Raises
        ------
        UsageError
            If the session is not open or has no place, the times are out of order, or the voice is unknown.
        ResourceError
            If the voice is not installed.
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
        overlaid = [host for host in self._hosts.values() if host.is_overlaid and host.session in sessions]
        if overlaid:
            faps = faps.copy()
            for host in overlaid:
                host.overlay(faps[sessions.index(host.session)], now_s)
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
            Called before each frame with the time, and when it was due: what came in since is taken then.
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
        """Log what failed; a session that is held is opened again, at neutral."""
        for fault in self.engine.faults():
            self.counts.faulted += 1
            log.error(
                "%s: ended, its frame could not be made", fault.session,
                exc_info=fault.error, extra={"session": fault.session},
            )  # fmt: skip
            if fault.session in self._holders:
                self.engine.open(fault.session, now_s)

    def _close_idle(self, now_s: float) -> None:
        for session in self.engine.sessions:
            quiet_s = now_s - self.engine.touched_s.get(session, now_s)
            is_still = self.engine.state(session) in ("idle", "paused")
            if quiet_s > self._idle_close_s and session not in self._holders and is_still:
                self.counts.idle_closed += 1
                self.engine.close(session, now_s)

    def _tell_command(self, session: str, command: Command, now_s: float) -> None:
        if isinstance(command, Audio | Cancel) and session in self._hosts:
            self._hosts[session].note(command, now_s)
        if isinstance(command, Cancel) and command.utterance is None:
            self.speaker.cancel(session)
        self.listeners.tell_command(session, command, now_s)

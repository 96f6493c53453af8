"""The one object that ticks: commands come in from anywhere, frames go out to whoever listens.

Theory of operation
-------------------
Everything happens on one thread, that of the event loop; only voices, which take tens of milliseconds, speak beside it
(:mod:`.speaker`) and come back with sound and phones. :meth:`Hub.tick` asks the engine for one frame of all sessions
and hands it out: once, whole, to those who take all sessions (sinks), and row by row to those who watch one (a page, a
window). A listener that raises is dropped, told of in the log and counted: the other faces do not notice.

A session lives as long as somebody holds it (:meth:`Hub.hold`) or tells it something; after ``idle_close_s`` of neither
it is closed.
"""

import asyncio
import logging
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from functools import partial
from itertools import count

import numpy as np

from fapengine.errors import UsageError
from fapengine.live.engine.commands import VOICE_UTTERANCES, Anchor, Append, Audio, Begin, Cancel, Command, End
from fapengine.live.engine.marked import commands_of
from fapengine.live.engine.port import EnginePort
from fapengine.live.hub.listeners import Listeners, Unsubscribe
from fapengine.live.hub.messages import HubCounts, HubFrames, Spoken
from fapengine.live.hub.observed_engine import ObservedEngine
from fapengine.live.hub.pacer import FramePacer
from fapengine.live.hub.performers import Performers
from fapengine.live.hub.pins import Pins
from fapengine.live.hub.speaker import Asked, PieceVoice, Speaker, ThreadVoice
from fapengine.live.hub.timed_words import TimedWords
from fapengine.live.hub.waiting import Waiting
from fapengine.speech.marks import read_marks
from fapengine.speech.phone_track import Phone
from fapengine.voices.choice import VoiceChoice
from fapengine.voices.espeak import DEFAULT_RATE_WPM, DEFAULT_VOICE
from fapengine.voices.pronounce import WORDS_OVERLAP_S
from fapengine.voices.protocol import Speech

RATE_HZ = 60.0
IDLE_CLOSE_S = 120.0
PHONES_A_COMMAND = 64
DOZE_S = 0.1
"""Time between two frames of no session."""
LOOK_EVERY_S = 1.0
"""Interval at which idle sessions are looked for."""
MAX_TEXT, MAX_SOUND_S = 4000, 590.0
"""Letters that are spoken at once, and seconds of their sound: an utterance may have 600 (``Limits.queued_s``)."""
LEAD_S, TAIL_S = 0.15, 0.25
"""Silence around a voice: the mouth opens out of rest and comes back to it."""

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
        engine: EnginePort,
        *,
        rate_hz: float = RATE_HZ,
        clock: Callable[[], float] = time.monotonic,
        idle_close_s: float = IDLE_CLOSE_S,
        voice: PieceVoice | None = None,
        most_sound_s: float = MAX_SOUND_S,
    ) -> None:
        self.engine = ObservedEngine(engine)
        self.counts = HubCounts()
        self.clock = clock
        self.pacer = FramePacer(rate_hz, clock())
        self._idle_close_s = idle_close_s
        self._look_s = -np.inf
        self.listeners = Listeners(self.counts)
        self._utterances = count(VOICE_UTTERANCES)
        self._holders: dict[str, int] = {}
        self._waiting = Waiting(self.engine, self.counts)
        self._asked: list[Asked] = []
        self._words = TimedWords(self._asked)
        self.speaker = Speaker(voice or ThreadVoice(), most_sound_s)
        self._pins = Pins()
        self._performers = Performers()
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
        """Open a session if need be, and keep it open until the returned function is called."""
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
        """Forget who holds what: the server ends."""
        self._holders.clear()

    def apply(self, session: str, command: Command) -> None:
        """Tell a session something, now.

        Raises
        ------
        UsageError
            If the session is not open.
        """
        self.engine.apply(session, command, self.clock())

    def new_number(self) -> int:
        """Give the number of a new utterance of the server's own."""
        return next(self._utterances)

    def pin(self, session: str, number: int, value: int | None) -> None:
        """Hold FAP ``number`` of a session at a value in FAPU, whatever the engine says; None lets it go.

        Raises
        ------
        UsageError
            If the session is not open, or there is no such FAP.
        """
        self._check_open(session)
        self._pins.pin(session, number, value)

    def perform(self, session: str, values: Mapping[int, int]) -> None:
        """Let somebody's FAPs move a face, as a camera sees them: FAP number to FAPU, over what the engine says.

        They last until the next call; when none comes for 0.3 s, the face is let go within 0.3 s.

        Raises
        ------
        UsageError
            If the session is not open, or there is no such FAP.
        """
        self._check_open(session)
        self._performers.perform(session, values, self.clock())

    def _check_open(self, session: str) -> None:
        if session not in self.engine:
            raise UsageError(f"session: got {session!r}, expected one of {', '.join(self.engine.sessions) or 'none'}")

    def pinned(self, session: str) -> dict[int, int]:
        """FAP number to the value at which it is held."""
        return self._pins.of(session)

    def begin(self, session: str, number: int, anchor: Anchor = "now", at_s: float = 0.0) -> None:
        """Begin an utterance, for an ``anchor`` of ``"at"`` at an engine time.

        Raises
        ------
        UsageError
            If the session is not open, or has as many utterances as there may be.
        """
        self.apply(session, Begin(number, anchor, at_s))
        if self.engine.utterance(session, number) is None:
            raise UsageError(f"session: {session!r} has as many utterances queued as there may be")

    # Voices

    def say(self, session: str, speech: Speech, *, text: str = "", anchor: Anchor | None = None) -> Spoken:
        """Let a face say what was spoken; the sound goes to those who listen for it.

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
        self.begin(session, spoken.utterance, anchor)
        self.tell_phones(session, spoken.utterance, speech.phones.phones, duration_s=speech.duration_s)
        self._waiting.for_times(session, spoken.utterance, commands_of(speech.marks))
        if anchor == "audio":
            self._waiting.for_sound(session, spoken.utterance, self.clock())
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
        """Speak a text, in turn with other sessions; then the session says it, unless it was told to stop meanwhile.

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
        request = Asked(session)
        self._asked.append(request)
        try:
            speech = await self.speaker.speak(request, text, VoiceChoice(voice, rate_wpm, ssml))
        finally:
            self._asked.remove(request)
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
        """Let a face say words whose times are known, as a TTS tells them; their sound is elsewhere.

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
        if utterance is not None:
            tell = partial(self.tell_phones, session, utterance, is_last=is_last, duration_s=duration_s)
            await self._words.go_on(session, utterance, words, voice, tell)
            return None if self.engine.utterance(session, utterance) is None else utterance
        phones = await self._words.pronounce(session, words, voice)
        if phones is None:
            return None
        number = self.new_number()
        self.begin(session, number, anchor, at_s)
        self.tell_phones(session, number, phones, is_last=is_last, duration_s=duration_s)
        return number

    def tell_phones(
        self, session: str, number: int, phones: Sequence[Phone], *, is_last: bool = True, duration_s: float = 0.0
    ) -> None:
        """Go on with an utterance that was begun; one that is over stays so.

        Parameters
        ----------
        session, number
            Of the engine.
        phones : sequence of Phone
            Behind those that came before, in the utterance's time; none only to end it.
        is_last : bool
            Whether no phone follows.
        duration_s : float
            With the last: the utterance's length, if longer than its phones.

        Raises
        ------
        UsageError
            If the session is not open, the utterance was ended, or the phones lie before those that came.
        """
        told = self.engine.utterance(session, number)
        if told is None:
            return
        if told.phone_count is not None:
            raise UsageError(f"utterance {number}: it was ended, and takes no more")
        if phones and phones[0].start_s < told.last_s - WORDS_OVERLAP_S:
            raise UsageError(
                f"utterance {number}: got {phones[0].label!r} at {phones[0].start_s:g} s, expected it behind"
                f" {told.last_s:g} s"
            )
        first = told.next_index
        for part in range(0, len(phones), PHONES_A_COMMAND):
            self.apply(session, Append(number, first + part, tuple(phones[part : part + PHONES_A_COMMAND])))
        if is_last:
            length_s = max(duration_s, told.last_s, phones[-1].end_s if phones else 0.0)
            self.apply(session, End(number, first + len(phones), length_s))

    # Time

    def tick(self, now_s: float, number: int | None = None) -> HubFrames:
        """Show one frame of every session to all who want it. Times rise from call to call."""
        self._waiting.tick(now_s)
        if now_s >= self._look_s:
            self._look_s = now_s + LOOK_EVERY_S
            self._close_idle(now_s)
        shown = self.engine.frame(now_s)
        self._tell_faults(now_s)
        self.engine.collect()
        sessions = tuple(shown.sessions)
        faps = self._performers.move(sessions, shown.faps, now_s) if self._performers else shown.faps
        faps = self._pins.hold(sessions, faps) if self._pins else faps
        if number is None:
            number = self.counts.frames + self.counts.skipped
        frames = HubFrames(number, now_s, sessions, faps)
        self.counts.frames += 1
        self.listeners.tell_frames(frames)
        return frames

    async def run(
        self,
        before: Callable[[float, float], None] | None = None,
        after: Callable[[float], None] | None = None,
    ) -> None:
        """Tick at the rate until :meth:`stop`; seldom while there is no session, until one is opened.

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
        """Let :meth:`run` end after its frame."""
        self._stopped = True

    def _tell_faults(self, now_s: float) -> None:
        """Log what failed; a session that somebody holds begins anew, at rest."""
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
        if isinstance(command, Audio | Cancel):
            self._waiting.hear(session, command, now_s)
        if isinstance(command, Cancel) and command.utterance is None:
            for request in self._asked:
                request.is_cancelled |= request.session == session
        self.listeners.tell_command(session, command, now_s)

"""Faces that are moved by audio: a recognizer for each session with audio, and its phones into the session.

Theory of operation
-------------------
:meth:`Hearing.hear` accepts audio of an utterance that a sender numbers; :meth:`Hearing.listen` accepts endless audio
of a microphone: speech in it is an utterance, which ends after :data:`PAUSE_S` of silence. Each session's audio goes to
a recognizer process (:class:`fapengine.recognition.process.RecognizerProcess`), which reports its final phones and,
after them, those that may still change. The engine gets both; each result replaces the phones after the final ones. So
the face can follow the audio :data:`DELAY_S` later. What cancels an utterance also empties its recognizer. The number
of recognizers is limited, and so is the audio that each keeps before it is processed; more audio is refused and
counted. Where the machine is too slow, the recognizer does less work, so that the face goes on
(:mod:`fapengine.recognition.process`).
"""

import logging
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, field, replace
from math import inf
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fapengine._counters import Counts, metric
from fapengine.engine.commands import Begin, Cancel, Command
from fapengine.engine.session import Event
from fapengine.errors import FapEngineError, ResourceError
from fapengine.host.hub import Hub
from fapengine.host.listeners import HeardSound, Place
from fapengine.host.words import ChangingPhones
from fapengine.recognition.choice import is_installed
from fapengine.recognition.process import RecognizerProcess
from fapengine.recognition.protocol import RecognizedPhones, StreamRecognizer
from fapengine.recognition.small_recognizer import LOOK_AHEAD_S
from fapengine.speech.phone_track import Phone

DELAY_S = 0.25
"""Delay of the face after audio that comes as it is spoken (``bench/recognizer_delays.py``)."""
MAX_RECOGNIZERS = 4
MAX_WAITING_S = 20.0
"""Most audio of one session that waits for its recognizer."""
IDLE_S = 30.0
"""Time without audio after which a session releases its recognizer."""
QUIET_S = 0.5
"""Time without audio after which a microphone's stream ends."""
JUMP_S = 0.3
"""Time by which a microphone's audio may be late before it counts as a new stream."""
DRIFT = 1e-3
"""Fraction by which a microphone's clock may be slower than ours."""
PAUSE_S = 0.5

log = logging.getLogger("fapengine.hub")


@dataclass(slots=True)
class HearingCounts(Counts):
    """Counts of audio and phones. Stateful."""

    METRIC = "sound", "Audio for recognizers, s, and its phones, by outcome."

    recognizers: int = metric("recognizers", "Recognizer processes.", is_gauge=True)
    heard_s: float = 0.0
    """Audio that was recognized."""
    refused_s: float = 0.0
    """Audio beyond what may wait, or without a recognizer."""
    reduced_s: float = 0.0
    """Audio that was recognized without the costly part, because the machine is too slow."""
    skipped_s: float = 0.0
    """Audio that was skipped, because the machine is too slow even for that."""
    phones: int = 0
    ended: int = 0
    """Recognizers that ended by themselves: each is a bug, or was killed."""


@dataclass(slots=True)
class _Utterance:
    """Utterance that the phones of a stream go to. Stateful."""

    number: int
    offset_s: float
    """Time in the utterance of the stream's first sample."""
    is_begun: bool
    end_s: float = 0.0
    """End of its last final phone that is not silence."""
    phones: ChangingPhones = field(init=False)

    def __post_init__(self) -> None:
        self.phones = ChangingPhones(self.number)


@dataclass(slots=True, eq=False)
class _Session:
    """One session's recognizer. Stateful."""

    recognizer: StreamRecognizer
    touched_s: float
    utterance: _Utterance | None = None
    """Current utterance."""
    is_endless: bool = False
    """True where the stream is a microphone's."""
    zero_s: float = 0.0
    """Engine time at which a microphone's stream began."""
    pushed_s: float = 0.0
    """Length of the stream."""
    deaf_s: float = 0.0
    """Time in a microphone's stream before which phones are dropped because they were cancelled."""
    rate_hz: int = 0
    source: Hashable = None
    """Source of a microphone's audio."""
    ends: bool = False
    heard_s: float = 0.0
    stream: int = 0
    """Number of its stream."""
    place: Place = lambda now_s: None
    """Place of the stream in engine time: see :class:`HeardSound`."""

    @property
    def delay_s(self) -> float:
        """Delay of the face: :data:`DELAY_S`, and more for a recognizer that looks farther ahead."""
        return DELAY_S + max(self.recognizer.look_ahead_s - LOOK_AHEAD_S, 0.0)


@dataclass(slots=True, eq=False)
class Hearing:
    """All recognizers of a hub. Stateful; call :meth:`tick` once before each frame."""

    hub: Hub
    max_recognizers: int = MAX_RECOGNIZERS
    model: Path | None = None
    """Name of a recognizer, or an ONNX model (:mod:`fapengine.recognition.choice`)."""
    opens: Callable[[Path | None], StreamRecognizer] = RecognizerProcess.open
    counts: HearingCounts = field(default_factory=HearingCounts)
    _sessions: dict[str, _Session] = field(default_factory=dict)
    _spare: StreamRecognizer | None = None
    _takers: list[tuple[str, Callable[[HeardSound], None]]] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.hub.listeners.on_command(None, self._note_command)
        self.hub.listeners.on_event(None, self._note_event)

    def hear(
        self,
        session: str,
        utterance: int,
        samples: NDArray[np.int16],
        rate_hz: int,
        *,
        first_s: float = 0.0,
        is_placed: bool = True,
        is_last: bool = False,
    ) -> None:
        """Add audio of an utterance; another utterance ends the one before.

        Raises ResourceError if no recognizer is free.

        Parameters
        ----------
        session : str
            An open session.
        utterance : int
            The engine's number.
        samples : (N,) int16
            Mono.
        rate_hz : int
        first_s : float
            Time in the utterance of its very first sample.
        is_placed : bool
            Whether the engine knows when it begins; otherwise it begins :data:`DELAY_S` from now.
        is_last : bool
            Whether no more audio of it follows.
        """
        one = self._session(session, len(samples) / rate_hz)
        if one.is_endless or one.utterance is None or one.utterance.number != utterance:
            self._end_utterance(session, one)
            self._begin_stream(one, rate_hz, is_endless=False)
            one.utterance = _Utterance(utterance, first_s, is_placed)
            one.place = self._place_in(session, one.utterance)
        self._push(session, one, samples, rate_hz)
        if is_last and not one.ends:
            one.ends = True
            one.recognizer.end()

    def on_sound(self, session: str, taker: Callable[[HeardSound], None]) -> Callable[[], None]:
        """Receive the audio that moves a session, and its place, until the returned function is called."""
        entry = (session, taker)
        self._takers.append(entry)
        return lambda: self._takers.remove(entry) if entry in self._takers else None

    @property
    def is_possible(self) -> bool:
        """Whether there may be a recognizer: it is installed, and allowed."""
        return self.max_recognizers > 0 and is_installed(self.model)

    def listen(self, session: str, samples: NDArray[np.int16], rate_hz: int, *, source: Hashable = None) -> bool:
        """Add the next audio of a microphone, (N,) int16, as it comes; False if it was refused.

        It is refused if too much waits, or while another source, or an utterance with audio, has the recognizer. Raises
        ResourceError if no recognizer is free.
        """
        before = self._sessions.get(session)
        if before is not None and not before.ends and before.rate_hz:
            is_taken = before.source != source if before.is_endless else before.utterance is not None
            if is_taken:
                self.counts.refused_s += len(samples) / rate_hz
                return False
        one = self._session(session, len(samples) / rate_hz)
        one.source = source
        now_s = self.hub.clock()
        began_s = now_s - one.pushed_s - len(samples) / rate_hz
        late_s = began_s - one.zero_s
        if not one.is_endless or one.ends or one.rate_hz != rate_hz or late_s > JUMP_S:
            self._end_utterance(session, one)
            self._begin_stream(one, rate_hz, is_endless=True)
            one.zero_s = now_s - len(samples) / rate_hz
            one.place = self._place_live(session, one)
        else:
            one.zero_s += min(late_s, DRIFT * len(samples) / rate_hz)
        return self._push(session, one, samples, rate_hz)

    def tick(self, now_s: float) -> None:
        """Send recognized phones to their sessions."""
        for session, one in list(self._sessions.items()):
            if one.is_endless and not one.ends and now_s - one.touched_s > QUIET_S:
                one.ends = True
                one.recognizer.end()
            try:
                shown_s = one.place(now_s)
                results = one.recognizer.poll(-inf if shown_s is None else shown_s)
            except ResourceError as error:
                log.error("%s: %s", session, error, extra={"session": session})
                self.counts.ended += 1
                self._end_utterance(session, one)
                self._close(session, keep=False)
                continue
            if results:
                phones = tuple(phone for result in results for phone in result.phones)
                heard = replace(results[-1], phones=phones)
                self._count(session, one, results)
                self._tell(session, one, heard, now_s)
            waits = one.utterance is not None and not one.utterance.is_begun
            if waits and one.recognizer.is_ready and session in self.hub.engine:
                self._begin(session, one, now_s)  # with what has come so far
            if session not in self.hub.engine or now_s - one.touched_s > IDLE_S:
                self._close(session, keep=session in self.hub.engine)

    def drop(self, session: str) -> None:
        """Drop a session's audio."""
        if session in self._sessions:
            self._end_utterance(session, self._sessions[session])
            self._close(session, keep=True)

    def close(self) -> None:
        """End all recognizers."""
        for session in list(self._sessions):
            self._close(session, keep=False)
        if self._spare is not None:
            self._spare.close()
            self._spare = None
            self.counts.recognizers -= 1

    # Recognizers

    def _session(self, session: str, length_s: float) -> _Session:
        one = self._sessions.get(session)
        if one is None:
            if len(self._sessions) >= self.max_recognizers:
                self.counts.refused_s += length_s
                raise ResourceError(
                    f"recognizers: got audio of another session, expected {self.max_recognizers} at most"
                )
            recognizer, self._spare = self._spare, None
            if recognizer is None:
                try:
                    recognizer = self.opens(self.model)
                except FapEngineError:
                    self.counts.refused_s += length_s
                    raise
                self.counts.recognizers += 1
            one = self._sessions[session] = _Session(recognizer, self.hub.clock())
        one.touched_s = self.hub.clock()
        return one

    def _close(self, session: str, *, keep: bool) -> None:
        one = self._sessions.pop(session)
        if keep and self._spare is None and one.recognizer.is_ready:
            one.recognizer.begin()
            self._spare = one.recognizer
        else:
            one.recognizer.close()
            self.counts.recognizers -= 1

    def _begin_stream(self, one: _Session, rate_hz: int, *, is_endless: bool) -> None:
        one.recognizer.begin()
        one.stream += 1
        one.utterance, one.is_endless, one.rate_hz, one.ends = None, is_endless, rate_hz, False
        one.pushed_s = one.deaf_s = one.heard_s = 0.0

    def _push(self, session: str, one: _Session, samples: NDArray[np.int16], rate_hz: int) -> bool:
        length_s = len(samples) / rate_hz
        if one.recognizer.waiting_s + length_s > MAX_WAITING_S:
            self.counts.refused_s += length_s
            samples = samples[:0]
        one.recognizer.push(samples, rate_hz)
        if len(samples):
            sound = HeardSound((one.stream, id(one)), samples, rate_hz, one.pushed_s, one.place, one.is_endless)
            for wanted, taker in tuple(self._takers):
                if wanted == session:
                    taker(sound)
        one.pushed_s += len(samples) / rate_hz
        return len(samples) > 0 or length_s == 0

    def _place_in(self, session: str, utterance: _Utterance) -> Place:
        """Follow an utterance of the engine."""
        engine, first_s = self.hub.engine, utterance.offset_s

        def place(now_s: float) -> float | None:
            if not utterance.is_begun:
                return -inf
            told = engine.utterance(session, utterance.number) if session in engine else None
            return None if told is None else told.position_s(now_s) - first_s

        return place

    def _place_live(self, session: str, one: _Session) -> Place:
        """Follow a microphone, as its face does."""
        stream = one.stream

        def place(now_s: float) -> float | None:
            if self._sessions.get(session) is not one or one.stream != stream:
                return None
            at_s = now_s - one.zero_s - one.delay_s
            return at_s if at_s >= max(one.deaf_s, 0.0) else -inf

        return place

    def _count(self, session: str, one: _Session, results: Sequence[RecognizedPhones]) -> None:
        was_slow = self.counts.reduced_s + self.counts.skipped_s > 0
        for result in results:
            length_s = result.position_s - one.heard_s - result.skipped_s
            one.heard_s = result.position_s
            self.counts.heard_s += length_s
            self.counts.reduced_s += length_s if result.is_reduced else 0.0
            self.counts.skipped_s += result.skipped_s
        if not was_slow and self.counts.reduced_s + self.counts.skipped_s > 0:
            message = "%s: this machine is too slow for the recognizer, which now does less work (small needs less)"
            log.warning(message, session, extra={"session": session})

    # Phones

    def _tell(self, session: str, one: _Session, heard: RecognizedPhones, now_s: float) -> None:
        self.counts.phones += len(heard.phones)
        if session not in self.hub.engine:
            return
        if one.is_endless:
            self._follow(session, one, heard)
        elif one.utterance is not None:
            if not one.utterance.is_begun:
                self._begin(session, one, now_s)
            self._append(session, one.utterance, heard.phones, heard.partial)
        if heard.is_over:
            self._end_utterance(session, one)

    def _begin(self, session: str, one: _Session, now_s: float) -> None:
        utterance = one.utterance
        if utterance is not None:
            utterance.is_begun = True
            zero_s = now_s + one.delay_s - utterance.offset_s
            self.hub.apply(session, Begin(utterance.number, "at", zero_s))

    def _follow(self, session: str, one: _Session, heard: RecognizedPhones) -> None:
        """Add phones of a microphone's audio; phones between two utterances are silences."""
        final: list[Phone] = []
        for phone in heard.phones:
            if phone.start_s < one.deaf_s:
                continue
            utterance = self._utterance_at(session, one, phone)
            if utterance is None:
                continue
            final.append(phone)
            if not phone.is_silence:
                utterance.end_s = phone.end_s + utterance.offset_s
            elif phone.end_s + utterance.offset_s - utterance.end_s > PAUSE_S:
                self._append(session, utterance, final)
                self._end_utterance(session, one)
                final = []
        partial = [phone for phone in heard.partial if phone.start_s >= one.deaf_s]
        while partial and self._utterance_at(session, one, partial[0]) is None:
            del partial[0]
        if one.utterance is not None:
            self._append(session, one.utterance, final, partial)

    def _utterance_at(self, session: str, one: _Session, phone: Phone) -> _Utterance | None:
        """Current utterance of a microphone; speech begins one."""
        if one.utterance is None and not phone.is_silence:
            one.utterance = _Utterance(self.hub.new_number(), -phone.start_s, is_begun=True)
            self.hub.apply(session, Begin(one.utterance.number, "at", one.zero_s + phone.start_s + one.delay_s))
        return one.utterance

    def _append(
        self, session: str, utterance: _Utterance, final: Sequence[Phone], partial: Sequence[Phone] = ()
    ) -> None:
        """Add phones, and replace those that may have changed."""
        shifted = [
            [
                replace(
                    phone, start_s=max(phone.start_s + utterance.offset_s, 0.0), end_s=phone.end_s + utterance.offset_s
                )
                for phone in phones
                if phone.end_s + utterance.offset_s > 0
            ]
            for phones in (final, partial)
        ]
        command = utterance.phones.append(*shifted)
        if command is not None:
            self.hub.apply(session, command)

    def _end_utterance(self, session: str, one: _Session) -> None:
        utterance, one.utterance = one.utterance, None
        if utterance is None or session not in self.hub.engine:
            return
        end_s = max(one.pushed_s + utterance.offset_s, 0.0) if not one.is_endless else utterance.end_s
        if utterance.is_begun:
            self.hub.apply(session, utterance.phones.end(end_s))

    def _note_command(self, session: str, command: Command, now_s: float) -> None:
        one = self._sessions.get(session)
        is_now = isinstance(command, Cancel) and (command.at_s is None or command.at_s <= now_s)
        if one is None or not isinstance(command, Cancel) or not is_now:
            return
        if one.utterance is not None and command.means(one.utterance.number):
            self._empty(one)
        elif one.is_endless and command.utterance is None:
            one.deaf_s = one.pushed_s

    def _note_event(self, event: Event) -> None:
        one = self._sessions.get(event.session)
        over = event.kind in ("cancelled", "error", "finished")
        if over and one is not None and one.utterance is not None and one.utterance.number == event.utterance:
            self._empty(one)

    def _empty(self, one: _Session) -> None:
        """Drop the current utterance, with its audio that was not recognized yet."""
        one.utterance = None
        if one.is_endless:
            one.deaf_s = one.pushed_s
        else:
            one.recognizer.begin()

"""A face in a stream: audio, words, cues and interruptions in; frames of FAPs and their audio out.

Theory of operation
-------------------
A host has no clock: its user calls :meth:`StreamHost.next` once per frame and plays the audio that comes with it. So
lips and audio stay together, however late the audio came in, and each frame's audio is handed out once: frames =
ceil(audio x rate), to the sample.

Audio is held back until :data:`LEAD_S` more of it has come: the delay of audio that comes as it is spoken, and what
lips need to anticipate. Then:

- **Words with times** are what is spoken (:meth:`StreamHost.words`); the recognizer only moves their phones. Without
  words, the recognizer's own phones are shown: the final ones, and those after them that may still change.
- **A TTS that stalls** holds the audio, and the face returns to neutral; after :data:`STALL_S` the end that was held
  back is played, too. When more comes, both continue.
- **A TTS that sends nothing** makes no audio and no event. What it sends at once is played in its time.
- **Another sample rate** in the middle is handed out at its own rate, in a piece of its own.
- **A slow recognizer** does less work (:mod:`fapengine.recognition.process`), so that the audio need not wait for it.
- **A recognizer that is much too slow, or gone,** delays the audio by :data:`PATIENCE_S` at most; then this utterance
  continues without it.
- **An interruption** ends all utterances at once; the lips are neutral within :data:`REST_S`.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from math import inf, nextafter
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fapengine._arrays import as_sound
from fapengine.audio.sound_queue import Run, Sound, SoundQueue
from fapengine.engine.command_table import Command
from fapengine.engine.commands import Begin, Cancel, GestureMethods, Pause, Resume
from fapengine.engine.engine import Engine
from fapengine.engine.session import Limits
from fapengine.errors import ResourceError, UsageError
from fapengine.host.host import Host
from fapengine.host.words import ChangingPhones, TimedWord, WordQueue
from fapengine.profiles import Profile
from fapengine.recognition.protocol import RecognizedPhones, StreamRecognizer
from fapengine.speech.phone_track import Phone
from fapengine.trajectory.style import Style

LEAD_S = 0.3
"""Time ahead of the audio up to which more of it, and the phones of its words, are known when it begins, or resumes
after a stall: later phones cost 0.01 mm of lip error (``design/look_ahead.py``)."""
HEARD_LEAD_S = 0.1
"""The same of the recognizer's phones, which may still change; the audio then goes on while they are known at all."""
MIN_LEAD_S = 0.1
"""Time ahead below which the audio is held back again."""
FEED_S = 0.6
"""Time ahead for which the engine receives phones; later words may still change the others."""
STALL_S = 1.0
"""Time without more audio after which the audio that is held back is played."""
SLOW_S = 0.12
"""Time by which the recognizer's phones end before the audio that it has processed, less
:data:`fapengine.recognition.process.LEAD_S`, and a frame: it does less work before the audio has to wait."""
PATIENCE_S = 1.0
"""Time for which audio waits for its recognizer."""
REST_S = 0.25
"""Time after an interruption within which the lips are neutral."""
_FADE_S = 0.2
_FACE = "face"
LIMITS = Limits(name_bytes=None, phones=1_000_000, queued_s=86_400.0, silence_s=1e9)
"""Limits of an engine whose utterances last until they are ended."""

EventKind = Literal["started", "finished", "interrupted"]
Pronounce = Callable[[Sequence[tuple[str, float, float]]], Sequence[Phone]]
"""Speaker of words that have times, such as :meth:`fapengine.voices.pronounce.Pronouncer.words`."""


@dataclass(frozen=True, slots=True)
class StreamEvent:
    """An event in the life of an utterance."""

    utterance: int
    """1 for the first."""
    kind: EventKind
    position_s: float
    """Length of its audio that was handed out; for ``interrupted``, that was heard."""


@dataclass(frozen=True, slots=True, eq=False)
class StreamFrame:
    """One frame."""

    faps: NDArray[np.int32]
    """(68,) FAPU."""
    sounds: tuple[Sound, ...]
    """Audio to be played from now on: none while nothing is said, one piece of a frame's length, less at the end of an
    utterance; two if the rate changes."""


@dataclass(slots=True, eq=False)
class _Utterance:
    """One unfinished utterance. Stateful."""

    number: int
    sound: SoundQueue = field(default_factory=SoundQueue)
    words: WordQueue = field(default_factory=WordQueue)
    heard: list[Phone] = field(default_factory=list)
    """Final phones of the recognizer, in the utterance's time."""
    partial: list[Phone] = field(default_factory=list)
    """Phones after these that may still change."""
    told: ChangingPhones = field(init=False)
    """Phones that the engine has received."""
    is_ended: bool = False
    is_deaf: bool = False
    is_held: bool = True
    """True while its audio waits: before it begins, and in a stall."""
    has_begun: bool = False
    quiet_s: float = 0.0
    """Time since audio came."""
    waited_s: float = 0.0
    """Time for which there was audio and the recognizer reported nothing."""
    told_s: float = 0.0
    """End of the last of them that does not change, or the present."""

    def __post_init__(self) -> None:
        self.told = ChangingPhones(self.number)

    @property
    def heard_s(self) -> float:
        """Time in it up to which the recognizer has reported phones."""
        if all(run.is_heard for run in self.sound.runs):
            return self.sound.end_s
        reported = self.partial or self.heard
        return reported[-1].end_s if reported else 0.0


class StreamHost(Host, GestureMethods):
    """One face that speaks streamed audio and words; see the theory of operation. Stateful.

    Parameters
    ----------
    profile : Profile
        Speaker profile.
    rng : numpy.random.Generator
        Random numbers of blinks, glances and head motion.
    style : Style, optional
    recognizer : StreamRecognizer, optional
        Recognizes phones; without it only words move the mouth. The caller closes it.
    pronounce : callable, optional
        Turns words with times into phones; without it :meth:`words` does nothing.

    Examples
    --------
    Half a second of silence, shown at 25 frames per second::

        face = StreamHost(profile, rng=np.random.default_rng(1))
        face.push(np.zeros(12_000, np.int16), 24_000)
        face.end()
        frames = [face.next(0.04) for _ in range(13)]
    """

    def __init__(
        self,
        profile: Profile,
        *,
        rng: np.random.Generator,
        style: Style | None = None,
        recognizer: StreamRecognizer | None = None,
        pronounce: Pronounce | None = None,
    ) -> None:
        super().__init__(Engine(profile, rng=rng, limits=replace(LIMITS, sessions=1), style=style), _FACE)
        self.engine.open(_FACE, 0.0)
        self._now_s = 0.0
        self._recognizer, self._pronounce = recognizer, pronounce
        self.has_recognized = False
        """True if the present recognizer has processed audio to its end."""
        self.is_paused = False
        """True while :meth:`pause` holds the audio."""
        self.newest = 0
        """Number of the newest utterance; 0 before the first."""
        self._queue: list[_Utterance] = []
        self._listening: tuple[_Utterance, Run] | None = None
        self._events: list[StreamEvent] = []

    # What comes in ---------------------------------------------------------------------------------------------------

    def push(self, samples: ArrayLike, rate_hz: int) -> None:
        """Add audio to the current utterance, or begin a new one.

        Raises UsageError if the samples have another form, or the rate is out of range.

        Parameters
        ----------
        samples : (N,) or (N, channels) array_like
            int16, or float in -1..1. Channels are averaged.
        rate_hz : int
            Samples per second.
        """
        if not 4_000 <= rate_hz <= 192_000:
            raise UsageError(f"rate_hz: got {rate_hz}, expected 4000 to 192000")
        samples, rate_hz = as_sound((samples, rate_hz), "samples")
        if len(samples):
            utterance = self._open()
            utterance.sound.push(samples, rate_hz)
            utterance.quiet_s = 0.0

    def words(self, words: Sequence[TimedWord]) -> None:
        """Add words to the current utterance, in order, with their times from its first sample on."""
        if self._pronounce is not None and words:
            utterance = self._open() if not self._queue else self._queue[-1]
            utterance.words.add(words, self._pronounce, max(utterance.told_s, utterance.sound.due_s))

    def cue(self, command: Command, at_s: float = 0.0) -> None:
        """Apply a command at a time in the current utterance, such as an expression at a word."""
        utterance = self._open() if not self._queue else self._queue[-1]
        self.add_cue(utterance.number, at_s, command)

    def send_command(self, command: Command) -> None:
        """Apply a command now."""
        self.apply(command, self._now_s)

    def end(self) -> None:
        """End the utterance: the next audio begins a new one."""
        if self._queue and not self._queue[-1].is_ended:
            self._queue[-1].is_ended = True
            self._queue[-1].sound.close()

    @property
    def hears(self) -> bool:
        """Whether there is a recognizer; False once its process has ended."""
        return self._recognizer is not None

    def listen_with(self, recognizer: StreamRecognizer) -> None:
        """Continue with another recognizer, in place of one that has ended; utterances that have begun do without."""
        for utterance in self._queue:
            if utterance.has_begun:
                self._deafen(utterance)
        self._recognizer, self._listening, self.has_recognized = recognizer, None, False

    def pause(self) -> None:
        """Hold all audio, with the mouth at rest, until :meth:`resume`; more may come meanwhile, or be interrupted."""
        self.is_paused = True

    def resume(self) -> None:
        """Continue after :meth:`pause`."""
        self.is_paused = False

    def interrupt(self, unplayed_s: float = 0.0) -> None:
        """Stop speaking, and drop all audio that was not handed out.

        Parameters
        ----------
        unplayed_s : float
            Length of audio that was handed out but not heard: subtracted from the position of the event.
        """
        for utterance in self._queue:
            position_s = max(utterance.sound.position_s - unplayed_s, 0.0)
            self._events.append(StreamEvent(utterance.number, "interrupted", position_s))
        self._queue.clear()
        self._cues.clear()
        self.apply(Cancel(fade_s=_FADE_S), self._now_s)
        if self._listening is not None and self._recognizer is not None:
            self._recognizer.begin()
        self._listening = None

    # What goes out ---------------------------------------------------------------------------------------------------

    def next(self, dt_s: float) -> StreamFrame:
        """Show the next frame.

        Raises UsageError if there is no such time.

        Parameters
        ----------
        dt_s : float
            Time for which it is shown, 0.001..1 s.
        """
        if not 1e-3 <= dt_s <= 1.0:
            raise UsageError(f"dt_s: got {dt_s:g} s, expected 0.001 to 1")
        self._listen()
        sounds, begins_s = self._speak(dt_s), self._now_s
        self._now_s += dt_s
        faps = self.engine.frame(begins_s).faps[0]
        self.engine.events()
        return StreamFrame(faps, sounds)

    def is_ready(self, dt_s: float) -> bool:
        """Whether a frame of ``dt_s`` would hold no audio back."""
        return not self._queue or (not self.is_paused and self._is_ready(self._queue[0], dt_s))

    def events(self) -> list[StreamEvent]:
        """Return the events since the last call."""
        events, self._events = self._events, []
        return events

    @property
    def is_speaking(self) -> bool:
        """Whether an utterance is spoken or waits."""
        return bool(self._queue)

    @property
    def position_s(self) -> float:
        """Length of the current utterance's audio that was handed out; 0 between utterances."""
        return self._queue[0].sound.position_s if self._queue else 0.0

    # ----------------------------------------------------------------------------------------------------------------

    def _open(self) -> _Utterance:
        if not self._queue or self._queue[-1].is_ended:
            self.newest += 1
            self._queue.append(_Utterance(self.newest))
        return self._queue[-1]

    def _speak(self, dt_s: float) -> tuple[Sound, ...]:
        """Hand out the audio of a frame, if it is ready."""
        if self.is_paused:
            for utterance in self._queue[:1]:
                self._hold(utterance)
            return ()
        while self._queue:
            utterance = self._queue[0]
            if utterance.is_ended and utterance.sound.due_s >= utterance.sound.end_s:
                self._finish(utterance)
                continue
            self._wait(utterance, dt_s)
            if not self._is_ready(utterance, dt_s):
                self._hold(utterance)
                return ()
            self._go_on(utterance)
            self._feed(utterance, dt_s)
            self.give_cues(utterance.number, nextafter(utterance.sound.due_s + dt_s, -inf), self._now_s)
            return utterance.sound.take(dt_s)
        return ()

    def _wait(self, utterance: _Utterance, dt_s: float) -> None:
        """Count time that passes without audio, or without its recognizer."""
        sound = utterance.sound
        for each in self._queue:
            each.quiet_s += dt_s
        if utterance.quiet_s > STALL_S:
            sound.close()
        is_there = sound.is_over or sound.end_s >= sound.due_s + dt_s + LEAD_S
        is_deaf = is_there and not self._is_known(utterance, sound.due_s + dt_s)
        utterance.waited_s = utterance.waited_s + dt_s if is_deaf else 0.0
        if utterance.waited_s > PATIENCE_S:
            self._deafen(utterance)

    def _is_ready(self, utterance: _Utterance, dt_s: float) -> bool:
        sound = utterance.sound
        if sound.due_s >= sound.end_s:
            return False
        over_s = sound.due_s + dt_s
        is_there = sound.is_over or sound.end_s >= over_s + (LEAD_S if utterance.is_held else MIN_LEAD_S)
        return is_there and self._is_known(utterance, over_s)

    def _is_known(self, utterance: _Utterance, over_s: float) -> bool:
        """Whether the phones for some time after ``over_s`` are known, by words or by the recognizer."""
        if self._recognizer is None or utterance.is_deaf:
            return True
        words_s, heard_s = (LEAD_S, HEARD_LEAD_S) if utterance.is_held else (MIN_LEAD_S, 0.0)
        end_s = utterance.sound.end_s
        has_words = utterance.words.end_s >= min(over_s + words_s, end_s)
        return has_words or utterance.heard_s >= min(over_s + heard_s, end_s)

    def _hold(self, utterance: _Utterance) -> None:
        if utterance.has_begun and not utterance.is_held:
            self.apply(Pause(fade_s=_FADE_S), self._now_s)
        utterance.is_held = True

    def _go_on(self, utterance: _Utterance) -> None:
        if not utterance.is_held:
            return
        utterance.is_held = False
        if utterance.has_begun:
            self.apply(Resume(), self._now_s)
        else:
            utterance.has_begun = True
            self._events.append(StreamEvent(utterance.number, "started", 0.0))
            self.apply(Begin(utterance.number, "at", self._now_s), self._now_s)

    def _finish(self, utterance: _Utterance) -> None:
        self._queue.pop(0)
        self._events.append(StreamEvent(utterance.number, "finished", utterance.sound.position_s))
        self.give_cues(utterance.number, inf, self._now_s)
        if not utterance.has_begun:
            return
        if utterance.is_held:
            self.apply(Cancel(utterance.number, fade_s=_FADE_S), self._now_s)
        else:
            self.apply(utterance.told.end(utterance.sound.end_s), self._now_s)

    # Phones ---------------------------------------------------------------------------------------------------------

    def _feed(self, utterance: _Utterance, dt_s: float) -> None:
        """Send the phones of the next :data:`FEED_S` to the engine."""
        until_s = utterance.sound.due_s + dt_s + FEED_S
        final = utterance.words.phones(utterance.heard, utterance.told_s, until_s)
        if final:
            utterance.told_s = final[-1].end_s
        partial = utterance.words.before_next(utterance.partial, utterance.told_s, until_s)
        command = utterance.told.append(final, partial)
        if command is not None:
            self.apply(command, self._now_s)
        now_s = utterance.sound.due_s
        utterance.told_s = max(utterance.told_s, min(now_s, partial[0].start_s) if partial else now_s)
        utterance.heard = [phone for phone in utterance.heard if phone.end_s > utterance.told_s] or utterance.heard[-1:]

    def _listen(self) -> None:
        """Send one run of audio after the other to the recognizer, and collect its phones."""
        while self._recognizer is not None:
            if self._listening is None:
                waiting = ((each, run) for each in self._queue for run in each.sound.runs if not run.is_heard)
                self._listening = next(waiting, None)
                if self._listening is None:
                    self._poll()  # notices that it has ended
                    return
                self._recognizer.begin()
            utterance, run = self._listening
            samples = run.unheard()
            if len(samples):
                self._recognizer.push(samples, run.rate_hz)
            if run.is_over and not run.is_end_told:
                self._recognizer.end()
                run.is_end_told = True
            for heard in self._poll():
                self._take(heard, utterance, run)
            if not run.is_heard:
                return
            self._listening = None

    def _poll(self) -> list[RecognizedPhones]:
        """Return the recognizer's news; if it has ended, continue without."""
        assert self._recognizer is not None
        shown_s = -inf
        if self._listening is not None and self._listening[0] in self._queue[:1]:
            utterance, run = self._listening
            shown_s = utterance.sound.due_s - run.start_s + SLOW_S
        try:
            return self._recognizer.poll(shown_s)
        except ResourceError:
            self._recognizer = self._listening = None
            return []

    def _take(self, heard: RecognizedPhones, utterance: _Utterance, run: Run) -> None:
        utterance.partial.clear()
        for phones, taken in ((heard.phones, utterance.heard), (heard.partial, utterance.partial)):
            for phone in phones:
                start_s, end_s = phone.start_s + run.start_s, min(phone.end_s + run.start_s, run.end_s)
                if end_s > start_s:
                    taken.append(replace(phone, start_s=start_s, end_s=end_s))
        run.is_heard = heard.is_over
        self.has_recognized |= heard.is_over

    def _deafen(self, utterance: _Utterance) -> None:
        utterance.is_deaf = True
        for run in utterance.sound.runs:
            run.is_heard = True
        if self._listening is not None and self._listening[0] is utterance and self._recognizer is not None:
            self._recognizer.begin()
            self._listening = None

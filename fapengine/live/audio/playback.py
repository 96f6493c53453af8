"""Plays what one of a hub's faces says, and tells the face where the sound really is, so that it follows.

Theory of operation
-------------------
An utterance whose sound is played here is begun with the anchor ``"audio"``: its face waits. :meth:`Playback.follow`
is called before every frame; it reads the sound's place from the output, whose clock is the sound card's, and hands it
on as :class:`fapengine.live.engine.commands.Audio`. The engine slews to it, or jumps where it must. A sound that stands
still is told as one that does, and its face rests. A device that is gone is replaced by silence of the same length: the
face goes on. A sound that is stopped ends its utterance, and an utterance that is cancelled or given up its sound; a
face that is told to pause takes its sound along.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from math import inf

from fapengine.live.audio.device import open_output
from fapengine.live.audio.output import Output
from fapengine.live.engine.commands import Audio, Cancel, Command, Pause, Resume, Seek
from fapengine.live.engine.session import Event
from fapengine.live.hub.hub import Hub
from fapengine.live.hub.messages import Spoken

TELL_EVERY_S = 0.02
"""Interval between two reports of a sound's position."""
STILL_S = 0.1
"""A sound whose place has not changed for so long stands still; a callback that is late does not make it so."""

SETTLE_S = 1.2
"""Longest wait of a sound for a device that was just opened; a hub begins without sound after 1.5 s."""

LEAP_S = 0.04
"""Face and sound that are farther apart are brought together at once; the engine slews what is less by 2 %."""

OpenOutput = Callable[[int], Output]


@dataclass(slots=True)
class Progress:
    """The position of a sound, and when to report it: at intervals while it moves, once when it stands still.

    Stateful.
    """

    place_s: float | None = None
    is_still: bool = False
    _moved_s: float = 0.0
    """Time at which the position last changed."""
    _told_s: float = -inf

    def is_due(self, place_s: float, now_s: float) -> bool:
        """Take the place; whether it is to be told now."""
        if place_s != self.place_s:
            self.place_s, self._moved_s = place_s, now_s
        was_still, self.is_still = self.is_still, now_s - self._moved_s > STILL_S
        if self.is_still == was_still and (self.is_still or now_s - self._told_s < TELL_EVERY_S):
            return False
        self._told_s = now_s
        return True


@dataclass(slots=True)
class _Playing:
    spoken: Spoken
    output: Output
    since_s: float
    sound: int | None = None
    """None: it waits for the device."""
    zero_s: float | None = None
    """Engine time at which the sound was at its beginning."""
    progress: Progress = field(default_factory=Progress)


class Playback:
    """The sound of a face; on the hub's thread. Close it.

    Stateful.

    Parameters
    ----------
    hub : Hub
    session : str
        Whose voice is played.
    opens : callable
        Sample rate in Hz to an output; called once for each rate.
    """

    def __init__(self, hub: Hub, session: str, *, opens: OpenOutput = open_output) -> None:
        self._hub, self.session, self._opens = hub, session, opens
        self._outputs: dict[int, Output] = {}
        self._playing: list[_Playing] = []
        self._is_held = False
        """The face was told to pause: it is not told that its sound still moves."""
        self._off_s: float | None = None
        self._unsubscribe = (
            hub.listeners.on_speech(session, self._play, plays=True),
            hub.listeners.on_event(session, self._event),
            hub.listeners.on_command(session, self._command),
        )

    @property
    def description(self) -> str:
        """The device, or why there is none; empty before anything was played."""
        return "; ".join(output.description for output in self._outputs.values())

    @property
    def is_silent(self) -> bool:
        """Whether sounds are only kept time of."""
        return any(output.is_silent for output in self._outputs.values())

    @property
    def off_s(self) -> float | None:
        """How far the face was ahead of the sound at the last :meth:`follow`; None while nothing sounds."""
        return self._off_s

    @property
    def is_playing(self) -> bool:
        """Whether a sound plays or waits."""
        return bool(self._playing)

    @property
    def is_paused(self) -> bool:
        """Whether the face was told to pause, and its sound stands still with it."""
        return self._is_held

    def zero_s(self, utterance: int) -> float | None:
        """Engine time of the beginning of an utterance's sound; None if that is not known (yet, or any more)."""
        return next((entry.zero_s for entry in self._playing if entry.spoken.utterance == utterance), None)

    def open(self, sample_rate_hz: int) -> Output:
        """Open the output now, so that the first sound need not wait for it."""
        if sample_rate_hz not in self._outputs:
            self._outputs[sample_rate_hz] = self._opens(sample_rate_hz)
            self._outputs[sample_rate_hz].pause(self._is_held)
        return self._outputs[sample_rate_hz]

    def follow(self, now_s: float) -> None:
        """Tell the face where its sound is; call it before each frame.

        Parameters
        ----------
        now_s : float
            The hub's clock.
        """
        self._off_s = None
        if self._is_held and (self.session not in self._hub.engine or self._hub.engine.state(self.session) != "paused"):
            self._hold(False)  # a face's pause ends with what it was saying
        for entry in tuple(self._playing):
            if entry.sound is None and (entry.output.is_settled(now_s) or now_s - entry.since_s > SETTLE_S):
                entry.sound = entry.output.play(entry.spoken.speech.samples)
            if self.session not in self._hub.engine:
                self._drop(entry)
            elif entry.sound and entry.output.is_over(entry.sound, now_s):
                self._playing.remove(entry)
            elif entry.sound and not self._is_held:
                place_s = entry.output.position_s(entry.sound, now_s)
                if place_s is not None:
                    self._follow(entry, place_s, now_s)

    def stop(self) -> None:
        """Fall silent at once, and end what was being said."""
        for output in self._outputs.values():
            output.stop()
        self._is_held = False
        playing, self._playing = self._playing, []
        for entry in playing:
            if self.session in self._hub.engine:
                self._hub.apply(self.session, Cancel(entry.spoken.utterance))

    def close(self) -> None:
        """Play no more, and give the devices back."""
        self.stop()
        for unsubscribe in self._unsubscribe:
            unsubscribe()
        for output in self._outputs.values():
            output.close()

    def _play(self, spoken: Spoken) -> None:
        output = self.open(spoken.speech.sample_rate_hz)
        self._playing.append(_Playing(spoken, output, self._hub.clock()))

    def _event(self, event: Event) -> None:
        if event.kind in ("cancelled", "error"):
            for entry in [entry for entry in self._playing if entry.spoken.utterance == event.utterance]:
                self._drop(entry)

    def _drop(self, entry: _Playing) -> None:
        if entry.sound:
            entry.output.drop(entry.sound)
        self._playing.remove(entry)

    def _command(self, session: str, command: Command, now_s: float) -> None:
        """Pause and go on with the face; a pause of a face that says nothing is none."""
        if isinstance(command, Pause | Resume):
            self._hold(self._hub.engine.state(session) == "paused")

    def _hold(self, on: bool) -> None:
        self._is_held = on
        for output in self._outputs.values():
            output.pause(on)

    def _follow(self, entry: _Playing, place_s: float, now_s: float) -> None:
        hub, session, number = self._hub, self.session, entry.spoken.utterance
        if entry.progress.is_due(place_s, now_s):
            stands, apart_s = entry.progress.is_still, self._apart_s(number, place_s, now_s)
            if apart_s is not None and abs(apart_s) > LEAP_S and not stands:
                hub.apply(session, Seek(number, place_s))
            hub.apply(session, Audio(number, now_s, place_s, 0.0 if stands else 1.0))
            entry.zero_s = now_s - place_s
        if place_s >= 0:
            self._off_s = self._apart_s(number, place_s, now_s)

    def _apart_s(self, number: int, place_s: float, now_s: float) -> float | None:
        """How far the face is ahead; None before it has begun, and while it stands."""
        utterance = self._hub.engine.utterance(self.session, number)
        if utterance is None or not utterance.anchored:
            return None
        return float(utterance.position_s(now_s)) - place_s

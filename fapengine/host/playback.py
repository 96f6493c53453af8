"""Plays what one of a hub's faces says, and reports where the sound really is, so that the face follows.

Theory of operation
-------------------
An utterance whose sound is played here is begun with the anchor ``"audio"``: its face waits. :meth:`Playback.follow`
is called before every frame; it reads the sound's place from the output, whose clock is the sound card's, and hands it
on as :class:`fapengine.engine.commands.Audio`. The engine slews to it, or jumps where it must. A sound that stands
still is told as one that does, and its face rests. A device that is gone is replaced by silence of the same length: the
face goes on. A sound that is stopped ends its utterance, and an utterance that is cancelled or given up its sound; a
face that is told to pause takes its sound along.
"""

from fapengine.audio.device import open_output
from fapengine.audio.output import Output
from fapengine.audio.player import OpenOutput, Playing, SoundPlayer
from fapengine.engine.commands import Audio, Cancel, Command, Pause, Resume, Seek
from fapengine.engine.session import Event
from fapengine.host.hub import Hub
from fapengine.host.listeners import Spoken

LEAP_S = 0.04
"""Face and sound that are farther apart are brought together at once; the engine slews what is less by 2 %."""


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
        self._hub, self.session = hub, session
        self._player = SoundPlayer(opens)
        self.off_s: float | None = None
        """How far the face was ahead of the sound at the last :meth:`follow`; None while nothing sounds."""
        self._unsubscribe = (
            hub.listeners.on_speech(session, self._play, plays=True),
            hub.listeners.on_event(session, self._event),
            hub.listeners.on_command(session, self._command),
        )

    @property
    def description(self) -> str:
        """The device, or why there is none; empty before anything was played."""
        return "; ".join(output.description for output in self._player.outputs.values())

    @property
    def is_silent(self) -> bool:
        """Whether sounds are only kept time of."""
        return any(output.is_silent for output in self._player.outputs.values())

    @property
    def is_playing(self) -> bool:
        """Whether a sound plays or waits."""
        return bool(self._player.playing)

    @property
    def is_paused(self) -> bool:
        """Whether the face was paused, and its sound with it; its sound's position is then not reported."""
        return self._player.is_paused

    def zero_s(self, utterance: int) -> float | None:
        """Engine time of the beginning of an utterance's sound; None if that is not known (yet, or any more)."""
        return next((entry.zero_s for entry in self._player.playing if entry.utterance == utterance), None)

    def open(self, sample_rate_hz: int) -> Output:
        """Open the output now, so that the first sound need not wait for it."""
        return self._player.open(sample_rate_hz)

    def follow(self, now_s: float) -> None:
        """Tell the face where its sound is; call it before each frame.

        Parameters
        ----------
        now_s : float
            The hub's clock.
        """
        self.off_s = None
        is_open = self.session in self._hub.engine
        if self.is_paused and (not is_open or self._hub.engine.state(self.session) != "paused"):
            self._player.pause(False)  # a face's pause ends with what it was saying
        for entry in self._player.follow(now_s):
            if is_open and not self.is_paused:
                self._follow(entry, now_s)
        if not is_open:
            for utterance in [entry.utterance for entry in self._player.playing]:
                self._player.drop(utterance)

    def stop(self) -> None:
        """Fall silent at once, and end what was being said."""
        for utterance in self._player.stop():
            if self.session in self._hub.engine:
                self._hub.apply(self.session, Cancel(utterance))

    def close(self) -> None:
        """Play no more, and close the devices."""
        self.stop()
        for unsubscribe in self._unsubscribe:
            unsubscribe()
        self._player.close()

    def _play(self, spoken: Spoken) -> None:
        speech = spoken.speech
        self._player.add(spoken.utterance, speech.samples, speech.sample_rate_hz, self._hub.clock())

    def _event(self, event: Event) -> None:
        if event.kind in ("cancelled", "error"):
            self._player.drop(event.utterance)

    def _command(self, session: str, command: Command, now_s: float) -> None:
        """Pause and resume with the face; a face that says nothing is not paused."""
        if isinstance(command, Pause | Resume):
            self._player.pause(self._hub.engine.state(session) == "paused")

    def _follow(self, entry: Playing, now_s: float) -> None:
        hub, session, number, place_s = self._hub, self.session, entry.utterance, entry.position_s(now_s)
        if place_s is None:
            return
        if entry.is_due(place_s, now_s):
            apart_s = self._apart_s(number, place_s, now_s)
            if apart_s is not None and abs(apart_s) > LEAP_S and not entry.is_still:
                hub.apply(session, Seek(number, place_s))
            hub.apply(session, Audio(number, now_s, place_s, 0.0 if entry.is_still else 1.0))
            entry.zero_s = now_s - place_s
        if place_s >= 0:
            self.off_s = self._apart_s(number, place_s, now_s)

    def _apart_s(self, number: int, place_s: float, now_s: float) -> float | None:
        """How far the face is ahead; None before it has begun, and while it stands."""
        utterance = self._hub.engine.utterance(self.session, number)
        if utterance is None or not utterance.state.is_placed:
            return None
        return float(utterance.position_s(now_s)) - place_s

"""Plays the speech of one of a hub's faces, and reports the position of the audio, so that the face follows.

Theory of operation
-------------------
An utterance that is played here begins with the anchor ``"audio"``: its face waits. :meth:`Playback.follow` is called
before every frame; it reads the position from the output, whose clock is the sound card's, and applies it as
:class:`fapengine.engine.commands.Audio`. The engine slews to it, or jumps if it must. Audio that stops is reported with
rate 0, and its face pauses. A device that is gone is replaced by silence of the same length: the face continues.
Stopping the audio ends its utterance; cancelling an utterance, or giving it up, stops its audio; pausing a face pauses
its audio.
"""

from fapengine.audio.device import open_output
from fapengine.audio.output import OpenOutput, Output, Playing, SoundPlayer
from fapengine.engine.commands import Audio, Cancel, Command, Pause, Resume, Seek
from fapengine.engine.session import Event
from fapengine.host.hub import Hub
from fapengine.host.listeners import Spoken

LEAP_S = 0.04
"""Offset of face and audio above which the face jumps; the engine slews smaller ones by 2 %."""


class Playback:
    """The audio of a face; on the hub's thread. Close it.

    Stateful.

    Parameters
    ----------
    hub : Hub
    session : str
        Session whose voice is played.
    opens : callable
        Sample rate in Hz to an output; called once for each rate.
    """

    def __init__(self, hub: Hub, session: str, *, opens: OpenOutput = open_output) -> None:
        self._hub, self.session = hub, session
        self._player = SoundPlayer(opens)
        self.sync_error_s: float | None = None
        """Time by which the face was ahead of the audio at the last :meth:`follow`; None while nothing plays."""
        self._unsubscribe = (
            hub.listeners.on_speech(session, self._play, plays=True),
            hub.listeners.on_event(session, self._event),
            hub.listeners.on_command(session, self._command),
        )

    @property
    def description(self) -> str:
        """Name of the device, or why there is none; empty before anything was played."""
        return "; ".join(output.description for output in self._player.outputs.values())

    @property
    def is_silent(self) -> bool:
        """Whether nothing is heard because there is no device."""
        return any(output.is_silent for output in self._player.outputs.values())

    @property
    def is_playing(self) -> bool:
        """Whether audio plays or waits."""
        return bool(self._player.playing)

    @property
    def is_paused(self) -> bool:
        """Whether the face was paused, and its audio with it; the position is then not reported."""
        return self._player.is_paused

    def zero_s(self, utterance: int) -> float | None:
        """Engine time at which an utterance's audio began; None if that is not known."""
        return next((entry.zero_s for entry in self._player.playing if entry.utterance == utterance), None)

    def open(self, sample_rate_hz: int) -> Output:
        """Open the output now, so that the first audio need not wait for it."""
        return self._player.open(sample_rate_hz)

    def follow(self, now_s: float) -> None:
        """Report the position of the audio to the face; call it before each frame.

        Parameters
        ----------
        now_s : float
            The hub's clock.
        """
        self.sync_error_s = None
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
        """Stop at once, and end the current utterances."""
        for utterance in self._player.stop():
            if self.session in self._hub.engine:
                self._hub.apply(self.session, Cancel(utterance))

    def close(self) -> None:
        """Stop, and close the devices."""
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
        """Pause and resume with the face; a face that does not speak is not paused."""
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
            self.sync_error_s = self._apart_s(number, place_s, now_s)

    def _apart_s(self, number: int, place_s: float, now_s: float) -> float | None:
        """Time by which the face is ahead; None before it has begun, and while it is paused."""
        utterance = self._hub.engine.utterance(self.session, number)
        if utterance is None or not utterance.state.is_placed:
            return None
        return float(utterance.position_s(now_s)) - place_s

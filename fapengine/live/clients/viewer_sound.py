"""Plays what a server's face says, and tells the server where the sound is, so that its face follows our loudspeaker.

Frames reach us some time after they were made; the server is told of a place that is so much ahead, and what is seen
then fits what is heard.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

from fapengine.live.audio.device import open_output
from fapengine.live.audio.output import Output
from fapengine.live.audio.playback import Progress
from fapengine.live.clients.websocket_viewer import WebSocketViewer


@dataclass(slots=True)
class _Playing:
    utterance: int
    output: Output
    sound: int
    progress: Progress = field(default_factory=Progress)


class ViewerSound:
    """The sound of a :class:`WebSocketViewer` that plays. Close it.

    Stateful.

    Parameters
    ----------
    link : WebSocketViewer
        Made with ``plays``.
    opens : callable
        Sample rate in Hz to an output; called once for each rate.
    """

    def __init__(self, link: WebSocketViewer, *, opens: Callable[[int], Output] = open_output) -> None:
        self._link, self._opens = link, opens
        self._outputs: dict[int, Output] = {}
        self._playing: list[_Playing] = []
        self._is_paused = False
        """The face was told to pause: it is not told that its sound still moves."""

    @property
    def is_playing(self) -> bool:
        """Whether a sound plays or waits."""
        return bool(self._playing)

    def follow(self, now_s: float) -> None:
        """Play what has come, and tell where it is; call it before each frame.

        Parameters
        ----------
        now_s : float
            Monotonic clock.
        """
        ended = self._link.ended()
        for announced in self._link.sounds():
            if announced.sample_rate_hz not in self._outputs:
                self._outputs[announced.sample_rate_hz] = self._opens(announced.sample_rate_hz)
                self._outputs[announced.sample_rate_hz].pause(self._is_paused)
            output = self._outputs[announced.sample_rate_hz]
            self._playing.append(_Playing(announced.utterance, output, output.play(announced.samples)))
        if self._link.state != "open":
            self.stop()
        for entry in tuple(self._playing):
            if entry.utterance in ended:
                entry.output.drop(entry.sound)
                self._playing.remove(entry)
            elif entry.output.is_over(entry.sound, now_s):
                self._playing.remove(entry)
            else:
                self._tell(entry, now_s)

    def pause(self, on: bool) -> None:
        """Let sound stand still, or go on, with the face."""
        self._is_paused = on
        for output in self._outputs.values():
            output.pause(on)

    def stop(self) -> None:
        """Fall silent."""
        for output in self._outputs.values():
            output.stop()
        self._is_paused = False
        self._playing.clear()

    def close(self) -> None:
        """Give the devices back."""
        for output in self._outputs.values():
            output.close()

    def _tell(self, entry: _Playing, now_s: float) -> None:
        place_s, server_s = entry.output.position_s(entry.sound, now_s), self._link.server_s(now_s)
        if place_s is None or server_s is None:
            return
        if not entry.progress.is_due(place_s, now_s):
            return
        stands = entry.progress.is_still
        if self._is_paused and not stands:
            return
        ahead_s = 0.0 if stands else max(self._link.age_s or 0.0, 0.0)
        self._link.send(
            "audio", utterance=entry.utterance, at_s=server_s, position_s=place_s + ahead_s, rate=0.0 if stands else 1.0
        )

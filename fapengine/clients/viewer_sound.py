"""Plays what a server's face says, and reports to the server where the sound is, so that its face follows our sound.

Frames reach us some time after they were made; the server is told of a place that is so much ahead, and what is seen
then fits what is heard.
"""

from fapengine.audio.device import open_output
from fapengine.audio.player import OpenOutput, Playing, SoundPlayer
from fapengine.clients.websocket_viewer import WebSocketViewer


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

    def __init__(self, link: WebSocketViewer, *, opens: OpenOutput = open_output) -> None:
        self._link, self._player = link, SoundPlayer(opens)

    @property
    def is_playing(self) -> bool:
        """Whether a sound plays or waits."""
        return bool(self._player.playing)

    def follow(self, now_s: float) -> None:
        """Play what has come, and report where it is; call it before each frame.

        Parameters
        ----------
        now_s : float
            Monotonic clock.
        """
        ended = self._link.ended()
        for announced in self._link.sounds():
            self._player.add(announced.utterance, announced.samples, announced.sample_rate_hz, now_s)
        if self._link.state != "open":
            self.stop()
        for utterance in ended:
            self._player.drop(utterance)
        for entry in self._player.follow(now_s):
            self._report(entry, now_s)

    def pause(self, on: bool) -> None:
        """Pause sound with the face, or resume it; its sound's position is then not reported."""
        self._player.pause(on)

    def stop(self) -> None:
        """Drop all sounds."""
        self._player.stop()

    def close(self) -> None:
        """Close the devices."""
        self._player.close()

    def _report(self, entry: Playing, now_s: float) -> None:
        place_s, server_s = entry.position_s(now_s), self._link.server_s(now_s)
        if place_s is None or server_s is None or not entry.is_due(place_s, now_s):
            return
        if self._player.is_paused and not entry.is_still:
            return
        ahead_s = 0.0 if entry.is_still else max(self._link.age_s or 0.0, 0.0)
        rate = 0.0 if entry.is_still else 1.0
        self._link.send("audio", utterance=entry.utterance, at_s=server_s, position_s=place_s + ahead_s, rate=rate)

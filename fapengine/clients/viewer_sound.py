"""Plays the sound of a server's face, and reports its position to the server, so that the face follows our sound.

Frames reach us some time after they were made. The position that is reported is ahead by this time, so that the image
matches the sound.
"""

from fapengine.audio.device import open_output
from fapengine.audio.player import OpenOutput, Playing, SoundPlayer
from fapengine.clients.websocket_viewer import WebSocketViewer


class ViewerSound(SoundPlayer):
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
        super().__init__(opens)
        self._link = link

    def play(self, now_s: float) -> None:
        """Play the sounds that have arrived, and report their positions; call it before each frame.

        Parameters
        ----------
        now_s : float
            Monotonic clock.
        """
        ended = self._link.ended()
        for announced in self._link.sounds():
            self.add(announced.utterance, announced.samples, announced.sample_rate_hz, now_s)
        if self._link.state != "open":
            self.stop()
        for utterance in ended:
            self.drop(utterance)
        for entry in self.follow(now_s):
            self._report(entry, now_s)

    def _report(self, entry: Playing, now_s: float) -> None:
        place_s, server_s = entry.position_s(now_s), self._link.server_s(now_s)
        if place_s is None or server_s is None or not entry.is_due(place_s, now_s):
            return
        if self.is_paused and not entry.is_still:  # while the face is paused, positions are not reported
            return
        ahead_s = 0.0 if entry.is_still else max(self._link.age_s or 0.0, 0.0)
        rate = 0.0 if entry.is_still else 1.0
        self._link.send("audio", utterance=entry.utterance, at_s=server_s, position_s=place_s + ahead_s, rate=rate)

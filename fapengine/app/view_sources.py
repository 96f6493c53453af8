"""What a window can show: our own face that speaks, a file, or a live face from elsewhere."""

import time
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Protocol
from urllib.parse import urlsplit

import numpy as np
from numpy.typing import NDArray

from fapengine.app.face import LEAD_S, TAIL_S, Face
from fapengine.app.phone_ticker import ticker
from fapengine.errors import DataError, FapEngineError, UsageError
from fapengine.files.motion import load_motion
from fapengine.files.sound import load_sound
from fapengine.live.audio.device import open_output
from fapengine.live.audio.output import Output
from fapengine.live.clients.osc_viewer import OscViewer
from fapengine.live.clients.viewer_sound import ViewerSound
from fapengine.live.clients.websocket_viewer import WebSocketViewer
from fapengine.live.engine.commands import Blink, Express, Look, Pause, Resume, SetParameter
from fapengine.mpeg4.track import FapTrack
from fapengine.mpeg4.visemes import Expression
from fapengine.render.panel import Event, Moved, Pressed, Said, Slider
from fapengine.voices.protocol import Speech

Faps = NDArray[np.int32]

EXPRESSIONS = tuple(expression for expression in Expression if expression)
MOOD_ATTACK_S = 0.15
"""A slider's expression follows the hand."""
LOOK_RAD = 0.5
PAUSE, STOP, BLINK = "Pause", "Stop", "Blink"
KEYS = {" ": PAUSE, "b": BLINK, "s": STOP}


class Source(Protocol):
    """Something that moves a face."""

    @property
    def title(self) -> str:
        """Title of the window."""
        ...

    @property
    def sliders(self) -> Sequence[Slider]:
        """Sliders of the panel."""
        ...

    @property
    def buttons(self) -> Sequence[str]:
        """Names of the panel's buttons."""
        ...

    @property
    def has_text(self) -> bool:
        """Whether typed text is spoken."""
        ...

    def frame(self, lead_s: float) -> Faps:
        """Return the FAPs, (68,) int32 FAPU, that are seen ``lead_s`` from now."""
        ...

    def status(self) -> tuple[str, ...]:
        """Return lines for the panel that describe the state."""
        ...

    @property
    def failure(self) -> str:
        """Reason for which nothing was ever to be shown; empty if something was."""
        ...

    def lit(self) -> frozenset[str]:
        """Return the buttons that are on."""
        ...

    def handle(self, event: Event) -> None:
        """Act on what was done to the controls."""
        ...

    def close(self) -> None:
        """Close sound, sockets and threads."""
        ...


def face_sliders() -> list[Slider]:
    """Make the sliders for expressions, the eyes and articulation."""
    return [
        *(
            Slider(expression.name.lower(), expression.name.replace("_", " ").capitalize())
            for expression in EXPRESSIONS
        ),
        Slider("yaw", "Look (left +)", 0.0, -LOOK_RAD, LOOK_RAD),
        Slider("pitch", "Look (down +)", 0.0, -LOOK_RAD, LOOK_RAD),
        Slider("articulation", "Articulation", 1.0, 0.0, 2.0),
    ]


class SpeakingSource:
    """Our own face; it speaks what is typed. The voice works in a thread of its own. Stateful.

    Parameters
    ----------
    face : Face
        Closed with this.
    speak : callable
        Text to speech; may raise.
    """

    title = "fapengine"
    buttons = (PAUSE, STOP, BLINK)
    has_text = True
    failure = ""

    def __init__(self, face: Face, speak: Callable[[str], Speech]) -> None:
        self.sliders = face_sliders()
        self._face, self._speak = face, speak
        self._voice = ThreadPoolExecutor(1, "fapengine-voice")
        self._asked: list[tuple[str, Future[Speech]]] = []
        self._said: list[tuple[int, Speech]] = []
        self._note = ""

    def say(self, text: str) -> None:
        """Speak a text, behind what is being said; a pause ends."""
        self._pause(False)
        self._asked.append((text, self._voice.submit(self._speak, text)))

    @property
    def is_busy(self) -> bool:
        """Whether something is being said, or prepared by the voice."""
        return bool(self._asked) or self._face.is_speaking

    def frame(self, lead_s: float) -> Faps:
        """See :class:`Source`."""
        while self._asked and self._asked[0][1].done():
            text, future = self._asked.pop(0)
            try:
                speech = future.result().padded(lead_s=LEAD_S, tail_s=TAIL_S)
            except FapEngineError as error:
                self._note = str(error)
                continue
            self._note = ""
            self._said = [*self._said[-7:], (self._face.say(speech, text=text), speech)]
        return self._face.frame(lead_s)

    def status(self) -> tuple[str, ...]:
        """See :class:`Source`."""
        if self._note:
            return (self._note,)
        now_s = self._face.hub.clock()
        for number, speech in self._said:
            zero_s = self._face.speaker.zero_s(number)
            if zero_s is not None and now_s < zero_s + speech.duration_s:
                before, now, after = ticker(speech.phones, now_s - zero_s)
                off_s = self._face.speaker.off_s or 0.0
                return (f"{before[-14:]} [{now}] {after[:14]}", f"{1e3 * off_s:+.1f} ms from its sound")
        return (self._face.speaker.description if self._face.speaker.is_silent else "",)

    def lit(self) -> frozenset[str]:
        """See :class:`Source`."""
        return frozenset({PAUSE} if self._face.speaker.is_paused else ())

    def handle(self, event: Event) -> None:
        """See :class:`Source`."""
        if isinstance(event, Said):
            self.say(event.text)
        elif isinstance(event, Moved):
            self._move(event)
        elif event.key == BLINK:
            self._face.tell(Blink())
        elif event.key == STOP:
            self._face.stop()
        elif event.key == PAUSE:
            self._pause(not self._face.speaker.is_paused)

    def close(self) -> None:
        """See :class:`Source`."""
        self._voice.shutdown(wait=True, cancel_futures=True)
        self._face.close()

    def _pause(self, on: bool) -> None:
        if on != self._face.speaker.is_paused:
            self._face.tell(Pause() if on else Resume())

    def _move(self, event: Moved) -> None:
        if event.key in ("yaw", "pitch"):
            angles = {slider.key: slider.value for slider in self.sliders}
            self._face.tell(Look(angles["yaw"], angles["pitch"]))
        elif event.key == "articulation":
            self._face.tell(SetParameter("articulation", event.value))
        else:
            self._face.tell(Express(Expression[event.key.upper()], event.value, attack_s=MOOD_ATTACK_S))


class TrackSource:
    """A track that is played over and over, with its sound if there is one. Stateful.

    Parameters
    ----------
    track : FapTrack
        At least one frame.
    clock : callable
        The monotonic clock, s.
    title : str
    samples : (N,) int16, optional
        Mono sound, from the track's first frame on.
    sample_rate_hz : int
        Samples a second.
    output : Output, optional
        Where the sound is played; closed with this.
    """

    buttons = (PAUSE,)
    has_text = False
    failure = ""

    def __init__(
        self,
        track: FapTrack,
        clock: Callable[[], float],
        *,
        title: str = "fapengine",
        samples: NDArray[np.int16] | None = None,
        sample_rate_hz: int = 0,
        output: Output | None = None,
    ) -> None:
        self.title = title
        self._track, self._clock = track, clock
        self._times_s = track.times_s - track.times_s[0]
        self._samples, self._sample_rate_hz, self._output = samples, sample_rate_hz, output
        sound_s = len(samples) / sample_rate_hz if samples is not None and sample_rate_hz else 0.0
        self.duration_s = max(float(self._times_s[-1]) + 1 / track.rate_hz, sound_s)
        self.sliders = [Slider("time", "Time", 0.0, 0.0, self.duration_s)]
        self._is_paused = False
        self._zero_s = clock()
        self._sound: int | None = None
        self._sound_from_s = 0.0
        self._position_s = 0.0
        self._play(0.0)

    @property
    def position_s(self) -> float:
        """Time from the first frame to the frame that is shown."""
        return self._position_s

    def frame(self, lead_s: float) -> Faps:
        """See :class:`Source`."""
        if not self._is_paused:
            now_s = self._clock()
            self._follow(now_s)
            self._position_s = now_s - self._zero_s
            if self._position_s >= self.duration_s:
                self._play(0.0)
        seen_s = min(max(self._position_s + (0.0 if self._is_paused else lead_s), 0.0), self.duration_s)
        self.sliders[0].value = seen_s
        row = int(np.searchsorted(self._times_s, seen_s + 1e-9, side="right")) - 1
        faps: Faps = self._track.values[max(row, 0)]
        return faps

    def status(self) -> tuple[str, ...]:
        """See :class:`Source`."""
        return (f"{self._position_s:.2f} of {self.duration_s:.2f} s, {self._track.rate_hz:g} Hz",)

    def lit(self) -> frozenset[str]:
        """See :class:`Source`."""
        return frozenset({PAUSE} if self._is_paused else ())

    def handle(self, event: Event) -> None:
        """See :class:`Source`."""
        if isinstance(event, Moved):
            self._play(event.value)
        elif isinstance(event, Pressed) and event.key == PAUSE:
            self._is_paused = not self._is_paused
            self._play(self._position_s)

    def close(self) -> None:
        """See :class:`Source`."""
        if self._output is not None:
            self._output.close()

    def _play(self, position_s: float) -> None:
        """Play from a position on, unless it is paused."""
        self._position_s, self._zero_s, self._sound = position_s, self._clock() - position_s, None
        if self._output is None or self._samples is None:
            return
        self._output.stop()
        rest = self._samples[round(position_s * self._sample_rate_hz) :]
        if not self._is_paused and len(rest):
            self._sound, self._sound_from_s = self._output.play(rest), position_s

    def _follow(self, now_s: float) -> None:
        """Take the position from the sound; until it is heard, wait for it."""
        if self._output is None or self._sound is None or self._output.is_over(self._sound, now_s):
            return
        heard_s = self._output.position_s(self._sound, now_s)
        self._zero_s = now_s - self._sound_from_s - max(heard_s or 0.0, 0.0)


class OscSource:
    """Frames that arrive at a port. Stateful."""

    buttons = ()
    has_text = False
    failure = ""
    sliders: Sequence[Slider] = ()

    def __init__(self, frames: OscViewer) -> None:
        self._frames = frames
        self.title = f"fapengine, port {frames.port}"

    def frame(self, lead_s: float) -> Faps:
        """See :class:`Source`."""
        return self._frames.faps()

    def status(self) -> tuple[str, ...]:
        """See :class:`Source`."""
        counts = self._frames.counts
        if self._frames.is_silent:
            return (f"nothing comes to port {self._frames.port}",)
        return (f"session {self._frames.session}", f"{counts.frames} frames, {counts.missed} missed")

    def lit(self) -> frozenset[str]:
        """See :class:`Source`."""
        return frozenset()

    def handle(self, event: Event) -> None:
        """See :class:`Source`."""

    def close(self) -> None:
        """See :class:`Source`."""
        self._frames.close()


class ServerSource:
    """A session of a server; what is typed is spoken there. Stateful."""

    buttons = (PAUSE, STOP, BLINK)
    has_text = True

    def __init__(
        self,
        link: WebSocketViewer,
        *,
        voice: str = "en-us",
        sound: ViewerSound | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.sliders = face_sliders()
        self.title = "fapengine, server"
        self._link, self._voice, self._sound, self._clock = link, voice, sound, clock
        self._is_paused = False

    def frame(self, lead_s: float) -> Faps:
        """See :class:`Source`."""
        if self._link.state == "open" and not self._link.is_speaking:
            self._pause(False)  # as the face's does, it ends with what was being said
        if self._sound is not None:
            self._sound.follow(self._clock())
        return self._link.faps()

    def status(self) -> tuple[str, ...]:
        """See :class:`Source`."""
        link = self._link
        if link.state != "open":
            return (f"no server: {link.trouble}" if link.trouble else "looking for the server",)
        age_s, trip_s = link.age_s, link.round_trip_s
        if age_s is None or trip_s is None:
            return ("open",)
        return (
            f"frames {1e3 * age_s:.0f} ms old, {link.counts.missed} missed",
            f"{1e3 * trip_s:.1f} ms there and back",
        )

    @property
    def failure(self) -> str:
        """See :class:`Source`."""
        return "" if self._link.hello else f"server: {self._link.trouble or 'it did not answer in time'}"

    def lit(self) -> frozenset[str]:
        """See :class:`Source`."""
        return frozenset({PAUSE} if self._is_paused else ())

    def handle(self, event: Event) -> None:
        """See :class:`Source`."""
        if isinstance(event, Said):
            self._pause(False)
            self._link.send("say", text=event.text, voice=self._voice)
        elif isinstance(event, Moved):
            self._move(event)
        elif event.key == PAUSE:
            self._pause(not self._is_paused and self._link.is_speaking)
        elif event.key == STOP:
            self._link.send("cancel")
            if self._sound is not None:
                self._sound.stop()
            self._pause(False)
        elif event.key == BLINK:
            self._link.send("blink")

    def close(self) -> None:
        """See :class:`Source`."""
        if self._sound is not None:
            self._sound.close()
        self._link.close()

    def _pause(self, on: bool) -> None:
        """Pause the face and its sound, or resume them."""
        if on == self._is_paused:
            return
        self._is_paused = on
        if self._sound is not None:
            self._sound.pause(on)
        if on or self._sound is None or not self._sound.is_playing:  # a sound that goes on says where: that is exact
            self._link.send("pause" if on else "resume")

    def _move(self, event: Moved) -> None:
        if event.key in ("yaw", "pitch"):
            angles = {slider.key: slider.value for slider in self.sliders}
            self._link.send("look", yaw=angles["yaw"], pitch=angles["pitch"])
        elif event.key == "articulation":
            self._link.send("manner", setting="articulation", value=event.value)
        else:
            self._link.send("express", name=event.key, level=event.value)


def open_file(path: Path, audio: Path | None = None, *, device: str | None = None, silent: bool = False) -> TrackSource:
    """Open a file of face motion, and its sound.

    Raises
    ------
    UsageError
        If a file cannot be read.
    DataError
        If a file's content is wrong, or there is no frame.
    ResourceError
        If a sound device that was named is not there.
    """
    track = load_motion(path)
    if not len(track):
        raise DataError("got no frame, expected some", where=str(path))
    title = f"fapengine, {path.name}"
    if audio is None:
        return TrackSource(track, time.monotonic, title=title)
    samples, sample_rate_hz = load_sound(audio)
    output = open_output(sample_rate_hz, device=device, silent=silent)
    return TrackSource(
        track, time.monotonic, title=title, samples=samples, sample_rate_hz=sample_rate_hz, output=output
    )  # fmt: skip


def open_url(
    url: str,
    *,
    session: str | None = None,
    voice: str = "en-us",
    device: str | None = None,
    silent: bool = False,
) -> "OscSource | ServerSource":
    """Connect to a server (``http://HOST:PORT/``), or listen for frames (``osc://HOST:PORT``).

    Parameters
    ----------
    url : str
    session : str, optional
        Whose face; by default the first.
    voice : str
        Language in which a server speaks what is typed.
    device : str, optional
        Where a server's sound is played.
    silent : bool
        Play no sound.

    Raises
    ------
    UsageError
        If the URL cannot be read.
    ResourceError
        If the port is taken.
    """
    if not url.startswith("osc://"):
        link = WebSocketViewer(url, session=session, plays=not silent)
        opens = partial(open_output, device=device)
        return ServerSource(link, voice=voice, sound=None if silent else ViewerSound(link, opens=opens))
    try:
        parts = urlsplit(url)
        host, port = parts.hostname, parts.port
    except ValueError as error:
        raise UsageError(f"source: got {url!r}, expected osc://HOST:PORT ({error})") from error
    if not host or port is None:
        raise UsageError(f"source: got {url!r}, expected osc://HOST:PORT")
    return OscSource(OscViewer(host, port, session=session))

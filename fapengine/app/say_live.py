"""A live face on any screen: it speaks a sentence, or follows a microphone with 0.25 s of latency."""

from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Protocol, Self

import numpy as np
from numpy.typing import NDArray

from fapengine.app.face import REST_S, SESSION, Face, Ticks
from fapengine.app.manner import Manner, moods_of
from fapengine.audio.device import Microphone
from fapengine.errors import UsageError
from fapengine.files.heads.load import DEFAULT_HEAD, load_levels
from fapengine.host.hearing import DELAY_S, Hearing
from fapengine.recognition.choice import check_recognizer
from fapengine.render.drawing import RenderOptions
from fapengine.render.window import FaceWindow
from fapengine.speech.phone_track import PhoneTrack
from fapengine.voices.protocol import Speech


class Screen(Protocol):
    """Shows frames; a context manager."""

    @property
    def display_latency_s(self) -> float:
        """Time from asking for a frame until it is seen."""

    def show(self, faps: NDArray[np.int32], position_s: float) -> bool:
        """Show a frame, (68,) FAPU, at a position of the sound; return False when the viewer closed the screen."""

    def __enter__(self) -> Self: ...

    def __exit__(self, *_: object) -> None: ...


def say_live(
    speech: Speech,
    text: str,
    manner: Manner,
    open_face: Callable[[], Face],
    open_screen: Callable[[], Screen],
    *,
    on_silence: Callable[[str], None] = lambda reason: None,
) -> dict[str, object]:
    """Speak now, and return when the face is at rest.

    Raises UsageError for an invalid profile, expression, sink or rate; ResourceError if a named sound device is
    missing, or the screen cannot be opened.

    Parameters
    ----------
    speech : Speech
    text : str
        Words of the speech, for programs that show them.
    manner : Manner
    open_face, open_screen : callable
        Create the face in this manner, and the screen when the face is ready.
    on_silence : callable
        Called with the reason if no sound is played.

    Returns
    -------
    dict
        Plain values: frames, device, distance of the face from its sound in ms.
    """
    moods = moods_of(manner.expressions, speech.phones)
    with open_face() as face, open_screen() as screen:
        ticks = Ticks(manner.rate_hz)
        opened = face.speaker.open(speech.sample_rate_hz)
        if opened.is_silent:
            on_silence(opened.description)
        utterance = face.say(speech, text=text, expressions=moods, is_last=True)
        try:
            _run(face, screen, ticks, utterance)
        except KeyboardInterrupt:
            face.stop()
            finish(face, screen, ticks)
        device, silent = face.sound, face.speaker.is_silent
    return {
        "said": text, "device": device, "silent": silent, "duration_s": speech.duration_s,
        "frames": ticks.frames, "skipped": ticks.skipped, "rate_hz": manner.rate_hz,
        "off_ms": face.errors.as_dict(),
    }  # fmt: skip


def _run(face: Face, screen: Screen, ticks: Ticks, utterance: int) -> None:
    position_s = 0.0
    while face.is_speaking:
        ticks.wait()
        zero_s = face.speaker.zero_s(utterance)
        position_s = face.hub.clock() - zero_s if zero_s is not None else position_s
        if not screen.show(face.frame(screen.display_latency_s), position_s):
            face.stop()
    finish(face, screen, ticks, position_s)


def finish(face: Face, screen: Screen, ticks: Ticks, position_s: float = 0.0) -> None:
    """Show how the face returns to neutral."""
    until_s = face.hub.clock() + REST_S
    while face.hub.clock() < until_s:
        ticks.wait()
        if not screen.show(face.frame(screen.display_latency_s), position_s):
            return


def listen_live(
    manner: Manner,
    open_face: Callable[[], Face],
    open_screen: Callable[[], Screen],
    *,
    microphone: str | None = None,
    recognizer: Path | None = None,
) -> dict[str, object]:
    """Drive a face from a microphone until the viewer closes the screen, or presses Ctrl-C.

    Raises UsageError for an invalid profile, expression, sink or rate; ResourceError if there is no microphone, no
    recognizer, or the screen cannot be opened.

    Parameters
    ----------
    manner : Manner
        Its expressions are shown all the time.
    open_face, open_screen : callable
        Create the face in this manner, and the screen when microphone, recognizer and face are ready. The face plays no
        sound.
    microphone : str, optional
        Number of the device, or part of its name; by default the system's.
    recognizer : Path, optional
        Name of a recognizer, or an ONNX model (:mod:`fapengine.recognition.choice`).

    Returns
    -------
    dict
        Plain values: microphone, seconds of input, phones, frames.
    """
    if any(isinstance(entry, str) and "@" in entry for entry in manner.expressions):
        raise UsageError("expressions: cannot have times or words with a microphone")
    check_recognizer(recognizer)
    with Microphone(microphone) as source, open_face() as face:
        hearing = Hearing(face.hub, max_recognizers=1, model=recognizer)
        try:
            hearing.listen(SESSION, np.zeros(0, np.int16), source.rate_hz, source=source)  # the recognizer starts
            for mood in moods_of(manner.expressions, PhoneTrack.from_phones([])):
                face.express(mood.expression, mood.strength)
            with open_screen() as screen:
                ticks = Ticks(manner.rate_hz)
                with suppress(KeyboardInterrupt):  # the way to end it
                    _listen(face, hearing, source, screen, ticks)
                face.stop()
                finish(face, screen, ticks)
        finally:
            hearing.close()
    return {
        "microphone": source.description, "heard_s": hearing.counts.heard_s, "phones": hearing.counts.phones,
        "delay_s": DELAY_S, "frames": ticks.frames, "skipped": ticks.skipped, "rate_hz": manner.rate_hz,
        "lost_pieces": source.dropped,
    }  # fmt: skip


def _listen(face: Face, hearing: Hearing, source: Microphone, screen: Screen, ticks: Ticks) -> None:
    is_shown, begun_s = True, face.hub.clock()
    while is_shown:
        ticks.wait()
        samples = source.take()
        if len(samples):
            hearing.listen(SESSION, samples, source.rate_hz, source=source)
        now_s = face.hub.clock()
        hearing.tick(now_s)
        is_shown = screen.show(face.frame(screen.display_latency_s), now_s - begun_s)


class WindowScreen:
    """A window that shows the face while it speaks. Stateful.

    Raises ResourceError if there is no display.

    Parameters
    ----------
    head : str
        See :func:`fapengine.files.heads.load.load_head`.
    drawing : RenderOptions
        Size and camera.
    rate_hz : float
        Frame rate to keep.
    """

    def __init__(self, head: str = DEFAULT_HEAD, *, drawing: RenderOptions, rate_hz: float) -> None:
        finest, coarser = load_levels(head)
        self._window = FaceWindow(finest, drawing, coarser=coarser, title="fapengine", hold_hz=rate_hz)

    @property
    def display_latency_s(self) -> float:
        """See :class:`Screen`."""
        return self._window.busy_s

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._window.close()

    def show(self, faps: NDArray[np.int32], position_s: float) -> bool:
        """See :class:`Screen`."""
        if self._window.is_open:
            self._window.show(faps)
        return self._window.is_open

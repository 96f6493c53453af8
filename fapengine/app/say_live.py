"""A sentence that is spoken and shown at once, on any screen."""

from collections.abc import Callable
from dataclasses import dataclass
from types import TracebackType
from typing import Protocol, Self

import numpy as np
from numpy.typing import NDArray

from fapengine.app.face import REST_S, Face, Ticks
from fapengine.app.manner import Manner, moods_of
from fapengine.files.heads.load import DEFAULT_HEAD, load_levels
from fapengine.render.drawing import Drawing
from fapengine.render.panel import Panel
from fapengine.render.window import FaceWindow
from fapengine.voices.protocol import Speech


class Screen(Protocol):
    """Place where frames are shown; a context manager."""

    @property
    def lead_s(self) -> float:
        """Time from asking for a frame until it is seen."""
        ...

    def show(self, faps: NDArray[np.int32], position_s: float) -> bool:
        """Show a frame, (68,) FAPU, at a position of the sound; return False when the viewer closed the screen."""
        ...

    def __enter__(self) -> Self: ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...


@dataclass(frozen=True, slots=True, kw_only=True)
class LiveOutput:
    """Where live sound and frames go."""

    device: str | None = None
    """Number of the sound device, or a part of its name; None: the system's."""
    silent: bool = False
    sinks: tuple[str, ...] = ()
    """URLs: see :mod:`fapengine.live.server.sink_address`."""


def open_face(manner: Manner, output: LiveOutput) -> Face:
    """Make a face. Raises as :class:`Face`."""
    return Face(
        manner.profile,
        style=manner.style,
        seed=manner.seed,
        rate_hz=manner.rate_hz,
        device=output.device,
        silent=output.silent,
        sinks=output.sinks,
    )


def say_live(
    speech: Speech,
    text: str,
    manner: Manner,
    output: LiveOutput,
    open_screen: Callable[[], Screen],
    *,
    on_silence: Callable[[str], None] = lambda reason: None,
) -> dict[str, object]:
    """Say it now, and return when the face is at rest.

    Parameters
    ----------
    speech : Speech
    text : str
        Words of it, for programs that show them.
    manner : Manner
    output : LiveOutput
    open_screen : callable
        Makes the screen, when the face is ready.
    on_silence : callable
        Called with the reason if no sound is played.

    Returns
    -------
    dict
        Plain values: frames, device, distance of the face from its sound in ms.

    Raises
    ------
    UsageError
        If the profile, an expression, a sink or the rate cannot be.
    ResourceError
        If a sound device that was named is not there, or the screen cannot be opened.
    """
    moods = moods_of(manner.expressions, speech.phones)
    with open_face(manner, output) as face, open_screen() as screen:
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
        if not screen.show(face.frame(screen.lead_s), position_s):
            face.stop()
    finish(face, screen, ticks, position_s)


def finish(face: Face, screen: Screen, ticks: Ticks, position_s: float = 0.0) -> None:
    """Show how it comes to rest."""
    until_s = face.hub.clock() + REST_S
    while face.hub.clock() < until_s:
        ticks.wait()
        if not screen.show(face.frame(screen.lead_s), position_s):
            return


class WindowScreen:
    """A window that shows the face while it speaks. Stateful.

    Parameters
    ----------
    head : str
        Whose face: see :func:`fapengine.files.heads.load.load_head`.
    drawing : Drawing
        Size and camera.
    rate_hz : float
        Frames a second that are to be kept.

    Raises
    ------
    ResourceError
        If there is no display.
    """

    def __init__(self, head: str = DEFAULT_HEAD, *, drawing: Drawing, rate_hz: float) -> None:
        finest, coarser = load_levels(head)
        self._window = FaceWindow(
            finest, drawing, coarser=coarser, title="fapengine", panel=Panel(), hold_hz=rate_hz,
        )  # fmt: skip
        self._window.hide_panel()

    @property
    def lead_s(self) -> float:
        """See :class:`Screen`."""
        return self._window.busy_s

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._window.close()

    def show(self, faps: NDArray[np.int32], position_s: float) -> bool:
        """See :class:`Screen`."""
        if self._window.is_open:
            self._window.show(faps)
        return self._window.is_open

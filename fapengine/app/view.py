"""A window with a face from any source, and its controls back to the source."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from fapengine.app.face import Ticks
from fapengine.app.view_sources import KEYS, Source
from fapengine.errors import ResourceError
from fapengine.files.pictures import save_png
from fapengine.mesh.face_mesh import FaceMesh
from fapengine.render.drawing import Drawing
from fapengine.render.live import LevelOfDetail
from fapengine.render.panel import Panel, Said
from fapengine.render.window import FaceWindow

STATUS_S = 0.2
"""Time between two updates of the status; it is drawn anew each time."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ViewOptions:
    """What to show in a window, and for how long."""

    drawing: Drawing
    """Camera, and the size of the window in points, panel included."""
    rate_hz: float = 60.0
    seconds: float | None = None
    """Time until the window closes by itself; None: never."""
    shot: Path | None = None
    """Picture (.png) of the window when it closes."""
    sentences: tuple[str, ...] = ()
    """Texts to say first."""


@dataclass(frozen=True, slots=True)
class ViewReport:
    """What a window showed."""

    frames: int
    skipped: int
    """Count of frames that came too late to be shown."""
    seconds: float
    """Time from the first frame to the last."""
    rate_hz: float
    """Frames a second that were shown."""
    frame_ms: float
    """Time that drawing a frame took of late."""
    quality: str
    """Resolution and level of detail at the end."""


def run_window(
    head: FaceMesh,
    coarser: Sequence[LevelOfDetail],
    open_source: Callable[[], Source],
    options: ViewOptions,
) -> ViewReport:
    """Show a source until the window is closed.

    Parameters
    ----------
    head : FaceMesh
    coarser : sequence of FaceMesh
        Coarser levels of detail, or functions that load them when they are needed.
    open_source : callable
        Makes the source, when the window is open; it is closed with the window.
    options : ViewOptions

    Raises
    ------
    ResourceError
        If there is no display, or what was to be shown was never there.
    UsageError
        If the window is too small.
    """
    with FaceWindow(head, options.drawing, coarser=coarser, keys=KEYS, hold_hz=options.rate_hz) as window:
        source = open_source()
        try:
            begun_s = time.monotonic()
            ticks = _run(window, source, options)
            if options.shot is not None:
                save_png(options.shot, window.picture())
            if source.failure:
                raise ResourceError(source.failure)
        finally:
            source.close()
        took_s = time.monotonic() - begun_s
    return ViewReport(
        ticks.frames, ticks.skipped, took_s, ticks.frames / took_s, 1e3 * window.busy_s, str(window.quality)
    )


def _pace(window: FaceWindow) -> str:
    """Describe the rate, and the resolution and head if those were reduced for it."""
    quality = window.quality
    reduced = "" if quality.scale == 1 else f" at {100 * quality.scale:.0f} %"
    reduced += ", coarser head" if quality.level else ""
    return f"{window.rate_hz:.0f} fps, {1e3 * window.busy_s:.1f} ms a frame{reduced}"


def _title(window: FaceWindow, source: Source) -> str:
    """Name the window; one without a panel says there what else would not be seen."""
    if window.has_room_for_panel:
        return source.title
    return f"{source.title} – {source.failure or 'wider, it shows its controls'}"


def _run(window: FaceWindow, source: Source, options: ViewOptions) -> Ticks:
    panel: Panel = window.panel
    panel.sliders, panel.has_text = source.sliders, source.has_text
    panel.buttons = (*panel.buttons, *source.buttons)
    named = source.title
    window.title(named)
    source_buttons = frozenset(source.buttons)
    window.show(source.frame(0.0))  # the first frame takes longest: the mesh goes to the GPU
    for sentence in options.sentences:
        source.handle(Said(sentence))
    ticks, status_s, begun_s = Ticks(options.rate_hz), 0.0, time.monotonic()
    while window.is_open and (options.seconds is None or time.monotonic() < begun_s + options.seconds):
        ticks.wait()
        for event in window.show(source.frame(window.busy_s)):
            source.handle(event)
        panel.lit = (panel.lit - source_buttons) | source.lit()
        if time.monotonic() >= status_s:
            status_s = time.monotonic() + STATUS_S
            panel.status = (_pace(window), *source.status())
            title = _title(window, source)
            if title != named:
                window.title(title)
                named = title
    return ticks

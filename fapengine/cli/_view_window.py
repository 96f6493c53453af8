"""The loop of ``fapengine view``: frames from a source into a window, controls back to the source."""

import json
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console

from fapengine.cli._live_face import Ticks
from fapengine.cli._view_sources import KEYS, Source
from fapengine.files.pictures import save_png
from fapengine.mesh.face_mesh import FaceMesh
from fapengine.render.panel import Panel, Said
from fapengine.render.window import FaceWindow

STATUS_S = 0.2
"""Between two writings of the status; it is drawn anew each time."""


@dataclass(frozen=True, slots=True)
class Wish:
    """What the command line chose."""

    size: tuple[int, int]
    camera: str
    rate_hz: float
    seconds: float | None = None
    """None: until it is closed."""
    shot: Path | None = None
    sentences: tuple[str, ...] = ()


def run_window(levels: Sequence[FaceMesh], shown: Callable[[], Source], wish: Wish, *, as_json: bool = False) -> None:
    """Show a source until the window is closed; the levels of the head begin with the finest.

    Raises
    ------
    ResourceError
        If there is no display.
    UsageError
        If the size or the camera cannot be.
    """
    with FaceWindow(
        levels[0], coarser=levels[1:], size=wish.size, camera=wish.camera, keys=KEYS, hold_hz=wish.rate_hz
    ) as window:
        source = shown()
        try:
            begun_s = time.monotonic()
            ticks = _run(window, source, wish)
            if wish.shot is not None:
                save_png(wish.shot, window.picture())
        finally:
            source.close()
        took_s = time.monotonic() - begun_s
    report = {
        "frames": ticks.frames, "skipped": ticks.skipped, "seconds": took_s, "rate_hz": ticks.frames / took_s,
        "frame_ms": 1e3 * window.busy_s, "quality": str(window.quality),
    }  # fmt: skip
    if as_json:
        print(json.dumps(report, indent=2))  # noqa: T201  the answer itself
    else:
        Console(highlight=False).print(
            f"{ticks.frames} frames in {took_s:.1f} s, {report['frame_ms']:.1f} ms each to draw"
        )


def _pace(window: FaceWindow) -> str:
    """Say how fast, and at what resolution and with what head if those were given up for it."""
    quality = window.quality
    given_up = "" if quality.scale == 1 else f" at {100 * quality.scale:.0f} %"
    given_up += ", coarser head" if quality.level else ""
    return f"{window.rate_hz:.0f} fps, {1e3 * window.busy_s:.1f} ms a frame{given_up}"


def _run(window: FaceWindow, source: Source, wish: Wish) -> Ticks:
    panel: Panel = window.panel
    panel.sliders, panel.has_text = source.sliders, source.has_text
    panel.buttons = (*panel.buttons, *source.buttons)
    window.title(source.title)
    own = frozenset(source.buttons)
    window.show(source.frame(0.0))  # the first frame takes longest: the mesh goes to the GPU
    for sentence in wish.sentences:
        source.handle(Said(sentence))
    ticks, status_s, begun_s = Ticks(wish.rate_hz), 0.0, time.monotonic()
    while window.is_open and (wish.seconds is None or time.monotonic() < begun_s + wish.seconds):
        ticks.wait()
        for event in window.show(source.frame(window.busy_s)):
            source.handle(event)
        panel.lit = (panel.lit - own) | source.lit()
        if time.monotonic() >= status_s:
            status_s = time.monotonic() + STATUS_S
            panel.status = (_pace(window), *source.status())
    return ticks

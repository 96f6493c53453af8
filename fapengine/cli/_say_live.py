"""``fapengine say --live``: speak and move at once, in a window or a line of the terminal."""

import json
from contextlib import ExitStack
from dataclasses import dataclass
from types import TracebackType
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.live import Live
from rich.text import Text

from fapengine.cli._live_face import LiveFace, Ticks, has_display
from fapengine.cli._phone_ticker import ticker
from fapengine.cli.talk import Options, parse_expressions, parse_size
from fapengine.errors import ResourceError
from fapengine.files.heads import load_levels
from fapengine.mpeg4 import fap
from fapengine.render.panel import Panel
from fapengine.render.window import FaceWindow
from fapengine.speech.phone_track import PhoneTrack
from fapengine.voices.protocol import Speech

AFTER_S = 0.4
"""The face is shown at rest for so long, so that it does not vanish with the last sound."""
BLOCKS = " \u2581\u2582\u2583\u2584\u2585\u2586\u2587\u2588"
WIDE_OPEN_FAPU = 500.0
PERCENTILES = {"p50": "half of the frames", "p95": "95 %", "max": "all"}


@dataclass(frozen=True, slots=True)
class LiveOptions:
    """What the command line chose besides :class:`fapengine.cli.talk.Options`."""

    device: str | None = None
    silent: bool = False
    window: bool | None = None
    """None: where there is a display."""
    sinks: tuple[str, ...] = ()


class Screen(Protocol):
    """Where frames are shown."""

    @property
    def lead_s(self) -> float:
        """How long after it was asked for a frame is seen."""
        ...

    def show(self, faps: NDArray[np.int32], place_s: float) -> bool:
        """Show a frame, (68,) FAPU; False when the watcher has had enough."""
        ...


def say_live(speech: Speech, text: str, options: Options, live: LiveOptions) -> dict[str, object]:
    """Say it now.

    Returns
    -------
    dict
        For ``--json``: frames, device, how far face and sound were apart.
    """
    moods = parse_expressions(options.expressions, speech.phones)
    face = LiveFace(
        options.profile, style=options.style, seed=options.seed, rate_hz=options.rate_hz,
        device=live.device, silent=live.silent, sinks=live.sinks,
    )  # fmt: skip
    ticks = Ticks(options.rate_hz)
    with ExitStack() as stack:
        stack.callback(face.close)
        screen = _screen(options, live, speech.phones, stack)
        output = face.speaker.open(speech.sample_rate_hz)
        if output.is_silent:
            _note(f"no sound ({output.description}); the face keeps time by the clock")
        utterance = face.say(speech, text, moods)
        try:
            _run(face, screen, ticks, utterance)
        except KeyboardInterrupt:
            face.stop()
            _finish(face, screen, ticks)
        device, silent = face.speaker.description, face.speaker.is_silent
    return {
        "said": text, "device": device, "silent": silent, "duration_s": speech.duration_s,
        "frames": ticks.frames, "skipped": ticks.skipped, "rate_hz": options.rate_hz,
        "off_ms": face.errors.as_dict(),
    }  # fmt: skip


def _run(face: LiveFace, screen: Screen, ticks: Ticks, utterance: int) -> None:
    place_s = 0.0
    while face.is_speaking:
        ticks.wait()
        zero_s = face.speaker.zero_s(utterance)
        place_s = face.hub.clock() - zero_s if zero_s is not None else place_s
        if not screen.show(face.frame(screen.lead_s), place_s):
            face.stop()
    _finish(face, screen, ticks, place_s)


def _finish(face: LiveFace, screen: Screen, ticks: Ticks, place_s: float = 0.0) -> None:
    """Show how it comes to rest."""
    until_s = face.hub.clock() + AFTER_S
    while face.hub.clock() < until_s:
        ticks.wait()
        if not screen.show(face.frame(screen.lead_s), place_s):
            return


def _screen(options: Options, live: LiveOptions, phones: PhoneTrack, stack: ExitStack) -> Screen:
    wanted = has_display() if live.window is None else live.window
    if wanted:
        try:
            return stack.enter_context(_WindowScreen(options))
        except ResourceError as error:
            if live.window:
                raise
            _note(str(error))
    return stack.enter_context(_LineScreen(phones))


class _LineScreen:
    """Stateful: a line of the terminal with phones, the mouth's opening and the time; nothing where there is none."""

    lead_s = 0.0

    def __init__(self, phones: PhoneTrack) -> None:
        self._phones = phones
        self._console = Console(stderr=True, highlight=False)
        self._live = Live(console=self._console, transient=True, refresh_per_second=15, auto_refresh=True)

    def __enter__(self) -> "_LineScreen":
        if self._console.is_terminal:
            self._live.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._console.is_terminal:
            self._live.stop()

    def show(self, faps: NDArray[np.int32], place_s: float) -> bool:
        """See :class:`Screen`."""
        if self._console.is_terminal:
            before, now, after = ticker(self._phones, place_s)
            line = Text(f"{_mouth(faps)}  {max(place_s, 0.0):5.2f} s  ")
            line.append(before, style="dim").append(f" {now} ", style="bold black on yellow").append(after)
            self._live.update(line)
        return True


class _WindowScreen:
    """Stateful: a window that shows the face while it speaks."""

    def __init__(self, options: Options) -> None:
        finest, *coarser = load_levels(options.head)
        self._window = FaceWindow(
            finest, coarser=coarser, title="fapengine say", size=parse_size(options.size), camera=options.camera,
            panel=Panel(), hold_hz=options.rate_hz,
        )  # fmt: skip
        self._window.hide_panel()

    @property
    def lead_s(self) -> float:
        """See :class:`Screen`."""
        return self._window.busy_s

    def __enter__(self) -> "_WindowScreen":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._window.close()

    def show(self, faps: NDArray[np.int32], place_s: float) -> bool:
        """See :class:`Screen`."""
        if self._window.is_open:
            self._window.show(faps)
        return self._window.is_open


def _mouth(faps: NDArray[np.int32]) -> str:
    """Four characters, the higher the wider the mouth is open."""
    lips = faps[fap.column(51)] + faps[fap.column(52)]  # both towards the middle are positive
    level = round(min(max(-float(lips) / WIDE_OPEN_FAPU, 0.0), 1.0) * (len(BLOCKS) - 1))
    return BLOCKS[level] * 4


def _note(text: str) -> None:
    Console(stderr=True, highlight=False).print(f"[yellow]{text}[/]", soft_wrap=True)


def print_live(done: dict[str, object], *, as_json: bool) -> None:
    """Say what was shown, and how far face and sound were apart."""
    if as_json:
        print(json.dumps(done, indent=2, ensure_ascii=False))  # noqa: T201  the answer itself
        return
    console = Console(highlight=False)
    console.print(f"[bold]{'sound':>8}[/]  {done['device']}", soft_wrap=True)
    console.print(f"[bold]{'face':>8}[/]  {done['frames']} frames at {done['rate_hz']:g} Hz, {done['skipped']} skipped")
    off = done["off_ms"]
    if isinstance(off, dict) and off:
        apart = ", ".join(f"{off[key]:.1f} ms ({name})" for key, name in PERCENTILES.items())
        console.print(f"[bold]{'apart':>8}[/]  {apart}", soft_wrap=True)

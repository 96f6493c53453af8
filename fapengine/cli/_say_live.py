"""``fapengine say --live``: a window or a line of the terminal, and the printed result."""

from typing import Self

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.live import Live
from rich.text import Text

from fapengine.app.face import has_display
from fapengine.app.say_live import Screen, WindowScreen
from fapengine.cli._printing import print_result, print_rows
from fapengine.errors import ResourceError
from fapengine.mpeg4 import fap
from fapengine.render.drawing import RenderOptions
from fapengine.speech.phone_track import PhoneTrack

PERCENTILES = {"p50": "half of the frames", "p95": "95 %", "max": "all"}


def open_screen(
    phones: PhoneTrack | None, *, head: str, drawing: RenderOptions, window: bool | None, rate_hz: float
) -> Screen:
    """Open a window, or use the terminal if there is no display; ``window`` True or False forces one of them."""
    if has_display() if window is None else window:
        try:
            return WindowScreen(head, drawing=drawing, rate_hz=rate_hz)
        except ResourceError as error:
            if window:
                raise
            note(str(error))
    return TerminalScreen(phones)


def note(text: str) -> None:
    """Print it to standard error, in yellow."""
    Console(stderr=True, highlight=False).print(f"[yellow]{text}[/]", soft_wrap=True)


def print_live(result: dict[str, object], *, as_json: bool) -> None:
    """Print the frame counts and the offset between face and sound, or what was recognized."""
    if as_json:
        print_result(result, as_json=True)
        return
    if "microphone" in result:
        heard = f"{result['heard_s']:.1f} s, {result['phones']} phones and pauses, shown {result['delay_s']:g} s later"
        rows = [("heard", result["microphone"], "bold"), ("sound", heard, "bold")]
    else:
        rows = [("sound", result["device"], "bold")]
    frames = f"{result['frames']} frames at {result['rate_hz']:g} Hz, {result['skipped']} skipped"
    rows.append(("face", frames, "bold"))
    off_ms = result.get("off_ms")
    if isinstance(off_ms, dict) and off_ms:
        apart = ", ".join(f"{off_ms[key]:.1f} ms ({name})" for key, name in PERCENTILES.items())
        rows.append(("apart", apart, "bold"))
    print_rows(rows)


BLOCKS = " \u2581\u2582\u2583\u2584\u2585\u2586\u2587\u2588"
WIDE_OPEN_FAPU = 500.0
BEFORE, AFTER = 6, 10
"""Numbers of phones shown on either side."""


class TerminalScreen:
    """A line of the terminal; without a terminal, nothing is written. Stateful.

    ``phones`` are those that will be said; None if they are unknown: ``doing`` then says what is done.
    """

    display_latency_s = 0.0

    def __init__(self, phones: PhoneTrack | None, doing: str = "listening") -> None:
        self._phones, self._doing = phones, doing
        self._console = Console(stderr=True, highlight=False)
        self._live = Live(console=self._console, transient=True, refresh_per_second=15, auto_refresh=True)

    def __enter__(self) -> Self:
        if self._console.is_terminal:
            self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._console.is_terminal:
            self._live.stop()

    def show(self, faps: NDArray[np.int32], position_s: float) -> bool:
        """See :class:`fapengine.app.say_live.Screen`."""
        if self._console.is_terminal:
            line = Text(f"{_mouth(faps)}  {max(position_s, 0.0):5.2f} s  ")
            if self._phones is None:
                line.append(f"{self._doing}; Ctrl-C ends it", style="dim")
            else:
                before, now, after = ticker(self._phones, position_s)
                line.append(before, style="dim").append(f" {now} ", style="bold black on yellow").append(after)
            self._live.update(line)
        return True


def _mouth(faps: NDArray[np.int32]) -> str:
    """Return four characters, the higher the wider the mouth is open."""
    lips = faps[fap.column(51)] + faps[fap.column(52)]  # both towards the middle are positive
    level = round(min(max(-float(lips) / WIDE_OPEN_FAPU, 0.0), 1.0) * (len(BLOCKS) - 1))
    return BLOCKS[level] * 4


def ticker(phones: PhoneTrack, position_s: float) -> tuple[str, str, str]:
    """Return the labels of the phones before a position, at it, and after it.

    Examples
    --------
    >>> from fapengine.speech.phone_track import Phone
    >>> track = PhoneTrack.from_phones([Phone("h", 0.0, 0.1), Phone("a", 0.1, 0.2), Phone("j", 0.3, 0.4)])
    >>> ticker(track, 0.15), ticker(track, 9.0)
    (('h', 'a', '· j'), ('h a · j', '', ''))
    >>> ticker(track, -0.5)  # nothing is said before the beginning
    ('', '', 'a · j')
    """
    labels = ["·" if phone.is_silence else phone.label for phone in phones.phones]
    at = sum(phone.end_s <= position_s for phone in phones.phones)
    now = labels[at] if at < len(labels) and position_s >= 0 else ""
    return " ".join(labels[max(at - BEFORE, 0) : at]), now, " ".join(labels[at + 1 : at + 1 + AFTER])

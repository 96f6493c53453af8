"""``fapengine say --live``: a window or a terminal line, and the printed result."""

import json
from pathlib import Path

from rich.console import Console

from fapengine.app.face import has_display
from fapengine.app.manner import Manner
from fapengine.app.say_live import LiveOutput, Screen, WindowScreen, listen_live, say_live
from fapengine.cli._terminal_screen import TerminalScreen
from fapengine.errors import ResourceError
from fapengine.render.drawing import Drawing
from fapengine.speech.phone_track import PhoneTrack
from fapengine.voices.protocol import Speech

PERCENTILES = {"p50": "half of the frames", "p95": "95 %", "max": "all"}


def say_now(
    speech: Speech,
    text: str,
    manner: Manner,
    output: LiveOutput,
    *,
    head: str,
    drawing: Drawing,
    window: bool | None,
) -> dict[str, object]:
    """Say it in a window, or in the terminal if there is no display; ``window`` forces one of them."""
    return say_live(
        speech, text, manner, output,
        lambda: _screen(speech.phones, manner, head=head, drawing=drawing, window=window),
        on_silence=lambda reason: _note(f"no sound ({reason}); the face follows the system clock"),
    )  # fmt: skip


def listen_now(
    microphone: str | None,
    manner: Manner,
    output: LiveOutput,
    *,
    recognizer: Path | None,
    head: str,
    drawing: Drawing,
    window: bool | None,
) -> dict[str, object]:
    """Drive the face from a microphone until the user stops it."""
    return listen_live(
        manner,
        output,
        lambda: _screen(None, manner, head=head, drawing=drawing, window=window),
        microphone=microphone,
        recognizer=recognizer,
    )


def _screen(
    phones: PhoneTrack | None, manner: Manner, *, head: str, drawing: Drawing, window: bool | None
) -> Screen:  # fmt: skip
    if has_display() if window is None else window:
        try:
            return WindowScreen(head, drawing=drawing, rate_hz=manner.rate_hz)
        except ResourceError as error:
            if window:
                raise
            _note(str(error))
    return TerminalScreen(phones)


def _note(text: str) -> None:
    Console(stderr=True, highlight=False).print(f"[yellow]{text}[/]", soft_wrap=True)


def print_live(result: dict[str, object], *, as_json: bool) -> None:
    """Print the frame counts and the offset between face and sound."""
    if as_json:
        print(json.dumps(result, indent=2, ensure_ascii=False))  # noqa: T201  the answer itself
        return
    console = Console(highlight=False)
    console.print(f"[bold]{'sound':>8}[/]  {result['device']}", soft_wrap=True)
    frames = f"{result['frames']} frames at {result['rate_hz']:g} Hz, {result['skipped']} skipped"
    console.print(f"[bold]{'face':>8}[/]  {frames}")
    off_ms = result["off_ms"]
    if isinstance(off_ms, dict) and off_ms:
        apart = ", ".join(f"{off_ms[key]:.1f} ms ({name})" for key, name in PERCENTILES.items())
        console.print(f"[bold]{'apart':>8}[/]  {apart}", soft_wrap=True)


def print_heard(result: dict[str, object], *, as_json: bool) -> None:
    """Print what was recognized and shown."""
    if as_json:
        print(json.dumps(result, indent=2, ensure_ascii=False))  # noqa: T201  the answer itself
        return
    console = Console(highlight=False)
    console.print(f"[bold]{'heard':>8}[/]  {result['microphone']}", soft_wrap=True)
    heard = f"{result['heard_s']:.1f} s, {result['phones']} phones and pauses, shown {result['delay_s']:g} s later"
    console.print(f"[bold]{'sound':>8}[/]  {heard}")
    console.print(
        f"[bold]{'face':>8}[/]  {result['frames']} frames at {result['rate_hz']:g} Hz, {result['skipped']} skipped"
    )

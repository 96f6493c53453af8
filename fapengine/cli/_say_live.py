"""``fapengine say --live``: a window or a terminal line, and the printed result."""

from pathlib import Path

from rich.console import Console

from fapengine.app.face import has_display
from fapengine.app.manner import Manner
from fapengine.app.say_live import LiveOutput, Screen, WindowScreen, listen_live, say_live
from fapengine.cli._printing import print_result, print_rows
from fapengine.cli._terminal_screen import TerminalScreen
from fapengine.errors import ResourceError
from fapengine.render.drawing import RenderOptions
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
    drawing: RenderOptions,
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
    drawing: RenderOptions,
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
    phones: PhoneTrack | None, manner: Manner, *, head: str, drawing: RenderOptions, window: bool | None
) -> Screen:
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

"""``fapengine doctor``: what this machine can do, and the one line that mends each lack."""

from collections.abc import Callable
from dataclasses import asdict, dataclass

import typer

from fapengine.errors import FapEngineError

ESSENTIAL = ("OpenGL", "video")
"""Without these no face is drawn; ``doctor`` then exits with 3."""


@dataclass(frozen=True, slots=True)
class Finding:
    """One line of the report."""

    part: str
    works: bool
    found: str
    """What was found, or why it does not work."""
    mend: str = ""
    """The command that mends it; empty where nothing is needed."""


class _LackError(Exception):
    """Something is missing; carries what was found and the line that mends it."""


def doctor(as_json: bool = typer.Option(False, "--json", help="Print the findings as JSON.")) -> None:
    """Say what works on this machine (OpenGL, voices, video, sound card) and how to mend what does not."""
    findings = [
        _check("Python", "", _python),
        _check("OpenGL", "sudo apt-get install -y libegl1 libgl1", _opengl),
        _check("voices", 'pip install "fapengine[voice]"', _voices),
        _check("video", "pip install --upgrade av", _video),
        _check("sound card", "sudo apt-get install -y libportaudio2", _sound_card),
        _check("compiled codec", 'pip install "fapengine[fast]"', _compiled_codec),
    ]
    if as_json:
        import json

        typer.echo(json.dumps([asdict(finding) for finding in findings], indent=2, ensure_ascii=False))
    else:
        _print_table(findings)
    if any(finding.part in ESSENTIAL and not finding.works for finding in findings):
        raise typer.Exit(3)


def _check(part: str, mend: str, look: Callable[[], str]) -> Finding:
    try:
        return Finding(part, True, look())
    except _LackError as lack:
        return Finding(part, False, *lack.args)
    except (FapEngineError, ImportError, OSError) as error:
        return Finding(part, False, str(error), mend)


def _python() -> str:
    import platform

    from fapengine import __version__

    return f"{platform.python_version()}, fapengine {__version__}, {platform.system()} {platform.machine()}"


def _opengl() -> str:
    from fapengine.render.context import create_context

    context = create_context()
    try:
        return f"{context.info['GL_VERSION']} on {context.info['GL_RENDERER']}"
    finally:
        context.release()


def _voices() -> str:
    from fapengine.voices.espeak import voices

    return f"espeak-ng, {len(voices())} voices"


def _video() -> str:
    import av

    encoders = [name for name in ("libx264", "libopenh264", "libvpx-vp9", "aac", "libopus") if _can_encode(name)]
    if not any(name in encoders for name in ("libx264", "libopenh264")):
        raise _LackError(f"PyAV {av.__version__} has no H.264 encoder", "pip install --force-reinstall av")
    return f"PyAV {av.__version__}: {', '.join(encoders)}"


def _can_encode(name: str) -> bool:
    from av.codec import Codec
    from av.codec.codec import UnknownCodecError

    try:
        Codec(name, "w")
    except UnknownCodecError:
        return False
    return True


def _sound_card() -> str:
    import sounddevice

    outputs = [device["name"] for device in sounddevice.query_devices() if device["max_output_channels"] > 0]
    if not outputs:
        raise _LackError("PortAudio works, but has no output device", "connect one; files need none")
    return str(outputs[0])


def _compiled_codec() -> str:
    import numba

    return f"numba {numba.__version__}"


def _print_table(findings: list[Finding]) -> None:
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    table = Table("", "part", "found", "to mend it", box=None, pad_edge=False)
    for finding in findings:
        sign = "[green]✓[/]" if finding.works else "[red]✗[/]"
        table.add_row(sign, finding.part, escape(finding.found), escape(finding.mend))
    Console().print(table)

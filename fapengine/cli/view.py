"""``fapengine view``: a window with a live face and its controls."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from fapengine.cli import options as shared

if TYPE_CHECKING:
    from fapengine.cli._view_sources import Source

CHECKED_HZ = 22_050
"""A device that does not know this rate is opened with its own."""


def view(
    source: Annotated[
        str | None,
        typer.Argument(
            help="FAPs (.fap, .fba, .csv, .json), a server (http://127.0.0.1:8110/, as `fapengine serve` prints it),"
            " or a port for OSC frames (osc://127.0.0.1:9100). Without one, a face that speaks what you type."
        ),
    ] = None,
    audio: Annotated[Path | None, typer.Option("--audio", help="Sound of the file; the face follows it.")] = None,
    session: Annotated[str | None, typer.Option("--session", help="Whose face, of a server or a port.")] = None,
    say: Annotated[list[str], typer.Option("--say", help="Say this first. May be given again.")] = [],  # noqa: B006
    voice: Annotated[str, typer.Option("--voice", "-v", help="Language, such as en-gb, de or fr-fr.")] = "en-us",
    rate: Annotated[int, typer.Option("--rate", help="Words a minute, 80 to 450.")] = 160,
    profile: shared.ProfileName = "grid_s1_en",
    head: shared.HeadName = "default",
    camera: shared.CameraName = "front",
    size: shared.Size = "900x660",
    fps: shared.Fps = 60.0,
    without: shared.Without = [],  # noqa: B006
    seed: shared.Seed = 1,
    device: shared.Device = None,
    silent: shared.Silent = False,
    sink: shared.Sinks = [],  # noqa: B006
    seconds: Annotated[float | None, typer.Option("--for", help="Close after so many seconds.")] = None,
    shot: Annotated[Path | None, typer.Option("--shot", help="Save the window as a PNG when it closes.")] = None,
    as_json: shared.AsJson = False,
) -> None:
    """Open a window with a face: your own words, a file, or a live session.

    Pull the face to turn it, wheel to come nearer; 1 to 4 cameras, R front, space pause, B blink, S stop, Enter types,
    Tab hides the panel, Q closes.

    Example: fapengine view; fapengine view out/demo.fap --audio out/demo.wav; fapengine view http://127.0.0.1:8110/
    """
    from fapengine.cli._view_window import Wish, run_window
    from fapengine.cli.talk import parse_size
    from fapengine.errors import UsageError
    from fapengine.files.heads import load_levels
    from fapengine.live.sound import open_output

    if audio is not None and (source is None or "://" in source):
        raise UsageError(f"--audio: got {audio}, expected a file of FAPs before it")
    if seconds is not None and not seconds > 0:
        raise UsageError(f"--for: got {seconds} s, expected a positive time")
    wish = Wish(
        size=parse_size(size), camera=camera, rate_hz=fps, seconds=seconds, shot=shot, sentences=tuple(say)
    )  # fmt: skip
    if device is not None and not silent:
        open_output(CHECKED_HZ, device=device).close()  # a wrong one is told of now, not at the first sentence
    levels = load_levels(head)

    def shown() -> "Source":
        if source is None:
            return _speaking(profile, without, seed, fps, device, silent, sink, voice, rate)
        if "://" in source:
            return _elsewhere(source, session, voice, device, silent)
        return _file(Path(source), audio, device, silent)

    run_window(levels, shown, wish, as_json=as_json)


def _speaking(
    profile: str, without: list[str], seed: int, fps: float, device: str | None, silent: bool, sink: list[str],
    voice: str, rate: int,
) -> "Source":  # fmt: skip
    from fapengine.cli._live_face import LiveFace
    from fapengine.cli._view_sources import SpeakingSource
    from fapengine.cli.talk import manner_of
    from fapengine.voices.espeak import EspeakVoice

    style = manner_of(1.0, 1.0, 1.0, 0.0, "context", without)
    face = LiveFace(profile, style=style, seed=seed, rate_hz=fps, device=device, silent=silent, sinks=sink)
    return SpeakingSource(face, lambda text: EspeakVoice(voice, rate).speak(text))


def _elsewhere(source: str, session: str | None, voice: str, device: str | None, silent: bool) -> "Source":
    from functools import partial
    from urllib.parse import urlsplit

    from fapengine.cli._view_sources import OscSource, ServerSource
    from fapengine.errors import UsageError
    from fapengine.live.sound import open_output
    from fapengine.live.watch import ServerLink
    from fapengine.live.watch_osc import OscFrames
    from fapengine.live.watch_sound import ServerSound

    if not source.startswith("osc://"):
        link = ServerLink(source, session=session, plays=not silent)
        opens = partial(open_output, device=device)
        return ServerSource(link, voice=voice, sound=None if silent else ServerSound(link, opens=opens))
    try:
        parts = urlsplit(source)
        host, port = parts.hostname, parts.port
    except ValueError as error:
        raise UsageError(f"source: got {source!r}, expected osc://HOST:PORT ({error})") from error
    if not host or port is None:
        raise UsageError(f"source: got {source!r}, expected osc://HOST:PORT")
    return OscSource(OscFrames(host, port, session=session))


def _file(path: Path, audio: Path | None, device: str | None, silent: bool) -> "Source":
    import time

    from fapengine.cli._view_sources import TrackSource
    from fapengine.errors import DataError
    from fapengine.files.motion import load_motion
    from fapengine.files.sound import load_sound
    from fapengine.live.sound import open_output

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

"""``fapengine capture``: a performance to FAPs."""

from pathlib import Path
from typing import Annotated

import typer

from fapengine.cli.options import LIVE, AsJson, HeadName, WriteOptions

WINDOW = "512x512"


def capture(
    source: Annotated[
        str,
        typer.Argument(
            help="A film with a face (.mp4, .webm, ...); webcam or webcam:1; 468 or 478 landmarks a frame (.json, .csv,"
            " with --size and --fps); OpenFace's table (.csv); scores of MediaPipe, ARKit or Live Link (.json, .csv)."
        ),
    ],
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            help="FAPs (.fap, .fba), ARKit's shapes (.csv), or feature points in mm (.npz, .c3d, .trc).",
        ),
    ] = None,
    overlay: Annotated[
        Path | None, typer.Option("--overlay", help="Film that shows our head beside the one that was watched (.mp4).")
    ] = None,
    size: Annotated[
        str | None, typer.Option("--size", help="Landmarks: width x height of their pictures. Live: of the window.")
    ] = None,
    fps: Annotated[
        float | None, typer.Option("--fps", help="Landmarks: frames a second. Live: shown and sent.")
    ] = None,
    seconds: Annotated[
        float | None,
        typer.Option("--seconds", min=0.5, help="Camera: how long it is watched; 10, or live until you end it."),
    ] = None,
    model: Annotated[
        Path | None, typer.Option("--model", help="face_landmarker.task, for a mediapipe that has no model inside.")
    ] = None,
    window: Annotated[
        bool,
        typer.Option("--window", help="A window with our head that does what the face does.", rich_help_panel=LIVE),
    ] = False,
    sink: Annotated[
        list[str],
        typer.Option(
            "--sink",
            help="Where it moves a face now: vmc://127.0.0.1, vrchat://HOST, livelink://HOST, osc://HOST:PORT. May be"
            " given again.",
            rich_help_panel=LIVE,
        ),
    ] = [],  # noqa: B006
    to: Annotated[
        str | None,
        typer.Option(
            "--to",
            metavar="URL",
            help="Session of `fapengine serve` that it moves: http://127.0.0.1:8110/?session=anna; its page and its"
            " sinks show it.",
            rich_help_panel=LIVE,
        ),
    ] = None,
    head: HeadName = "default",
    as_json: AsJson = False,
    writing: WriteOptions = WriteOptions(),
) -> None:
    """Capture a performance: mouth, brows, lids, gaze and turns of the head as FAPs; no phones, no session.

        fapengine capture talk.mp4 -o talk.fap --overlay out/beside.mp4
        fapengine capture webcam -o talk.fba
        fapengine capture webcam --window
        fapengine capture webcam --sink vmc://127.0.0.1
        fapengine capture openface.csv -o talk.fba
        fapengine capture landmarks.json --size 1280x720 --fps 30 -o talk.csv
        fapengine capture talk.mp4 -o S03/talk.npz    # a take for fapengine fit

    The face at rest is found by itself: the quietest frames with the lips together. Films and cameras need the face
    detector (make detector); everything else needs nothing. A take for fapengine fit wants its phones, talk.TextGrid,
    beside it. With --window, --sink or --to a camera moves a face now; a film is then played in place of a camera, and
    a face that is lost eases to rest.
    """
    from fapengine.app.capture import CAMERA, CAMERA_S, CaptureJob, run_capture
    from fapengine.app.score import is_film
    from fapengine.cli._progress import progress, working
    from fapengine.errors import UsageError
    from fapengine.files.video import count_pictures
    from fapengine.render.drawing import parse_size

    camera = source.partition(":")[0] == CAMERA
    writing.check(
        [path for path in (output, overlay) if path is not None], [head, model, *([] if camera else [source])]
    )
    if window or sink or to is not None:
        if overlay is not None:
            raise UsageError(f"--overlay: got {overlay}, expected none of a face that is moved now")
        done = _live(source, output, sink, to, fps, seconds, model, head if window else None, size)
        _print_live(done, output, as_json=as_json)
        return
    if output is None:
        raise UsageError("--output: got none, expected a file to write; or --window, --sink or --to")
    job = CaptureJob(
        source=source, output=output, size=None if size is None else parse_size(size), rate_hz=fps,
        seconds=CAMERA_S if seconds is None else seconds, overlay=overlay, head=head, model=model,
    )  # fmt: skip
    if is_film(Path(source)) and Path(source).is_file():
        with progress("looking, frames", count_pictures(Path(source))) as advance:
            found = run_capture(job, on_frame=advance)
    else:
        with working("looking into the camera" if camera else "reading"):
            found = run_capture(job)
    track = found.track
    if as_json:
        import json

        facts = {"frames": len(track), "rate_hz": track.rate_hz, "source": found.kind, "seen": round(found.seen, 4)}
        typer.echo(json.dumps(facts | {"output": str(output)}))
        return
    typer.echo(f"{output}: {len(track)} frames at {track.rate_hz:g} Hz; a face in {100 * found.seen:.0f} % of them")
    if overlay is not None:
        typer.echo(f"look at {overlay}")


def _live(
    source: str, output: Path | None, sinks: list[str], server: str | None, fps: float | None, seconds: float | None,
    model: Path | None, head: str | None, size: str | None,
) -> dict[str, object]:  # fmt: skip
    """Let it move a face now, in a window if there is a head for it."""
    from fapengine.app.say_live import Screen, WindowScreen
    from fapengine.app.watch_live import LIVE_HZ, WatchJob, watch_live
    from fapengine.cli._terminal_screen import TerminalScreen
    from fapengine.render.drawing import Drawing

    job = WatchJob(
        source=source, rate_hz=LIVE_HZ if fps is None else fps, seconds=seconds, sinks=tuple(sinks), server=server,
        output=output, model=model,
    )  # fmt: skip
    drawing = Drawing.parse(size=size or WINDOW)

    def screen() -> Screen:
        if head is None:
            return TerminalScreen(None, "watching")
        return WindowScreen(head, drawing=drawing, rate_hz=job.rate_hz)

    return watch_live(job, screen)


def _print_live(done: dict[str, object], output: Path | None, *, as_json: bool) -> None:
    if as_json:
        import json

        typer.echo(json.dumps(done | ({} if output is None else {"output": str(output)})))
        return
    delays = done["delay_ms"]
    assert isinstance(delays, dict)
    typer.echo(
        f"{done['pictures']} pictures, {done['late']} left out for newer ones, a face in {done['seen']:.0%} of them;"
        f" a face is known {delays['p50']:.0f} ms after its picture"
    )
    typer.echo(f"{done['frames']} frames at {done['rate_hz']:g} Hz, {done['skipped']} skipped")
    if not done["known"]:
        typer.echo("no face was seen for long enough to know it at rest: 1.5 s are needed", err=True)
    if output is not None:
        typer.echo(f"{output}")

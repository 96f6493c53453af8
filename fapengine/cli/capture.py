"""``fapengine capture``: turn a video, a camera or landmarks into FAPs."""

from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from fapengine.cli.options import AsJson, HeadName, Sinks, WithoutMark, WriteOptions, live

WINDOW = "512x512"


def capture(
    source: Annotated[
        str,
        typer.Argument(
            help="A face video (.mp4, .webm, ...); webcam or webcam:1; 468 or 478 landmarks per frame (.json, .csv,"
            " with --size and --fps); an OpenFace table (.csv); blendshape scores of MediaPipe, ARKit or Live Link"
            " (.json, .csv)."
        ),
    ],
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            help="FAPs (.fap, .fba), ARKit blendshapes (.csv), or feature points in mm (.npz, .c3d, .trc).",
        ),
    ] = None,
    overlay: Annotated[
        Path | None, typer.Option(help="Video that shows the captured head next to the source (.mp4).")
    ] = None,
    size: Annotated[
        str | None, typer.Option(help="Landmarks: WIDTHxHEIGHT of the images. Live: of the window.")
    ] = None,
    fps: Annotated[
        float | None, typer.Option(min=0.1, max=1000.0, help="Landmarks: frame rate. Live: output frame rate.")
    ] = None,
    seconds: Annotated[
        float | None,
        typer.Option(min=0.5, max=86_400.0, help="Camera: duration in seconds. Default: 10; live: until Ctrl-C."),
    ] = None,
    model: Annotated[
        Path | None, typer.Option(help="face_landmarker.task, for a mediapipe without a built-in model.")
    ] = None,
    window: Annotated[bool, live("--window", help="Show the result live in a window.")] = False,
    sink: Sinks = [],  # noqa: B006
    to: Annotated[
        str | None,
        live(metavar="URL", help="Drive a session of `fapengine serve`: http://127.0.0.1:8110/?session=anna."),
    ] = None,
    head: HeadName = "default",
    without: WithoutMark = [],  # noqa: B006
    as_json: AsJson = False,
    writing: WriteOptions = WriteOptions(),
) -> None:
    """Capture mouth, brows, lids, gaze and head motion as FAPs, from a video, a camera or landmarks.

        fapengine capture talk.mp4 -o talk.fap --overlay out/beside.mp4
        fapengine capture webcam -o talk.fba
        fapengine capture webcam --window
        fapengine capture webcam --sink vmc://127.0.0.1
        fapengine capture openface.csv -o talk.fba
        fapengine capture landmarks.json --size 1280x720 --fps 30 -o talk.csv
        fapengine capture talk.mp4 -o S03/talk.npz    # a take for fapengine fit

    The neutral face is found automatically: the quietest frames with closed lips. Videos and cameras need the face
    detector (`make detector`). A take for `fapengine fit` needs its phones, talk.TextGrid, next to it. With --window,
    --sink or --to, a camera drives a face live; a video is then played in real time, and a lost face returns to
    neutral.
    """
    from fapengine.app.capture import CAMERA, run_capture
    from fapengine.app.score import is_film
    from fapengine.cli._printing import print_result, progress, working
    from fapengine.errors import UsageError
    from fapengine.files.video import count_pictures
    from fapengine.render.drawing import RenderOptions, parse_size

    camera = source.partition(":")[0] == CAMERA
    writing.check(
        [path for path in (output, overlay) if path is not None], [head, model, *([] if camera else [source])]
    )
    if window or sink or to is not None:
        if overlay is not None:
            raise UsageError("--overlay: cannot be used live")
        from fapengine.app.say_live import Screen, WindowScreen
        from fapengine.app.watch_live import LIVE_HZ, watch_live
        from fapengine.cli._say_live import TerminalScreen

        rate_hz, drawing = LIVE_HZ if fps is None else fps, RenderOptions.parse(size=size or WINDOW, rest=0.0)

        def screen() -> Screen:
            return WindowScreen(head, drawing=drawing, rate_hz=rate_hz) if window else TerminalScreen(None, "watching")

        done = watch_live(
            source, screen, rate_hz=rate_hz, seconds=seconds, sinks=sink, server=to, output=output, model=model
        )
        _print_live(done, output, as_json=as_json)
        return
    if output is None:
        raise UsageError("--output: missing; or use --window, --sink or --to")
    captured = partial(
        run_capture, source, output, size=None if size is None else parse_size(size), rate_hz=fps, seconds=seconds,
        overlay=overlay, head=head, model=model,
    )  # fmt: skip
    if is_film(Path(source)) and Path(source).is_file():
        with progress("detecting, frames", count_pictures(Path(source))) as advance:
            found = captured(on_frame=advance)
    else:
        with working("recording the camera" if camera else "reading"):
            found = captured()
    track = found.track
    facts = {"frames": len(track), "rate_hz": track.rate_hz, "source": found.kind, "seen": round(found.seen, 4)}
    lines = [f"{output}: {len(track)} frames at {track.rate_hz:g} Hz; face found in {100 * found.seen:.0f} % of them"]
    lines += [f"overlay: {overlay}"] if overlay is not None else []
    print_result(facts | {"output": str(output)}, *lines, as_json=as_json)


def _print_live(done: dict[str, object], output: Path | None, *, as_json: bool) -> None:
    from fapengine.cli._printing import print_result

    delays = done["delay_ms"]
    assert isinstance(delays, dict)
    lines = [
        f"{done['pictures']} images, {done['late']} skipped for newer ones, face found in {done['seen']:.0%} of them;"
        f" latency {delays['p50']:.0f} ms",
        f"{done['frames']} frames at {done['rate_hz']:g} Hz, {done['skipped']} skipped",
    ]
    if output is not None:
        done["output"] = str(output)
        lines.append(str(output))
    print_result(done, *lines, as_json=as_json)
    if not (done["known"] or as_json):
        typer.echo("no face was visible long enough to find its neutral pose; 1.5 s are needed", err=True)

"""``fapengine capture``: a performance to FAPs."""

from pathlib import Path
from typing import Annotated

import typer

from fapengine.cli.options import AsJson, HeadName, WriteOptions


def capture(
    source: Annotated[
        str,
        typer.Argument(
            help="A film with a face (.mp4, .webm, ...); webcam or webcam:1; 468 or 478 landmarks a frame (.json, .csv,"
            " with --size and --fps); OpenFace's table (.csv); scores of MediaPipe, ARKit or Live Link (.json, .csv)."
        ),
    ],
    output: Annotated[
        Path,
        typer.Option(
            "--output",
            "-o",
            help="FAPs (.fap, .fba), ARKit's shapes (.csv), or feature points in mm (.npz, .c3d, .trc).",
        ),
    ],
    overlay: Annotated[
        Path | None, typer.Option("--overlay", help="Film that shows our head beside the one that was watched (.mp4).")
    ] = None,
    size: Annotated[str | None, typer.Option("--size", help="Landmarks: width x height of their pictures.")] = None,
    fps: Annotated[float | None, typer.Option("--fps", help="Landmarks: frames a second.")] = None,
    seconds: Annotated[float, typer.Option("--seconds", min=0.5, help="Camera: how long it is watched.")] = 10.0,
    model: Annotated[
        Path | None, typer.Option("--model", help="face_landmarker.task, for a mediapipe that has no model inside.")
    ] = None,
    head: HeadName = "default",
    as_json: AsJson = False,
    writing: WriteOptions = WriteOptions(),
) -> None:
    """Capture a performance: mouth, brows, lids, gaze and turns of the head as FAPs; no phones, no session.

        fapengine capture talk.mp4 -o talk.fap --overlay out/beside.mp4
        fapengine capture webcam -o talk.fba
        fapengine capture openface.csv -o talk.fba
        fapengine capture landmarks.json --size 1280x720 --fps 30 -o talk.csv
        fapengine capture talk.mp4 -o S03/talk.npz    # a take for fapengine fit

    The face at rest is found by itself: the quietest frames with the lips together. Films and cameras need the face
    detector (make detector); everything else needs nothing. A take for fapengine fit wants its phones, talk.TextGrid,
    beside it.
    """
    from fapengine.app.capture import CAMERA, CaptureJob, run_capture
    from fapengine.app.score import is_film
    from fapengine.cli._progress import progress, working
    from fapengine.files.video import count_pictures
    from fapengine.render.drawing import parse_size

    job = CaptureJob(
        source=source, output=output, size=None if size is None else parse_size(size), rate_hz=fps, seconds=seconds,
        overlay=overlay, head=head, model=model,
    )  # fmt: skip
    camera = source.partition(":")[0] == CAMERA
    writing.check(
        [path for path in (output, overlay) if path is not None], [head, model, *([] if camera else [source])]
    )
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

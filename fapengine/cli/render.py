"""``fapengine render``: render FAPs or recorded takes to a video, animation, image sequence or image."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from fapengine.cli import options as shared

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from fapengine.mesh.deform import Pose

MAX_S = 86_400.0
"""Largest time of an option."""


def render(
    drawing: shared.DrawingOptions,
    track: Annotated[
        list[Path],
        typer.Argument(
            help="FAPs (.fap, .fba) or blendshapes (.csv, Azure .json); for a dense face, marker recordings (.c3d,"
            " .trc, .npz, .csv, .tsv). Several are shown side by side."
        ),
    ],
    output: Annotated[
        Path,
        typer.Option(
            "--output",
            "-o",
            help="Video (.mp4, .webm, .mkv, .mov), animation (.gif, .webp), image sequence (frame_%04d.png, or a"
            " folder), or .png for one frame.",
        ),
    ] = Path("out/render.mp4"),
    audio: Annotated[Path | None, typer.Option("--audio", "-a", help="Sound for the video.")] = None,
    at: Annotated[float, typer.Option("--at", min=0.0, max=MAX_S, help="With .png: time to render, in seconds.")] = 0.0,
    sheet: Annotated[
        int,
        typer.Option("--contact-sheet", min=0, max=400, help="With .png: contact sheet with this number of frames."),
    ] = 0,
    head: Annotated[
        list[str],
        typer.Option(
            "--head", help="Head, once, or once per track: same values as `say --head`, or a profile with a dense face."
        ),
    ] = ["default"],  # noqa: B006  typer copies it
    turntable: Annotated[
        float,
        typer.Option("--turntable", min=0.0, max=MAX_S, help="Orbit the camera around the head, in seconds per turn."),
    ] = 0.0,
    wire: Annotated[bool, typer.Option("--wireframe", help="Draw the wireframe over the face.")] = False,
    fps: Annotated[
        float | None, typer.Option("--fps", min=1.0, max=1000.0, help="Frame rate. Default: that of the track.")
    ] = None,
    by: Annotated[
        str, typer.Option("--reconstruction", help="For marker recordings: estimator (paper 004) or modes (paper 003).")
    ] = "estimator",
    still_head: Annotated[
        bool, typer.Option("--no-head-motion", help="For marker recordings: leave out the head motion.")
    ] = False,
    with_markers: Annotated[
        bool, typer.Option("--with-markers", help="For marker recordings: show the markers beside each face.")
    ] = False,
    without: shared.WithoutMark = [],  # noqa: B006
    strict: shared.Strict = False,
    as_json: shared.AsJson = False,
    writing: shared.WriteOptions = shared.WriteOptions(),
) -> None:
    """Render existing FAPs, or a recorded take on the dense face of its session.

    fapengine render talk.fba --audio talk.wav -o out/talk.mp4
    fapengine render talk.fap --turntable 4 --wireframe -o out/turn.webp
    fapengine render talk.fap --contact-sheet 12 -o out/sheet.png
    fapengine render ours.fap theirs.fap -o out/both.mp4
    fapengine render take.c3d --head profiles/s03 --with-markers -o out/dense.mp4
    """
    import numpy as np

    from fapengine.app.dense_film import is_take, takes_on_heads
    from fapengine.app.drawing import crowd_size, draw_crowd, open_crowd, shown_at, side_by_side
    from fapengine.cli._printing import print_remarks, print_result, progress
    from fapengine.errors import UsageError
    from fapengine.files.heads.load import load_head
    from fapengine.files.motion import load_motion
    from fapengine.files.moving import CODECS, KINDS, check_moving, is_moving, is_sequence, moving_file, write_moving
    from fapengine.files.pictures import contact_sheet, save_png
    from fapengine.files.sound import load_sound
    from fapengine.laboratory.marker_driver import WAYS

    is_one = output.suffix == ".png" and not is_sequence(output)
    if not (is_one or is_moving(output)):
        raise UsageError(f"--output: unknown file type {output}; use {KINDS} or .png")
    if audio and output.suffix not in CODECS:
        raise UsageError(f"--audio: {output.suffix} cannot contain sound; use {', '.join(CODECS)}")
    if sheet and not is_one:
        raise UsageError(f"--contact-sheet: requires a .png output, got {output.name}")
    faces = max(len(track), len(head))
    for name, count in (("track", len(track)), ("--head", len(head))):
        if count not in (1, faces):
            raise UsageError(f"{name}: got {count}; give one, or one for each of the {faces} faces")
    writing.check([output if is_one else moving_file(output)], [*track, audio, *head, drawing.background])
    way = next((name for name in WAYS if name == by), None)
    if way is None:
        raise UsageError(f"--reconstruction: unknown value {by!r}; use {' or '.join(WAYS)}")
    how = drawing.value(wire=wire)
    rows: Sequence[NDArray[np.int32] | list[Pose]]
    facts: dict[str, float]
    if any(is_take(path) for path in track):
        rate_hz, meshes, rows, notes = takes_on_heads(
            track, head, way=way, still_head=still_head, with_markers=with_markers
        )
        remarks = list(notes)
    else:
        moving = {path: load_motion(path, strict=strict) for path in track}
        remarks = [f"{path}: {remark}" for path, each in moving.items() for remark in each.remarks]
        rate_hz, faps = side_by_side([moving[path] for path in track])
        rows = list(np.broadcast_to(faps, (len(faps), faces, faps.shape[2])))
        loaded = {name: load_head(name) for name in dict.fromkeys(head)}
        meshes = [loaded[name] for name in head] * (faces if len(head) == 1 else 1)
    print_remarks(remarks)
    if fps is not None:
        count = max(1, int((len(rows) - 1) / rate_hz * fps + 1e-6) + 1)
        chosen = shown_at(np.arange(count) / fps, len(rows), rate_hz)
        rate_hz, rows = fps, [rows[index] for index in chosen]
    if not is_one:
        check_moving(output, rate_hz=rate_hz, size=crowd_size(how, len(meshes)), alpha=how.components == 4)
    sound = load_sound(audio, spoken_s=len(rows) / rate_hz) if audio else None
    last_s = (len(rows) - 1) / rate_hz
    with open_crowd(meshes, how) as crowd:
        if is_one and sheet:
            moments = np.unique(np.linspace(0, len(rows) - 1, sheet).round().astype(int))
            shown = [rows[moment] for moment in moments]
            pictures = list(draw_crowd(crowd, shown, rate_hz * len(moments) / len(rows)))
            labels = [(f"{moment / rate_hz:.2f} s", "") for moment in moments]
            save_png(output, contact_sheet(pictures, labels, title=", ".join(each.name for each in track)))
            facts, told = {"moments": len(pictures)}, f"{len(pictures)} moments"
        elif is_one:
            if not 0 <= at <= last_s:
                raise UsageError(f"--at: {at} s is past the end; the track lasts {last_s:.2f} s")
            moment = int(np.ceil(round(at * rate_hz, 6)))
            save_png(output, next(draw_crowd(crowd, rows[moment : moment + 1], rate_hz)))
            facts, told = {"frames": 1, "at_s": moment / rate_hz}, "one frame"
        else:
            with progress("drawing", len(rows)) as advance:
                frames = draw_crowd(crowd, rows, rate_hz, turn_s=turntable)
                count = write_moving(output, frames, rate_hz=rate_hz, sound=sound, on_frame=advance)
            facts, told = {"frames": count, "rate_hz": rate_hz}, f"{count} frames at {rate_hz:g} Hz"
    print_result({"output": str(output), **facts, "remarks": remarks}, f"{output}: {told}", as_json=as_json)

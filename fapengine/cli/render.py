"""``fapengine render``: FAPs or recorded takes to a video, an animation, numbered pictures or one picture."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from fapengine.cli import options as shared

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from fapengine.mesh.deform import Pose


def render(
    drawing: shared.DrawingOptions,
    track: Annotated[
        list[Path],
        typer.Argument(
            help="FAPs (.fap, .fba), or blend shapes (.csv, Azure's .json); or, for a dense face, recordings of markers"
            " (.c3d, .trc, .npz, .csv, .tsv); several stand side by side."
        ),
    ],
    output: Annotated[
        Path,
        typer.Option(
            "--output",
            "-o",
            help="Video (.mp4, .webm, .mkv, .mov), animation (.gif, .webp), pictures (frame_%04d.png, or a folder),"
            " or .png for one frame.",
        ),
    ] = Path("out/render.mp4"),
    audio: Annotated[Path | None, typer.Option("--audio", "-a", help="Sound for the video, from its start.")] = None,
    at: Annotated[float, typer.Option("--at", help="With .png: which second to draw.")] = 0.0,
    sheet: Annotated[int, typer.Option("--sheet", help="With .png: a contact sheet of so many moments.")] = 0,
    head: Annotated[
        list[str],
        typer.Option(
            "--head", help="Whose face, once or once a face: default, an imported head's folder, or a profile's."
        ),
    ] = ["default"],  # noqa: B006  typer copies it
    turntable: Annotated[
        float, typer.Option("--turntable", help="The camera goes once round the head in so many seconds.")
    ] = 0.0,
    wire: Annotated[bool, typer.Option("--wire", help="Draw the mesh's edges over the face.")] = False,
    fps: Annotated[
        float | None, typer.Option("--fps", min=1.0, help="Frames a second; by default the track's.")
    ] = None,
    by: Annotated[
        str, typer.Option("--by", help="Of a recording: estimator (paper 004), or modes (paper 003).")
    ] = "estimator",
    still_head: Annotated[
        bool, typer.Option("--still-head", help="Of a recording: leave out the motion of the head.")
    ] = False,
    as_json: shared.AsJson = False,
    writing: shared.WriteOptions = shared.WriteOptions(),
) -> None:
    """Draw FAPs that are there already, or a recorded take on the dense face that was learned from its session.

    fapengine render talk.fba --audio talk.wav -o out/talk.mp4
    fapengine render talk.fap --turntable 4 --wire -o out/turn.webp
    fapengine render talk.fap --sheet 12 -o out/sheet.png
    fapengine render ours.fap theirs.fap -o out/both.mp4
    fapengine render take.c3d --head profiles/s03 -o out/dense.mp4
    """
    import numpy as np

    from fapengine.app.dense_film import at_rate, is_take, takes_on_heads
    from fapengine.app.drawing import crowd_size, draw_crowd, open_crowd, side_by_side
    from fapengine.cli._progress import progress
    from fapengine.cli._result import print_result
    from fapengine.errors import UsageError
    from fapengine.files.animation import is_sequence
    from fapengine.files.heads.load import load_head
    from fapengine.files.motion import load_motion
    from fapengine.files.moving import KINDS, check_moving, is_moving, moving_files, write_moving
    from fapengine.files.pictures import contact_sheet, save_png
    from fapengine.files.sound import load_sound
    from fapengine.files.video import CODECS
    from fapengine.laboratory.marker_driver import WAYS

    is_one = output.suffix == ".png" and not is_sequence(output)
    if not (is_one or is_moving(output)):
        raise UsageError(f"--output: got {output}, expected a name that ends with {KINDS}, or .png")
    if audio and output.suffix not in CODECS:
        raise UsageError(f"--audio: got {audio}, but {output.suffix} holds no sound; expected {', '.join(CODECS)}")
    if turntable < 0 or sheet < 0 or (sheet and not is_one):
        raise UsageError(f"--turntable, --sheet: got {turntable:g}, {sheet}, expected 0 or more, --sheet with .png")
    faces = max(len(track), len(head))
    for name, count in (("track", len(track)), ("--head", len(head))):
        if count not in (1, faces):
            raise UsageError(f"{name}: got {count}, expected one, or one for each of {faces} faces")
    writing.check([output] if is_one else moving_files(output), [*track, audio, *head, drawing.background])
    way = next((name for name in WAYS if name == by), None)
    if way is None:
        raise UsageError(f"--by: got {by!r}, expected {' or '.join(WAYS)}")
    how = drawing.value(wire=wire)
    rows: NDArray[np.int32] | list[list[Pose]]
    done: tuple[dict[str, float], str]
    if any(is_take(path) for path in track):
        rate_hz, meshes, rows, notes = takes_on_heads(track, head, way=way, still_head=still_head)
        for note in notes:
            typer.echo(f"note: {note}", err=True)
    else:
        rate_hz, faps = side_by_side([load_motion(path) for path in track])
        rows = np.broadcast_to(faps, (len(faps), faces, faps.shape[2]))
        loaded = {name: load_head(name) for name in dict.fromkeys(head)}
        meshes = [loaded[name] for name in head] * (faces if len(head) == 1 else 1)
    if fps is not None:
        chosen = at_rate(len(rows), rate_hz, fps)
        rate_hz, rows = fps, [rows[index] for index in chosen] if isinstance(rows, list) else rows[chosen]
    if not is_one:
        check_moving(output, rate_hz=rate_hz, size=crowd_size(how, faces), alpha=how.components == 4)
    sound = load_sound(audio) if audio else None
    last_s = (len(rows) - 1) / rate_hz
    with open_crowd(meshes, how) as crowd:
        if is_one and sheet:
            moments = np.unique(np.linspace(0, len(rows) - 1, sheet).round().astype(int))
            shown = [rows[moment] for moment in moments] if isinstance(rows, list) else rows[moments]
            pictures = list(draw_crowd(crowd, shown, rate_hz * len(moments) / len(rows)))
            labels = [(f"{moment / rate_hz:.2f} s", "") for moment in moments]
            save_png(output, contact_sheet(pictures, labels, title=track[0].name))
            done = {"moments": len(pictures)}, f"{len(pictures)} moments"
        elif is_one:
            if not 0 <= at <= last_s:
                raise UsageError(f"--at: got {at} s, the track lasts {last_s:.2f} s")
            moment = int(np.ceil(round(at * rate_hz, 6)))
            save_png(output, next(draw_crowd(crowd, rows[moment : moment + 1], rate_hz)))
            done = {"frames": 1, "at_s": moment / rate_hz}, "one frame"
        else:
            with progress("drawing", len(rows)) as advance:
                frames = draw_crowd(crowd, rows, rate_hz, turn_s=turntable)
                count = write_moving(output, frames, rate_hz=rate_hz, sound=sound, on_frame=advance)
            done = {"frames": count, "rate_hz": rate_hz}, f"{count} frames at {rate_hz:g} Hz"
    facts, told = done
    print_result({"output": str(output), **facts}, f"{output}: {told}", as_json=as_json)

"""``fapengine convert``: convert face motion between file formats."""

from pathlib import Path
from typing import Annotated

import typer

from fapengine.cli import options as shared


def convert(
    motion: Annotated[
        Path,
        typer.Argument(
            help="FAPs (.fap, .fba), a table of ARKit, Oculus or VRM weights (.csv; Azure frames, .json), or VMC"
            " (.osc); with --into a dense face, or to another format, a marker recording (.c3d, .trc, .npz)."
        ),
    ],
    output: shared.Output,
    shapes: shared.Shapes = None,
    avatar: shared.AvatarOptions = shared.AvatarOptions(),
    without: shared.WithoutMark = [],  # noqa: B006
    strict: shared.Strict = False,
    as_json: shared.AsJson = False,
    writing: shared.WriteOptions = shared.WriteOptions(),
) -> None:
    """Convert face motion: FAPs to blendshapes or visemes, and back, or into an avatar file.

        fapengine convert talk.fap -o talk.csv                     # 52 ARKit weights
        fapengine convert talk.fap --shapes oculus -o visemes.csv
        fapengine convert livelink.csv -o take.fap
        fapengine convert take.fap --shapes rhubarb -o take.json
        fapengine convert take.fap --into avatar.glb -o spoken.glb
        fapengine convert take.c3d --into profiles/s03 -o dense.glb
        fapengine convert via.npz -o take.trc                       # via points

    With --into, the result is the avatar with an animation that any tool plays. The modes of a dense face become morph
    targets.
    """
    from fapengine.app.dense_film import TAKES, is_take
    from fapengine.app.outputs import EVENT_SETS, SaveOptions, check_output
    from fapengine.cli._printing import print_remarks, print_result
    from fapengine.files.motion import load_motion
    from fapengine.files.paths import is_standard, standard_output
    from fapengine.files.recordings import load_markers, save_markers

    output = standard_output(output, ".json" if shapes in EVENT_SETS else ".csv")
    options = SaveOptions(shapes=shapes, into=avatar.value(), name=motion.stem)
    writing.check([output], [motion, avatar.into, avatar.mapping])
    if is_take(motion):
        if output.suffix.lower() in TAKES:
            markers = load_markers(motion).markers
            save_markers(output, markers)
            summary = f"{markers.frame_count} frames of {len(markers.labels)} markers at {markers.rate_hz:g} Hz"
        else:
            from fapengine.app.scene_files import save_take_scene

            check_output(output, options, rate_hz=0.0)
            summary = save_take_scene(output, motion, options.into)
        print_result({"output": str(output), "moved": summary}, f"{output}: {summary}", as_json=as_json)
        return
    kind = check_output(output, options, rate_hz=0.0)
    track = load_motion(motion, strict=strict)
    print_remarks(track.remarks)
    kind.write(track, output, options)
    facts: dict[str, object] = {"output": str(output), "frames": len(track), "rate_hz": track.rate_hz}
    facts["remarks"] = list(track.remarks)
    summary = f"{output}: {len(track)} frames at {track.rate_hz:g} Hz"
    if moved := options.report.moved:
        facts["moved"], summary = moved, f"{summary}; {moved}"
    print_result(facts, summary, as_json=as_json, err=is_standard(output))

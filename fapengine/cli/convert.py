"""``fapengine convert``: convert face motion between file formats."""

from pathlib import Path

import typer

from fapengine.cli import options as shared

OUT_KINDS = (".fap", ".csv", ".json", ".tsv", ".xml", ".dat", ".glb", ".vrm", ".vrma", ".usda", ".usdc", ".usd")


def convert(
    motion: Path = typer.Argument(
        ...,
        help="FAPs (.fap, .fba), a table of ARKit, Oculus or VRM weights (.csv; Azure frames, .json), or VMC (.osc);"
        " with --into a dense face, a marker recording (.c3d, .trc, .npz).",
    ),
    output: Path = typer.Option(
        ...,
        "--output",
        "-o",
        help="FAPs (.fap); weights and head rotation (.csv); mouth cues (.json, .tsv, .xml, .dat); with --into,"
        " an avatar (.glb, .vrm) or a built-in head (.usda, .usdc); an animation for VRM avatars (.vrma). - writes a"
        " table to standard output; -.fap chooses another type.",
    ),
    shapes: str | None = typer.Option(
        None,
        "--shapes",
        help="Shapes of a table: arkit (52, the default), oculus (15 visemes), vrm0 or vrm1 (presets). Of .vrma: vrm1"
        " (the default) or arkit. Of .json, .tsv, .xml, .dat: rhubarb (nine mouth shapes).",
    ),
    avatar: shared.AvatarOptions = shared.AvatarOptions(),
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

    With --into, the result is the avatar with an animation that any tool plays. The modes of a dense face become morph
    targets.
    """
    from fapengine.app.dense_film import is_take
    from fapengine.app.motion import save
    from fapengine.app.mouth_cues import RHUBARB, check_cues
    from fapengine.app.scene_choice import check_scene, is_scene
    from fapengine.app.scene_files import save_scene, save_take_scene
    from fapengine.cli._result import print_result
    from fapengine.errors import UsageError
    from fapengine.files.motion import load_motion
    from fapengine.files.paths import is_standard, standard_output

    output = standard_output(output, ".json" if shapes == RHUBARB else ".csv")
    if output.suffix not in OUT_KINDS:
        raise UsageError(f"--output: unknown file type {output}; use {', '.join(OUT_KINDS)}")
    check_cues(output, shapes)
    into = avatar.value()
    check_scene(output, into)
    writing.check([output], [motion, avatar.into, avatar.mapping])
    if is_take(motion):
        told = save_take_scene(output, motion, into)
        print_result({"output": str(output), "moved": told}, f"{output}: {told}", as_json=as_json)
        return
    track = load_motion(motion)
    moved = ""
    if is_scene(output):
        moved = save_scene(output, track, into, shapes=shapes, name=motion.stem)
    else:
        save(track, output, shapes=shapes)
    facts = {"output": str(output), "frames": len(track), "rate_hz": track.rate_hz} | (
        {"moved": moved} if moved else {}
    )
    told = f"{output}: {len(track)} frames at {track.rate_hz:g} Hz" + (f"; {moved}" if moved else "")
    print_result(facts, told, as_json=as_json, err=is_standard(output))

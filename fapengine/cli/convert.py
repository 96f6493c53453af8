"""``fapengine convert``: face motion from one file format to another."""

from pathlib import Path

import typer

from fapengine.cli import options as shared

OUT_KINDS = (".fap", ".csv", ".json", ".tsv", ".xml", ".dat", ".glb", ".vrm", ".vrma", ".usda", ".usdc", ".usd")


def convert(
    motion: Path = typer.Argument(
        ...,
        help="FAPs (.fap, .fba), a table of ARKit, Oculus or VRM shapes (.csv; Azure's frames, .json), or VMC (.osc);"
        " a recording of markers (.c3d, .trc, .npz) --into a dense face.",
    ),
    output: Path = typer.Option(
        ...,
        "--output",
        "-o",
        help="FAPs (.fap); a table of shapes and the head (.csv); mouth shapes (.json, .tsv, .xml, .dat); with --into,"
        " an avatar (.glb, .vrm) or a head of ours (.usda, .usdc); an animation for VRM avatars (.vrma). - is a"
        " table, to standard output; -.fap says another kind.",
    ),
    shapes: str | None = typer.Option(
        None,
        "--shapes",
        help="Of the table: arkit (52, the default), oculus (15 visemes), vrm0 or vrm1 (presets of an avatar); of"
        " .vrma: vrm1 (the default) or arkit; of .json, .tsv, .xml, .dat: rhubarb (nine mouth shapes).",
    ),
    avatar: shared.AvatarOptions = shared.AvatarOptions(),
    as_json: shared.AsJson = False,
    writing: shared.WriteOptions = shared.WriteOptions(),
) -> None:
    """Convert face motion: FAPs to blend shapes or visemes of avatars, and back; or into an avatar's own file.

        fapengine convert talk.fap -o talk.csv                     # ARKit's 52
        fapengine convert talk.fap --shapes oculus -o visemes.csv
        fapengine convert livelink.csv -o take.fap
        fapengine convert take.fap --shapes rhubarb -o take.json
        fapengine convert take.fap --into avatar.glb -o spoken.glb
        fapengine convert take.c3d --into profiles/s03 -o dense.glb

    With --into any tool opens the file, and the avatar speaks in it; the modes of a dense face become morph targets.
    """
    from fapengine.app.dense_film import is_take
    from fapengine.app.mouth_cues import RHUBARB, check_cues, is_cues, save_cues_of_motion
    from fapengine.app.scene_choice import check_scene, is_scene
    from fapengine.app.scene_files import save_scene, save_take_scene
    from fapengine.cli._result import print_result
    from fapengine.errors import UsageError
    from fapengine.files.fap import save_fap
    from fapengine.files.motion import load_motion
    from fapengine.files.paths import is_standard, standard_output, write_bytes
    from fapengine.retarget.blend_tracks import format_blend_csv

    output = standard_output(output, ".json" if shapes == RHUBARB else ".csv")
    if output.suffix not in OUT_KINDS:
        raise UsageError(f"--output: got {output}, expected a name that ends with {' or '.join(OUT_KINDS)}")
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
    elif is_cues(output):
        save_cues_of_motion(output, track)
    elif output.suffix == ".fap":
        save_fap(output, track)
    else:
        write_bytes(output, format_blend_csv(track, shapes or "arkit"))
    facts = {"output": str(output), "frames": len(track), "rate_hz": track.rate_hz} | (
        {"moved": moved} if moved else {}
    )
    told = f"{output}: {len(track)} frames at {track.rate_hz:g} Hz" + (f"; {moved}" if moved else "")
    print_result(facts, told, as_json=as_json, err=is_standard(output))

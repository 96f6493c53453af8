"""``fapengine inspect``: say what is in a file or a profile, whatever it is."""

from pathlib import Path

import typer

from fapengine.cli import options as shared

PICTURES = (".gif", ".webp", ".png", ".jpg", ".jpeg")
MARKERS = (".c3d", ".trc", ".npz")
LANDMARKS = (".json", ".jsonl", ".csv")
FBA_STARTS = (b"\x00\x00\x01",)


def inspect(
    path: Path = typer.Argument(
        ...,
        help="What to look into: .fba, .fap, a table of shapes, phone timings, a sound, a film, a picture, a recording"
        " of markers (.c3d, .trc, .csv, .npz, a folder of meshes), landmarks of a face, OpenFace's table, an avatar or"
        " scan, a profile or a head.",
    ),
    everything: bool = typer.Option(False, "--all", help="Every plane, not only the first ones."),
    plot: Path | None = typer.Option(None, "--plot", help="Draw the findings into a picture (.png)."),
    sliders: Path | None = typer.Option(
        None, "--sliders", help="Of a profile: write a page with a slider for each component (.html)."
    ),
    as_json: bool = typer.Option(False, "--json", help="Print the findings as JSON."),
    timings: shared.TimingOptions = shared.TimingOptions(),
    writing: shared.WriteOptions = shared.WriteOptions(),
) -> None:
    """Say what is in a file, a profile or a head; what a file is, its bytes decide.

    fapengine inspect talk.fba
    fapengine inspect take.c3d
    fapengine inspect grid_s1_en --plot faces.png --sliders components.html
    """
    from fapengine._resources import profile_ids
    from fapengine.app.hearing import SOUND_SUFFIXES
    from fapengine.cli._inspect_avatar import SCENE_ENDINGS, inspect_avatar
    from fapengine.cli._inspect_markers import inspect_markers
    from fapengine.cli._inspect_media import inspect_head, inspect_motion, inspect_picture, inspect_recording
    from fapengine.cli._inspect_watched import inspect_watched
    from fapengine.errors import UnsupportedError, UsageError
    from fapengine.files.fba_film import read_fba_film
    from fapengine.files.paths import is_mp4, read_bytes
    from fapengine.files.recordings import MESHES, is_table, mesh_files
    from fapengine.mesh.default_head.people import parse_person
    from fapengine.retarget.blend_tracks import is_blend_table
    from fapengine.retarget.vmc_recording import is_vmc_recording
    from fapengine.speech.formats.registry import guess_format

    file_format = timings.file_format
    writing.check([output for output in (plot, sliders) if output is not None], [path])
    is_profile = (path / "profile.toml").is_file() or str(path) in profile_ids()
    if sliders is not None and not is_profile:
        raise UsageError(f"--sliders: got {path}, expected a profile (folder or name)")
    if is_profile:
        from fapengine.cli._inspect_profile import inspect_profile

        inspect_profile(str(path), as_json=as_json, plot=plot, sliders=sliders)
        return
    if (path / "head.toml").is_file() or (not path.exists() and parse_person(str(path)) is not None):
        inspect_head(str(path), as_json=as_json, plot=plot)
        return
    if (
        path.suffix.lower() in LANDMARKS
        and path.is_file()
        and not file_format
        and inspect_watched(path, as_json=as_json)
    ):
        return
    if path.suffix.lower() in MARKERS or (path.is_dir() and mesh_files(path)) or (not file_format and is_table(path)):
        inspect_markers(path, as_json=as_json, everything=everything, plot=plot)
        return
    if path.suffix.lower() in (*SCENE_ENDINGS, *MESHES):
        inspect_avatar(path, as_json=as_json, plot=plot)
        return
    data = read_bytes(path)
    head = data[:4]
    if head.startswith(FBA_STARTS) or (is_mp4(data) and read_fba_film(path) is not None):
        from fapengine.cli._inspect_fba import inspect_fba

        inspect_fba(path, as_json=as_json, everything=everything, plot=plot)
    elif file_format is None and (is_blend_table(data) or is_vmc_recording(data)):
        inspect_motion(path, "shapes, as FAPs", as_json=as_json, everything=everything, plot=plot)
    elif file_format is not None or guess_format(data, ending=path.suffix) is not None:
        from fapengine.cli._inspect_timings import inspect_timings

        inspect_timings(
            path, timings.load(path), as_json=as_json, everything=everything, plot=plot, file_format=file_format
        )
    elif path.suffix.lower() == ".fap":
        inspect_motion(path, "FAPs", as_json=as_json, everything=everything, plot=plot)
    elif path.suffix.lower() in SOUND_SUFFIXES:
        inspect_recording(path, as_json=as_json, plot=plot)
    elif path.suffix.lower() in PICTURES:
        inspect_picture(path, as_json=as_json, plot=plot)
    elif path.suffix.lower() == ".bap":
        raise UnsupportedError(
            f"{path}: got body animation parameters (.bap), which move a body, expected what moves a face (.fap)"
        )
    else:
        raise UnsupportedError(
            f"{path}: got {head.hex(' ')}, expected an FBA stream (00 00 01 ..), a .fap file, a table of shapes, phone"
            " timings, a sound, a film, a picture, a recording of markers (.c3d, .trc, .csv, .npz), an avatar (.glb,"
            " .vrm), or the folder of a profile or a head",
            where="byte 0",
        )

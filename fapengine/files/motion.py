"""Face motion from files: ``.fap`` text, FBA streams, tables of blendshapes and recorded VMC streams."""

from dataclasses import replace
from pathlib import Path

from fapengine.codec.fapfile import format_fap, parse_fap
from fapengine.errors import DataError
from fapengine.files.paths import is_mp4, naming, read_bytes, write_bytes
from fapengine.mpeg4.fap import column
from fapengine.mpeg4.track import FapTrack
from fapengine.speaking import DEFAULT_PROFILE


def load_fap(path: Path) -> FapTrack:
    """Read ``.fap`` text.

    Raises
    ------
    UsageError
        If the file cannot be read.
    DataError
        If it is not a FAP file; the message names it.
    """
    with naming(path):
        return parse_fap(read_bytes(path))


def save_fap(path: Path, track: FapTrack, *, single_numbers: bool = False) -> None:
    """Write ``.fap`` text, version 2.1; see :func:`fapengine.codec.fapfile.format_fap`.

    Raises
    ------
    ResourceError
        If it cannot be written.
    """
    write_bytes(path, format_fap(track, single_numbers=single_numbers).encode())


BLEND_ENDINGS = (".csv", ".json", ".jsonl")
RECORDED_ENDINGS = (".osc",)
ANIMATED_ENDINGS = (".glb", ".vrm", ".vrma")


def shown(track: FapTrack) -> FapTrack:
    """Return what a face shows: low-level FAPs in place of visemes and expressions (FAP 1 and 2).

    The default profile supplies their faces; a track that has none is returned as it is.
    """
    if not track.mask[:, : column(3)].any():
        return track
    from fapengine.files.profiles import load_profile
    from fapengine.trajectory.high_level import expand

    return expand(track, load_profile(DEFAULT_PROFILE))


def as_visemes(track: FapTrack) -> FapTrack:
    """Return the visemes (FAP 1) that come closest to a track's mouth; the default profile supplies their faces."""
    from fapengine.files.profiles import load_profile
    from fapengine.trajectory.high_level import to_visemes

    return to_visemes(track, load_profile(DEFAULT_PROFILE))


def load_motion(path: Path, *, strict: bool = False) -> FapTrack:
    """Read what a face shows: an FBA stream (alone or in MP4), blendshapes (.csv, .json), a VMC recording, .fap text.

    Visemes and expressions (FAP 1 and 2) become low-level FAPs. The track has remarks on what looks wrong.

    Raises
    ------
    UsageError
        If it cannot be read.
    DataError
        If its content is wrong, or ``strict`` finds a remark; the message names the file.
    """
    from fapengine.mpeg4.track import motion_remarks

    track = _read(path)
    remarks = (*track.remarks, *motion_remarks(track))
    if strict and remarks:
        raise DataError("; ".join(remarks), where=str(path))
    return replace(track, remarks=remarks)


def _read(path: Path) -> FapTrack:
    data = read_bytes(path)
    if data[:3] == b"\x00\x00\x01" or is_mp4(data):
        from fapengine.codec.fit import fill_track
        from fapengine.files.fba import load_fba

        decoded = load_fba(path)
        return fill_track(decoded, shown(decoded.track))[0]
    if data[:4] == b"glTF":
        from fapengine.files.gltf.animation import parse_animation

        with naming(path):
            return parse_animation(data)
    if path.suffix.lower() == ".fap":
        return shown(load_fap(path))
    from fapengine.files.sound import SOUND_SUFFIXES
    from fapengine.retarget.blend_tracks import is_vmc_recording, parse_blend_track, parse_vmc_recording

    recorded = is_vmc_recording(data)
    if path.suffix.lower() in SOUND_SUFFIXES:
        raise DataError("is a recording, not motion; `fapengine animate` makes motion of it", where=str(path))
    if path.suffix.lower() not in BLEND_ENDINGS and not recorded:
        return shown(load_fap(path))
    with naming(path):
        return parse_vmc_recording(data) if recorded else parse_blend_track(data)

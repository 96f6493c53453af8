"""Face motion from any file that holds it, as FAPs."""

from pathlib import Path

from fapengine.errors import DataError
from fapengine.files.fap import load_fap
from fapengine.files.paths import is_mp4, read_bytes
from fapengine.mpeg4.track import FapTrack
from fapengine.retarget.blend_tracks import parse_blend_track
from fapengine.retarget.vmc_recording import is_vmc_recording, parse_vmc_recording

BLEND_ENDINGS = (".csv", ".json", ".jsonl")
RECORDED_ENDINGS = (".osc",)


def load_motion(path: Path) -> FapTrack:
    """Read FAPs: an FBA stream (alone or in an MP4 file), blend shapes (.csv, .json), a recorded VMC stream, .fap text.

    Raises
    ------
    UsageError
        If it cannot be read.
    DataError
        If its content is wrong; the message names the file.
    """
    data = read_bytes(path)
    if data[:3] == b"\x00\x00\x01" or is_mp4(data):
        from fapengine.codec.interpolate import fill_track
        from fapengine.files.fba import load_fba

        return fill_track(load_fba(path))
    recorded = is_vmc_recording(data)
    if path.suffix.lower() not in BLEND_ENDINGS and not recorded:
        return load_fap(path)
    try:
        return parse_vmc_recording(data) if recorded else parse_blend_track(data)
    except DataError as error:
        raise type(error)(f"{path}: {error.message}", where=error.where, clause=error.clause) from error

"""Phone timings from a file; the format is detected from its content."""

from pathlib import Path

from fapengine.files.paths import naming, read_bytes
from fapengine.speech.formats.documents import MAX_BYTES
from fapengine.speech.formats.registry import FORMATS, ParseOptions, parse_timings
from fapengine.speech.phone_track import PhoneTrack

__all__ = ["FORMATS", "load_timings"]


def load_timings(
    path: Path,
    *,
    format: str | None = None,  # noqa: A002  as the option of the command line
    tier: str | None = None,
    alphabet: str | None = None,
    columns: str | None = None,
) -> PhoneTrack:
    """Read phone timings.

    Parameters
    ----------
    path : Path
        The file.
    format : str, optional
        One of :data:`FORMATS`; by default found from the content, else from the name's ending.
    tier : str, optional
        For formats with tiers: the phone tier; for MFA's CSV: the speaker.
    alphabet : str, optional
        Alphabet of the labels, if the format does not fix it: one of
        :data:`fapengine.speech.alphabets.convert.ALPHABETS`.
    columns : str, optional
        Columns of a list in no known format: see
        :func:`fapengine.speech.formats.table.parse_columns`.

    Raises
    ------
    UsageError
        If the file cannot be read, or the format does not support an option.
    DataError
        If its content is not in that format; the message names the file.
    """
    options = ParseOptions(tier, alphabet, columns)
    with naming(path):
        return parse_timings(read_bytes(path, MAX_BYTES), file_format=format, ending=path.suffix, options=options)

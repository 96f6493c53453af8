"""Phone timings from a file; the format is detected from its content."""

from pathlib import Path

from fapengine.errors import DataError
from fapengine.files.paths import read_bytes
from fapengine.speech.formats.registry import FORMATS, ParseOptions, parse_timings
from fapengine.speech.phone_track import PhoneTrack

__all__ = ["FORMATS", "load_timings"]


def load_timings(
    path: Path,
    *,
    file_format: str | None = None,
    tier: str | None = None,
    alphabet: str | None = None,
    columns: str | None = None,
) -> PhoneTrack:
    """Read phone timings.

    Parameters
    ----------
    path : Path
        The file.
    file_format : str, optional
        One of :data:`FORMATS`; by default found from the content, else from the name's ending.
    tier : str, optional
        For formats with tiers: the phone tier; for MFA's CSV: the speaker.
    alphabet : str, optional
        What the labels are, where the format does not fix it: one of
        :data:`fapengine.speech.alphabets.convert.ALPHABETS`.

    columns : str, optional
        For lists that no tool has a name for: what its columns are. See
        :func:`fapengine.speech.formats.table.parse_columns`.

    Raises
    ------
    UsageError
        If the file cannot be read, or the format has no such choice.
    DataError
        If its content is no such format; the message names the file.
    """
    data = read_bytes(path)
    try:
        return parse_timings(
            data, file_format=file_format, ending=path.suffix, options=ParseOptions(tier, alphabet, columns)
        )
    except DataError as error:
        raise type(error)(f"{path}: {error.message}", where=error.where, clause=error.clause) from error

"""Options of the verbs that listen, and the bar while they do."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from fapengine.app.hearing import Hearing

HEARING = "What is heard"

Text = Annotated[
    Path | None,
    typer.Option(
        "--text", "-t", help="File with the words that are said: closer than without.", rich_help_panel=HEARING
    ),
]
Transcript = Annotated[
    str | None, typer.Option("--transcript", help="The words themselves.", rich_help_panel=HEARING)
]  # fmt: skip
Language = Annotated[
    str,
    typer.Option(
        "--language", help="Of the words: en-us, de, fr-fr, ...; without words, no matter.", rich_help_panel=HEARING
    ),
]
Channel = Annotated[
    str | None,
    typer.Option(
        "--channel",
        metavar="NUMBER|each",
        help="Channel of the sound, 1 for the first; else the mean. each: a file for every one, OUT-1, OUT-2, ...: two"
        " speakers in two channels.",
        rich_help_panel=HEARING,
    ),
]
EarModel = Annotated[
    Path | None,
    typer.Option(
        "--ear",
        metavar="EAR",
        help="What hears without words: small (a network of our own), sphinx, both, or MODEL.onnx, a learned ear"
        " of yours with its labels beside it in MODEL.json.",
        rich_help_panel=HEARING,
    ),
]
EACH = "each"
MAX_EACH = 8
"""Channels that are taken for speakers of their own at most."""


def channels_of(
    channel: str | None, path: Path | None, output: Path, *, has_words: bool = False
) -> list[tuple[int | None, Path]]:
    """List the channels to be taken, and where the result of each goes; None is the mean of all.

    Raises
    ------
    UsageError
        If it is no number, or each of several is meant with the words of one.
    """
    from fapengine.errors import UsageError
    from fapengine.files.sound import inspect_sound

    if channel is None:
        return [(None, output)]
    if channel != EACH:
        if not channel.isdecimal():
            raise UsageError(f"channel: got {channel!r}, expected a number from 1 on, or {EACH}")
        return [(int(channel), output)]
    if path is None:
        raise UsageError(f"channel: got {EACH}, which is of a recording; expected a number or none with timings")
    if has_words:
        raise UsageError(
            f"channel: got {EACH} and words, which are of one; expected one at a time with words of its own"
        )
    count = inspect_sound(path).channels
    if count > MAX_EACH:
        raise UsageError(f"channel: got {EACH} of {count}, expected {MAX_EACH} channels or fewer")
    return [(n, output.with_name(f"{output.stem}-{n}{output.suffix}")) for n in range(1, count + 1)]


def transcript_of(text: Path | None, transcript: str | None) -> str | None:
    """Return the words of either option.

    Raises
    ------
    UsageError
        If both are given, or the file cannot be read.
    """
    from fapengine.app.hearing import read_text
    from fapengine.errors import UsageError

    if text is not None and transcript is not None:
        raise UsageError("--text, --transcript: got both, expected one")
    return read_text(text) if text is not None else transcript


def hear_with_bar(
    path: Path, *, transcript: str | None, language: str, channel: int | None, ear: Path | None
) -> "Hearing":
    """Hear a file under a bar that counts its seconds. Raises as :func:`fapengine.app.hearing.hear`."""
    from fapengine.app.hearing import hear
    from fapengine.cli._progress import progress
    from fapengine.files.sound import inspect_sound

    with progress("listening, s", round(inspect_sound(path).duration_s)) as advance:
        return hear(path, transcript=transcript, language=language, channel=channel, ear=ear, on_heard=advance)

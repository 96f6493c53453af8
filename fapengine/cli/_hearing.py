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
    int | None,
    typer.Option("--channel", help="Channel of the sound, 1 for the first; else the mean.", rich_help_panel=HEARING),
]


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


def hear_with_bar(path: Path, *, transcript: str | None, language: str, channel: int | None) -> "Hearing":
    """Hear a file under a bar that counts its seconds. Raises as :func:`fapengine.app.hearing.hear`."""
    from fapengine.app.hearing import hear
    from fapengine.cli._talking import progress
    from fapengine.files.sound import inspect_sound

    with progress("listening, s", round(inspect_sound(path).duration_s)) as advance:
        return hear(path, transcript=transcript, language=language, channel=channel, on_heard=advance)

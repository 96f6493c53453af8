"""Options of the commands that recognize speech, and their progress bar."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from fapengine.app.hearing import Hearing

HEARING = "Speech recognition"

Text = Annotated[
    Path | None,
    typer.Option("--transcript-file", "-t", help="Transcript file. Improves accuracy.", rich_help_panel=HEARING),
]
Transcript = Annotated[
    str | None, typer.Option("--transcript", help="Transcript as text.", rich_help_panel=HEARING)
]  # fmt: skip
Language = Annotated[
    str | None,
    typer.Option(
        "--language",
        help="Language of the transcript or of timed words: en-us, de, french, ... Default: the file's, else en-us.",
        rich_help_panel=HEARING,
    ),
]
Channel = Annotated[
    str | None,
    typer.Option(
        "--channel",
        metavar="NUMBER|each",
        help="Audio channel, 1 for the first. Default: the mean of all. each: one output per channel (OUT-1, OUT-2),"
        " for one speaker per channel.",
        rich_help_panel=HEARING,
    ),
]
RecognizerName = Annotated[
    Path | None,
    typer.Option(
        "--recognizer",
        metavar="NAME",
        help="Speech recognizer without a transcript: small (built-in network), sphinx (PocketSphinx), both, or"
        " MODEL.onnx, your own network with its labels in MODEL.json.",
        rich_help_panel=HEARING,
    ),
]
TrustTranscript = Annotated[
    bool,
    typer.Option(
        "--trust-transcript",
        help="Align all words of the transcript, without a check that they are in the recording.",
        rich_help_panel=HEARING,
    ),
]
EACH = "each"
MAX_EACH = 8
"""Largest number of channels for ``each``."""


def channels_of(
    channel: str | None, path: Path | None, output: Path, *, has_words: bool = False
) -> list[tuple[int | None, Path]]:
    """List the channels to read, and the output of each; None is the mean of all.

    Raises
    ------
    UsageError
        If it is not a number, or ``each`` is combined with one transcript.
    """
    from fapengine.errors import UsageError
    from fapengine.files.sound import inspect_sound

    if channel is None:
        return [(None, output)]
    if channel != EACH:
        if not channel.isdecimal():
            raise UsageError(f"channel: must be a number from 1, or {EACH}, got {channel!r}")
        return [(int(channel), output)]
    if path is None:
        raise UsageError(f"channel: {EACH} works with recordings only, not with timings")
    if has_words:
        raise UsageError(f"channel: {EACH} cannot be combined with a transcript; process one channel at a time")
    count = inspect_sound(path).channels
    if count > MAX_EACH:
        raise UsageError(f"channel: {EACH} supports at most {MAX_EACH} channels, got {count}")
    return [(n, output.with_name(f"{output.stem}-{n}{output.suffix}")) for n in range(1, count + 1)]


def transcript_of(text: Path | None, transcript: str | None) -> str | None:
    """Return the transcript of either option.

    Raises
    ------
    UsageError
        If both are given, or the file cannot be read.
    """
    from fapengine.app.hearing import read_text
    from fapengine.errors import UsageError
    from fapengine.files.paths import is_standard

    if text is not None and transcript is not None:
        raise UsageError("--transcript-file and --transcript: use only one")
    if text is not None and not is_standard(text) and not text.exists():
        raise UsageError(f"--transcript-file: file not found: {text}; --transcript takes the words themselves")
    return read_text(text) if text is not None else transcript


def hear_with_bar(path: Path, **how: Any) -> "Hearing":
    """Recognize a file with a progress bar; options as :func:`fapengine.app.hearing.hear`."""
    from fapengine.app.hearing import hear
    from fapengine.cli._printing import progress
    from fapengine.files.sound import inspect_sound

    with progress("listening, s", round(inspect_sound(path).duration_s)) as advance:
        return hear(path, **how, on_heard=advance)

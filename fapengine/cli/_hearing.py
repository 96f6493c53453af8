"""Options of the commands that recognize speech, and their progress bar."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from fapengine.app.hearing import Hearing, Recognition

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


@dataclass(frozen=True, slots=True)
class RecognitionOptions:
    """How the phones of a recording are found."""

    text: Text = None
    transcript: Transcript = None
    language: Language = None
    channel: Channel = None
    recognizer: RecognizerName = None
    trust_transcript: TrustTranscript = False

    def channels(self, path: Path | None, output: Path) -> list[tuple[int | None, Path]]:
        """List the channels to read, and the output of each; None is the mean of all.

        Raises UsageError if it is not a number, or ``each`` is combined with one transcript.
        """
        from fapengine.errors import UsageError
        from fapengine.files.sound import inspect_sound

        if self.channel is None:
            return [(None, output)]
        if self.channel != EACH:
            if not self.channel.isdecimal():
                raise UsageError(f"channel: must be a number from 1, or {EACH}, got {self.channel!r}")
            return [(int(self.channel), output)]
        if path is None:
            raise UsageError(f"channel: {EACH} works with recordings only, not with timings")
        if self.text is not None or self.transcript is not None:
            raise UsageError(f"channel: {EACH} cannot be combined with a transcript; process one channel at a time")
        count = inspect_sound(path).channels
        if count > MAX_EACH:
            raise UsageError(f"channel: {EACH} supports at most {MAX_EACH} channels, got {count}")
        return [(n, output.with_name(f"{output.stem}-{n}{output.suffix}")) for n in range(1, count + 1)]

    def value(self) -> "Recognition":
        """Return the recognition that the options describe, of the mean of all channels.

        Raises UsageError if there are two transcripts, or the file cannot be read.
        """
        from fapengine.app.hearing import Recognition, read_text
        from fapengine.errors import UsageError
        from fapengine.files.paths import is_standard

        text = self.text
        if text is not None and self.transcript is not None:
            raise UsageError("--transcript-file and --transcript: use only one")
        if text is not None and not is_standard(text) and not text.exists():
            raise UsageError(f"--transcript-file: file not found: {text}; --transcript takes the words themselves")
        return Recognition(
            transcript=read_text(text) if text is not None else self.transcript, language=self.language,
            recognizer=self.recognizer, trust_transcript=self.trust_transcript,
        )  # fmt: skip


def hear_with_bar(path: Path, how: "Recognition") -> "Hearing":
    """Recognize a file with a progress bar; errors as of :func:`fapengine.app.hearing.hear`."""
    from fapengine.app.hearing import hear
    from fapengine.cli._printing import progress
    from fapengine.files.sound import inspect_sound

    with progress("listening, s", round(inspect_sound(path).duration_s)) as advance:
        return hear(path, how, on_heard=advance)

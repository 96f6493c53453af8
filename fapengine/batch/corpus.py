"""A run from its folder: what it was asked for is kept beside what it made, so that it can be asked about again."""

import glob
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path

import msgspec

from fapengine.batch.journal import Done, load_journals
from fapengine.batch.manifest import parse_manifest, rows_of_pattern
from fapengine.batch.rows import KINDS, Options, Row
from fapengine.batch.work import Digests, key_of
from fapengine.errors import DataError, UsageError
from fapengine.files.paths import read_bytes, write_bytes

RECORD = "batch.json"


@dataclass(frozen=True, slots=True, kw_only=True)
class Corpus:
    """What a run was asked for."""

    manifest: str
    """Path of a manifest, or a pattern of files."""
    kind: str
    text: str | None = None
    """Files with the words of a pattern's recordings."""
    options: Options = field(default_factory=Options)

    def rows(self) -> tuple[Row, ...]:
        """Read the manifest, or find the files.

        Raises
        ------
        UsageError
            If it cannot be read, or no file is found.
        DataError
            If rows cannot be; all of them are told at once.
        """
        if self.kind not in KINDS:
            raise UsageError(f"to: got {self.kind!r}, expected one of {', '.join(KINDS)}")
        if glob.has_magic(self.manifest):
            anchor = Path(self.manifest).anchor
            paths = list(Path(anchor).glob(str(Path(self.manifest).relative_to(anchor))))
            if not paths:
                raise UsageError(f"manifest: got {self.manifest}, expected a pattern that some file has")
            return rows_of_pattern(paths, self.text, self.kind, self.options)
        if self.text is not None:
            raise UsageError(
                "text: got one with a manifest, expected a pattern of files; a manifest has a column for it"
            )
        path = Path(self.manifest)
        return parse_manifest(read_bytes(path), str(path), path.resolve().parent, self.kind, self.options)

    def inputs(self, rows: Sequence[Row] = ()) -> set[Path]:
        """Files that are read: the manifest, an avatar and its mapping, and those of rows."""
        words = {Path(self.text.format(stem=row.id)) for row in rows} if self.text is not None else set()
        named = (self.manifest, self.options.into, self.options.map)
        return (
            {Path(path) for path in named if path is not None} | words | {path for row in rows for path in row.inputs}
        )


def keep(folder: Path, corpus: Corpus) -> None:
    """Write what a run was asked for beside what it makes.

    Raises
    ------
    UsageError
        If the folder holds a run of another kind.
    ResourceError
        If it cannot be written.
    """
    if (folder / RECORD).is_file() and (kept := load_corpus(folder)).kind != corpus.kind:
        raise UsageError(f"to: got {corpus.kind}, but {folder} holds a run to {kept.kind}; expected another folder")
    write_bytes(folder / RECORD, json.dumps(asdict(corpus), indent=1, ensure_ascii=False).encode() + b"\n")


def load_corpus(folder: Path) -> Corpus:
    """Read what a run was asked for.

    Raises
    ------
    UsageError
        If the folder holds no run.
    DataError
        If the record is damaged.
    """
    path = folder / RECORD
    if not path.is_file():
        raise UsageError(f"manifest: got {folder}, expected the folder of a run, with {RECORD} in it")
    try:
        return msgspec.json.decode(read_bytes(path), type=Corpus)
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise DataError(f"{path}: {error}") from error


@dataclass(frozen=True, slots=True)
class State:
    """How far a run is."""

    rows: int
    done: int
    failed: tuple[Done, ...]
    left: int
    damaged: tuple[str, ...] = ()
    """Rows whose files are not as they were written."""


def state_of(folder: Path, *, verify: bool = False) -> State:
    """Tell how far a run is by its journals; ``verify`` reads every file and every input again.

    Raises
    ------
    UsageError, DataError
        As :func:`load_corpus` and :meth:`Corpus.rows` do.
    """
    corpus = load_corpus(folder)
    rows, known = corpus.rows(), load_journals(folder)
    entries = [known[row.id] for row in rows if row.id in known]
    failed = tuple(entry for entry in entries if entry.error)
    damaged: tuple[str, ...] = ()
    if verify:
        digests = Digests()
        damaged = tuple(
            row.id
            for row in rows
            if row.id in known
            and not known[row.id].error
            and not (known[row.id].key == key_of(row, corpus.kind, digests) and known[row.id].stands(folder))
        )
    return State(len(rows), len(entries) - len(failed), failed, len(rows) - len(entries), damaged)

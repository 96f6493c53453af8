"""A corpus: its manifest, and the record of its run in the output folder.

A manifest is a table (CSV), lines of JSON, or a file pattern; all errors are found before any work is done.
"""

import csv
import glob
import io
import json
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path, PurePosixPath
from typing import Any

import msgspec

from fapengine.batch.journal import Done, load_journals
from fapengine.batch.rows import FILES, KINDS, LISTS, OPTION_NAMES, PROFILE, Options, Row
from fapengine.batch.work import Digests, key_of
from fapengine.errors import DataError, UsageError
from fapengine.files.paths import read_bytes, write_bytes

RECORD = "batch.json"
COLUMNS = ("id", "text", "timings", "audio", "session", *OPTION_NAMES)
NAME = re.compile(r"[\w+-][\w.+ -]*(/[\w+-][\w.+ -]*)*")
"""An id: a file name, with slashes for folders; no part begins with a dot."""
MAX_ERRORS = 20
"""Errors that a message lists; it counts the others."""


def parse_manifest(
    data: bytes, where: str, folder: Path, kind: str, defaults: Options, bad: dict[str, str] | None = None
) -> tuple[Row, ...]:  # fmt: skip
    """Read a manifest and check all of it.

    Parameters
    ----------
    data : bytes
        CSV with a header, or one JSON object per line. Columns are ``id`` and ``text``, ``timings``, ``audio`` or
        ``session``, and any option of the commands; an empty cell is the default. Lists are JSON lists, or texts
        separated by ``;``.
    where : str
        Name of the manifest, for error messages.
    folder : Path
        Folder that file names are relative to.
    kind : str
        Kind of the output: one of :data:`fapengine.batch.rows.KINDS`.
    defaults : Options
        Options of rows that do not have their own.
    bad : dict of str to str, optional
        Gets the error of each invalid row by its line, and the others are returned; by default they are an error.

    Raises
    ------
    DataError
        Lists every invalid row, with its line: unknown columns, values out of range, missing files, invalid or repeated
        ids.
    """
    errors: dict[str, str] = {} if bad is None else bad
    rows: list[Row] = []
    seen: dict[str, int] = {}
    for line, cells in _lines(data, where):
        try:
            if isinstance(cells, DataError):
                raise cells
            row = _row(cells, line, folder, defaults)
            row.check(kind)
            name = row.id.casefold()  # some file systems ignore case
            if name in seen:
                raise UsageError(f"id: got {row.id!r} again, as in line {seen[name]}; expected unique ids")
            seen[name] = line
            rows.append(row)
        except (DataError, UsageError) as error:
            errors[f"line {line}"] = error.message if isinstance(error, DataError) else str(error)
    if bad is None:
        refuse_rows(errors, where)
    if not rows:
        raise DataError(f"{where}: contains no {'valid ' * bool(errors)}rows")
    return tuple(rows)


def refuse_rows(errors: Mapping[str, str], where: str) -> None:
    """Raise a DataError that lists all invalid rows, if there are any."""
    if errors:
        told = [f"{place}: {error}" for place, error in errors.items()]
        more = f"\nand {len(errors) - MAX_ERRORS} more" if len(errors) > MAX_ERRORS else ""
        raise DataError(f"{where}: {len(errors)} invalid rows:\n" + "\n".join(told[:MAX_ERRORS]) + more)


def rows_of_pattern(
    paths: list[Path], text: str | None, kind: str, defaults: Options, bad: dict[str, str] | None = None
) -> tuple[Row, ...]:  # fmt: skip
    """Make a row of each file (a recording or timings), or for profiles of each folder; its stem is the id.

    Raises UsageError if two files have one stem; DataError if transcripts are missing.

    Parameters
    ----------
    paths : list of Path
    text : str, optional
        Transcript of each recording; ``{stem}`` is replaced by its stem.
    bad : dict of str to str, optional
        As of :func:`parse_manifest`.
    """
    from fapengine.app.hearing import is_sound, read_text

    defaults.check(kind)
    rows: list[Row] = []
    errors: dict[str, str] = {} if bad is None else bad
    for number, path in enumerate(sorted(path for path in paths if kind != PROFILE or path.is_dir()), 1):
        source: dict[str, Any] = {"timings": path}
        if kind == PROFILE:
            source = {"session": path}
        elif is_sound(path):
            try:
                words = read_text(Path(text.format(stem=path.stem))).strip() if text else None
            except (UsageError, DataError) as error:
                errors[path.name] = str(error)
                continue
            source = {"audio": path, "text": words}
        name = path.name if kind == PROFILE else path.stem
        rows.append(Row(id=name, options=defaults, line=number, **source))
    if bad is None:
        refuse_rows(errors, "manifest")
    counts = Counter(row.id.casefold() for row in rows)
    if twice := [row.id for row in rows if counts[row.id.casefold()] > 1]:
        raise UsageError(f"manifest: got two files called {twice[0]}, expected unique names")
    return tuple(rows)


def _lines(data: bytes, where: str) -> Iterator[tuple[int, Mapping[str, Any] | DataError]]:
    """Yield the line and the cells by column of each row, or what is wrong with it."""
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise DataError(f"{where}: is not UTF-8 text ({error.reason})", where=f"byte {error.start}") from error
    if text.lstrip()[:1] == "{":
        for line, entry in enumerate(text.splitlines(), 1):
            if entry.strip():
                yield line, _json_row(entry)
        return
    reader = csv.reader(io.StringIO(text), strict=True)
    try:
        header = [cell.strip() for cell in next(reader, [])]
        _check_header(header, where)
        before = reader.line_num
        for cells in reader:
            if any(cell.strip() for cell in cells):
                if len(cells) > len(header):
                    message = f"got {len(cells)} cells, expected {len(header)}; quote texts with commas"
                    yield before + 1, DataError(message)
                else:
                    yield before + 1, {name: cell for name, cell in zip(header, cells, strict=False) if cell.strip()}
            before = reader.line_num
    except csv.Error as error:
        raise DataError(f"{where}: is not a table: {error}", where=f"line {reader.line_num}") from error


def _check_header(header: list[str], where: str) -> None:
    unknown = [name for name in header if name not in COLUMNS]
    if unknown or "id" not in header or len(set(header)) < len(header):
        what = f"unknown {', '.join(map(repr, unknown))}" if unknown else ", ".join(header) or "none"
        expected = f"id and some of {', '.join(COLUMNS[1:])}, once each"
        raise DataError(f"{where}: columns: got {what}; expected {expected}", where="line 1")


def _json_row(entry: str) -> Mapping[str, Any] | DataError:
    try:
        value = json.loads(entry)
    except (ValueError, RecursionError) as error:
        return DataError(f"is not JSON: {error}")
    if not isinstance(value, dict):
        return DataError(f"got {type(value).__name__}, expected an object")
    return {name: cell for name, cell in value.items() if cell is not None}


def _row(cells: Mapping[str, Any], line: int, folder: Path, defaults: Options) -> Row:
    if unknown := [name for name in cells if name not in COLUMNS]:
        raise DataError(f"{unknown[0]}: got an unknown column, expected one of {', '.join(COLUMNS)}")
    name = str(cells.get("id", "")).strip()
    if not NAME.fullmatch(name) or PurePosixPath(name).name.endswith((".", " ")):
        raise DataError(f"id: got {name!r}, expected a file name, with / for folders")
    places: dict[str, Path] = {}
    for column in FILES:
        if column in cells:
            places[column] = folder / str(cells[column]).strip()
            if column == "session":
                if not places[column].is_dir():
                    raise DataError(f"{column}: got {cells[column]}, expected an existing folder")
            elif not places[column].is_file() and not (column == "into" and not places[column].suffix):
                raise DataError(f"{column}: got {cells[column]}, expected an existing file")
    given = {key: _value(key, cells[key]) for key in cells if key in OPTION_NAMES}
    given |= {key: str(places[key]) for key in ("into", "map") if key in places and places[key].is_file()}
    try:
        chosen = msgspec.convert({**given}, Options, strict=False) if given else defaults
    except msgspec.ValidationError as error:
        message, _, place = str(error).partition(" - at `$.")
        raise DataError(f"{place.rstrip('`')}: {message}") from error
    options = replace(defaults, **{key: getattr(chosen, key) for key in given})
    text = str(cells["text"]) if "text" in cells else None
    sources = {key: place for key, place in places.items() if key not in ("into", "map")}
    return Row(id=name, text=text, options=options, line=line, **sources)


def _value(key: str, value: object) -> object:
    if key in LISTS and isinstance(value, str):
        return [part.strip() for part in value.split(";") if part.strip()]
    return value.strip() if isinstance(value, str) else value


@dataclass(frozen=True, slots=True, kw_only=True)
class Corpus:
    """The input and the options of a run."""

    manifest: str
    """Path of a manifest, or a file pattern."""
    kind: str
    text: str | None = None
    """Pattern of the transcripts of recordings."""
    options: Options = field(default_factory=Options)
    skip_bad: bool = False
    """True to leave out invalid rows."""

    def rows(self, bad: dict[str, str] | None = None) -> tuple[Row, ...]:
        """Read the manifest, or find the files.

        Raises UsageError if it cannot be read, or no file is found; DataError if rows are invalid, unless they are left
        out (the message lists all of them).

        Parameters
        ----------
        bad : dict of str to str, optional
            Gets the error of each row that is left out, by its line.
        """
        left_out = (bad if bad is not None else {}) if self.skip_bad else None
        if self.kind not in KINDS:
            raise UsageError(f"to: got {self.kind!r}, expected one of {', '.join(KINDS)}")
        if glob.has_magic(self.manifest):
            anchor = Path(self.manifest).anchor
            paths = list(Path(anchor).glob(str(Path(self.manifest).relative_to(anchor))))
            if not paths:
                raise UsageError(f"manifest: got {self.manifest}, which matches no file")
            return rows_of_pattern(paths, self.text, self.kind, self.options, left_out)
        if self.text is not None:
            raise UsageError("text: requires a file pattern; a manifest has a column for transcripts")
        path = Path(self.manifest)
        return parse_manifest(read_bytes(path), str(path), path.resolve().parent, self.kind, self.options, left_out)

    def inputs(self, rows: Sequence[Row] = ()) -> set[Path]:
        """Return the files that are read: the manifest, an avatar and its mapping, and those of rows."""
        texts = [self.text.format(stem=row.id) for row in rows] if self.text is not None else []
        named = (self.manifest, self.options.into, self.options.map, *texts)
        return {Path(path) for path in named if path is not None}.union(*(row.inputs for row in rows))


def keep(folder: Path, corpus: Corpus) -> None:
    """Write the record of a run into its output folder.

    Raises
    ------
    UsageError
        If the folder contains a run of another kind.
    ResourceError
        If it cannot be written.
    """
    if (folder / RECORD).is_file() and (kept := load_corpus(folder)).kind != corpus.kind:
        raise UsageError(f"to: got {corpus.kind}, but {folder} contains a run to {kept.kind}; expected another folder")
    write_bytes(folder / RECORD, json.dumps(asdict(corpus), indent=1, ensure_ascii=False).encode() + b"\n")


def load_corpus(folder: Path) -> Corpus:
    """Read the record of a run. Raises UsageError if the folder contains no run; DataError if the record is damaged."""
    path = folder / RECORD
    if not path.is_file():
        raise UsageError(f"manifest: got {folder}, expected the folder of a run, with {RECORD}")
    try:
        return msgspec.json.decode(read_bytes(path), type=Corpus)
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise DataError(f"{path}: {error}") from error


@dataclass(frozen=True, slots=True)
class State:
    """Progress of a run."""

    rows: int
    done: int
    failed: tuple[Done, ...]
    left: int
    damaged: tuple[str, ...] = ()
    """Rows whose files or inputs have changed."""


def state_of(folder: Path, *, verify: bool = False) -> State:
    """Return the progress of a run according to its journals; ``verify`` checks every file and every input.

    Raises UsageError, DataError as :func:`load_corpus` and :meth:`Corpus.rows` do.
    """
    corpus, digests = load_corpus(folder), Digests()
    rows, known = corpus.rows(), load_journals(folder)
    found = [(row, known[row.id]) for row in rows if row.id in known]
    failed = tuple(entry for _, entry in found if entry.error)
    damaged = tuple(
        row.id
        for row, entry in (found if verify else ())
        if not entry.error and not (entry.key == key_of(row, corpus.kind, digests) and entry.stands(folder))
    )
    return State(len(rows), len(found) - len(failed), failed, len(rows) - len(found), damaged)

"""The journal of a run: one line for each row that was processed.

A line is JSON: the row's id, the digest of its inputs and options, its files with their sizes and checksums, figures
for the report, or an error. Lines are only appended, by one process; the later of two lines for one row counts. An
incomplete last line, of a process that was killed, is ignored: its row is processed again.
"""

import json
import os
import zlib
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field
from pathlib import Path

import msgspec

from fapengine.errors import ResourceError

PATTERN = "journal*.jsonl"


@dataclass(frozen=True, slots=True, kw_only=True)
class Done:
    """Result of a row."""

    id: str
    key: str
    """Digest of the row, its inputs and the version of fapengine."""
    outputs: dict[str, tuple[int, int]] = field(default_factory=dict)
    """Size and CRC-32 by the file's name, relative to the folder of the run."""
    duration_s: float = 0.0
    """Length of the utterance."""
    frames: int = 0
    phones: int = 0
    unknown: int = 0
    """Number of unknown phones."""
    remarks: tuple[str, ...] = ()
    """What looked wrong, and what was assumed."""
    seconds: float = 0.0
    """Processing time."""
    error: str = ""

    def stands(self, folder: Path) -> bool:
        """Whether its files exist as they were written."""
        return not self.error and all(checksum(folder / name) == told for name, told in self.outputs.items())


def checksum(path: Path) -> tuple[int, int] | None:
    """Size and CRC-32 of a file; None if it cannot be read."""
    size = crc = 0
    try:
        with path.open("rb") as file:
            while piece := file.read(1 << 20):
                size, crc = size + len(piece), zlib.crc32(piece, crc)
    except OSError:
        return None
    return size, crc


def parse_journal(data: bytes) -> dict[str, Done]:
    """Read lines by the ids of the rows; incomplete and invalid lines are ignored."""
    done: dict[str, Done] = {}
    whole = data[: data.rfind(b"\n") + 1]
    for line in whole.splitlines():
        try:
            entry = msgspec.json.decode(line, type=Done)
        except (msgspec.DecodeError, UnicodeDecodeError):
            continue
        done[entry.id] = entry
    return done


def load_journals(folder: Path) -> dict[str, Done]:
    """Read all journals of a run and its shards, the oldest first."""
    done: dict[str, Done] = {}
    for path in sorted(folder.glob(PATTERN), key=lambda path: (path.stat().st_mtime_ns, path.name)):
        done |= parse_journal(path.read_bytes())
    return done


class Journal:
    """A journal open for appending; an incomplete last line is removed first.

    Stateful. Raises ResourceError if it cannot be written.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._file = path.open("ab")
            data = path.read_bytes()
            self._file.truncate(data.rfind(b"\n") + 1)
        except OSError as error:
            raise ResourceError(f"{path}: cannot be written ({error.strerror or error})") from error

    def add(self, entries: Iterable[Done]) -> None:
        """Add lines, and wait until they are on the disk. Raises ResourceError if that fails."""
        start = self._file.tell()
        try:
            for entry in entries:
                facts = {key: value for key, value in asdict(entry).items() if value or key in ("id", "key")}
                self._file.write(json.dumps(facts, ensure_ascii=False).encode() + b"\n")
            self._file.flush()
            os.fsync(self._file.fileno())
        except OSError as error:
            os.ftruncate(self._file.fileno(), start)  # a full disk leaves no half line
            raise ResourceError(f"{self._path}: cannot be written ({error.strerror or error})") from error

    def __enter__(self) -> "Journal":
        return self

    def __exit__(self, *_: object) -> None:
        try:
            self._file.close()
        except OSError:  # the failed write was reported before
            os.close(self._file.fileno())

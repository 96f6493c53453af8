"""The journal of a run: a line for each row that was done, and nothing else counts.

A line is JSON: the row's id, the digest of all that it was made of, its files with their sizes and checksums, figures
for the report, or an error. Lines are only added, by one process; of two for one row the later counts. A last line that
is torn, for its writer was killed, is forgotten: its row is done again.
"""

import json
import os
import zlib
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import msgspec

from fapengine.errors import ResourceError

PATTERN = "journal*.jsonl"


@dataclass(frozen=True, slots=True, kw_only=True)
class Done:
    """What became of a row."""

    id: str
    key: str
    """Digest of the row, its inputs and what made it."""
    outputs: dict[str, tuple[int, int]] = field(default_factory=dict)
    """Size and CRC-32 by the file's name, relative to the folder of the run."""
    duration_s: float = 0.0
    """Length of the utterance."""
    frames: int = 0
    phones: int = 0
    unknown: int = 0
    """Phones that no set explains."""
    seconds: float = 0.0
    """Time that the work took."""
    error: str = ""

    def stands(self, folder: Path) -> bool:
        """Tell whether its files are there as they were written."""
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
    """Read lines by the rows' ids, for all bytes: what is no whole line of ours is as if it were not there."""
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
    """Read all journals of a run, those of shards too, the older first."""
    done: dict[str, Done] = {}
    paths = sorted(folder.glob(PATTERN), key=lambda path: (path.stat().st_mtime_ns, path.name))
    for path in paths:
        done |= parse_journal(path.read_bytes())
    return done


class Journal:
    """A journal open for more lines; a torn last line goes when it is opened.

    Stateful.

    Raises
    ------
    ResourceError
        If it cannot be written.
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
        """Add lines, and wait until they are on the disk. Raises ResourceError if they cannot be."""
        start = self._file.tell()
        try:
            for entry in entries:
                self._file.write(json.dumps(_sparse(entry), ensure_ascii=False).encode() + b"\n")
            self._file.flush()
            os.fsync(self._file.fileno())
        except OSError as error:
            self._take_back(start)
            raise ResourceError(f"{self._path}: cannot be written ({error.strerror or error})") from error

    def _take_back(self, start: int) -> None:
        """Leave nothing half written where the disk is full."""
        os.ftruncate(self._file.fileno(), start)

    def __enter__(self) -> "Journal":
        return self

    def __exit__(self, *_: object) -> None:
        try:
            self._file.close()
        except OSError:  # that it could not be written was raised before
            os.close(self._file.fileno())


def _sparse(entry: Done) -> Mapping[str, Any]:
    return {key: value for key, value in asdict(entry).items() if value or key in ("id", "key")}

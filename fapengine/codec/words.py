"""Words of a text file, with their line numbers: for ``.fap`` and ``.epf``, where line breaks hardly matter."""

from collections import deque
from collections.abc import Iterator

from fapengine.errors import DataError, TruncatedError

LINES_KEPT = 256
"""Number of lines whose word counts are kept: the digits of a frame may be on one line each."""


def text_lines(data: bytes, what: str) -> Iterator[tuple[int, str]]:
    """Return the number and the text of each line that is neither empty nor a comment (``#``).

    Raises
    ------
    DataError
        If the data are not UTF-8 text; ``what`` is the kind of file, for the message.
    """
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise DataError(f"{what}: is not UTF-8 text", where=f"byte {error.start}") from error
    numbered = enumerate(text.splitlines(), start=1)
    return ((number, line) for number, line in numbered if line.strip() and not line.lstrip().startswith("#"))


class Words:
    """The words of numbered lines, which are split when they are needed.

    Stateful.
    """

    def __init__(self, lines: Iterator[tuple[int, str]]) -> None:
        self._lines = lines
        self._ready: deque[tuple[str, int]] = deque()
        self._last_line = 1
        self.per_line: dict[int, int] = {}
        """Number of words in each of the last lines."""

    def has(self, count: int) -> bool:
        """Split lines until ``count`` words are ready; False at the end of the file."""
        while len(self._ready) < count:
            number, line = next(self._lines, (0, ""))
            if not number:
                return False
            words = line.split()
            self._ready.extend((word, number) for word in words)
            self._last_line = number
            self.per_line[number] = len(words)
            if len(self.per_line) > LINES_KEPT:
                del self.per_line[next(iter(self.per_line))]
        return True

    def line(self) -> int:
        """Line of the next word."""
        return self._ready[0][1] if self.has(1) else self._last_line

    def take(self, count: int, what: str) -> list[tuple[str, int]]:
        """Next ``count`` words and their lines."""
        if not self.has(count):
            where = f"line {self.line()}, the end"
            raise TruncatedError(f"{what}: got {len(self._ready)} numbers, expected {count}", where=where)
        return [self._ready.popleft() for _ in range(count)]

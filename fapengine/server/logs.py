"""The server's log: one line per record, as text or JSON."""

import json
import logging
import sys
import time
from typing import TextIO

PLAIN = frozenset(vars(logging.makeLogRecord({}))) | {"message", "asctime", "taskName"}
"""Attributes that every record has; all others were given as ``extra``."""


class JsonLines(logging.Formatter):
    """One JSON object per line: time (UTC), level, logger, message, trouble, and the caller's extra fields."""

    def format(self, record: logging.LogRecord) -> str:
        """Format a record."""
        fields: dict[str, object] = {
            "time": time.strftime("%Y-%m-%dT%H:%M:%S", time.gmtime(record.created)) + f".{int(record.msecs):03d}Z",
            "level": record.levelname.lower(),
            "logger": record.name,
            "message": record.getMessage(),
        }
        fields |= {name: value for name, value in vars(record).items() if name not in PLAIN}
        if record.exc_info:
            fields["trouble"] = self.formatException(record.exc_info)
        return json.dumps(fields, default=str, ensure_ascii=False)


class Lines(logging.Formatter):
    """Time, level unless it is info, and message."""

    def format(self, record: logging.LogRecord) -> str:
        """Format a record."""
        level = "" if record.levelno == logging.INFO else f"{record.levelname.lower()}: "
        text = f"{time.strftime('%H:%M:%S', time.localtime(record.created))} {level}{record.getMessage()}"
        return f"{text}\n{self.formatException(record.exc_info)}" if record.exc_info else text


AT_ONCE, WITHIN_S = 5, 10.0
"""Number of records of one kind that are written within this time; further ones are only counted."""
MAX_KINDS = 1000


class SeldomFilter(logging.Filter):
    """A filter of repeated records, so that no client can fill the disk. Stateful.

    Two records are of one kind if their texts differ only in the arguments.
    """

    def __init__(self) -> None:
        super().__init__()
        self._kinds: dict[tuple[str, str], list[float]] = {}
        """Kind to the time of its first record of the latest 10 s, the number since, and the number not written."""

    def filter(self, record: logging.LogRecord) -> bool:
        """Return whether a record is written; the first one after omitted records reports their number."""
        kind = (record.name, str(record.msg))
        if len(self._kinds) > MAX_KINDS:
            self._kinds.clear()
        seen = self._kinds.setdefault(kind, [record.created, 0, 0])
        if record.created - seen[0] >= WITHIN_S:
            if seen[2]:
                record.msg, record.args = f"{record.getMessage()} ({seen[2]:.0f} more like it before)", None
            seen[:] = record.created, 0, 0
        seen[1] += 1
        if seen[1] <= AT_ONCE or record.levelno < logging.WARNING:
            return True
        seen[2] += 1
        return False


def begin_log(level: str, form: str, stream: TextIO | None = None) -> logging.Handler:
    """Write the log of fapengine to a stream, by default standard error.

    Parameters
    ----------
    level : str
        debug, info, warning or error.
    form : str
        ``"json"`` or ``"text"``.
    """
    handler = logging.StreamHandler(stream or sys.stderr)
    handler.setFormatter(JsonLines() if form == "json" else Lines())
    handler.addFilter(SeldomFilter())
    root = logging.getLogger("fapengine")
    root.setLevel(level.upper())
    root.addHandler(handler)
    root.propagate = False
    return handler

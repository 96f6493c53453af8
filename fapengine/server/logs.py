"""The server's log: a line each, for people or for programs."""

import json
import logging
import sys
import time
from typing import TextIO

PLAIN = frozenset(vars(logging.makeLogRecord({}))) | {"message", "asctime", "taskName"}
"""Names that every record has; any other was given as ``extra``."""


class JsonLines(logging.Formatter):
    """One JSON object a line: time (UTC), level, logger, message, trouble, and whatever the caller added."""

    def format(self, record: logging.LogRecord) -> str:
        """Write a record."""
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
    """Time, level where it is not plain information, message."""

    def format(self, record: logging.LogRecord) -> str:
        """Write a record."""
        level = "" if record.levelno == logging.INFO else f"{record.levelname.lower()}: "
        text = f"{time.strftime('%H:%M:%S', time.localtime(record.created))} {level}{record.getMessage()}"
        return f"{text}\n{self.formatException(record.exc_info)}" if record.exc_info else text


AT_ONCE, WITHIN_S = 5, 10.0
"""Records of one kind that are written within so long; more are only counted."""
MAX_KINDS = 1000


class SeldomFilter(logging.Filter):
    """A filter of records that repeat themselves: what anybody can cause must not fill a disk.

    Two records are of one kind if they have the same text but for its arguments.
    Stateful.
    """

    def __init__(self) -> None:
        super().__init__()
        self._kinds: dict[tuple[str, str], list[float]] = {}
        """Kind to when its first record of the latest 10 s came, how many came since, how many were not written."""

    def filter(self, record: logging.LogRecord) -> bool:
        """Whether a record is written; the first one after others that were not tells how many they were."""
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
    """Send what fapengine logs to a stream, standard error by default.

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

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
    root = logging.getLogger("fapengine")
    root.setLevel(level.upper())
    root.addHandler(handler)
    root.propagate = False
    return handler

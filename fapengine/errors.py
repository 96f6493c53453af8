"""All exceptions, in three branches: the caller, the data or the machine must change.

A message has the form *subject: what is wrong (at where; clause)* and shows the values.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager


class FapEngineError(Exception):
    """Base of every error that fapengine raises on purpose."""


class UsageError(FapEngineError, ValueError):
    """The caller must change the call."""


class ElsewhereError(UsageError):
    """A session that another process shows."""


class NothingToSpeakError(UsageError):
    """The text contains nothing to speak."""


class DataError(FapEngineError, ValueError):
    """The bytes, the file or the profile must change.

    Parameters
    ----------
    message : str
        What is wrong, and what was expected.
    where : str, optional
        File, line, key, byte or bit of the problem.
    clause : str, optional
        Clause of the standard, or section of the format description.
    """

    def __init__(self, message: str, *, where: str = "", clause: str = "") -> None:
        self.message = message
        self.where = where
        self.clause = clause
        place = "; ".join(part for part in (f"at {where}" if where else "", clause) if part)
        super().__init__(f"{message} ({place})" if place else message)

    def __reduce__(self) -> tuple[object, ...]:
        """Keep ``where`` and ``clause`` when the error crosses a process border."""
        return _rebuild, (type(self), self.message, self.where, self.clause)


@contextmanager
def as_data_error(what: str = "", *, where: str = "", kind: type[DataError] = DataError) -> Iterator[None]:
    """Turn a UsageError raised inside into a DataError that begins with ``what``: the value is from a file."""
    try:
        yield
    except UsageError as error:
        raise kind(f"{what}{error}", where=where) from error


@contextmanager
def any_error_as(kind: Callable[[str], FapEngineError], message: str) -> Iterator[None]:
    """Turn whatever others' code raises into ``message (ValueError: its first line)``; errors of ours pass."""
    try:
        yield
    except FapEngineError:
        raise
    except Exception as error:
        first = f"{type(error).__name__}: {error}".splitlines()[0][:200]
        raise kind(f"{message} ({first})") from error


def _rebuild(kind: type[DataError], message: str, where: str, clause: str) -> DataError:
    return kind(message, where=where, clause=clause)


class TruncatedError(DataError):
    """The data end too early; more bytes may complete them."""


class ConformanceError(DataError):
    """The data break a rule of the standard."""


class UnsupportedError(DataError):
    """Valid data that fapengine does not support."""


class ProfileError(DataError):
    """A profile is invalid; ``where`` is file and key."""


class ResourceError(FapEngineError, RuntimeError):
    """Something is missing on the machine: a GPU, a free port, an audio device, a voice."""

"""All exceptions: three branches, by who must act.

A message says *what: got ..., expected ... (at where; clause)*, with the values shown.
"""


class FapEngineError(Exception):
    """Base of every error that fapengine raises on purpose."""


class UsageError(FapEngineError, ValueError):
    """The caller must change the call."""


class NothingToSpeakError(UsageError):
    """A text in which a voice finds nothing."""


class DataError(FapEngineError, ValueError):
    """The bytes, the file or the profile must change.

    Parameters
    ----------
    message : str
        What was got and what was expected.
    where : str, optional
        File, line, key, byte and bit: where the trouble is.
    clause : str, optional
        Clause of the standard or section of the format description that was broken.
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


def _rebuild(kind: type[DataError], message: str, where: str, clause: str) -> DataError:
    return kind(message, where=where, clause=clause)


class TruncatedError(DataError):
    """The data end too early; more bytes may cure it."""


class ConformanceError(DataError):
    """The data break a rule of the standard."""


class UnsupportedError(DataError):
    """Legal data that fapengine does not handle; never guessed around."""


class ProfileError(DataError):
    """A profile is wrong; ``where`` is file and key."""


class ResourceError(FapEngineError, RuntimeError):
    """The machine lacks something: no GPU, a port taken, no audio device, no voice."""

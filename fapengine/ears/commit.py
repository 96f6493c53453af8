"""Which phones of a hypothesis that still changes may be told: those that are old enough, and then for good."""

from collections.abc import Sequence

MIN_FRAMES = 3
"""Frames of 10 ms of the shortest phone that is told, the shortest that the model can hear; less goes to the next."""

Labelled = tuple[str, int, int]
"""A label, its first frame and the one behind its last."""


def due(
    segments: Sequence[Labelled], told: int, horizon: int, *, silence: str, at_end: bool = False
) -> list[Labelled]:  # fmt: skip
    """Choose what is told now of a new hypothesis.

    Parameters
    ----------
    segments : sequence of (label, first, behind)
        The whole hypothesis, in order and without holes.
    told : int
        First frame that has not been told. What lies before stays as it was told, whatever the hypothesis says now.
    horizon : int
        Frame up to which the hypothesis is old enough.
    silence : str
        Label of silence, which is told as far as it reaches; other phones wait until they are over.
    at_end : bool
        Nothing follows, so all is told.

    Returns
    -------
    list of (label, first, behind)
        Without holes, from ``told`` on.

    Examples
    --------
    >>> due([("m", 0, 8), ("a", 8, 20), ("_", 20, 50)], 8, 40, silence="_")
    [('a', 8, 20), ('_', 20, 40)]
    >>> due([("b", 0, 9), ("a", 9, 30)], 8, 15, silence="_")
    []
    """
    chosen: list[Labelled] = []
    now = told
    for label, _, behind in segments:
        if behind <= now:
            continue
        if behind > horizon and not at_end:
            if label == silence and horizon - now >= MIN_FRAMES:
                chosen.append((label, now, horizon))
            break
        if behind - now < MIN_FRAMES and not at_end:
            continue  # the next begins earlier
        chosen.append((label, now, behind))
        now = behind
    return chosen

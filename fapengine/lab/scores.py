"""Scores of lip sync, on tracks."""

from fapengine._strict_toml import checked
from fapengine.mpeg4.track import FapTrack
from fapengine.scoring.mouth import CLOSED_MM, mouth_of
from fapengine.scoring.score import Score, score_mouth
from fapengine.speech.phone_track import PhoneTrack


@checked
def score(
    made: FapTrack,
    *,
    truth: FapTrack | None = None,
    phones: PhoneTrack | None = None,
    offset_s: float = 0.0,
    closed_mm: float = CLOSED_MM,
) -> Score:
    """Score a lip sync, as ``fapengine score`` does.

    Parameters
    ----------
    made : FapTrack
        Motion to score: (T, 68) FAPs.
    truth : FapTrack, optional
        Recorded motion of the same speech; gives ``score.truth``: distances in mm, correlations, lags in ms.
    phones : PhoneTrack, optional
        Timed phones of the speech; give ``score.phones``: contacts and timing.
    offset_s : float
        Time in ``truth`` and ``phones`` at which ``made`` begins.
    closed_mm : float
        Opening below which lips count as closed.

    Raises
    ------
    DataError
        If the tracks have no common time.
    """
    reference = None if truth is None else mouth_of(truth)
    return score_mouth(mouth_of(made, offset_s=offset_s), truth=reference, phones=phones, closed_mm=closed_mm)

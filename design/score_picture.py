"""docs/pictures/score.svg: the picture of a score's report, and the figures of docs/how-to/score.md.

python -m design.score_picture

A sentence by nine mouth shapes, 150 ms late, against the plan of its phones.
"""

from pathlib import Path

import numpy as np

import fapengine
from fapengine.files.report.score_page import draw_openings, score_rows
from fapengine.mpeg4.track import FapTrack
from fapengine.scoring.mouth import mouth_of
from fapengine.scoring.score import score_mouth
from fapengine.speech.formats.registry import parse_timings
from fapengine.speech.formats.rhubarb import cues_of_phones, format_rhubarb

PICTURE = Path(__file__).resolve().parent.parent / "docs" / "pictures" / "score.svg"
SENTENCE = "My baby fell off a boat. Five big umbrellas move."
RATE_HZ = 60.0
LATE_FRAMES = 9


def main() -> None:
    spoken = fapengine.speak(SENTENCE, rate_hz=RATE_HZ)
    cues = format_rhubarb(cues_of_phones(spoken.phones, duration_s=spoken.duration_s), ".json")
    shaped = fapengine.animate(parse_timings(cues), rate_hz=RATE_HZ).track.values
    late = FapTrack.from_values(
        np.concatenate([np.repeat(shaped[:1], LATE_FRAMES, axis=0), shaped[:-LATE_FRAMES]]), rate_hz=RATE_HZ
    )
    made, truth = mouth_of(late), mouth_of(spoken.track)
    score = score_mouth(made, truth=truth, phones=spoken.phones)
    for name, rows in score_rows(score).items():
        print(name, *("   ".join(row) for row in rows), sep="\n  ")
    PICTURE.write_bytes(draw_openings(score, made, truth, spoken.phones))


if __name__ == "__main__":
    main()

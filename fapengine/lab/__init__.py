"""The laboratory on arrays: read recordings, fit a face model, drive a face by few markers, reduce, expand, score.

>>> from fapengine import lab
>>> session = lab.read("recordings/S03")  # doctest: +SKIP
>>> fitted = lab.fit(session, name="s03")  # doctest: +SKIP
>>> lab.tables_of(fitted)["phones"].rows[0]  # doctest: +SKIP

The functions are those of ``fapengine fit``, ``drive``, ``reduce`` and ``score``. Lengths are in mm, times in s,
rates in Hz; axes are +x to the subject's left, +y up, +z out of the face. Sessions can be made of arrays, too:

>>> import numpy as np
>>> places_mm = np.random.default_rng(1).normal(0, 30, (1, 5, 3)) + np.zeros((60, 1, 1))
>>> track = lab.MarkerTrack(positions_mm=places_mm, labels=("8.1", "8.2", "8.3", "8.4", "2.1"), rate_hz=100.0)
>>> session = lab.LoadedSession(lab.Session("S03", (lab.Take("rest", track),)))
>>> len(lab.reduce(track.positions_mm, 100.0, 0.5))
3
"""

from fapengine.app.drive_grid import Driven, DriveOptions, drive
from fapengine.app.fit import fit
from fapengine.app.score import score
from fapengine.capture.marker_track import Interval, MarkerTrack, Session, Take
from fapengine.files.profiles import save_profile
from fapengine.files.sessions import LoadedSession, read
from fapengine.geometry.rigid import triangulate
from fapengine.laboratory.fit import FitOptions, Fitted
from fapengine.laboratory.setup import Moment, Setup
from fapengine.laboratory.tables import Table, tables_of, weights_of_takes
from fapengine.models.via_points import ViaPoints
from fapengine.models.via_points import extract_via_points as reduce
from fapengine.scoring.statistics import compare, estimate
from fapengine.scoring.vertices import vertex_errors
from fapengine.trajectory.high_level import expand

__all__ = [
    "DriveOptions", "Driven", "FitOptions", "Fitted", "Interval", "LoadedSession", "MarkerTrack", "Moment", "Session",
    "Setup", "Table", "Take", "ViaPoints", "compare", "drive", "estimate", "expand", "fit", "read", "reduce",
    "save_profile", "score", "tables_of", "triangulate", "vertex_errors", "weights_of_takes",
]  # fmt: skip

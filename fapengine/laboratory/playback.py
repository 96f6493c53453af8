"""Captured takes as FAPs: what was recorded, on any face, with the head motion put back."""

import numpy as np
from scipy.spatial.transform import Rotation

from fapengine.laboratory.faces import split
from fapengine.laboratory.prepare import Displacements, Prepared
from fapengine.mpeg4 import fap
from fapengine.mpeg4.codable import to_codable
from fapengine.mpeg4.fapu import AU_RAD
from fapengine.mpeg4.track import FapTrack
from fapengine.profiles import Profile
from fapengine.trajectory.faps import displacements_to_faps


def captured_faps(take: Displacements, prepared: Prepared, profile: Profile) -> FapTrack:
    """Turn a take into FAPs: mouth, every other recorded point, and the turns of the head (FAP 48 to 50).

    The head turns yaw, then pitch, then roll about axes that move with it, as :mod:`fapengine.mesh.deform` turns it.
    Its shifts have no FAP.
    """
    weights, beyond = split(take.moved_mm.astype(np.float64), prepared, profile.space, profile.fapu)
    mouth = displacements_to_faps(profile.space.to_points_mm(weights), profile.space.points, profile.fapu)
    faps = mouth + beyond
    turns = Rotation.from_matrix(take.head.rotation).as_euler("YXZ")
    for number, angle in zip((49, 48, 50), turns.T, strict=True):
        faps[:, fap.column(number)] = angle / AU_RAD
    return FapTrack.of(np.asarray(to_codable(faps)), rate_hz=prepared.rate_hz)

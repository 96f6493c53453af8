"""A session whose truth is known: a shipped profile speaks, and markers on a standard face are recorded."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fapengine.capture.marker_track import Interval, MarkerTrack, Session, Take
from fapengine.files.profiles import load_profile
from fapengine.mesh.default_head.head import build_head
from fapengine.models.viseme_space import MARKERS
from fapengine.profiles import Profile
from fapengine.speech.phone_track import SILENCE, Phone, PhoneTrack
from fapengine.trajectory.targets import weights_of

from .dense_made import MadeFace, make_face

RATE_HZ = 50.0
SKULL = {
    "LFHD": (55, 90, 70),
    "RFHD": (-55, 90, 70),
    "LBHD": (70, 70, -40),
    "RBHD": (-70, 70, -40),
    "TOP": (0, 120, 20),
}
INNER_LIPS = tuple(f"2.{n}" for n in range(2, 10))
SPOKEN = ("p", "b", "m", "f", "v", "t", "s", "i", "aɪ", "æ", "u", "l")


@dataclass(frozen=True)
class Made:
    session: Session
    truth_mm: tuple[np.ndarray, ...]
    """Displacements of each take, (T, M, 3), in head axes."""
    profile: Profile


@pytest.fixture(scope="session")
def standard() -> Profile:
    return load_profile("grid_s1_en")


@pytest.fixture(scope="session")
def face():
    return build_head()


@pytest.fixture(scope="session")
def made() -> MadeFace:
    """A dense face whose truth is known."""
    return make_face(build_head(level="coarse"))


@pytest.fixture(scope="session")
def face_mm(face) -> dict[str, np.ndarray]:
    return {name: np.asarray(face.point_mm(name), np.float64) for name in face.feature_points}


def speech(rng: np.random.Generator, words: int = 12) -> PhoneTrack:
    phones, now = [Phone(SILENCE, 0.0, 0.5)], 0.5
    for _ in range(words):
        length = float(rng.uniform(0.07, 0.2))
        phones.append(Phone(str(rng.choice(SPOKEN)), now, now + length))
        now += length
    return PhoneTrack((*phones, Phone(SILENCE, now, now + 0.5)))


@pytest.fixture(scope="session")
def make(standard, face_mm) -> Callable[..., Made]:
    def made(
        takes: int = 8,
        *,
        head: bool = True,
        room: bool = True,
        noise_mm: float = 0.0,
        seed: int = 3,
        skull: bool = True,
    ) -> Made:
        """Takes of one session; ``head`` moves the head, ``room`` turns the recording's axes."""
        rng = np.random.default_rng(seed)
        labels = (*MARKERS, *INNER_LIPS)
        columns = [standard.space.points.index(name) for name in labels]
        neutral = np.stack([face_mm[name] for name in labels])
        recorded, truths = [], []
        for index in range(takes):
            phones = speech(rng)
            times = np.arange(round(phones.duration_s * RATE_HZ)) / RATE_HZ
            moved = standard.space.to_points_mm(weights_of(phones, standard, times, context=False))[:, columns]
            points = neutral + moved
            if skull:
                points = np.concatenate(
                    [points, np.tile(np.array([*SKULL.values()], float), (len(times), 1, 1))], axis=1
                )
            points = points + noise_mm * rng.normal(size=points.shape)
            if head:
                turn = Rotation.from_rotvec(np.outer(np.sin(2 * times + index), [0.1, 0.2, 0.05])).as_matrix()
                points = np.einsum("tij,tmj->tmi", turn, points) + np.outer(np.cos(times), [10.0, 5.0, -3.0])[:, None]
            if room:
                points = points @ Rotation.from_rotvec([0.4, -1.2, 0.3]).as_matrix().T + [500.0, 100.0, -900.0]
            names = (*labels, *SKULL) if skull else labels
            track = MarkerTrack(positions_mm=points, labels=names, rate_hz=RATE_HZ)
            intervals = tuple(Interval(p.label, p.start_s, p.end_s) for p in phones.phones)
            recorded.append(Take(f"take{index}", track, intervals))
            truths.append(moved)
        return Made(Session("S01", tuple(recorded)), tuple(truths), standard)

    return made


def edited(session: Session, change: Callable[[Take], MarkerTrack]) -> Session:
    """Another recording of the same takes."""
    return replace(session, takes=tuple(replace(take, markers=change(take)) for take in session.takes))

"""What the program says and makes is what it said and made: texts, about 300 jobs, and live sessions frame by frame.

A text that was changed on purpose: ``python -m tests.snapshots --bless texts`` in the same commit, whose diff shows the
old words and the new. Digests of jobs change only where the result was meant to change.
"""

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.snapshots import jobs, sessions, texts
from tests.snapshots.fresh import Fresh
from tests.snapshots.inputs import make_inputs

JOBS = jobs.all_jobs()
EXPECTED = jobs.read_digests()
CONVERSATIONS = sessions.conversations()
REPLAYED = sessions.read_digests()
PRINTED, KEYS = (texts.sections_of(texts.kept(name)) for name in (texts.PRINTED, texts.KEYS))


@pytest.fixture(scope="module")
def fresh() -> Iterator[Fresh]:
    """Where jobs run: each in a process of its own."""
    with Fresh() as process:
        yield process


@pytest.fixture(scope="module")
def inputs(fresh: Fresh, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of the inputs that all jobs share."""
    folder = tmp_path_factory.mktemp("inputs")
    fresh.call(make_inputs, folder)
    return folder


def test_there_are_as_many_as_there_were() -> None:
    assert len(JOBS) >= 298
    assert sum(not job.is_nightly for job in JOBS) >= 269
    assert set(EXPECTED) == {job.name for job in JOBS}
    assert len(CONVERSATIONS) >= 15
    assert set(REPLAYED) == set(CONVERSATIONS)
    assert len(list(texts.FOLDER.rglob("*.txt"))) >= 26
    assert texts.kept("errors.txt").count("\n$ ") >= 120


def test_texts_are_as_they_were(fresh: Fresh, inputs: Path, tmp_path: Path) -> None:
    found = fresh.call(texts.all_texts, inputs, tmp_path)
    for name, text in found.items():
        assert text.splitlines() == texts.kept(name).splitlines(), name
    held = {path.relative_to(texts.FOLDER).as_posix() for path in texts.FOLDER.rglob("*.*")}
    assert held == {*found, texts.PRINTED, texts.KEYS}


@pytest.mark.parametrize(
    "job", [pytest.param(job, id=job.name, marks=[pytest.mark.nightly] * job.is_nightly) for job in JOBS]
)
def test_a_job_makes_what_it_made(job: jobs.Job, fresh: Fresh, inputs: Path, tmp_path: Path) -> None:
    result = fresh.call(jobs.run_job, job, inputs, tmp_path / "job")
    assert jobs.differences(EXPECTED.get(job.name, {}), result.digests) == []
    assert result.printed == PRINTED.get(job.name, "")
    assert ", ".join(result.keys) == KEYS.get(job.name, "")


@pytest.mark.parametrize("name", sessions.VOICED)
def test_a_face_moves_as_it_moved(name: str, fresh: Fresh) -> None:
    assert fresh.call(sessions.replay, name) == REPLAYED[name]

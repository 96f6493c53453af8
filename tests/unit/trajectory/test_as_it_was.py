"""Phones, moods and gestures move the face as they moved it: the snapshots of commands that need only phones."""

from pathlib import Path

import pytest

from tests.snapshots import inputs, jobs

EXPECTED = jobs.read_digests()
JOBS = {job.name: job for job in jobs.all_jobs()}
NAMES = (
    "animate phones", "animate phones, odd ones", "animate moods", "animate without some", "animate words",
)  # fmt: skip


@pytest.mark.parametrize("name", NAMES)
def test_phones_move_the_face_as_they_moved_it(name: str, tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    inputs.write_texts(tmp_path / "in")
    made = jobs.run_job(JOBS[name], tmp_path / "in", tmp_path / "job").digests
    assert jobs.differences(EXPECTED[name], made) == []

import tarfile
from collections.abc import Mapping
from pathlib import Path

import pytest

ARCHIVE = Path(__file__).resolve().parents[2] / "vectors" / "fba" / "vectors.tar.xz"


@pytest.fixture(scope="session")
def vectors() -> Mapping[str, bytes]:
    """Files of the 30 FBA vectors: ``NAME.fap`` and ``.epf`` in, ``.fba`` and ``.decoded.fap`` out (PROVENANCE.md)."""
    with tarfile.open(ARCHIVE) as archive:
        return {member.name: archive.extractfile(member).read() for member in archive}

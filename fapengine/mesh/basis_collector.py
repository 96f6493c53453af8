"""Collecting a deformation basis channel by channel."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from fapengine._arrays import Array, Indices
from fapengine.mesh.face_mesh import Channel, DeformationBasis

NEGLIGIBLE_MM = 0.08
"""Displacements below this at 1000 FAPU are dropped."""


class BasisCollector:
    """Collects channels and their displacements into a basis.

    Stateful.
    """

    def __init__(self, vertex_count: int) -> None:
        self._count = vertex_count
        self._channels: list[Channel] = []
        self._entries: list[tuple[Indices, int, Array]] = []

    def add(self, channel: Channel, vertices: Indices, displacement_mm: Array) -> None:
        """Add displacements, (N, 3) mm per FAPU, of vertices (N,) to a channel."""
        kept = np.abs(displacement_mm).max(axis=1) * 1000 > NEGLIGIBLE_MM
        self._add(channel, vertices[kept], np.pad(displacement_mm[kept], ((0, 0), (0, 1))))

    def add_shade(self, channel: Channel, vertices: Indices, shade: Array | float = 0.0) -> None:
        """Add entries without displacement for vertices (N,): the change of the shade per FAPU, (N,) or one for all.

        With 0 they are for vertices whose normals turn by more than their bone's rotation.
        """
        rows = np.zeros((len(vertices), 4))
        rows[:, 3] = shade
        self._add(channel, vertices, rows)

    def _add(self, channel: Channel, vertices: Indices, rows: Array) -> None:
        if channel not in self._channels:
            self._channels.append(channel)
        self._entries.append((vertices, self._channels.index(channel), rows + 0.0))  # -0 becomes 0

    def gathered(self) -> tuple[DeformationBasis, Array]:
        """Return the basis, and the change of the shade of each entry, (N,)."""
        basis, rows = gather(self._count, self._channels, self._entries)
        return basis, rows[:, 3]


def gather(
    vertex_count: int,
    channels: Sequence[Channel],
    entries: Sequence[tuple[Indices, int, Array]],
    mix: NDArray[np.float32] | None = None,
) -> tuple[DeformationBasis, Array]:
    """Make a basis, sorted by vertex, from vertices (N,), their channel or row of ``mix``, and rows (N, 3 or more).

    A row is a displacement, mm, and further values. Rows of the same vertex and channel are added up. Returns the
    basis, and the row of each of its entries.
    """
    width = len(channels) if mix is None else len(mix)
    columns = np.repeat([column for _, column, _ in entries], [len(vertices) for vertices, _, _ in entries])
    keys = width * np.concatenate([vertices for vertices, _, _ in entries]) + columns
    order = np.argsort(keys, kind="stable")
    keys, first = np.unique(keys[order], return_index=True)
    rows = np.add.reduceat(np.concatenate([rows for _, _, rows in entries])[order], first, axis=0)
    basis = DeformationBasis(
        channels=tuple(channels),
        offsets=np.concatenate([[0], np.cumsum(np.bincount(keys // width, minlength=vertex_count))]),
        entry_channels=keys % width,
        entry_mm=rows[:, :3].astype(np.float32),
        mix=mix,
    )
    return basis, rows

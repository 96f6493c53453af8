"""Collecting a deformation basis channel by channel."""

import numpy as np

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
        self._entries: list[tuple[Indices, int, Array, Array]] = []

    def add(self, channel: Channel, vertices: Indices, displacement_mm: Array) -> None:
        """Add displacements, (N, 3) mm per FAPU, of vertices (N,) to a channel."""
        kept = np.abs(displacement_mm).max(axis=1) * 1000 > NEGLIGIBLE_MM
        self._add(channel, vertices[kept], displacement_mm[kept], np.zeros(kept.sum()))

    def add_still(self, channel: Channel, vertices: Indices) -> None:
        """Add entries without displacement for vertices (N,), whose normals turn by more than their bone's rotation."""
        self._add(channel, vertices, np.zeros((len(vertices), 3)), np.zeros(len(vertices)))

    def add_shade(self, channel: Channel, vertices: Indices, shade: Array) -> None:
        """Add the change of the shade per FAPU, (N,), of vertices (N,): an entry of the folds."""
        self._add(channel, vertices, np.zeros((len(vertices), 3)), shade)

    def _add(self, channel: Channel, vertices: Indices, displacement_mm: Array, shade: Array) -> None:
        if channel not in self._channels:
            self._channels.append(channel)
        self._entries.append((vertices, self._channels.index(channel), displacement_mm, shade))

    def gathered(self) -> tuple[DeformationBasis, Array]:
        """Return the basis, sorted by vertex, and the change of the shade of each entry, (N,)."""
        vertices = np.concatenate([entry[0] for entry in self._entries])
        channels = np.concatenate([np.full(len(entry[0]), entry[1]) for entry in self._entries])
        moves = np.concatenate([entry[2] for entry in self._entries])
        # What was added twice, of the same channel to the same vertex, becomes one entry.
        keys, entry = np.unique(vertices * len(self._channels) + channels, return_inverse=True)
        summed = np.stack([np.bincount(entry, moves[:, axis], len(keys)) for axis in range(3)], axis=-1)
        shades: Array = np.bincount(entry, np.concatenate([each[3] for each in self._entries]), len(keys)).astype(float)
        owners = keys // len(self._channels)
        basis = DeformationBasis(
            channels=tuple(self._channels),
            offsets=np.concatenate([[0], np.cumsum(np.bincount(owners, minlength=self._count))]),
            entry_channels=keys % len(self._channels),
            entry_mm=summed.astype(np.float32),
        )
        return basis, shades

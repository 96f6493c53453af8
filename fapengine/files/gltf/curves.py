"""Curves of a glTF animation: weights of morph targets, turns and places of nodes."""

import numpy as np
from numpy.typing import NDArray

from fapengine.files.gltf.writing import Row, Writer
from fapengine.models.keyed_curve import KeyedCurve, key_curve

Array = NDArray[np.float64]

WEIGHT_TOLERANCE, TURN_TOLERANCE = 0.01, 0.002
"""Largest error of cubic curves: of a weight, and of a quaternion's components (0.23 degrees)."""


def quaternions_of(matrices: Array) -> Array:
    """(T, 4) x y z w of rotations (T, 3, 3); of the two that mean a turn, the one near to that of the frame before."""
    from scipy.spatial.transform import Rotation

    quaternions = Rotation.from_matrix(matrices).as_quat()
    flips = np.cumprod(np.where((quaternions[1:] * quaternions[:-1]).sum(axis=1) < 0, -1.0, 1.0))
    quaternions[1:] *= flips[:, None]
    return np.asarray(quaternions)


class Curves:
    """Samplers and channels of one animation. Stateful."""

    def __init__(self, writer: Writer, rate_hz: float, keys: str) -> None:
        self._writer, self._rate_hz, self._keys = writer, rate_hz, keys
        self._made: dict[tuple[bytes, str], int] = {}
        self.samplers: list[Row] = []
        self.channels: list[Row] = []
        self.count = 0

    def add_weights(self, node: int, weights: Array | None) -> None:
        """Add the weights of a node's morph targets, (T, targets), if any move."""
        if weights is not None:
            self._add(node, "weights", weights, WEIGHT_TOLERANCE)

    def add_turns(self, node: int, quaternions: Array) -> None:
        """Add the turns of a node, (T, 4)."""
        self._add(node, "rotation", quaternions, TURN_TOLERANCE)

    def add_places(self, node: int, places: Array) -> None:
        """Add the places of a node, (T, 3)."""
        self._add(node, "translation", places, WEIGHT_TOLERANCE)

    def row(self, name: str) -> Row:
        """Return the animation's row."""
        return {"name": name, "samplers": self.samplers, "channels": self.channels}

    def _add(self, node: int, path: str, values: Array, tolerance: float) -> None:
        key = values.tobytes(), path
        if key not in self._made:  # meshes of one face have the same weights
            curve = key_curve(values, self._rate_hz, self._keys, tolerance)
            self.count += len(curve.times_s)
            self._made[key] = len(self.samplers)
            self.samplers.append(self._sampler(curve, path))
        self.channels.append({"sampler": self._made[key], "target": {"node": node, "path": path}})

    def _sampler(self, curve: KeyedCurve, path: str) -> Row:
        times = self._writer.accessor(curve.times_s.astype(np.float32), bounds=True)
        out = curve.values
        if curve.slopes is not None:  # at each key the slope before, the value and the slope behind
            out = np.stack([curve.slopes, curve.values, curve.slopes], axis=1)
        flat = out.reshape(-1) if path == "weights" else out.reshape(-1, curve.values.shape[1])
        row = {"input": times, "output": self._writer.accessor(flat.astype(np.float32))}
        return row if curve.slopes is None else row | {"interpolation": "CUBICSPLINE"}

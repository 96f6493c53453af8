"""Distances of an adapted head from its scan, in words."""

from fapengine.models.adapted_head import Nearness


def spell_nearness(nearness: Nearness) -> str:
    """Say how near the head comes to the scan."""
    before, after = nearness.front_mm
    said = f"front of the face to the scan: {before:.2f} mm before, {after:.2f} mm after"
    if nearness.left_out_mm is None:
        return f"{said}; too few feature points to leave some out"
    before, after = nearness.left_out_mm
    return f"{said}; {nearness.left_out} feature points, left out in turn: {before:.2f} mm before, {after:.2f} mm after"

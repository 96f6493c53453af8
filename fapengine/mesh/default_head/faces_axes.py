"""Sex, build and age among the measured differences between faces, found by ``design/learn_axes.py``."""

# fmt: off
AXES: dict[str, tuple[float, ...]] = {
    "sex": (0.06, 1.03, 0.16, 0.41, -0.24, -0.32, -0.07, -0.26, 0.09, 0.10, 0.28, 0.14, -0.33, 0.81, -0.45, -0.13),
    "build": (
        0.77, 0.87, -0.49, -0.18, -0.19, 0.19, -0.46, -0.49, -0.11, -0.34, -0.04, -0.57, -0.49, -0.05, 0.41, 0.28,
    ),
    "age": (0.79, 0.42, -0.43, 0.75, 0.23, 0.04, 0.35, 0.15, -0.35, 0.03, -0.41, -0.44, 0.69, 0.47, 0.35, 0.27),
}
# fmt: on
"""Weights of the modes for one step of an axis, in standard deviations."""
MIDDLE_AGE = 0.25
"""Age of the mean face; one step of the axis leads from it to 1."""

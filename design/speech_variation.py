"""Measure natural variation of speech: what a speaker adds to the plan, for :mod:`fapengine.trajectory.variation`.

    python -m design.speech_variation [--train data/speech_train.npz]

Training sentences are planned from their phones. The residual of the captured motion during speech, minus its mean over
all sentences, is split into a symmetric and an asymmetric part. The largest principal components of each become FAPs,
scaled to one standard deviation. Prints the tables of the module.
"""

import argparse
import sys

import numpy as np

from bench.fidelity import Clip, add_files, captured, learn, ours, read_files
from design.fit_profile import is_mistimed
from fapengine.mpeg4 import fap
from fapengine.trajectory.faps import DETERMINED, displacements_to_faps
from fapengine.trajectory.variation import PARTS

Array = np.ndarray
KEPT = 3
"""Principal components of each kind that are kept."""
LIPS = (0.5, 0.65, 0.5)
"""Share of the measured size that each symmetric component shows at the lips; asymmetric ones show all."""
JAW, CORNERS = 0.9, 0.85
"""The same of the jaw and of the height of the corners, which tell a lip reader less. All were chosen on training
sentences alone: measured on 340, judged on 80 others, in two such splits."""
OF_FAP = {3: JAW, 12: CORNERS, 13: CORNERS, 59: CORNERS, 60: CORNERS}
SPECTRUM = 128
LEAST_FAPU = 0.3


def mirrored(points: Array, names: list[str]) -> Array:
    """(T, P, 2) of the mirrored face: point 8.3 is 8.4 of it, 2.2 is itself, and so on; x changes its sign."""
    others = {
        "8.3": "8.4", "8.5": "8.6", "8.7": "8.8", "5.1": "5.2", "5.3": "5.4", "2.4": "2.5", "2.6": "2.7", "2.8": "2.9",
    }  # fmt: skip
    others |= {right: left for left, right in others.items()}
    return points[:, [names.index(others.get(name, name)) for name in names]] * (-1.0, 1.0)


def directions(residuals: list[Array], rate_hz: float) -> tuple[Array, Array, Array]:
    """Largest components of residuals, (T, P, 2) mm each.

    Returns
    -------
    sizes : (KEPT, P, 2) float64, mm
        One standard deviation.
    shares : (KEPT,) float64
        Of the power.
    quantiles_hz : (KEPT, PARTS + 1) float64
        Frequencies that divide the power of each into equal parts. A sentence's mean is slower than all of them.
    """
    flat = [one.reshape(len(one), -1) for one in residuals]
    together = np.concatenate(flat)
    power, modes = np.linalg.eigh(together.T @ together / len(together))
    power, modes = power[::-1], modes[:, ::-1][:, :KEPT]
    courses = [one @ modes for one in flat]
    posture = np.sum([len(one) * one.mean(axis=0) ** 2 for one in courses], axis=0)
    moving = np.sum([len(one) * one.var(axis=0) for one in courses], axis=0)
    windowed = [(one - one.mean(axis=0)) * np.hanning(len(one))[:, None] for one in courses]
    spectra = np.sum([np.abs(np.fft.rfft(one, SPECTRUM, axis=0)) ** 2 for one in windowed], axis=0)
    spectra *= moving / spectra.sum(axis=0)
    spectra[0] += posture
    hertz = np.fft.rfftfreq(SPECTRUM, 1 / rate_hz)
    edges = np.concatenate([[0.0], np.minimum(hertz + hertz[1] / 2, hertz[-1])])
    below = np.concatenate([np.zeros((1, KEPT)), np.cumsum(spectra, axis=0) / spectra.sum(axis=0)])
    quantiles = [np.interp(np.linspace(0, 1, PARTS + 1), one, edges) for one in below.T]
    return (modes * np.sqrt(power[:KEPT])).T.reshape(KEPT, -1, 2), power[:KEPT] / power.sum(), np.array(quantiles)


def main(arguments: list[str] | None = None) -> int:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_files(parser)
    training, tested = read_files(parser.parse_args(arguments))
    rate_hz = tested.rate_hz
    profile = learn(training, rate_hz).profile
    names = list(profile.space.points)
    lips = names.index("2.2"), names.index("2.3")

    def residual(clip: Clip) -> Array | None:
        times = np.arange(len(clip.points)) / rate_hz
        shown, planned = (method(clip, profile, times) for method in (captured(at_keys=False), ours("context")))
        openings = [points[:, lips[0], 1] - points[:, lips[1], 1] for points in (shown, planned)]
        return None if is_mistimed(*openings) else (shown - planned)[clip.spoken, :, :2]

    residuals = [one for one in map(residual, training) if one is not None]
    mean = np.concatenate(residuals).mean(axis=0)
    print(f"{len(residuals)} sentences")
    for kind, sign, shares in (("asymmetric", -1.0, None), ("symmetric", 1.0, LIPS)):
        parts = [(one + sign * mirrored(one, names)) / 2 for one in (left - mean for left in residuals)]
        for index, (size, power, quantiles) in enumerate(zip(*directions(parts, rate_hz), strict=True)):
            moved = np.concatenate([size, np.zeros((len(names), 1))], axis=1)[None]
            faps = displacements_to_faps(moved, names, profile.fapu)[0]
            sizes = {n: (OF_FAP.get(n, shares[index]) if shares else 1.0) * faps[fap.column(n)] for n in DETERMINED}
            row = ", ".join(f"{n} = {value:.1f}" for n, value in sizes.items() if abs(value) > LEAST_FAPU)
            print(f"[[directions]]  # {kind}, {power:.0%} of its power\nfapu = {{ {row} }}")
            print(f"quantiles_hz = {quantiles.round(2).tolist()}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())

"""Measure natural variation of speech: what a speaker adds to the plan, for :mod:`fapengine.trajectory.variation`.

    python -m design.speech_variation [--train data/speech_train.npz]

Training sentences are planned from their phones. The residual of the captured motion during speech, minus the mean of
each sentence, is split into a symmetric and an asymmetric part. The largest principal components of each become FAPs,
scaled to one standard deviation. Prints the tables of the module.
"""

import argparse
import sys

import numpy as np

from bench.fidelity import Clip, add_files, captured, learn, ours, read_files
from design.fit_profile import is_mistimed
from fapengine.mpeg4 import fap
from fapengine.trajectory.faps import DETERMINED, displacements_to_faps
from fapengine.trajectory.variation import ASYMMETRIC_SHARE, QUANTILES_HZ, SYMMETRIC_SHARE

Array = np.ndarray
KEPT = {"asymmetric": 3, "symmetric": 2}
"""Principal components that are kept."""
SPECTRUM = 128
LEAST_FAPU = 0.3


def mirrored(points: Array, names: list[str]) -> Array:
    """(T, P, 2) of the mirrored face: point 8.3 is 8.4 of it, 2.2 is itself, and so on; x changes its sign."""
    others = {
        "8.3": "8.4", "8.5": "8.6", "8.7": "8.8", "5.1": "5.2", "5.3": "5.4", "2.4": "2.5", "2.6": "2.7", "2.8": "2.9",
    }  # fmt: skip
    others |= {right: left for left, right in others.items()}
    return points[:, [names.index(others.get(name, name)) for name in names]] * (-1.0, 1.0)


def directions(residuals: list[Array], kept: int) -> tuple[Array, Array, Array]:
    """Largest components, (kept, P, 2) mm, their shares of the power, and (kept, bins) power by frequency."""
    flat = [one.reshape(len(one), -1) for one in residuals]
    together = np.concatenate(flat)
    power, modes = np.linalg.eigh(together.T @ together / len(together))
    power, modes = power[::-1], modes[:, ::-1][:, :kept]
    courses = [(one @ modes - (one @ modes).mean(axis=0)) * np.hanning(len(one))[:, None] for one in flat]
    spectrum = np.sum([np.abs(np.fft.rfft(one, SPECTRUM, axis=0)) ** 2 for one in courses], axis=0)
    sizes = (modes * np.sqrt(power[:kept])).T.reshape(kept, -1, 2)
    return sizes, power[:kept] / power.sum(), spectrum.T


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
        if is_mistimed(*openings):
            return None
        left = (shown - planned)[clip.spoken, :, :2]
        return left - left.mean(axis=0)

    residuals = [one for one in map(residual, training) if one is not None]
    print(f"{len(residuals)} sentences")
    hertz, quantiles = np.fft.rfftfreq(SPECTRUM, 1 / rate_hz), []
    for kind, sign, share in (("asymmetric", -1.0, ASYMMETRIC_SHARE), ("symmetric", 1.0, SYMMETRIC_SHARE)):
        sizes, shares, spectra = directions([(one + sign * mirrored(one, names)) / 2 for one in residuals], KEPT[kind])
        for size, of_power, spectrum in zip(sizes, shares, spectra, strict=True):
            moved = np.concatenate([size, np.zeros((len(names), 1))], axis=1)[None]
            faps = share * displacements_to_faps(moved, names, profile.fapu)[0]
            row = {n: round(float(faps[fap.column(n)]), 1) for n in DETERMINED if abs(faps[fap.column(n)]) > LEAST_FAPU}
            print(f"{kind}, {of_power:.0%} of its power: {row}")
            total = np.concatenate([[0.0], np.cumsum(spectrum)]) / spectrum.sum()
            places = np.linspace(0, 1, len(QUANTILES_HZ))
            quantiles.append(np.interp(places, total, np.concatenate([[0.0], hertz])))
    print("QUANTILES_HZ, mean:", np.mean(quantiles, axis=0).round(2).tolist())
    return 0


if __name__ == "__main__":
    sys.exit(main())

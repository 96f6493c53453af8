"""TRC, the text format of Motion Analysis and OpenSim: five lines of header, then a line a frame."""

import numpy as np

from fapengine.capture.marker_track import MarkerTrack
from fapengine.capture.raw import RawTrack
from fapengine.capture.text import decode_text, numbers, rate_of, whole
from fapengine.errors import DataError, TruncatedError

FIRST_COLUMNS = 2
"""Frame number and time."""


def parse_trc(data: bytes) -> RawTrack:
    """Read a recording.

    Raises
    ------
    TruncatedError
        If it ends within its header, or without a frame.
    DataError
        If a header field or a cell is wrong; ``where`` is the line.
    """
    lines = decode_text(data, "TRC").splitlines()
    if not lines or not lines[0].startswith("PathFileType"):
        raise DataError(f"TRC: got {(lines or [''])[0]!r:.40}, expected PathFileType", where="line 1")
    if len(lines) < 6:
        raise TruncatedError(
            f"TRC: got {len(lines)} lines, expected a header of 5 and frames", where=f"line {len(lines)}"
        )
    rows = [[cell.strip() for cell in (line.split("\t") if "\t" in line else line.split())] for line in lines]
    fields = dict(zip((key.lower() for key in rows[1]), rows[2], strict=False))
    labels, columns = _names(rows[3][FIRST_COLUMNS:])
    if not labels:
        raise DataError("TRC: got no marker name, expected some", where="line 4")
    first = next((n for n in range(4, len(rows)) if rows[n] and rows[n][0].lstrip("-").isdigit()), None)
    if first is None:
        raise TruncatedError("TRC: got no frame", where=f"line {len(rows)}")
    body = [row for row in rows[first:] if any(row)]
    filled = np.array([max(n for n, cell in enumerate(row) if cell) + 1 for row in body])
    held, odd = divmod(int(filled.max()) - FIRST_COLUMNS, 3)
    if odd and held >= columns[-1] + 1:
        raise DataError(
            f"TRC: got {filled.max()} cells, expected {FIRST_COLUMNS} and three for each of"
            f" {len(labels)} named or more markers",
            where=f"line {first + int(filled.argmax()) + 1}",
        )
    count = max(held, columns[-1] + 1)
    table = numbers(body, FIRST_COLUMNS + 3 * count, first + 1)
    stated = _rate(fields)
    positions = whole(table[:, FIRST_COLUMNS:].reshape(len(table), count, 3)[:, columns])
    wanted = fields.get("nummarkers", "")
    notes: tuple[str, ...] = ()
    if count > len(labels):
        notes = (f"{count - len(labels)} of {count} trajectories have no name and are left out",)
    elif wanted.isdigit() and int(wanted) != len(labels):
        notes = (f"NumMarkers says {wanted}, but {len(labels)} are named",)
    return RawTrack(
        positions=positions,
        labels=labels,
        rate_hz=stated or rate_of(table[:, 1]),
        units=fields.get("units") or None,
        notes=notes,
    )


def _names(cells: list[str]) -> tuple[tuple[str, ...], list[int]]:
    """Names, and the trajectory that each is of: they stand over the first of its three columns, or close together."""
    at = [index for index, cell in enumerate(cells) if cell]
    spread = all(index % 3 == 0 for index in at)
    return tuple(cells[index] for index in at), [index // 3 for index in at] if spread else list(range(len(at)))


def _rate(fields: dict[str, str]) -> float | None:
    try:
        rate = float(fields.get("datarate", ""))
    except ValueError:
        return None
    return rate if np.isfinite(rate) and rate > 0 else None


def format_trc(track: MarkerTrack) -> bytes:
    """Write a recording in mm; what was not seen is left empty."""
    frames, count = track.positions_mm.shape[:2]
    rate = f"{track.rate_hz:.10g}"
    lines = [
        "PathFileType\t4\t(X/Y/Z)\tfapengine.trc",
        "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames",
        f"{rate}\t{rate}\t{frames}\t{count}\tmm\t{rate}\t1\t{frames}",
        "Frame#\tTime\t" + "\t\t\t".join(track.labels) + "\t\t",
        "\t\t" + "\t".join(f"X{n}\tY{n}\tZ{n}" for n in range(1, count + 1)),
        "",
    ]
    for index, frame in enumerate(track.positions_mm):
        cells = ("" if np.isnan(value) else f"{value:.5f}" for value in frame.ravel())
        lines.append(f"{index + 1}\t{index / track.rate_hz:.6f}\t" + "\t".join(cells))
    return ("\n".join(lines) + "\n").encode()

"""Small recordings of articulographs and skeletons, as bytes."""

import io

import numpy as np
import scipy.io

from fapengine.capture.marker_track import MarkerTrack


def pos_file(track: MarkerTrack, *, header: bool = True) -> bytes:
    """A Carstens recording; without a header that of an AG500, which has 12 sensors at 200 Hz."""
    places = track.positions_mm[..., [0, 2, 1]] * [1, -1, 1]  # the file's z is up
    sensors = np.zeros((*places.shape[:2], 7), "<f4")
    sensors[..., :3] = places
    sensors[..., 3:] = 7.0
    text = f"AG50xDATA_V003\n00000100\nNumberOfChannels={places.shape[1]}\nSamplingFrequencyHz={track.rate_hz:g}\n"
    return (text.encode().ljust(100, b"\0") if header else b"") + sensors.tobytes()


def wave_file(track: MarkerTrack) -> bytes:
    """A table of an NDI Wave; a sensor that was not seen has empty cells."""
    head = ["Time[s]", "MeasId", "WavId"]
    for sensor in range(len(track.labels)):
        head += [
            f"Sensor {sensor + 1} Id",
            f"Sensor {sensor + 1} Status",
            "X[mm]",
            "Y[mm]",
            "Z[mm]",
            "Q0",
            "Qx",
            "Qy",
            "Qz",
        ]
    rows = ["\t".join(head)]
    for number, places in enumerate(track.positions_mm):
        cells = [f"{number / track.rate_hz:.4f}", str(number), str(220 * number)]
        for sensor, place in enumerate(places):
            seen = [f"{value:.6f}" for value in place] + ["0.5"] * 4
            cells += [str(sensor), "55", *(seen if np.isfinite(place).all() else [""] * 7)]
        rows.append("\t".join(cells))
    return "\n".join(rows).encode()


def mview_file(track: MarkerTrack, **changes: object) -> bytes:
    """A recording in MVIEW's format, with sound."""
    places = track.positions_mm[..., [0, 2, 1]] * [1, -1, 1]
    rows = [("AUDIO", 16000.0, np.zeros((16, 1)))]
    rows += [
        (label, track.rate_hz, np.hstack([places[:, index], np.zeros((len(places), 3))]))
        for index, label in enumerate(track.labels)
    ]
    signals = np.array(rows, dtype=[("NAME", "O"), ("SRATE", "O"), ("SIGNAL", "O")])
    for name, value in changes.items():
        signals[1][name] = value
    buffer = io.BytesIO()
    scipy.io.savemat(buffer, {"take": signals}, do_compression=True)
    return buffer.getvalue()


BVH = b"""HIERARCHY
ROOT hip
{
  OFFSET 0 0 0
  CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
  JOINT knee
  {
    OFFSET 0 -10 0
    CHANNELS 3 Zrotation Xrotation Yrotation
    End Site
    {
      OFFSET 0 -5 2
    }
  }
}
MOTION
Frames: 2
Frame Time: 0.04
1 2 3 0 0 0 0 0 0
1 2 3 90 0 0 0 0 90
"""

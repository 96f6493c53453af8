"""Run by test_sound.py in a process of its own: plays clicks, hears them at the sink's monitor, compares.

Writes JSON: how far, at each click heard, the place that the player told was from the click's.
"""

import json
import sys
import time

import numpy as np
import sounddevice

from fapengine.audio.device import Player, devices

RATE_HZ = 22_050


def main() -> None:
    heard: list[float] = []

    def listen(data: np.ndarray, frames: int, times: object, status: object) -> None:
        began_s = time.monotonic() - (times.currentTime - times.inputBufferAdcTime)
        heard.extend(began_s + np.flatnonzero(np.abs(data[:, 0].astype(int)) > 8000) / RATE_HZ)

    clicks_s = np.arange(0.5, 2.4, 0.25)
    sound = np.zeros(round(2.5 * RATE_HZ), np.int16)
    sound[np.rint(clicks_s * RATE_HZ).astype(int)] = 20_000
    microphone = sounddevice.InputStream(samplerate=RATE_HZ, channels=1, dtype="int16", callback=listen, latency=0.05)
    told: list[tuple[float, float]] = []
    with microphone, Player(RATE_HZ) as player:
        while not player.is_settled(time.monotonic()):
            time.sleep(0.01)
        number = player.play(sound)
        begun = time.monotonic()
        while not player.is_over(number, now := time.monotonic()):
            if (place := player.position_s(number, now)) is not None:
                told.append((now, place))
            time.sleep(0.004)
        took_s = time.monotonic() - begun
        second = player.play(np.full(RATE_HZ * 60, 12_000, np.int16))
        time.sleep(0.3)
        player.stop()
        time.sleep(0.4)
        stopped = player.is_over(second, time.monotonic())
    onsets = [at for before, at in zip([-1.0, *sorted(heard)[:-1]], sorted(heard), strict=True) if at - before > 0.1]
    at_s, places = np.array(told).T
    off = np.interp(onsets[: len(clicks_s)], at_s, places) - clicks_s[: len(onsets)]
    answer = {
        "off_s": off.tolist(), "took_s": took_s, "stopped": bool(stopped), "description": player.description,
        "underruns": player.clock.underruns, "devices": [one.name for one in devices()],
        "backwards": bool((np.diff(places) < 0).any()),
    }  # fmt: skip
    json.dump(answer, sys.stdout)


if __name__ == "__main__":
    main()

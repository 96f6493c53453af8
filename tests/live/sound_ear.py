"""Run by test_server_sound.py in a process of its own: hears the sound card's monitor; a line a time, loudness."""

import time

import numpy as np
import sounddevice


def main() -> None:
    def listen(data: np.ndarray, frames: int, times: object, status: object) -> None:
        loudness = float(np.sqrt(np.mean(np.square(data[:, 0].astype(float)))))
        print(f"{time.monotonic() - (times.currentTime - times.inputBufferAdcTime):.4f} {loudness:.1f}", flush=True)

    with sounddevice.InputStream(
        samplerate=22_050, channels=1, dtype="int16", blocksize=441, latency=0.05, callback=listen
    ):
        time.sleep(1000)  # it is killed before


if __name__ == "__main__":
    main()

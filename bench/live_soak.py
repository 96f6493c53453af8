"""A server in use for a long time: what grows, and what stays undone.

    python -m bench.live_soak [--minutes 30] [--sessions 40] [--json FILE]

The server is ``fapengine serve`` in a process of its own, with every kind of sink. Sessions speak all the time, phone
by phone with acknowledgements; some stop in the middle of a word, cancel, leave, and come back under another name;
streams connect and hang up, in the middle of a packet too; one peer sends rubbish. Memory, files, queues and counts are
read every second. Left with 1 if something grew or was left over.
"""

import argparse
import json
import os
import random
import socket
import sys
import time
from dataclasses import asdict, dataclass
from pathlib import Path

from bench.live import Server, serving
from bench.live_load import Load, listening, name_of
from fapengine.wire import osc
from fapengine.wire.framing import encode_length, encode_slip

MEMORY_GROWTH_MB = 4.0
"""From the middle of the run to its end: allocators settle, caches fill."""
FILES_GROWTH = 3
CONFIG = "[limits]\nidle_close_s = 3\nsilence_s = 1\nwait_s = 3\n"
EXTRA_SINKS = ("vmc", "vrchat", "livelink", "named", "fba")


@dataclass(frozen=True)
class Sample:
    """What was seen at one moment."""

    time_s: float
    memory_mb: float
    files: int
    sessions: int
    streams: int
    waiting: int
    """Packets."""
    frames: int
    skipped: int
    utterances: int
    over: int
    """Utterances that finished, were cancelled or given up."""
    faults: int


def look(server: Server, start_s: float) -> Sample:
    """Take a sample."""
    process = Path(f"/proc/{server.process.pid}")
    pages = int((process / "statm").read_text().split()[1])
    told = server.metrics()

    def of(name: str, kind: str = "") -> int:
        return int(told[f'fapengine_{name}_total{{kind="{kind}"}}' if kind else f"fapengine_{name}"])

    sessions = sum(value for key, value in told.items() if key.startswith("fapengine_sessions{"))
    over = sum(of("speech", kind) for kind in ("finished", "cancelled", "unended"))
    return Sample(
        time_s=round(time.monotonic() - start_s, 1),
        memory_mb=pages * os.sysconf("SC_PAGE_SIZE") / 2**20,
        files=len(list((process / "fd").iterdir())),
        sessions=int(sessions),
        streams=of("streams"),
        waiting=of("packets_waiting"),
        frames=of("frames_total"),
        skipped=of("skipped_total"),
        utterances=of("speech", "utterances"),
        over=over,
        faults=of("intake", "faults") + of("listeners_dropped_total"),
    )


class Bother:
    """Stateful: what does not go as it should, a little every time."""

    def __init__(self, server: tuple[str, int], stream_port: int, seed: int) -> None:
        self._server, self._stream_port = server, stream_port
        self._rng = random.Random(seed)
        self._out = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._out.connect(server)
        self._guests: list[socket.socket] = []
        self._visits = 0

    def work(self, sessions: int) -> None:
        """Bother the server once."""
        rng = self._rng
        anyone = name_of(rng.randrange(sessions))
        for data in (
            rng.randbytes(rng.randrange(1, 400)),
            osc.message("/fap/1/utt/cancel", "si", anyone, -1),
            osc.message("/fap/1/bye", "s", name_of(rng.randrange(sessions))),
            osc.message("/fap/1/expr", "ssf", anyone, rng.choice(("joy", "anger", "neutral")), rng.random()),
        ):
            if rng.random() < 0.4:
                self._out.send(data)
        self._visits += 1
        visitor = f"v{self._visits:04d}"  # says a word in the middle of which it is gone
        begin = osc.message("/fap/1/utt/begin", "sii", visitor, 0, 0)
        word = osc.message("/fap/1/phones", "siiii" + "siiif" * 2, visitor, 0, 0, 0, 2,
                           "m", 0, 150_000, 0, 1.0, "a", 150_000, 200_000, 0, 1.0)  # fmt: skip
        frame = rng.choice((encode_slip, encode_length))
        self._guests += [self._say(self._server[1], frame(begin) + frame(word) + frame(word)[:20])]
        self._guests += [self._say(self._stream_port, b"")]
        while len(self._guests) > 12:
            self._guests.pop(0).close()

    def _say(self, port: int, data: bytes) -> socket.socket:
        guest = socket.create_connection((self._server[0], port), timeout=5)
        guest.sendall(data)
        return guest

    def close(self) -> None:
        """Leave."""
        for guest in self._guests:
            guest.close()
        self._out.close()


def soak(seconds: float, sessions: int, *, seed: int = 0, tell: bool = False) -> list[Sample]:
    """Use a server for so long, then leave it alone until its sessions are over; the last sample is of then."""
    receiver, other = listening(), listening()
    stream_port = _free_port()
    extra = [f"{kind}://127.0.0.1:{other.getsockname()[1]}" for kind in EXTRA_SINKS]
    extra.append(f"fba+tcp://127.0.0.1:{stream_port}")
    samples: list[Sample] = []
    with serving(receiver.getsockname()[1], other.getsockname()[1], sinks=extra, config=CONFIG) as server:
        load = Load(server.address, receiver, sessions, chunked=True, seed=seed)
        bother = Bother(server.address, stream_port, seed)
        start_s = time.monotonic()
        while (now_s := time.monotonic()) < start_s + seconds:
            load.run(1.0, 0.0)
            bother.work(sessions)
            samples.append(look(server, start_s))
            if tell and len(samples) % 60 == 0:
                print(json.dumps(asdict(samples[-1])), flush=True)
        load.close()
        bother.close()
        receiver.close()
        other.close()
        while now_s < start_s + seconds + 100 and (samples[-1].sessions or samples[-1].streams):
            time.sleep(0.5)  # the last words are said, and idle sessions closed
            now_s = time.monotonic()
            samples.append(look(server, start_s))
    return samples


def troubles(samples: list[Sample]) -> list[str]:
    """Say what grew, or was left over."""
    last = samples[-1]
    used = [one for one in samples if one.sessions > 10]
    early, late = used[len(used) // 2 - 1 : len(used) // 2 + 2], used[-3:]
    found = []
    grown_mb = max(one.memory_mb for one in late) - max(one.memory_mb for one in early)
    if grown_mb > MEMORY_GROWTH_MB:
        found.append(f"memory grew by {grown_mb:.1f} MB from {early[0].time_s} s to {late[-1].time_s} s")
    grown = max(one.files for one in late) - max(one.files for one in early)
    if grown > FILES_GROWTH:
        found.append(f"open files grew by {grown}")
    if last.files > samples[0].files:
        found.append(f"{last.files} files are open when all have left, {samples[0].files} were at first")
    left_over = ("sessions", "streams", "waiting", "faults")
    found += [f"{name}: {getattr(last, name)} at the end" for name in left_over if getattr(last, name)]
    if last.utterances != last.over:
        found.append(f"{last.utterances - last.over} of {last.utterances} utterances are not over")
    if max(one.waiting for one in late) > max(200, 2 * max(one.waiting for one in early)):
        found.append("the queue of packets grew")
    return found


def _free_port() -> int:
    with socket.socket() as own:
        own.bind(("127.0.0.1", 0))
        port: int = own.getsockname()[1]
        return port


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=30.0)
    parser.add_argument("--sessions", type=int, default=40)
    parser.add_argument("--json", type=Path)
    wanted = parser.parse_args()
    samples = soak(60 * wanted.minutes, wanted.sessions, tell=True)
    print(json.dumps(asdict(samples[-1])))
    if wanted.json:
        wanted.json.write_text(json.dumps([asdict(one) for one in samples]))
    found = troubles(samples)
    print("\n".join(found) or "nothing grew, nothing is left over")
    sys.exit(bool(found))


if __name__ == "__main__":
    main()

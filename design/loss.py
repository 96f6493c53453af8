"""What repeats and acknowledgements are worth: closures lost on a bad network, by slack.

    python design/loss.py [--seconds 300]

The network of tests/simulation: 5 % of the packets lost, a tenth of the time nothing at all for 0.3 s, 5 % overtaken,
2 % doubled. Slack is how long before its sound a phone is known. Counted are the phones that did not come in time, and
the bilabials between open vowels that were not shown: the engine stretches the neighbour of a missing phone. (With
little slack all phones of an outage are missing, the mouth comes to rest, and a closure is seen where none was sent.)
"""

import argparse
import sys
from itertools import count
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from tests.simulation.network import Channel
from tests.simulation.world import Talk, World, script

HARD = Channel(loss=0.05, burst_s=0.3, burst_share=0.1, late=0.05, twice=0.02)
MODES = {
    "each phone once": {"repeats": 0, "acknowledged": False},
    "2 repeats": {"acknowledged": False},
    "acknowledged": {"repeats": 0},
    "both": {},
}
SYLLABLES = 200
UDP_BYTES = 28
"""Headers of IPv4 and UDP."""


def run(seed: int, slack_s: float, options: dict) -> np.ndarray:
    """Phones, those not in time, closures, those not shown, seconds of speech, and bits that went out."""
    world = World(seed, HARD, options=options)
    talk = Talk(world, script(world.script_rng, SYLLABLES), 1.0, slack_s)
    world.run(talk.zero_s + talk.phones[-1].end_s + 1.5, talk)
    counters = world.engine.counters("anna")
    untimely = counters.late + counters.dropped + counters.lost + counters.concealed
    missing = world.missing_closures(talk.phones, talk.zero_s)
    bits = 8 * (world.up.sent_bytes + UDP_BYTES * world.up.carried)
    closures = sum(phone.label in "pbm" for phone in talk.phones)
    return np.array([len(talk.phones), untimely, closures, len(missing), talk.phones[-1].end_s, bits])


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--seconds", type=float, default=200.0, help="of speech in each case")
    seconds = parser.parse_args().seconds
    for slack_s in (0.2, 0.5, 1.5):
        for mode, options in MODES.items():
            total = np.zeros(6)
            for seed in count():
                total += run(seed, slack_s, options)
                if total[4] >= seconds:
                    break
            phones, untimely, closures, missing, spoken_s, bits = total
            print(
                f"slack {slack_s:.1f} s  {mode:16} phones not in time {100 * untimely / phones:6.2f} %"
                f"  closures not shown {missing:3.0f} of {closures:.0f}  {bits / spoken_s / 1e3:5.1f} kbit/s",
                flush=True,
            )


if __name__ == "__main__":
    main()

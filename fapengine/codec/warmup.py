"""Compile or load the inner loops before the first frame, so that a live stream does not pause."""

from fapengine.codec import kernels
from fapengine.codec.decoder import decode
from fapengine.codec.encoder import EncoderOptions, encode
from fapengine.mpeg4.track import FapTrack


def warm_up() -> bool:
    """Run every inner loop once on a tiny stream: it is compiled the first time on a machine, and loaded later.

    Returns
    -------
    bool
        True if the loops are compiled (``fapengine[fast]``).
    """
    stream = encode(FapTrack.of([[0] * 68] * 3, rate_hz=25.0), EncoderOptions(intra_every=2))
    decode(stream, with_costs=True)
    damaged = bytes([*stream[:-8], *[0xAA] * 4, *stream[-4:]])
    decode(damaged + stream, errors="resync")
    return kernels.COMPILED

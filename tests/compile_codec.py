"""Compiles the codec's inner loops, before several processes of the tests would all do it."""

from fapengine.codec.decoder import decode
from fapengine.codec.encoder import EncoderOptions, encode
from fapengine.mpeg4.track import FapTrack

if __name__ == "__main__":
    stream = encode(FapTrack.from_values([[0] * 68] * 3, rate_hz=25.0), EncoderOptions(intra_every=2))
    decode(stream, with_costs=True)
    damaged = bytes([*stream[:-8], *[0xAA] * 4, *stream[-4:]])
    decode(damaged + stream, errors="resync")

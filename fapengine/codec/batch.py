"""Many tracks on all cores."""

from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context

from fapengine.codec.encoder import EncoderOptions, encode
from fapengine.codec.warmup import warm_up
from fapengine.mpeg4.track import FapTrack


def encode_all(
    tracks: Sequence[FapTrack], options: EncoderOptions | None = None, *, workers: int | None = None
) -> list[bytes]:
    """Encode many tracks, each by itself, in their order.

    Parameters
    ----------
    workers : int or None
        Processes; None: one a core. 1 stays in this process.

    Raises
    ------
    UsageError
        As :func:`fapengine.codec.encoder.encode`, for the first track that fails.
    """
    work = partial(encode, options=options)
    if workers == 1 or len(tracks) < 2:
        return [work(track) for track in tracks]
    warm_up()  # compiled once, loaded from disk by every worker
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        return list(pool.map(work, tracks, chunksize=max(1, len(tracks) // 64)))

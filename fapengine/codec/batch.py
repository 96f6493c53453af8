"""Many tracks on all cores."""

from collections.abc import Sequence
from concurrent.futures import Executor, ProcessPoolExecutor, ThreadPoolExecutor
from functools import partial
from multiprocessing import cpu_count, get_context

from fapengine.codec.encoder import EncoderOptions, encode
from fapengine.codec.warmup import warm_up
from fapengine.mpeg4.track import FapTrack


def encode_all(
    tracks: Sequence[FapTrack], options: EncoderOptions | None = None, *, workers: int | None = None
) -> list[bytes]:
    """Encode many tracks, each by itself, in their order.

    Compiled loops let other threads run beside them, so threads serve; uncompiled ones need processes.

    Parameters
    ----------
    workers : int or None
        None: one a core. 1 stays in this thread.

    Raises
    ------
    UsageError
        As :func:`fapengine.codec.encoder.encode`, for the first track that fails.
    """
    work = partial(encode, options=options)
    count = workers or cpu_count()
    if count == 1 or len(tracks) < 2:
        return [work(track) for track in tracks]
    with _pool(count, compiled=warm_up()) as pool:
        return list(pool.map(work, tracks))


def _pool(count: int, *, compiled: bool) -> Executor:
    return ThreadPoolExecutor(count) if compiled else ProcessPoolExecutor(count, mp_context=get_context("spawn"))

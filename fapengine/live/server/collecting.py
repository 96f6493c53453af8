"""The search for cycles of dead objects, when the server has time for it.

There are few: each closed connection leaves one. Python by itself looks every few seconds; with 500 sessions that takes
30 ms, in which nothing is shown.
"""

import asyncio
import gc
import time

COLLECT_SHARE = 1e-4
"""Share of its time that the server spends on the search."""
COLLECT_S = (30.0, 600.0)
"""Least and most time from one look to the next."""


async def collect_now_and_then() -> None:
    """Take the search over from Python, until cancelled; what is there now lives as long as the server does."""
    gc.disable()
    gc.collect()
    gc.freeze()
    took_s = 0.0
    try:
        while True:
            await asyncio.sleep(min(max(took_s / COLLECT_SHARE, COLLECT_S[0]), COLLECT_S[1]))
            begun_s = time.perf_counter()
            gc.collect()
            took_s = time.perf_counter() - begun_s
    finally:
        gc.unfreeze()
        gc.enable()

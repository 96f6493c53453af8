"""Rates, and turns at the time of one loop: on virtual time, with a processor that takes as long as it is told."""

import asyncio
from collections import Counter
from contextlib import suppress

from fapengine.server.intake.rates import AT_ONCE_S, SHARE, TokenBucket, Turns
from tests.leaping import run_leaping

SECONDS = 10.0


class Processor:
    """Stateful: work that takes processor time."""

    def __init__(self) -> None:
        self.used_s = 0.0
        self.done: Counter[str] = Counter()
        self.turns = Turns(lambda: self.used_s)

    async def ask(self, who: str, each_s: float, pause_s: float = 0.0) -> None:
        """Ask for work again and again, for some seconds; of who pauses, see how long its work waits."""
        loop = asyncio.get_running_loop()

        def work() -> None:
            assert self.used_s < 10 * SECONDS, "there is no rest, and so no end"
            self.used_s += each_s
            self.done[who] += 1

        while loop.time() < SECONDS:
            await self.turns.take(who, work)
            await asyncio.sleep(pause_s)
        self.turns.leave(who)


def test_an_allowance_comes_back_with_time_up_to_the_burst() -> None:
    allowance = TokenBucket(rate_hz=10.0, burst=5)
    assert [allowance.take(100.0) for _ in range(6)] == [True] * 5 + [False]
    assert [allowance.take(100.2) for _ in range(3)] == [True, True, False]
    assert [allowance.take(200.0) for _ in range(6)] == [True] * 5 + [False]


def test_all_pages_together_take_a_share_of_the_time_and_rest_between_their_messages() -> None:
    """Forty pages send messages of 6 ms as fast as they can; no frame between two of them waits for more than one."""
    processor, gaps_s = Processor(), []

    async def watch() -> None:
        while asyncio.get_running_loop().time() < SECONDS:
            before_s = processor.used_s
            await asyncio.sleep(1 / 60)
            gaps_s.append(processor.used_s - before_s)

    async def whole() -> None:
        await asyncio.gather(watch(), *(processor.ask(f"page {n}", 0.006) for n in range(40)))

    run_leaping(whole())
    assert max(gaps_s) <= 0.006 + AT_ONCE_S
    assert 0.9 * SHARE * SECONDS <= processor.used_s <= 1.1 * SHARE * SECONDS
    assert max(processor.done.values()) - min(processor.done.values()) <= 2


def test_light_messages_go_before_those_of_who_has_used_much() -> None:
    processor, waits_s = Processor(), []

    async def honest() -> None:
        loop = asyncio.get_running_loop()
        while (begun_s := loop.time()) < SECONDS:
            await processor.turns.take("honest", lambda: None)
            waits_s.append(loop.time() - begun_s)
            await asyncio.sleep(0.1)

    async def whole() -> None:
        await asyncio.gather(honest(), *(processor.ask(f"page {n}", 0.006) for n in range(40)))

    run_leaping(whole())
    assert len(waits_s) > 60
    assert max(waits_s[2:]) < 0.05  # behind 40 messages it would be a second, as before any was measured


def test_a_page_that_leaves_while_it_waits_does_not_keep_the_turn() -> None:
    processor = Processor()

    async def whole() -> None:
        asked = [asyncio.create_task(processor.ask(f"page {n}", 0.01)) for n in range(6)]
        for task in asked[:5]:
            await asyncio.sleep(0.02)
            task.cancel()
        with suppress(asyncio.CancelledError):
            await asyncio.gather(*asked[:5])
        await asked[5]

    run_leaping(whole())
    assert processor.done["page 5"] > 0.8 * SHARE * SECONDS / 0.01


def test_few_light_messages_do_not_wait() -> None:
    processor = Processor()

    async def whole() -> None:
        for _ in range(20):
            await processor.turns.take("page", lambda: None)
        assert asyncio.get_running_loop().time() == 0.0

    run_leaping(whole())

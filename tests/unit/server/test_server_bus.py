"""A server's parts that speak to other machines: the end of the bus, with a store of our own; relays; senders."""

import asyncio
import random
import socket
import time
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest

from fapengine.clients import connection, sender
from fapengine.errors import DataError, ResourceError, UsageError
from fapengine.server import partitions
from fapengine.server.cluster import bus as bus_module
from fapengine.server.cluster.bus import Bus
from fapengine.server.cluster.front import MAX_RELAYS, Relays, copied
from fapengine.server.config import BusChoice
from fapengine.server.partitions import Here, Machine, Record, partition_of
from tests.fuzz.mutated import mutated
from tests.live.stage import on_a_loop, until

errors = pytest.importorskip("nats.js.errors", reason="nats-py is absent: pip install fapengine[nats]")


class Entry:
    def __init__(self, value: bytes | None, revision: int) -> None:
        self.value, self.revision = value, revision


class Bucket:
    """A bucket of a store in memory."""

    def __init__(self) -> None:
        self.entries: dict[str, Entry] = {}
        self.revision = 0
        self.is_away = False

    async def put(self, key: str, value: bytes) -> int:
        await self._reach()
        self.revision += 1
        self.entries[key] = Entry(value, self.revision)
        return self.revision

    async def get(self, key: str) -> Entry:
        await self._reach()
        entry = self.entries.get(key)
        if entry is None or entry.value is None:
            raise errors.KeyNotFoundError(entry)
        return entry

    async def update(self, key: str, value: bytes, last: int) -> int:
        known = self.entries.get(key)
        if (known.revision if known else 0) != last:
            raise errors.KeyWrongLastSequenceError
        return await self.put(key, value)

    async def delete(self, key: str, last: int | None = None) -> None:
        await self._reach()
        if last is None or self.entries[key].revision == last:
            await self.put(key, b"")
            self.entries[key].value = None

    async def _reach(self) -> None:
        await asyncio.sleep(0)
        if self.is_away:
            raise TimeoutError


class Wire:
    """What machines tell each other, and whether NATS is reached."""

    is_connected = True

    def __init__(self) -> None:
        self.heard: list[Callable[[Any], Any]] = []

    async def publish(self, subject: str, data: bytes) -> None:
        message = type("Message", (), {"subject": subject, "data": data})
        for hear in self.heard:
            await hear(message)

    async def close(self) -> None:
        pass


def joined(wire: Wire, leases: Bucket, records: Bucket, port: int, fenced: list[int]) -> Bus:
    """Make a machine's end that is connected to the store in memory."""
    end = Bus(BusChoice("nats://here:1"), "127.0.0.1", lambda until_s: None, lambda: fenced.append(port))
    own: Any = end
    own._nats, own._leases, own._records = wire, leases, records
    own._table = partitions.Partitions(Machine(f"m{port}", "127.0.0.1", port))
    wire.heard.append(end._receive)
    return end


async def found(end: Bus, session: str) -> Here | Machine | None:
    settled = asyncio.Event()
    if end.settle(session, settled.set):
        await asyncio.wait_for(settled.wait(), 300.0)
    return end.find(session)


def test_two_machines_agree_on_every_session_and_one_that_steps_down_hands_over(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    async def main() -> None:
        wire, leases, records, fenced = Wire(), Bucket(), Bucket(), []
        ends = [joined(wire, leases, records, port, fenced) for port in (1, 2)]
        keeping = []
        for end in ends:
            end.step_up()
            keeping.append(asyncio.create_task(end._keep_lease()))
        await until(lambda: all(end.machines == 2 for end in ends))
        names = [f"s{number}" for number in range(40)]
        homes: dict[str, int] = {}
        for number, name in enumerate(names):
            answers = [await found(end, name) for end in (ends if number % 2 else ends[::-1])]
            here = [answer for answer in answers if isinstance(answer, Here)]
            there = [answer.port for answer in answers if isinstance(answer, Machine)]
            assert len(here) == len(there) == 1
            homes[name] = there[0]
            ends[there[0] - 1].placed(name)
        assert 10 < list(homes.values()).count(1) < 30
        epochs = {name: records.entries[str(partition_of(name))].revision for name in names}

        ends[0].left(names[0])  # one session is closed, and its partition given back
        await asyncio.sleep(0.01)
        await ends[0].step_down()
        await until(lambda: ends[1].machines == 1)
        for name in names:
            answer = await found(ends[1], name)
            assert isinstance(answer, Here)
            assert answer.epoch > epochs[name] if homes[name] == 1 else answer.epoch == epochs[name]
            assert isinstance(await found(ends[0], name), Machine)  # it goes on to tell where

        leases.is_away = True
        await until(lambda: fenced == [2], 300.0)
        assert ends[1].fences == 1
        assert ends[1].find(names[1]) is None
        for task in keeping:
            task.cancel()

    on_a_loop(main)


def test_a_record_that_another_machine_reports_is_read_again_and_never_believed() -> None:
    async def main() -> None:
        wire, leases, records = Wire(), Bucket(), Bucket()
        ends = [joined(wire, leases, records, port, []) for port in (1, 2)]
        for end in ends:
            end._table.renewed(asked_s=time.monotonic() + 1000.0, revision=1, now_s=time.monotonic())
        for end in ends:
            for other in ends:
                end._table.saw(other._table.me, time.monotonic() + 1000.0)
        forged = [Record(partition_of("anna"), end._table.me.id, 2**40 + number) for number, end in enumerate(ends)]
        before = [await found(end, "anna") for end in ends]
        for record in (*forged, *forged[::-1], Record(partition_of("ben"), "nobody", 2**62)):
            await wire.publish("fapengine.faces.record", partitions.encode(record))
        assert [await found(end, "anna") for end in ends] == before
        answers = [await found(end, "ben") for end in ends]
        assert sorted(type(answer).__name__ for answer in answers) == ["Here", "Machine"]

    on_a_loop(main)


def test_rumours_of_machines_are_few_and_have_ports() -> None:
    async def main() -> None:
        wire = Wire()
        end = joined(wire, Bucket(), Bucket(), 1, [])
        for number in range(3 * partitions.MAX_MACHINES):
            await wire.publish("fapengine.faces.alive", partitions.encode(Machine(f"x{number}", "127.0.0.1", 9)))
        assert end.machines == partitions.MAX_MACHINES
        for port, page_port in ((0, 0), (-1, 0), (65536, 0), (10**30, 0), (9, -1), (9, 65536)):
            with pytest.raises(DataError):
                partitions.decode(
                    partitions.encode({"id": "a", "host": "b", "port": port, "page_port": page_port}), Machine
                )

    on_a_loop(main)


def test_what_is_asked_while_nats_is_away_is_lost() -> None:
    async def main() -> None:
        wire = Wire()
        end = joined(wire, Bucket(), Bucket(), 1, [])
        wire.is_connected = False
        assert end.settle("anna", lambda: pytest.fail("it is known"))

    on_a_loop(main)


def test_nobody_at_the_address_is_told_without_its_password(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bus_module, "CONNECT_S", 0.5)

    async def main() -> None:
        end = Bus(BusChoice("nats://me:secret@127.0.0.1:1"), "127.0.0.1", lambda until_s: None, lambda: None)
        with pytest.raises(ResourceError, match=r"got 127\.0\.0\.1:1, expected NATS with JetStream") as caught:
            await end.start(1, 0)
        assert "secret" not in str(caught.value)

    on_a_loop(main)


@pytest.mark.parametrize("wrong", [{"url": "http://x"}, {"url": "nats://"}, {"name": "a.b"}, {"replicas": 9}])
def test_a_bus_that_cannot_be_is_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(UsageError):
        BusChoice(**wrong)


@pytest.mark.parametrize("data", [b"", b"{}", b"[1]", b'{"partition":4096,"owner":"","revision":1}', b"\xff"])
def test_what_is_not_a_message_is_refused(data: bytes) -> None:
    with pytest.raises(DataError):
        partitions.decode(data, Record)
    with pytest.raises(DataError):
        partitions.decode(data, Machine)


def test_no_bytes_from_nats_do_more_than_a_message_may() -> None:
    """Any bytes under any subject: nothing is raised, few machines are remembered, and no record is believed."""
    chance, troubles = random.Random(3), []
    bus = Bus(BusChoice(url="nats://127.0.0.1"), "127.0.0.1", lambda until_s: None, lambda: None)
    good = partitions.encode(Machine("a" * 32, "10.0.0.1", 9110, 8110)), partitions.encode(Record(3, "a" * 32, 7))

    async def receive() -> None:
        for number in range(20_000):
            data = bytes(mutated(chance, good))
            subject = f"fapengine.x.{chance.choice(('alive', 'gone', 'record', 'other', ''))}"
            try:
                await bus._receive(SimpleNamespace(subject=subject, data=data))  # type: ignore[arg-type]
            except Exception as error:  # noqa: BLE001  that is what is looked for
                troubles.append(f"{number} {data!r}: {error!r}")

    asyncio.run(receive())
    assert troubles == []
    assert len(bus._table._seen) <= partitions.MAX_MACHINES
    assert bus._table._records == {}


def test_a_message_comes_back_as_it_was() -> None:
    machine, record = Machine("a", "10.0.0.1", 9110, 8110), Record(7, "a", 3)
    assert partitions.decode(partitions.encode(machine), Machine) == machine
    assert partitions.decode(partitions.encode(record), Record) == record


def udp() -> socket.socket:
    own = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    own.bind(("127.0.0.1", 0))
    own.setblocking(False)
    return own


def test_datagrams_are_sent_on_from_a_socket_for_each_sender_and_answers_find_it() -> None:
    async def main() -> None:
        server, answers = udp(), []
        loop = asyncio.get_running_loop()
        relays = Relays(lambda data, address: answers.append((data, address)))
        machine = Machine("b", "127.0.0.1", server.getsockname()[1])
        callers = [("10.0.0.1", number) for number in range(3)]
        seen = {}
        for caller in callers:
            assert relays.send(machine, caller, str(caller[1]).encode())
            data, address = await loop.sock_recvfrom(server, 100)
            seen[address] = data
            server.sendto(b"to " + data, address)
        assert len(seen) == 3
        await until(lambda: len(answers) == 3)
        assert answers == [(f"to {number}".encode(), ("10.0.0.1", number)) for number in range(3)]
        for number in range(MAX_RELAYS + 5):
            assert relays.send(machine, ("10.0.0.2", number), b"x")
        assert len(relays._sockets) == MAX_RELAYS
        relays.close()
        assert not relays.send(Machine("c", "no such host.", 1), callers[0], b"x")
        server.close()

    on_a_loop(main)


def test_a_connection_is_copied_both_ways_until_it_ends() -> None:
    async def main() -> None:
        async def echo(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            while data := await reader.read(100):
                writer.write(data.upper())
            writer.close()

        server = await asyncio.start_server(echo, "127.0.0.1", 0)
        ours, theirs = socket.socketpair()
        ours.setblocking(False)
        theirs.setblocking(False)
        copying = asyncio.create_task(copied(theirs, server.sockets[0].getsockname()))
        loop = asyncio.get_running_loop()
        await loop.sock_sendall(ours, b"hello")
        assert await loop.sock_recv(ours, 100) == b"HELLO"
        ours.close()
        await asyncio.wait_for(copying, 300.0)
        theirs.close()
        server.close()

    on_a_loop(main)


def test_a_sender_that_is_not_answered_asks_the_next_address(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(connection, "LOST_S", 0.1)
    first, second = udp(), udp()
    client = sender.Client(*first.getsockname(), session="anna", fallback_addresses=[second.getsockname()])
    stop_s = time.monotonic() + 300.0
    data = b""
    while b"/fap/1/hello" not in data and time.monotonic() < stop_s:
        try:
            data = second.recv(2000)
        except BlockingIOError:
            time.sleep(0.01)
    client.close()
    assert b"/fap/1/hello" in data
    for one in (first, second):
        one.close()

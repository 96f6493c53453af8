"""A worker and its channel, without a parent process: what it may open, and from where it answers."""

import asyncio
import socket
from collections.abc import Callable

from fapengine.server.cluster import channel
from fapengine.server.cluster.channel import Channel
from fapengine.server.cluster.worker import Worker
from fapengine.wire import osc
from tests.live.stage import Sender, config_of, on_a_loop, until

HELLO = osc.message("/fap/1/hello", "sissisi", "anna", 1, "ipa", "", 1, "", 5)


class Parent:
    """The other end of the channel."""

    def __init__(self, link: Channel) -> None:
        self.link = link
        self.heard: list[object] = []

    def tells(self, kind: type[object]) -> Callable[[], bool]:
        """Whether something of a kind was told; what comes is remembered."""

        def find() -> bool:
            self.heard += [message for message, _ in self.link.take()]
            return any(isinstance(message, kind) for message in self.heard)

        return find

    def take(self, kind: type[object]) -> list[object]:
        found = [message for message in self.heard if isinstance(message, kind)]
        self.heard = [message for message in self.heard if not isinstance(message, kind)]
        return found


async def answered(sender: Sender, packet: bytes) -> list[object]:
    """Arguments of the first answer to a packet, behind its address."""
    sender.socket.send(packet)
    came: list[osc.Message] = []
    await until(lambda: bool(came.extend(sender.answers()) or came))
    return [came[0].address, *came[0].arguments]


def test_a_worker_opens_what_it_was_given_and_no_more() -> None:
    async def main() -> None:
        ours, theirs = Channel.pair()
        parent = Parent(Channel(ours, is_worker=False))
        front = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        front.bind(("127.0.0.1", 0))
        known_port = front.getsockname()[1]
        worker = Worker(Channel(theirs, is_worker=True), front, config_of(), known_port)
        task = asyncio.create_task(worker.run())
        await until(parent.tells(channel.Ready))
        (ready,) = parent.take(channel.Ready)
        assert isinstance(ready, channel.Ready)
        direct = Sender(("127.0.0.1", ready.port))

        assert await answered(direct, HELLO) == ["/fap/1/moved", "anna", "", known_port, 5]
        begin = osc.message("/fap/1/utt/begin", "si", "anna", 1)
        assert (await answered(direct, begin))[:4] == ["/fap/1/event", "anna", -1, "unknown"]
        assert worker.server.hub.engine.sessions == ()

        parent.link.put(channel.Own("anna", 3))
        assert (await answered(direct, HELLO))[:2] == ["/fap/1/welcome", "anna"]
        await until(parent.tells(channel.Sessions))
        assert parent.take(channel.Sessions) == [channel.Sessions(["anna"], [])]

        other = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)  # speaks to the known port alone
        other.bind(("127.0.0.1", 0))
        other.setblocking(False)
        parent.link.put(channel.Packet(other.getsockname(), HELLO))
        data, address = await asyncio.get_running_loop().sock_recvfrom(other, 4096)
        assert (data[:14], address) == (b"/fap/1/welcome", front.getsockname())

        parent.link.put(channel.Leave("anna"))  # it is open
        parent.link.put(channel.AskMetrics())
        await until(lambda: parent.tells(channel.Metrics)() and channel.Metrics(b"") in parent.heard)
        assert not parent.tells(channel.Left)()
        text = b"".join(part.text for part in parent.take(channel.Metrics) if isinstance(part, channel.Metrics))
        assert b'fapengine_sessions{state="idle"} 1.0' in text

        worker.server.hub.engine.close("anna", worker.server.hub.clock())
        await until(parent.tells(channel.Sessions))
        assert parent.take(channel.Sessions) == [channel.Sessions([], ["anna"])]
        parent.link.put(channel.Leave("anna"))
        await until(parent.tells(channel.Left))
        assert (await answered(direct, HELLO))[0] == "/fap/1/moved"

        parent.link.close()  # the parent ends
        await asyncio.wait_for(task, 300.0)
        for one in (front, other):
            one.close()
        direct.close()
        worker.close()

    on_a_loop(main)

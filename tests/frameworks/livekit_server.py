"""A stand-in for a LiveKit server, on ``livekit.protocol`` and aiortc: the real ``rtc.Room`` connects to it.

It has one room per name: signalling by WebSocket, tracks from each participant to all others, data packets to those
they are for. Tokens are read, not checked. It is not LiveKit's server: no reconnection, simulcast, TURN or permissions.
"""

import asyncio
import contextlib
import itertools
import json
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from typing import Any

import jwt
from aiohttp import WSMsgType, web
from aiortc import RTCBundlePolicy, RTCConfiguration, RTCPeerConnection, RTCSessionDescription
from aiortc.contrib.media import MediaRelay
from aiortc.sdp import candidate_from_sdp
from livekit.protocol import models, rtc

NUMBERS = itertools.count(1)


def peer() -> RTCPeerConnection:
    """A connection without servers, all on one transport."""
    return RTCPeerConnection(RTCConfiguration(iceServers=[], bundlePolicy=RTCBundlePolicy.MAX_BUNDLE))


@dataclass(eq=False)
class Member:
    """A participant and its two connections. Stateful."""

    room: "Room"
    info: Any
    socket: web.WebSocketResponse
    publisher: RTCPeerConnection = field(default_factory=peer)
    subscriber: RTCPeerConnection = field(default_factory=peer)
    channels: dict[str, Any] = field(default_factory=dict)
    """Data channels to the participant, by label."""
    unsent: list[bytes] = field(default_factory=list)
    """Reliable packets that came before the channel was open."""
    waiting: dict[str, Any] = field(default_factory=dict)
    """Tracks that are announced and not received yet, by the participant's own id."""
    tracks: list[tuple[Any, Any]] = field(default_factory=list)
    """What is known of received tracks, and the tracks."""
    gets: set[str] = field(default_factory=set)
    """Ids of the tracks that are sent to the participant."""
    subscribes: bool = True
    """False if it asked for no tracks (``auto_subscribe=False``)."""
    turn: asyncio.Lock = field(default_factory=asyncio.Lock)
    answered: asyncio.Event = field(default_factory=asyncio.Event)

    async def send(self, **what: Any) -> None:
        if not self.socket.closed:
            with contextlib.suppress(ConnectionError):
                await self.socket.send_bytes(rtc.SignalResponse(**what).SerializeToString())

    async def offer(self) -> None:
        """Offer the participant all tracks of the others, and the data channels."""
        async with self.turn:
            new = []
            for other in self.room.members:
                for info, track in other.tracks if self.subscribes and other is not self else ():
                    if info.sid in self.gets:
                        continue
                    self.gets.add(info.sid)
                    new.append((other, info.sid))
                    sender = self.subscriber.addTrack(self.room.relay.subscribe(track))
                    sender._track_id, sender._stream_id = info.sid, f"{other.info.sid}|{info.sid}"
            if not self.channels:
                reliable = self.subscriber.createDataChannel("_reliable", ordered=True)
                lossy = self.subscriber.createDataChannel("_lossy", ordered=True, maxRetransmits=0)
                self.channels = {"_reliable": reliable, "_lossy": lossy}
                reliable.on("open", self.catch_up)
            await self.subscriber.setLocalDescription(await self.subscriber.createOffer())
            self.answered.clear()
            sdp = self.subscriber.localDescription.sdp
            await self.send(offer=rtc.SessionDescription(type="offer", sdp=sdp))
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(30):
                    await self.answered.wait()
        for other, sid in new:
            await other.send(track_subscribed=rtc.TrackSubscribed(track_sid=sid))

    def pass_on(self, label: str, data: bytes) -> None:
        """Send a packet on a data channel; reliable ones wait until it is open."""
        channel = self.channels.get(label)
        if channel is not None and channel.readyState == "open":
            channel.send(data)
        elif label == "_reliable":
            self.unsent.append(data)

    def catch_up(self) -> None:
        """Send what waited for the reliable channel."""
        waited, self.unsent = self.unsent, []
        for data in waited:
            self.pass_on("_reliable", data)


class Room:
    """Participants of one name. Stateful."""

    def __init__(self, name: str) -> None:
        self.info = models.Room(sid=f"RM_{next(NUMBERS)}", name=name)
        self.members: list[Member] = []
        self.relay = MediaRelay()
        self.streams: dict[str, set[str]] = {}
        """Whom byte and text streams are for; only their headers say it."""

    async def tell(self, member: Member) -> None:
        """Tell the others what a participant is now."""
        for other in list(self.members):
            if other is not member:
                await other.send(update=rtc.ParticipantUpdate(participants=[member.info]))

    def forward(self, member: Member, label: str, data: bytes) -> None:
        """Send a packet to those it is for."""
        packet = models.DataPacket.FromString(data)
        packet.participant_identity, packet.participant_sid = member.info.identity, member.info.sid
        wanted = set(packet.destination_identities)
        kind = packet.WhichOneof("value") or ""
        if kind == "stream_header":
            self.streams[packet.stream_header.stream_id] = wanted
        elif kind.startswith("stream_"):
            wanted = self.streams.get(getattr(packet, kind).stream_id, set())
        for other in self.members:
            if other is not member and (not wanted or other.info.identity in wanted):
                other.pass_on(label, packet.SerializeToString())


class LiveKitDouble:
    """The server. Stateful."""

    def __init__(self) -> None:
        self.rooms: dict[str, Room] = {}
        self.tasks: set[asyncio.Task[Any]] = set()

    @asynccontextmanager
    async def open(self) -> AsyncIterator[str]:
        """Serve on the loopback; its address."""
        app = web.Application()
        app.add_routes([web.get("/rtc", self._join), web.get("/rtc/validate", self._validate)])
        runner = web.AppRunner(app, shutdown_timeout=1.0)
        await runner.setup()
        await web.TCPSite(runner, "127.0.0.1", 0).start()
        try:
            yield f"ws://127.0.0.1:{runner.addresses[0][1]}"
        finally:
            for room in self.rooms.values():
                for member in list(room.members):
                    await member.socket.close()
            await runner.cleanup()

    async def _validate(self, _: web.Request) -> web.Response:
        return web.Response(text="success")

    def _spawn(self, work: Any) -> None:
        task = asyncio.ensure_future(work)
        self.tasks.add(task)
        task.add_done_callback(self.tasks.discard)

    async def _join(self, request: web.Request) -> web.StreamResponse:
        token = request.query.get("access_token") or request.headers["Authorization"].removeprefix("Bearer ")
        claims = jwt.decode(token, options={"verify_signature": False})
        room = self.rooms.setdefault(claims["video"]["room"], Room(claims["video"]["room"]))
        socket = web.WebSocketResponse()
        await socket.prepare(request)
        kinds = {"agent": models.ParticipantInfo.AGENT}
        info = models.ParticipantInfo(
            sid=f"PA_{next(NUMBERS)}", identity=claims["sub"], name=claims.get("name", ""),
            state=models.ParticipantInfo.ACTIVE,
            kind=kinds.get(claims.get("kind", ""), models.ParticipantInfo.STANDARD),
            attributes=claims.get("attributes", {}),
            permission=models.ParticipantPermission(can_subscribe=True, can_publish=True, can_publish_data=True),
        )  # fmt: skip
        member = Member(room, info, socket, subscribes=request.query.get("auto_subscribe") != "0")
        self._listen(member)
        others = [other.info for other in room.members]
        room.members.append(member)
        await member.send(
            join=rtc.JoinResponse(
                room=room.info, participant=info, other_participants=others, subscriber_primary=True,
                server_info=models.ServerInfo(version="1.9.0", protocol=15), ping_timeout=120, ping_interval=60,
            )
        )  # fmt: skip
        await room.tell(member)
        self._spawn(member.offer())
        try:
            async for message in socket:
                if message.type is WSMsgType.BINARY:
                    await self._hear(member, rtc.SignalRequest.FromString(message.data))
        finally:
            await self._leave(member)
        return socket

    async def _leave(self, member: Member) -> None:
        room = member.room
        if member in room.members:
            room.members.remove(member)
            member.info.state = models.ParticipantInfo.DISCONNECTED
            await room.tell(member)
        await member.publisher.close()
        await member.subscriber.close()

    def _listen(self, member: Member) -> None:
        room = member.room

        @member.publisher.on("datachannel")
        def on_channel(channel: Any) -> None:
            channel.on("message", lambda data: room.forward(member, channel.label, data))

        @member.publisher.on("track")
        def on_track(track: Any) -> None:
            kind = models.TrackType.AUDIO if track.kind == "audio" else models.TrackType.VIDEO
            found = next((cid for cid, info in member.waiting.items() if info.type == kind), None)
            if found is None:
                return
            info = member.waiting.pop(found)
            member.tracks.append((info, track))
            member.info.tracks.append(info)
            self._spawn(self._published(member))

    async def _published(self, member: Member) -> None:
        await member.room.tell(member)
        await asyncio.gather(
            *(other.offer() for other in list(member.room.members) if other is not member and other.subscribes)
        )

    async def _hear(self, member: Member, request: Any) -> None:
        kind = request.WhichOneof("message")
        if kind == "offer":
            await member.publisher.setRemoteDescription(RTCSessionDescription(request.offer.sdp, "offer"))
            await member.publisher.setLocalDescription(await member.publisher.createAnswer())
            sdp = member.publisher.localDescription.sdp
            await member.send(answer=rtc.SessionDescription(type="answer", sdp=sdp, id=request.offer.id))
        elif kind == "answer":
            await member.subscriber.setRemoteDescription(RTCSessionDescription(request.answer.sdp, "answer"))
            member.answered.set()
        elif kind == "trickle":
            given = json.loads(request.trickle.candidateInit)
            connection = member.publisher if request.trickle.target == rtc.SignalTarget.PUBLISHER else member.subscriber
            if given.get("candidate"):
                candidate = candidate_from_sdp(given["candidate"].removeprefix("candidate:"))
                candidate.sdpMid, candidate.sdpMLineIndex = given.get("sdpMid"), given.get("sdpMLineIndex")
                with contextlib.suppress(Exception):  # before the description
                    await connection.addIceCandidate(candidate)
        elif kind == "add_track":
            add = request.add_track
            info = models.TrackInfo(
                sid=f"TR_{next(NUMBERS)}", type=add.type, name=add.name, source=add.source, width=add.width,
                height=add.height, stream=add.stream,
            )  # fmt: skip
            member.waiting[add.cid] = info
            await member.send(track_published=rtc.TrackPublishedResponse(cid=add.cid, track=info))
        elif kind == "update_metadata":
            member.info.attributes.update(request.update_metadata.attributes)
            await member.send(update=rtc.ParticipantUpdate(participants=[member.info]))
            await member.room.tell(member)
        elif kind in ("ping", "ping_req"):
            await member.send(pong=request.ping or 1)
        elif kind == "leave":
            await member.socket.close()

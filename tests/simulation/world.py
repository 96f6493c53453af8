"""A sender, a network and an engine on one virtual clock; what the face showed, and when the sound really was where."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from fapengine.engine.engine import Engine
from fapengine.mpeg4 import fap
from fapengine.speech.phone_track import Phone
from fapengine.trajectory.style import Style
from fapengine.wire.speech_osc import schema
from fapengine.wire.speech_osc.receiver import OscReceiver
from fapengine.wire.speech_osc.sender import OscSender
from tests.english import english
from tests.simulation import network

STEP_S = 0.005
RATE_HZ = 50.0
FRAME_STEPS = 4
UPPER, LOWER = fap.column(4), fap.column(5)
CLOSED_FAPU = 8
"""0.2 mm on the recorded face."""
PHONE_S = 0.09
WALL_S = 1_790_000_000.0


def script(rng: np.random.Generator, syllables: int, start_s: float = 0.2) -> list[Phone]:
    """Open vowels, and between them consonants, half of which close the lips."""
    phones = [Phone("ɑ", start_s, start_s + PHONE_S)]
    for _ in range(syllables):
        consonant = str(rng.choice(["p", "b", "m", "t", "k", "s"]))
        vowel = str(rng.choice(["ɑ", "æ", "aɪ"]))
        phones.append(Phone(consonant, phones[-1].end_s, phones[-1].end_s + PHONE_S))
        phones.append(Phone(vowel, phones[-1].end_s, phones[-1].end_s + 1.5 * PHONE_S))
    return phones


@dataclass
class World:
    """One sender and one face."""

    seed: int
    channel: network.Channel = field(default_factory=network.Channel)
    sender_clock: network.Clock = field(default_factory=network.Clock)
    engine_clock: network.Clock = field(default_factory=lambda: network.Clock(1000.0))
    wall_clock: network.Clock = field(default_factory=lambda: network.Clock(WALL_S))
    options: dict = field(default_factory=dict)
    frames: list = field(default_factory=list)
    times_s: list = field(default_factory=list)
    """True times of the frames."""
    notices: list = field(default_factory=list)
    is_dead: bool = False
    """The sender was killed."""
    steps: int = 0

    def __post_init__(self) -> None:
        chance = np.random.default_rng(self.seed)
        self.script_rng, up, down, face = chance.spawn(4)
        self.up, self.down = network.Link(self.channel, up), network.Link(self.channel, down)
        self.engine = Engine(english(), rng=face, style=Style.speech_only())
        self.receiver = OscReceiver(self.engine, instance=11)
        self.sender = OscSender("anna", instance=self.seed + 1, **self.options)
        self.peer = "sender"

    def restart_engine(self) -> None:
        self.engine = Engine(english(), rng=np.random.default_rng(self.seed), style=Style.speech_only())
        self.receiver = OscReceiver(self.engine, instance=12)

    def restart_sender(self, instance: int) -> None:
        self.sender = OscSender("anna", instance=instance, **self.options)
        self.peer, self.is_dead = f"sender {instance}", False

    def run(self, until_s: float, *acts: Callable[[float], None]) -> None:
        """Run; ``acts`` see the sender's clock."""
        while self.steps < round(until_s / STEP_S):
            true_s = self.steps * STEP_S
            if not self.is_dead:
                for act in acts:
                    act(self.sender_clock(true_s))
            self._send(true_s)
            self._take(true_s)
            if self.steps % FRAME_STEPS == 0:
                self._show(true_s)
            self.steps += 1

    def _send(self, true_s: float) -> None:
        now_s = self.sender_clock(true_s)
        for packet in self.down.arrived(true_s):
            if not self.is_dead:
                self.notices += [told for told in self.sender.receive(packet, now_s) if isinstance(told, schema.Notice)]
        if not self.is_dead:
            for packet in self.sender.due(now_s):
                self.up.send(packet, true_s)

    def _take(self, true_s: float) -> None:
        for packet in self.up.arrived(true_s):
            answers = self.receiver.receive(packet, self.peer, self.engine_clock(true_s), self.wall_clock(true_s))
            for _, answer in answers:
                self.down.send(answer, true_s)

    def _show(self, true_s: float) -> None:
        now_s = self.engine_clock(true_s)
        shown = self.engine.frame(now_s)
        self.frames.append(shown.faps[0] if len(shown.sessions) else np.zeros(fap.FAP_COUNT, np.int32))
        self.times_s.append(true_s)
        for _, packet in self.receiver.tick(now_s):
            self.down.send(packet, true_s)

    @property
    def faps(self) -> np.ndarray:
        """(T, 68)."""
        return np.array(self.frames)

    @property
    def opening(self) -> np.ndarray:
        """(T,) FAPU: how far the inner lips stand apart."""
        return -(self.faps[:, UPPER] + self.faps[:, LOWER])

    def missing_closures(self, phones: list[Phone], zero_s: float, late_s: float = 0.04) -> list[Phone]:
        """Bilabials between open vowels that were not shown; ``zero_s`` is true time."""
        times, opening = np.array(self.times_s), self.opening
        missed = []
        for phone in phones:
            if phone.label in "pbm":
                during = (times >= zero_s + phone.start_s - late_s) & (times <= zero_s + phone.end_s + late_s)
                if during.any() and opening[during].min() > CLOSED_FAPU:
                    missed.append(phone)
        return missed


@dataclass
class Talk:
    """A sender that knows its phones a while before they sound, as a TTS does."""

    world: World
    phones: list[Phone]
    begin_s: float
    slack_s: float = 1.5
    anchor: str = "at"
    audio_hz: float = 0.0
    """Reports of the sound's position."""
    number: int | None = None
    told: int = 0
    next_audio_s: float = 0.0

    @property
    def zero_s(self) -> float:
        """When the sound begins, sender's clock."""
        return self.begin_s + self.slack_s

    def __call__(self, now_s: float) -> None:
        sender = self.world.sender
        if now_s < self.begin_s:
            return
        if self.number is None:
            self.number = sender.begin(now_s, anchor=self.anchor, at_s=self.zero_s)
        known = self.told
        while known < len(self.phones) and self.phones[known].start_s + self.zero_s - self.slack_s <= now_s:
            known += 1
        if known > self.told:
            sender.append(self.number, self.phones[self.told : known])
            self.told = known
            if known == len(self.phones):
                sender.end(self.number)
        position_s = now_s - self.zero_s
        if self.audio_hz and now_s >= self.next_audio_s and 0 <= position_s <= self.phones[-1].end_s:
            self.next_audio_s = now_s + 1 / self.audio_hz
            sender.audio(self.number, position_s, now_s)

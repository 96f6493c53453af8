"""Every command to a live face, with any arguments that its table allows, at any moment, on virtual time.

    python -m tests.simulation.any_command [--minutes 60] [--commands 50000] [--seed 1]

Several faces are told things at random, sensible ones and such at the ends of what may be asked for; frames come
regularly, late, twice at one time, or after a jump of the clock. In each frame must hold:

- *near*: lips part, and the jaw drops, by no more than :data:`NEAR` times what these phones and expressions make of
  them at the gains of the last second, and :data:`MARGIN_FAPU` more;
- *lips*: upper and lower lip do not pass through each other by more than rounding;
- *range*: every value is one that a stream can carry;
- *speed*: at natural gains the opening changes by no more than :data:`FASTEST_FAPU_S`;
- *step*: no FAP of jaw and lips changes faster than 1.5 times the fastest of speech, whatever is asked for;
- *rest*: a face that has nothing to say and shows nothing is at rest, :data:`REST_S` behind its last fade or closure;
- *faults*: no session is ended for a fault, and no counter falls.

At the end, memory is compared with that at a quarter of the time. Exits 1 where something did not hold.
"""

import argparse
import resource
import sys
from collections import Counter, deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict, dataclass, field, replace
from functools import cache
from math import inf

import numpy as np

from fapengine.engine import commands
from fapengine.engine.command_table import Choice, EndlessDuration, FieldSpec, Time, fields_of
from fapengine.engine.commands import Append, Audio, Begin, Cancel, Command, End, Express, Pause, Resume, Seek
from fapengine.engine.engine import JAW_AND_LIPS, Engine
from fapengine.engine.session import Limits
from fapengine.errors import UsageError
from fapengine.expressions import EXPRESSIONS
from fapengine.mpeg4 import fap
from fapengine.mpeg4.track import to_codable
from fapengine.speech.phone_track import SILENCE, Phone, PhoneTrack
from fapengine.trajectory.closures import MIN_HOLD_S, PAIRS, RAMP_S
from fapengine.trajectory.expression import expression_faps
from fapengine.trajectory.planner import plan
from fapengine.trajectory.style import Style
from tests.english import english

NEAR, MARGIN_FAPU = 1.25, 150.0
"""A mouth that was held shut by a closure shows what was below it; 150 FAPU are 3 mm on the recorded face."""
CROSSED_FAPU = 2
"""Of the rounding of two lips."""
REST_S = 2 * RAMP_S + MIN_HOLD_S + 0.2
FASTEST_FAPU_S = 42_000.0
"""Of the opening: 870 mm/s, what is promised of speech, on the recorded face."""
STEP_FAPU_S = 45_800.0
"""1.5 times 509 FAPU in 1/60 s: speech of 60 random texts, FAP 16."""
RATE_HZ = 30.0
LABELS = ("p", "b", "m", "f", "v", "s", "ʃ", "n", "w", "i", "uː", "ɑ", "æ", "aɪ", "ɔɪ", "%", SILENCE)
LENGTHS_S = (0.004, 0.02, 0.05, 0.08, 0.12, 0.2, 0.6, 5.0)
SAID = 0.15
"""Share of times that a whole utterance is said, in four commands."""
QUIET_S = 12.0
"""Time without commands, now and then, in which faces come to rest."""
LOWEST, HIGHEST = (to_codable(np.full((1, fap.FAP_COUNT), limit))[0] for limit in (-np.inf, np.inf))
INNER = np.array([[fap.column(number) for number in pair[:2]] for pair in PAIRS])


@dataclass
class Face:
    """What one session was told, as far as it bounds what it may show."""

    name: str
    is_natural: bool
    """Its gains and its mood stay as they are."""
    next_number: int = 0
    numbers: deque[int] = field(default_factory=lambda: deque(maxlen=6))
    gains: deque[tuple[float, float, float]] = field(default_factory=deque)
    """Engine time until which they count, jaw, lips."""
    moods: np.ndarray = field(default_factory=lambda: np.zeros(len(EXPRESSIONS)))
    """Highest level that each expression was sent to since it was last away from all commands."""
    busy_until_s: float = 0.0
    last_opening: np.ndarray | None = None
    last_row: np.ndarray | None = None
    counters: dict[str, int] = field(default_factory=dict)
    style: Style = field(default_factory=Style.speech_only)

    def note(self, command: Command, now_s: float) -> None:
        """Note what it may show of a command."""
        if isinstance(command, commands.SetParameter):
            with suppress(UsageError):  # the face refuses it too
                self.style = replace(self.style, **{command.parameter: command.value})
        self.gains.append((inf, self.style.jaw_gain, self.style.lips_gain))
        if len(self.gains) > 1:
            self.gains[-2] = (now_s + 1.0, *self.gains[-2][1:])
        if isinstance(command, Express) and command.expression:
            index = EXPRESSIONS.index(command.expression)
            self.moods[index] = max(self.moods[index], command.level)
        if isinstance(command, Cancel | Pause):
            until_s = max(now_s, getattr(command, "at_s", None) or 0.0) + command.fade_s
            self.busy_until_s = max(self.busy_until_s, min(until_s, now_s + 60.0))


@dataclass
class Trial:
    """Faces, chance and a clock; see the module."""

    seed: int
    faces: int = 4
    longest_s: float = inf
    """Longest duration that is asked for: of fades, attacks and the like."""
    broken: Counter[str] = field(default_factory=Counter)
    first: dict[str, str] = field(default_factory=dict)
    """Of each kind that did not hold, the first."""
    told: Counter[str] = field(default_factory=Counter)
    recent: deque[str] = field(default_factory=lambda: deque(maxlen=12))
    frames: int = 0
    now_s: float = 0.0
    worst: Counter[str] = field(default_factory=Counter)

    def __post_init__(self) -> None:
        self.rng = np.random.default_rng(self.seed)
        limits = Limits(silence_s=1.0, wait_s=4.0)
        self.engine = Engine(english(), rng=self.rng.spawn(1)[0], limits=limits, style=Style.speech_only())
        self.watched = {f"face {n}": Face(f"face {n}", is_natural=n % 2 == 0) for n in range(self.faces)}
        for name in self.watched:
            self.engine.open(name, 0.0)

    # Chance ---------------------------------------------------------------------------------------------------------

    def of(self, *choices: object) -> object:
        return choices[int(self.rng.integers(len(choices)))]

    def value(self, spec: FieldSpec, name: str) -> object:
        """Any value that a field may have, its ends as often as what lies between."""
        if isinstance(spec, Choice):
            return self.of(*spec.values.values())
        if isinstance(spec, Time) or name == "at_s":
            near_s = self.now_s + self.rng.uniform(-1.0, 2.0)
            return self.of(near_s, near_s, self.now_s, None if isinstance(spec, Time) else near_s)
        if isinstance(spec, EndlessDuration):
            return self.of(inf, 0.0, self.rng.uniform(0, 3))
        low, high = max(spec.low, -1e4), min(spec.high, 1e4)
        if spec.is_whole:
            return int(self.rng.integers(low, high))
        if 0 < low < high:  # durations: each size as likely
            high = min(high, self.longest_s)
            return self.of(low, high, *np.exp(self.rng.uniform(np.log(low), np.log(high), 4)).tolist())
        usual = min(max(self.rng.uniform(-1, 3), low), high)
        return self.of(low, high, usual, *self.rng.uniform(low, high, 3).tolist())

    def phones(self) -> tuple[Phone, ...]:
        """Phones one behind the other, now and then with a gap or an overlap."""
        at_s = float(self.of(0.0, 0.1, self.rng.uniform(0, 3)))
        made = []
        for _ in range(int(self.rng.integers(1, 16))):
            length_s = float(self.of(*LENGTHS_S[:6], *LENGTHS_S))
            made.append(Phone(str(self.of(*LABELS)), at_s, at_s + length_s, int(self.of(0, 0, 1, 2))))
            at_s = max(at_s + length_s + float(self.of(0.0, 0.0, 0.0, 0.0, 0.05, -0.02, 1.0)), 0.0)
        return tuple(made)

    def some(self, face: Face) -> tuple[Command, ...]:
        """Say something whole, or give any command."""
        if self.rng.random() > SAID:
            return (self.command(face),)
        face.next_number += 1
        face.numbers.append(face.next_number)
        spoken = self.phones()
        begin = Begin(face.next_number, self.of("now", "now", "at"), self.now_s + self.rng.uniform(-0.2, 0.5))
        end = End(face.next_number, len(spoken), float(self.of(0.0, 3.0)))
        return Resume(), begin, Append(face.next_number, 0, spoken), end

    def command(self, face: Face) -> Command:
        """Any command of the list."""
        kind = self.of(Begin, Append, Append, *commands.COMMANDS)
        if (kind in (Begin, Append) and self.rng.random() < 0.5) or not face.numbers:
            face.next_number += 1
            face.numbers.append(face.next_number)
        number = int(self.of(*face.numbers, face.numbers[-1]))
        revision = int(self.of(0, 0, 0, 1, 2))
        if kind is Begin:
            return Begin(number, self.of("now", "at", "audio"), self.now_s + self.rng.uniform(-1, 2), revision)
        if kind is Append:
            return Append(number, int(self.of(0, 0, 0, 5, 16)), self.phones(), revision)
        if kind is End:
            return End(number, int(self.of(0, 8, 16, 31)), float(self.of(0.0, 1.0, 20.0)), revision)
        drawn = {name: self.value(spec, name) for name, spec in fields_of(kind).items()}
        if kind in (Seek, Audio):
            drawn["utterance"] = number
            drawn["position_s"] = self.of(drawn["position_s"], self.rng.uniform(0, 3), self.rng.uniform(0, 3))
        if kind is Cancel:
            drawn |= {"utterance": self.of(None, number), "first": int(self.of(0, number))}
        return kind(**drawn)

    # Time -----------------------------------------------------------------------------------------------------------

    def tell(self, face: Face, command: Command) -> None:
        """Tell a face something, and note what it may show of it."""
        if face.is_natural and isinstance(command, Express | commands.SetParameter):
            return
        self.engine.apply(face.name, command, self.now_s)
        self.told[type(command).__name__] += 1
        self.recent.append(f"{self.now_s:.3f} {face.name} {command}"[:300])
        face.note(command, self.now_s)

    def quiet(self) -> None:
        """Stop everything, and look whether all come to rest."""
        for face in self.watched.values():
            self.tell(face, Cancel(fade_s=float(self.of(0.01, 0.2, 2.0, 10.0))))
            for expression in EXPRESSIONS:
                self.engine.apply(face.name, Express(expression, 0.0, attack_s=0.3), self.now_s)
        for _ in range(round(QUIET_S * RATE_HZ)):
            self.show(1 / RATE_HZ)
        for face in self.watched.values():
            face.moods[:] = 0.0

    def show(self, after_s: float) -> None:
        """Draw a frame, and look at it."""
        self.now_s += after_s
        shown = self.engine.frame(self.now_s)
        self.frames += 1
        for fault in self.engine.faults():
            self.fail("faults", f"{fault.session}: {fault.error!r}")
            self.engine.open(fault.session, self.now_s)
        for event in self.engine.events():
            face = self.watched[event.session]
            face.busy_until_s = max(face.busy_until_s, self.now_s + 0.2)
        for name, row in zip(shown.sessions, shown.faps, strict=True):
            self.look_at(self.watched[name], row, after_s)
            self.look_at_state(self.watched[name], row)

    def fail(self, kind: str, what: str) -> None:
        self.broken[kind] += 1
        self.first.setdefault(kind, f"at {self.now_s:.3f} s {what}\n    " + "\n    ".join(self.recent))

    def look_at(self, face: Face, row: np.ndarray, after_s: float) -> None:
        """Look at one frame, drawn so long after the one before."""
        opening = -row[INNER].sum(axis=1)
        if (row < LOWEST).any() or (row > HIGHEST).any():
            self.fail("range", f"{face.name}: {row.min()}..{row.max()}")
        if opening.min() < -CROSSED_FAPU:
            self.fail("lips", f"{face.name}: lips pass each other by {-opening.min()} FAPU")
        while face.gains and face.gains[0][0] < self.now_s:
            face.gains.popleft()
        open_most, jaw_most = self.bounds(face)
        for kind, got, most in (("opening", opening.max(), open_most), ("jaw", row[fap.column(3)], jaw_most)):
            if face.is_natural:
                self.worst[kind] = max(self.worst[kind], int(got))
            if got > most:
                self.fail("near", f"{face.name}: {kind} {got}, expected at most {most:.0f}")
        if face.is_natural and face.last_opening is not None and 0 < after_s <= 1.01 / RATE_HZ:
            speed = np.abs(opening - face.last_opening).max() / after_s
            self.worst["speed"] = max(self.worst["speed"], int(speed))
            if speed > FASTEST_FAPU_S:
                self.fail("speed", f"{face.name}: the opening changes by {speed:.0f} FAPU/s")
        face.last_opening = opening
        if face.last_row is not None and after_s > 0:
            step = np.abs(row - face.last_row)[JAW_AND_LIPS].max()
            self.worst["step"] = max(self.worst["step"], int(step / after_s))
            if step > STEP_FAPU_S * after_s + 1:
                self.fail("step", f"{face.name}: a FAP changes by {step} in {after_s:.3f} s")
        face.last_row = row.copy()

    def look_at_state(self, face: Face, row: np.ndarray) -> None:
        """Look whether it rests when it should, and at its counters."""
        state = self.engine.state(face.name)
        if state != "idle" or self.engine._by_name[face.name].fresh:
            face.busy_until_s = max(face.busy_until_s, self.now_s + (0.0 if state == "paused" else 0.2))
        elif face.is_natural and self.now_s > face.busy_until_s + REST_S and row[2:18].any():
            self.fail("rest", f"{face.name}: {row[2:18].tolist()}")
        counters = asdict(self.engine.counters(face.name))
        if any(counters[name] < count for name, count in face.counters.items()):
            self.fail("faults", f"{face.name}: a counter fell, {face.counters} to {counters}")
        face.counters = counters

    def bounds(self, face: Face) -> tuple[float, float]:
        """Greatest opening and jaw that what it was told may show."""
        whole, jaws, lips = reach()
        jaw, lip = (max((entry[index] for entry in face.gains), default=1.0) for index in (1, 2))
        moods = expression_faps(english()).T
        opened, dropped = _openings(moods)
        raised = -moods[:, INNER[:, 0]].min(axis=-1)  # the upper lip, while f and v hold the lower one at the teeth
        mood_open, mood_jaw = np.maximum([np.maximum(opened, raised), dropped], 0) @ face.moods * 1.1
        most = []
        for index, mood in enumerate((mood_open, mood_jaw)):
            speech = jaw * whole[index] if jaw == lip else jaw * jaws[index] + lip * lips[index]
            most.append(NEAR * (speech + mood) + MARGIN_FAPU)
        return most[0], most[1]


def _openings(rows: np.ndarray) -> np.ndarray:
    """(2, N): the widest opening of three places, and open_jaw."""
    return np.stack([-rows[:, INNER].sum(axis=-1).min(axis=-1), rows[:, fap.column(3)]])


@cache
def reach() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Greatest opening and open_jaw of undisturbed speech with these phones: whole, the jaw's part, the lips' part."""
    found = []
    for jaw, lips in ((1.0, 1.0), (1.0, 0.0), (0.0, 1.0)):
        rng, most = np.random.default_rng(1), np.zeros(2)
        style = Style(jaw=jaw, lips=lips, blinks=False, head_motion=False, gaze=False, idle=False, emphasis=False)
        for _ in range(60):
            edges = np.cumsum([0.2, *rng.choice(LENGTHS_S[:7], 30)])
            labels = rng.choice(LABELS, 30)
            track = PhoneTrack.from_phones(
                [Phone(str(label), *map(float, edges[n : n + 2])) for n, label in enumerate(labels)]
            )
            rows = plan(track, english(), rng=rng, rate_hz=RATE_HZ, style=style).track.values
            most = np.maximum(most, _openings(rows).max(axis=1))
        found.append(most)
    return found[0], found[1], found[2]


def run(trial: Trial, seconds: float, count: int, on_second: Callable[[float], None] = lambda _: None) -> None:
    """Tell about so many commands in about so many seconds."""
    share, second = count / seconds, 0
    since_quiet_s = 0.0
    while trial.now_s < seconds:
        for _ in range(int(trial.rng.poisson(share * 1.2 / RATE_HZ))):
            face = trial.watched[str(trial.of(*trial.watched))]
            for command in trial.some(face):
                trial.tell(face, command)
        after_s = float(trial.rng.choice([1 / RATE_HZ, 0.0, 0.1, 1.0, 4.0], p=[0.985, 0.005, 0.007, 0.002, 0.001]))
        trial.show(after_s)
        since_quiet_s += after_s
        if since_quiet_s > 40.0:
            trial.quiet()
            since_quiet_s = 0.0
        if trial.now_s >= second + 1:
            second = int(trial.now_s)
            on_second(trial.now_s)


def main() -> int:
    """Run one trial, and print what it found."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--commands", type=int, default=50_000)
    parser.add_argument("--seed", type=int, default=1)
    chosen = parser.parse_args()
    trial, sizes = Trial(chosen.seed), []

    def weigh(now_s: float) -> None:
        if now_s > (len(sizes) + 1) * chosen.minutes * 15:
            sizes.append(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)

    run(trial, 60 * chosen.minutes, chosen.commands, weigh)
    print(f"{trial.now_s:.0f} s of virtual time, {trial.frames} frames of {trial.faces} faces, "
          f"{sum(trial.told.values())} commands: {dict(trial.told)}")  # fmt: skip
    print(f"peak memory at each quarter: {', '.join(f'{size:.1f}' for size in sizes)} MiB; widest {dict(trial.worst)}, "
          f"of undisturbed speech {reach()[0].astype(int).tolist()}")  # fmt: skip
    for kind, what in trial.first.items():
        print(f"{kind}: {trial.broken[kind]} times; first {what}")
    grew = len(sizes) > 2 and sizes[-1] > sizes[0] + 4.0
    print("memory grew" if grew else "", "all held" if not trial.broken else "")
    return bool(trial.broken or grew)


if __name__ == "__main__":
    sys.exit(main())

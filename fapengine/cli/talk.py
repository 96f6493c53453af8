"""The job that ``say`` and ``animate`` share: phones and their sound to FAPs, a talking face, and a contact sheet."""

import re
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from fapengine.cli._drawing import parse_background, parse_edges
from fapengine.errors import DataError, UsageError
from fapengine.files.fap import save_fap
from fapengine.files.heads import DEFAULT_HEAD, load_head
from fapengine.files.moving import KINDS, beside, check_moving, is_moving, write_moving
from fapengine.files.pictures import Picture, contact_sheet, save_png, straight
from fapengine.files.profiles import load_profile
from fapengine.files.sound import save_wav
from fapengine.files.video import CODECS
from fapengine.mpeg4.track import FapTrack
from fapengine.mpeg4.visemes import Expression
from fapengine.profiles import Profile
from fapengine.render.camera import preset
from fapengine.render.renderer import FaceRenderer
from fapengine.speech.phone_track import Phone, PhoneTrack
from fapengine.speech.unknown import UnknownPhone, find_unknown
from fapengine.trajectory.expression import Mood, during_word
from fapengine.trajectory.planner import plan
from fapengine.trajectory.style import GENERATORS, METHOD_NAMES, Style

DEFAULT_PROFILE = "grid_s1_en"
DEFAULT_OUT = Path("out/talk.mp4")
SHEET_FRAMES = 40
"""At most so many phones on a contact sheet; of longer speech, evenly chosen."""
KEY_FRACTION = 0.3
"""A phone is shown at its keyframe."""


@dataclass(frozen=True, slots=True)
class Options:
    """What the command line chose."""

    out: Path = DEFAULT_OUT
    expressions: tuple[str, ...] = ()
    profile: str = DEFAULT_PROFILE
    head: str = DEFAULT_HEAD
    camera: str = "front"
    size: str = "512x512"
    rate_hz: float = 30.0
    style: Style = Style()  # noqa: RUF009  frozen
    seed: int = 1
    background: str = "studio"
    edges: str = "fine"


@dataclass(slots=True)
class Report:
    """Stateful: what was done, and how long each stage took."""

    stages: dict[str, float] = field(default_factory=dict)
    """Seconds by stage."""
    files: list[tuple[Path, str]] = field(default_factory=list)
    frames: int = 0
    rate_hz: float = 0.0
    duration_s: float = 0.0
    phones: int = 0
    level: str = "phone"
    """What the timings were given for."""
    unknown: tuple[UnknownPhone, ...] = ()

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Time what happens inside."""
        started = time.perf_counter()
        yield
        self.stages[name] = self.stages.get(name, 0.0) + time.perf_counter() - started

    def as_dict(self) -> dict[str, object]:
        """For ``--json``."""
        total = sum(self.stages.values())
        return {
            "files": {what: str(path) for path, what in self.files},
            "seconds": self.stages,
            "total_s": total,
            "duration_s": self.duration_s,
            "frames": self.frames,
            "rate_hz": self.rate_hz,
            "times_real_time": self.duration_s / total if total else 0.0,
            "phones": self.phones,
            "level": self.level,
            "unknown_phones": [
                {"label": each.label, "count": each.count, "first_s": each.first_s, "stand_in": each.stand_in}
                for each in self.unknown
            ],
        }


def manner_of(
    articulation: float, jaw: float, lips: float, loudness_db: float, method: str, without: Sequence[str]
) -> Style:
    """Turn options into a style.

    Raises
    ------
    UsageError
        For any that is out of range or unknown.
    """
    chosen = next((name for name in METHOD_NAMES if name == method), None)
    if chosen is None:
        raise UsageError(f"--method: got {method!r}, expected one of {', '.join(METHOD_NAMES)}")
    names = [name.replace("-", "_") for name in without]
    for name in names:
        if name not in (*GENERATORS, "all"):
            known = ", ".join((*GENERATORS, "all")).replace("_", "-")
            raise UsageError(f"--without: got {name!r}, expected one of {known}")
    moving = {name: name not in names and "all" not in names for name in GENERATORS}
    return Style(articulation, jaw, lips, loudness_db, chosen, **moving)


def parse_wish(wish: str) -> tuple[Expression, float, str]:
    """Turn ``"joy:0.4@word"`` into what, how strong, and when (empty: from beginning to end).

    Raises
    ------
    UsageError
        For a name that is no expression or a strength that is no number.
    """
    what, _, when = wish.partition("@")
    name, _, strength = what.partition(":")
    known = [expression.name.lower() for expression in Expression if expression]
    if name.lower() not in known:
        raise UsageError(f"--expression: got {name!r}, expected one of {', '.join(known)}")
    try:
        return Expression[name.upper()], float(strength or 1.0), when
    except ValueError as error:
        raise UsageError(f"--expression: got strength {strength!r}, expected a number as in joy:0.4") from error


def parse_expressions(wishes: Sequence[str], phones: PhoneTrack) -> list[Mood]:
    """Turn ``["joy:0.4", "surprise@1.5-3", "anger@word"]`` into expressions with their times.

    Raises
    ------
    UsageError
        For what :func:`parse_wish` refuses, and for a word that is not spoken.
    """
    moods: list[Mood] = []
    for wish in wishes:
        expression, strength, when = parse_wish(wish)
        span = re.fullmatch(r"([0-9.]+)-([0-9.]+)", when)
        if not when:
            moods.append(Mood(expression, strength))
        elif span:
            try:
                start_s, stop_s = float(span[1]), float(span[2])
            except ValueError as error:
                raise UsageError(f"--expression: got {when!r}, expected seconds as in joy:0.4@1.5-3") from error
            moods.append(Mood(expression, strength, start_s, stop_s))
        else:
            moods += during_word(expression, strength, when, phones)
    return moods


def parse_size(text: str) -> tuple[int, int]:
    """Turn ``"512x512"`` or ``"512"`` into width and height.

    Raises
    ------
    UsageError
        If it is neither.
    """
    width, _, height = text.lower().partition("x")
    try:
        return int(width), int(height or width)
    except ValueError as error:
        raise UsageError(f"--size: got {text!r}, expected WIDTHxHEIGHT such as 512x512") from error


def check(options: Options) -> None:
    """Refuse wishes that cannot be met before any work is done.

    Raises
    ------
    UsageError
        For any option out of range.
    """
    if not (is_moving(options.out) or options.out.suffix == ".fap"):
        raise UsageError(f"--output: got {options.out}, expected a name that ends with {KINDS}, or .fap")
    for wish in options.expressions:
        parse_wish(wish)
    preset(options.camera)
    parse_edges(options.edges)
    alpha, size = parse_background(options.background) is None, parse_size(options.size)
    if options.out.suffix != ".fap":
        check_moving(options.out, rate_hz=options.rate_hz, size=size, alpha=alpha)


def refuse_unknown(phones: PhoneTrack, where: str, *, strict: bool) -> None:
    """Refuse a track with labels that are no IPA, if ``strict``.

    Raises
    ------
    DataError
        That lists them; ``where`` is the file or the voice.
    """
    unknown = find_unknown(phones) if strict else ()
    if unknown:
        raise DataError(f"unknown phones: got {'; '.join(map(str, unknown))}, expected IPA", where=where)


def talk(
    phones: PhoneTrack, sound: tuple[NDArray[np.int16], int] | None, options: Options, report: Report, title: str
) -> None:
    """Do the whole job and write every file; ``report`` is filled in."""
    check(options)
    with report.stage("plan"):
        profile = load_profile(options.profile)
        track = _plan(phones, profile, sound, options, report)
    save_fap(beside(options.out, ".fap"), track)
    if sound is not None:
        save_wav(beside(options.out, ".wav"), *sound)
    if options.out.suffix != ".fap":
        _render(phones, sound, track, options, report, title)
        report.files.append((options.out, "video" if options.out.suffix in CODECS else "pictures"))
    report.files.append((beside(options.out, ".fap"), "FAPs"))
    if sound is not None:
        report.files.append((beside(options.out, ".wav"), "sound"))


def _plan(
    phones: PhoneTrack,
    profile: Profile,
    sound: tuple[NDArray[np.int16], int] | None,
    options: Options,
    report: Report,
) -> FapTrack:
    duration_s = len(sound[0]) / sound[1] if sound else phones.duration_s
    planned = plan(
        phones,
        profile,
        rng=np.random.default_rng(options.seed),
        rate_hz=options.rate_hz,
        expressions=parse_expressions(options.expressions, phones),
        style=options.style,
        duration_s=duration_s,
    )
    report.frames, report.rate_hz, report.duration_s = len(planned.track), options.rate_hz, duration_s
    report.phones = sum(not phone.is_silence for phone in phones.phones)
    report.unknown, report.level = find_unknown(phones), phones.level
    return planned.track


def _render(
    phones: PhoneTrack,
    sound: tuple[NDArray[np.int16], int] | None,
    track: FapTrack,
    options: Options,
    report: Report,
    title: str,
) -> None:
    shown = _shown_phones(phones, track)
    kept: dict[int, Picture] = {}
    with report.stage("head"):
        mesh = load_head(options.head)
    with report.stage("upload"):
        renderer = FaceRenderer(
            mesh,
            size=parse_size(options.size),
            camera=preset(options.camera),
            background=parse_background(options.background),
            samples=parse_edges(options.edges),
        )
    with renderer, progress("drawing", len(track)) as advance:

        def frames() -> Iterator[Picture]:
            pictures = map(straight, renderer.frames(track.values))
            for number in range(len(track)):
                with report.stage("draw"):
                    picture = next(pictures)
                if number in shown:
                    kept[number] = picture
                yield picture

        started = time.perf_counter()
        write_moving(options.out, frames(), rate_hz=track.rate_hz, sound=sound, on_frame=advance)
        report.stages["encode"] = time.perf_counter() - started - report.stages["draw"]
    with report.stage("contact sheet"):
        labels = [(phone.label, f"{number / track.rate_hz:.2f} s") for number, phone in shown.items()]
        if kept:
            sheet = beside(options.out, ".png")
            save_png(sheet, contact_sheet([kept[number] for number in shown], labels, title=title))
            report.files.append((sheet, "contact sheet"))


def _shown_phones(phones: PhoneTrack, track: FapTrack) -> dict[int, Phone]:
    """Frame number to phone, for the contact sheet."""
    spoken = [phone for phone in phones.phones if not phone.is_silence]
    if len(spoken) > SHEET_FRAMES:
        spoken = [spoken[index] for index in np.linspace(0, len(spoken) - 1, SHEET_FRAMES).round().astype(int)]
    shown: dict[int, Phone] = {}
    for phone in spoken:
        number = round((phone.start_s + KEY_FRACTION * phone.duration_s) * track.rate_hz)
        shown.setdefault(min(number, len(track) - 1), phone)
    return shown


@contextmanager
def progress(what: str, total: int) -> Iterator["_Advance"]:
    """Show a progress bar, on a terminal only; call what it gives after each step."""
    console = Console(stderr=True)
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        yield _Advance(progress, total, what)


class _Advance:
    """Stateful: moves one progress bar."""

    def __init__(self, progress: Progress, total: int, what: str) -> None:
        self._progress, self._task = progress, progress.add_task(what, total=total)

    def __call__(self) -> None:
        self._progress.advance(self._task)


def print_report(report: Report, *, as_json: bool) -> None:
    """Say what was written, how long it took, and what was not understood."""
    if as_json:
        import json

        print(json.dumps(report.as_dict(), indent=2, ensure_ascii=False))  # noqa: T201  the answer itself
        return
    console = Console(highlight=False)
    for path, what in report.files:
        console.print(f"[bold]{what:>14}[/]  {path}", soft_wrap=True)
    stages = "  ".join(f"{name} {seconds:.2f} s" for name, seconds in report.stages.items())
    total = sum(report.stages.values())
    console.print(f"{'time':>14}  {stages}", soft_wrap=True)
    drawing = report.stages.get("draw", 0.0)
    reached = f", drawn at {report.frames / drawing:.0f} frames/s" if drawing else ""
    console.print(
        f"{'speech':>14}  {report.duration_s:.2f} s, {report.phones} phones, {report.frames} frames at"
        f" {report.rate_hz:g} Hz{reached}; all in {total:.2f} s,"
        f" {report.duration_s / total:.1f} times real time",
        soft_wrap=True,
    )
    if report.level != "phone":
        console.print(f"{'timings':>14}  of each {report.level}, not of each phone", soft_wrap=True)
    for unknown in report.unknown:
        console.print(f"[yellow]{'unknown phone':>14}[/]  {unknown}", soft_wrap=True)

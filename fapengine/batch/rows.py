"""A row of a manifest: one utterance, or the session of one speaker, and its options."""

from dataclasses import dataclass, field, fields
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

from fapengine.app.manner import manner_of, voice_of
from fapengine.app.outputs import OUTPUT_KINDS, SaveOptions, check_output, find_kind
from fapengine.codec.encoder import EncoderOptions
from fapengine.errors import UsageError
from fapengine.files.heads.load import load_head_info
from fapengine.files.outputs import files_in
from fapengine.files.profiles import load_profile
from fapengine.models.via_points import STRAIGHT
from fapengine.render.drawing import RenderOptions
from fapengine.speaking import DEFAULT_VOICE, PROVENANCE, SpeakingOptions
from fapengine.speech.formats.registry import ParseOptions, check_options
from fapengine.voices.choice import VoiceChoice, language_voice

if TYPE_CHECKING:
    from fapengine.laboratory.fit import FitOptions

PROFILE = "profile"
KINDS = (*(row.ending[1:] for row in OUTPUT_KINDS if row.ending.startswith(".")), PROFILE)
"""Kinds of output: all files that ``say`` writes, and a profile, which is a folder."""
FILES = ("session", "timings", "audio", "into", "map")
"""Columns that name files, or a folder of recordings, relative to the manifest."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Options(SpeakingOptions):
    """Options of ``say``, ``animate``, ``encode``, ``convert`` and ``fit``, with their names and defaults."""

    language: str | None = None
    channel: int | None = None
    format: str | None = None
    tier: str | None = None
    alphabet: str | None = None
    columns: str | None = None
    strict: bool = False
    trust_transcript: bool = False
    head: str = "default"
    camera: str = "front"
    background: str = "studio"
    edges: str = "soft"
    size: str = "512x512"
    shapes: str | None = None
    quant: int = 1
    kbps: float | None = None
    into: str | None = None
    keys: str = STRAIGHT
    map: str | None = None
    modes: int | None = None
    subset: int | None = None
    tolerance: float = 0.35
    held_out: float = 0.2
    units: str | None = None
    up: str | None = None
    report: bool = True
    faps: bool = False

    @property
    def chosen_voice(self) -> str | None:
        """Voice of timed words; None if it is the default, which gives way to the language."""
        return None if self.voice == DEFAULT_VOICE else self.voice

    @property
    def how(self) -> dict[str, str | None]:
        """Options of :func:`fapengine.files.timings.load_timings`."""
        return {name: getattr(self, name) for name in ("format", "tier", "alphabet", "columns")}

    def saving(self, kind: str) -> SaveOptions:
        """Return the options of a file of this kind. Raises UsageError for an invalid one."""
        into = None
        if self.into and find_kind(Path(f"a.{kind}")).takes_avatar:
            from fapengine.app.scene_files import Into

            into = Into(Path(self.into), self.keys, Path(self.map) if self.map else None)
        return SaveOptions(
            head=self.head,
            drawing=RenderOptions.parse(
                size=self.size, camera=self.camera, background=self.background, edges=self.edges
            ),
            shapes=self.shapes,
            encoding=EncoderOptions(quant=self.quant, kbit_s=self.kbps) if kind == "fba" else None,
            into=into,
            provenance=PROVENANCE not in self.without,
        )

    def fitting(self) -> "FitOptions":
        """Return how a profile is learned from a session. Raises UsageError for invalid options."""
        from fapengine.laboratory.fit import FitOptions  # much of scipy, for profiles alone

        return FitOptions(modes=self.modes, k=self.subset, tolerance_mm=self.tolerance, held_out=self.held_out)

    def check(self, kind: str) -> None:
        """Reject invalid options before any work is done. Raises UsageError, which begins with the option's name."""
        manner_of(self)
        if kind == PROFILE:
            self.fitting()
            return
        loaded_profile(self.profile)
        check_options(self.format, ParseOptions(self.tier, self.alphabet, self.columns))
        if check_output(Path(f"a.{kind}"), self.saving(kind), rate_hz=self.fps).is_drawn:
            _known_head(self.head)


loaded_profile = lru_cache(maxsize=8)(load_profile)
"""Loads a profile once per process."""
_known_head = lru_cache(maxsize=1024)(load_head_info)
_known_voice = lru_cache(maxsize=1024)(VoiceChoice.load)
OPTION_NAMES = tuple(each.name for each in fields(Options))
LISTS = tuple(each.name for each in fields(Options) if each.default == ())
"""Options that hold several values; in a table they are separated by ``;``."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """One utterance: a text, timings (and their sound), or a recording (and its transcript).

    Or one speaker: the session from which a profile is learned.
    """

    id: str
    text: str | None = None
    timings: Path | None = None
    audio: Path | None = None
    session: Path | None = None
    options: Options = field(default_factory=Options)
    line: int = 0
    """Line of the manifest."""

    def __post_init__(self) -> None:
        if self.session is not None:
            if (self.timings, self.audio, self.text) != (None, None, None):
                raise UsageError("session: cannot be combined with text, timings or audio")
            return
        if self.timings is None and self.audio is None and self.text is None:
            raise UsageError("row: text, timings and audio are missing; give one of them")
        if self.timings is not None and self.text is not None:
            raise UsageError("text: cannot be combined with timings")

    def check(self, kind: str) -> None:
        """Reject what cannot become such a file. Raises UsageError, which begins with the option's name."""
        if kind == PROFILE and self.session is None:
            raise UsageError("session: missing; a profile needs a folder of recordings")
        if kind != PROFILE and self.session is not None:
            raise UsageError(f"session: cannot become {kind}, only a profile")
        self.options.check(kind)
        if (choice := self.voice) is not None:
            _known_voice(choice)

    @property
    def voice(self) -> VoiceChoice | None:
        """The voice that speaks the text, or pronounces words of the timings or the transcript; None if it is open."""
        options = self.options
        if self.text is not None and self.audio is None:
            return voice_of(options)
        if self.timings is not None and options.chosen_voice:
            return VoiceChoice(options.chosen_voice)
        if options.language is None or (self.timings is None and self.text is None):
            return None
        return VoiceChoice(language_voice(options.language))

    @property
    def inputs(self) -> tuple[Path, ...]:
        """Input files, and names that may be files."""
        options = self.options
        if self.session is not None:
            return (self.session,)
        named = (self.timings, self.audio, options.into, options.map, options.profile, options.head)
        return tuple(Path(path) for path in named if path is not None)

    def output(self, folder: Path, kind: str) -> Path:
        """Name of the output file, or of the folder of a profile."""
        return folder / (self.id if kind == PROFILE else f"{self.id}.{kind}")

    def outputs(self, folder: Path, kind: str) -> list[Path]:
        """Names of all output files."""
        output = self.output(folder, kind)
        if kind != PROFILE:
            return [output]
        from fapengine.app.fit import OWNED  # much of scipy, for profiles alone

        return files_in(output, OWNED)

"""A row of a manifest: one utterance, and the options that the verbs have for one."""

from dataclasses import dataclass, field, fields
from pathlib import Path

from fapengine.app.manner import DEFAULT_PROFILE, Manner, check_expressions
from fapengine.app.scene_files import Into, check_scene
from fapengine.codec.encoder import EncoderOptions
from fapengine.errors import UsageError
from fapengine.files.moving import check_moving
from fapengine.models.keyed_curve import STRAIGHT
from fapengine.render.drawing import Drawing
from fapengine.retarget.shape_sets import shape_set
from fapengine.trajectory.style import Style, parse_method
from fapengine.voices.choice import VoiceChoice

KINDS = ("fba", "fap", "mp4", "csv", "glb")
"""Kinds of files that rows may become."""
LISTS = ("expression", "without")
"""Options that hold several values; in a table they stand apart by ``;``."""
FILES = ("timings", "audio", "into", "map")
"""Columns that name files, relative to the manifest."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """Options of ``say``, ``animate``, ``encode`` and ``convert``, with their names and defaults."""

    voice: str = "en-us"
    rate: int = 160
    ssml: bool = False
    language: str = "en-us"
    channel: int | None = None
    format: str | None = None
    tier: str | None = None
    alphabet: str | None = None
    columns: str | None = None
    strict: bool = False
    expression: tuple[str, ...] = ()
    profile: str = DEFAULT_PROFILE
    fps: float = 30.0
    articulation: float = 1.0
    jaw: float = 1.0
    lips: float = 1.0
    loudness: float = 0.0
    method: str = "context"
    without: tuple[str, ...] = ()
    seed: int = 1
    head: str = "default"
    camera: str = "front"
    background: str = "studio"
    edges: str = "soft"
    size: str = "512x512"
    shapes: str = "arkit"
    quant: int = 1
    kbps: float | None = None
    into: str | None = None
    keys: str = STRAIGHT
    map: str | None = None

    def manner(self) -> Manner:
        """How the face speaks. Raises UsageError for what cannot be."""
        style = Style(
            articulation=self.articulation, jaw=self.jaw, lips=self.lips, loudness_db=self.loudness,
            method=parse_method(self.method),
        )  # fmt: skip
        check_expressions(self.expression)
        return Manner(
            profile=self.profile, style=style.without(self.without), expressions=self.expression, seed=self.seed,
            rate_hz=self.fps,
        )  # fmt: skip

    def drawing(self) -> Drawing:
        """How the face is drawn. Raises UsageError for what cannot be."""
        return Drawing.parse(size=self.size, camera=self.camera, background=self.background, edges=self.edges)

    def encoding(self) -> EncoderOptions:
        """How a stream is coded. Raises UsageError for what cannot be."""
        return EncoderOptions(quant=self.quant, kbit_s=self.kbps)

    def voice_choice(self) -> VoiceChoice:
        """Whose voice speaks a text. Raises UsageError for what cannot be."""
        return VoiceChoice(self.voice, self.rate, self.ssml)

    def avatar(self) -> Into | None:
        """Return the avatar that a motion goes into."""
        return Into(Path(self.into), self.keys, Path(self.map) if self.map else None) if self.into else None

    def check(self, kind: str) -> None:
        """Refuse what cannot be, before anything is done.

        Raises
        ------
        UsageError
            It begins with the option's name.
        """
        self.manner()
        self.voice_choice()
        if kind == "fba":
            self.encoding()
        elif kind == "mp4":
            check_moving(
                Path("a.mp4"), rate_hz=self.fps, size=self.drawing().size, alpha=self.drawing().components == 4
            )
        elif kind == "csv":
            shape_set(self.shapes)
        elif kind == "glb":
            check_scene(Path("a.glb"), self.avatar())


OPTION_NAMES = tuple(each.name for each in fields(Options))


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """One utterance: a text; or timings, with their sound or without; or a recording, with its words or without."""

    id: str
    text: str | None = None
    timings: Path | None = None
    audio: Path | None = None
    options: Options = field(default_factory=Options)
    line: int = 0
    """Place in the manifest."""

    def __post_init__(self) -> None:
        if self.timings is None and self.audio is None and self.text is None:
            raise UsageError("row: got no text, no timings and no audio, expected one")
        if self.timings is not None and self.text is not None:
            raise UsageError("text: got one beside timings, which say themselves what is spoken; expected none")

    @property
    def inputs(self) -> tuple[Path, ...]:
        """Files that it is made of, and names that may be such."""
        options = self.options
        named = (self.timings, self.audio, options.into, options.map, options.profile, options.head)
        return tuple(Path(path) for path in named if path is not None)

    def output(self, folder: Path, kind: str) -> Path:
        """Name of the file that the row becomes."""
        return folder / f"{self.id}.{kind}"

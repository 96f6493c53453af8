"""MPEG-4 facial animation: text or phone timings in, FAP streams and a talking face out.

>>> import fapengine
>>> hello = fapengine.speak("Hello there.", expressions={"joy": 0.4})
>>> hello.save("out/hello.mp4")  # doctest: +SKIP

The names in ``__all__`` are the whole public interface; every other module is private by convention and may change
without notice. A name is imported when it is first used: importing this package imports nothing heavy.

The folders are floors; imports go down only (``pyproject.toml``, import-linter):

====  ==========================================  ==========================================================
16    ``cli`` ``conformance``                     one file a verb: options and printing; suites for programs of others
15    ``batch``                                   corpora: a manifest, a journal, many machines
14    ``app``                                     what a verb does, for Python too
13    ``agents``                                  the face of a voice agent: LiveKit, Pipecat
12    ``live``                                    sessions in real time
11    ``render`` ``files`` ``voices`` ``ears``    the edge: pictures, paths, sound
10    ``_resources`` ``_signals``                 the data inside the package; Ctrl-C while a library works
9     ``laboratory`` ``scoring``                  recordings to a profile, with evidence; scores of lip syncs
8     ``trajectory``                              speech to motion
7     ``profiles``                                the data that make one face speak
6     ``models`` ``speech`` ``retarget``          learned spaces; phones and timings; other rigs
5     ``codec`` ``capture`` ``mesh``              FBA and ``.fap``; recordings; the head
4     ``geometry``                                rotations and splines, without a face word
3     ``mpeg4``                                   the standard's tables and ``FapTrack``
2     ``_strict_toml``                            TOML into checked dataclasses
1     ``_arrays`` ``_late``                       checked, read-only arrays; libraries imported when they are used
0     ``errors``                                  all exceptions
====  ==========================================  ==========================================================
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from fapengine.app.face import Face
    from fapengine.app.heads import load_head
    from fapengine.app.motion import frames, load, save
    from fapengine.app.performance import Performance, animate, speak
    from fapengine.codec.decoder import Decoder
    from fapengine.codec.encoder import Encoder, EncoderOptions
    from fapengine.errors import DataError, FapEngineError, ResourceError, UsageError
    from fapengine.files.profiles import load_profile
    from fapengine.live.clients.sender import Client
    from fapengine.live.server.config import ServeConfig
    from fapengine.live.server.server import Server
    from fapengine.mesh.default_head.style import HeadStyle
    from fapengine.mesh.face_mesh import FaceMesh as Head
    from fapengine.mpeg4.track import FapTrack
    from fapengine.mpeg4.visemes import Expression
    from fapengine.profiles import Profile
    from fapengine.render.drawing import Drawing
    from fapengine.speech.phone_track import Phone, PhoneTrack
    from fapengine.trajectory.expression import Mood
    from fapengine.trajectory.style import Style

__version__: str
"""Version of the installed distribution, from the git tag; ``"0.0.0"`` where fapengine is not installed."""

__all__ = [
    "Client",
    "DataError",
    "Decoder",
    "Drawing",
    "Encoder",
    "EncoderOptions",
    "Expression",
    "Face",
    "FapEngineError",
    "FapTrack",
    "Head",
    "HeadStyle",
    "Mood",
    "Performance",
    "Phone",
    "PhoneTrack",
    "Profile",
    "ResourceError",
    "ServeConfig",
    "Server",
    "Style",
    "UsageError",
    "animate",
    "frames",
    "load",
    "load_head",
    "load_profile",
    "save",
    "speak",
]

_MODULES = {
    "render.drawing": ("Drawing",),
    "app.face": ("Face",),
    "app.heads": ("load_head",),
    "app.motion": ("frames", "load", "save"),
    "app.performance": ("Performance", "animate", "speak"),
    "codec.decoder": ("Decoder",),
    "codec.encoder": ("Encoder", "EncoderOptions"),
    "errors": ("DataError", "FapEngineError", "ResourceError", "UsageError"),
    "files.profiles": ("load_profile",),
    "live.clients.sender": ("Client",),
    "live.server.config": ("ServeConfig",),
    "live.server.server": ("Server",),
    "mesh.default_head.style": ("HeadStyle",),
    "mesh.face_mesh": ("Head",),
    "mpeg4.track": ("FapTrack",),
    "mpeg4.visemes": ("Expression",),
    "profiles": ("Profile",),
    "speech.phone_track": ("Phone", "PhoneTrack"),
    "trajectory.expression": ("Mood",),
    "trajectory.style": ("Style",),
}
"""Names by the module that has them."""
_OF_EXTRAS = {"aiohttp": "live", "prometheus_client": "live", "msgspec": "live"}
"""Libraries that a public name needs as soon as it is used, and the extra that has them."""
_SPELLED = {"Head": "FaceMesh"}
"""Names that a module spells otherwise."""


def __getattr__(name: str) -> Any:
    if name == "__version__":
        return _version()
    for module, names in _MODULES.items():
        if name in names:
            value = getattr(_module(f"{__name__}.{module}", name), _SPELLED.get(name, name))
            globals()[name] = value
            return value
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def _module(module: str, name: str) -> Any:
    try:
        return import_module(module)
    except ModuleNotFoundError as lack:
        if not lack.name or lack.name.partition(".")[0] not in _OF_EXTRAS:
            raise
        from fapengine.errors import ResourceError

        extra = _OF_EXTRAS[lack.name.partition(".")[0]]
        message = f'{name}: {lack.name} is not installed; mend it with: pip install "fapengine[{extra}]"'
        raise ResourceError(message) from lack


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})


def _version() -> str:
    from importlib import metadata

    try:
        return metadata.version(__name__)
    except metadata.PackageNotFoundError:
        return "0.0.0"

"""MPEG-4 facial animation: text or phone timings in, FAP streams and a talking face out.

>>> import fapengine
>>> hello = fapengine.speak("Hello there.", expressions={"joy": 0.4})
>>> hello.save("out/hello.mp4")  # doctest: +SKIP

The names in ``__all__`` and those of ``fapengine.lab`` are the whole public interface; every other module is private
by convention and may change without notice. A name is imported when it is first used: importing this package imports
nothing heavy.

The folders are layers; imports go down only (``pyproject.toml``, import-linter):

====  =================================================  ==========================================================
22    ``cli`` ``conformance``                            command line: options and printing; suites for other programs
21    ``batch`` ``lab``                                  corpora: a manifest, a journal; the laboratory on arrays
20    ``app``                                            what each command does, for Python too
19    ``agents``                                         the face of a voice agent: LiveKit, Pipecat
18    ``clients``                                        the other end of the wire: senders and viewers
17    ``server``                                         listeners, sinks, the web page, calls, workers
16    ``host``                                           engines with sound and words; one clock
15    ``audio``                                          sound devices and their clocks
14    ``render`` ``files`` ``voices`` ``recognition``    the edge: images, paths, speech in and out
13    ``_resources`` ``_cache`` ``_signals`` ``_child``  packaged data; the cache; signals; child processes
12    ``wire``                                           packets: OSC, VMC, VRChat, Live Link, RTP
11    ``engine``                                         sessions on an explicit clock
10    ``laboratory`` ``scoring``                         recordings to a profile, with evidence; scores of lip sync
9     ``trajectory``                                     speech to motion
8     ``profiles``                                       the data that make one face speak
7     ``models`` ``speech`` ``retarget``                 learned spaces; phones and timings; other rigs
6     ``codec`` ``capture`` ``mesh``                     FBA and ``.fap``; recordings; the head
5     ``speaking``                                       the options of speaking, defined once
4     ``geometry`` ``expressions``                       rotations and splines; the expressions, a row each
3     ``mpeg4``                                          the standard's tables and ``FapTrack``
2     ``_strict_toml``                                   TOML into checked dataclasses
1     ``_arrays`` ``_late`` ``_counters``                checked arrays; imports on first use; sums of counts
0     ``errors``                                         all exceptions
====  =================================================  ==========================================================
"""

import os
from importlib import import_module
from typing import TYPE_CHECKING, Any

os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")  # before onnxruntime is imported, by whomever

if TYPE_CHECKING:
    from fapengine.app.face import Face
    from fapengine.app.heads import load_head
    from fapengine.app.motion import frames, load, save, weights
    from fapengine.app.performance import Performance, animate, speak, visemes
    from fapengine.app.score import score
    from fapengine.clients.sender import Client
    from fapengine.codec.decoder import Decoder
    from fapengine.codec.encoder import Encoder, EncoderOptions
    from fapengine.errors import DataError, FapEngineError, ResourceError, UsageError
    from fapengine.expressions import Expression
    from fapengine.files.profiles import load_profile
    from fapengine.mesh.default_head.style import HeadStyle
    from fapengine.mesh.face_mesh import FaceMesh as Head
    from fapengine.mpeg4.track import FapTrack
    from fapengine.profiles import Profile
    from fapengine.render.drawing import RenderOptions
    from fapengine.server.config import ServerConfig
    from fapengine.server.server import Server
    from fapengine.speech.phone_track import Phone, PhoneTrack
    from fapengine.trajectory.expression import Mood
    from fapengine.trajectory.style import Style
    from fapengine.voices.protocol import Speech, Voice

__version__: str
"""Version of the installed distribution, from the git tag; ``"0.0.0"`` where fapengine is not installed."""

__all__ = [
    "Client", "DataError", "Decoder", "Encoder", "EncoderOptions", "Expression", "Face", "FapEngineError", "FapTrack",
    "Head", "HeadStyle", "Mood", "Performance", "Phone", "PhoneTrack", "Profile", "RenderOptions", "ResourceError",
    "Server", "ServerConfig", "Speech", "Style", "UsageError", "Voice", "animate", "frames", "load", "load_head",
    "load_profile", "save", "score", "speak", "visemes", "weights",
]  # fmt: skip

_MODULES = {
    "render.drawing": ("RenderOptions",),
    "app.face": ("Face",),
    "app.heads": ("load_head",),
    "app.motion": ("frames", "load", "save", "weights"),
    "app.performance": ("Performance", "animate", "speak", "visemes"),
    "app.score": ("score",),
    "codec.decoder": ("Decoder",),
    "codec.encoder": ("Encoder", "EncoderOptions"),
    "errors": ("DataError", "FapEngineError", "ResourceError", "UsageError"),
    "files.profiles": ("load_profile",),
    "clients.sender": ("Client",),
    "server.config": ("ServerConfig",),
    "server.server": ("Server",),
    "mesh.default_head.style": ("HeadStyle",),
    "mesh.face_mesh": ("Head",),
    "mpeg4.track": ("FapTrack",),
    "expressions": ("Expression",),
    "profiles": ("Profile",),
    "speech.phone_track": ("Phone", "PhoneTrack"),
    "trajectory.expression": ("Mood",),
    "trajectory.style": ("Style",),
    "voices.protocol": ("Speech", "Voice"),
}
"""Module of each public name."""
_SPELLED = {"Head": "FaceMesh"}
"""Public names that differ from those in their modules."""


def __getattr__(name: str) -> Any:
    if name == "__version__":
        return _version()
    for module, names in _MODULES.items():
        if name in names:
            try:
                value = getattr(import_module(f"{__name__}.{module}"), _SPELLED.get(name, name))
            except ModuleNotFoundError as error:
                from fapengine._late import EXTRAS, missing

                package = (error.name or "").partition(".")[0]
                if package not in EXTRAS:
                    raise
                raise missing(package, name) from error
            globals()[name] = value
            return value
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})


def _version() -> str:
    from importlib import metadata

    try:
        return metadata.version(__name__)
    except metadata.PackageNotFoundError:
        return "0.0.0"

"""Kinds of files that ``fapengine inspect`` knows, in the order in which they are tried.

To add a kind, write how it is found and described in a module here, and add its row.
"""

from fapengine.app.inspection import faces, media, motion, tracked
from fapengine.app.inspection.report import FileKind, Source
from fapengine.errors import UnsupportedError
from fapengine.files.gltf.document import find_other

FILE_KINDS: tuple[FileKind, ...] = (
    faces.PROFILE,
    faces.HEAD,
    tracked.TRACKED,
    tracked.MARKERS,
    tracked.SESSION,
    faces.AVATAR,
    motion.FBA,
    media.RECORDING,
    motion.SHAPES,
    media.TIMINGS,
    motion.FAPS,
    media.IMAGE,
)


def find_kind(source: Source) -> FileKind:
    """Find what a file is: by its content, and where that cannot tell by its ending.

    Raises UsageError if it cannot be read; UnsupportedError if it is none of them.
    """
    kind = next((kind for kind in FILE_KINDS if kind.fits(source)), None)
    if kind is not None:
        return kind
    if source.ending == ".bap":
        raise UnsupportedError(
            f"{source.path}: got body animation parameters (.bap), which move a body, expected what moves a face (.fap)"
        )
    if other := find_other(source.data):
        raise UnsupportedError(f"{source.path}: got {other}")
    raise UnsupportedError(
        f"{source.path}: got {source.data[:20]!r}, expected {', '.join(kind.name for kind in FILE_KINDS)}",
        where="byte 0",
    )

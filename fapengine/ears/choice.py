"""Which ear hears sound without a text: one of ours by its name, or a learned one of the user's own."""

from importlib.util import find_spec
from pathlib import Path

from fapengine.ears.protocol import Ear
from fapengine.errors import ResourceError

SMALL, SPHINX, BOTH = "small", "sphinx", "both"
"""Names of our own small network, of PocketSphinx's phone loop, and of the two together."""
NAMES = (SMALL, SPHINX, BOTH)
_NEEDS_SPHINX = (SPHINX, BOTH)


def chosen(ear: Path | None) -> Path:
    """Return the ear that hears: what was asked for, else both where PocketSphinx is installed, else the small one.

    Examples
    --------
    >>> chosen(Path("small")).name
    'small'
    """
    if ear is not None:
        return ear
    return Path(BOTH if find_spec("pocketsphinx") is not None else SMALL)


def check_ear(ear: Path | None) -> None:
    """Refuse an ear that cannot hear.

    Raises
    ------
    UsageError, DataError
        As :func:`.onnx_ear.load_model`, for what is no name of :data:`NAMES`.
    ResourceError
        If what it needs is not installed.
    """
    check_installed(ear)
    if str(chosen(ear)) not in NAMES:
        from fapengine.ears.onnx_ear import load_model

        load_model(chosen(ear))


def check_installed(ear: Path | None) -> None:
    """Raise ``ResourceError`` if PocketSphinx is chosen and not installed."""
    if not is_installed(ear):
        raise ResourceError('ear: PocketSphinx is not installed; mend it with: pip install "fapengine[ear]"')


def is_installed(ear: Path | None) -> bool:
    """Tell whether what a chosen ear needs is there; of a learned one that is not known before it is loaded."""
    return str(chosen(ear)) not in _NEEDS_SPHINX or find_spec("pocketsphinx") is not None


def new_ear(ear: Path | None) -> Ear:
    """Make the ear that is chosen.

    Raises
    ------
    UsageError, DataError, ResourceError
        As :func:`check_ear`; and ``DataError`` if the package's weights are damaged.
    """
    name = str(chosen(ear))
    if name == SMALL:
        from fapengine.ears.small_ear import SmallEar

        return SmallEar()
    if name == SPHINX:
        from fapengine.ears.sphinx_ear import SphinxEar

        return SphinxEar()
    if name == BOTH:
        from fapengine.ears.joint_ear import JointEar

        return JointEar()
    from fapengine.ears.onnx_ear import OnnxEar

    return OnnxEar(Path(name))

"""The recognizer for audio without a text: a built-in one by its name, or a model of the user's."""

from importlib.util import find_spec
from pathlib import Path

from fapengine._late import missing
from fapengine.recognition.protocol import Recognizer

SMALL, SPHINX, BOTH = "small", "sphinx", "both"
"""Names of the built-in network, of PocketSphinx's phone loop, and of the two together."""
NAMES = (SMALL, SPHINX, BOTH)


def chosen(recognizer: Path | None) -> Path:
    """Name of the recognizer to use: the given one, else both if PocketSphinx is installed, else the small one.

    Examples
    --------
    >>> chosen(Path("small")).name
    'small'
    """
    if recognizer is not None:
        return recognizer
    return Path(BOTH if find_spec("pocketsphinx") is not None else SMALL)


def check_recognizer(recognizer: Path | None) -> None:
    """Raise ``ResourceError`` if a recognizer's library is not installed, and as ``load_model`` for a bad model."""
    check_installed(recognizer)
    if str(chosen(recognizer)) not in NAMES:
        from fapengine.recognition.onnx_recognizer import load_model

        load_model(chosen(recognizer))


def check_installed(recognizer: Path | None) -> None:
    """Raise ``ResourceError`` if PocketSphinx is chosen and not installed."""
    if not is_installed(recognizer):
        raise missing("PocketSphinx", "recognizer")


def is_installed(recognizer: Path | None) -> bool:
    """Return whether a built-in recognizer's library is installed; a model's is checked when it is loaded."""
    return str(chosen(recognizer)) not in (SPHINX, BOTH) or find_spec("pocketsphinx") is not None


def new_recognizer(recognizer: Path | None) -> Recognizer:
    """Make the chosen recognizer; raises as :func:`check_recognizer`, and ``DataError`` for damaged weights."""
    name = str(chosen(recognizer))
    if name == SMALL:
        from fapengine.recognition.small_recognizer import SmallRecognizer

        return SmallRecognizer()
    if name == SPHINX:
        from fapengine.recognition.sphinx_recognizer import SphinxRecognizer

        return SphinxRecognizer()
    if name == BOTH:
        from fapengine.recognition.small_recognizer import JointRecognizer

        return JointRecognizer()
    from fapengine.recognition.onnx_recognizer import OnnxRecognizer

    return OnnxRecognizer(Path(name))

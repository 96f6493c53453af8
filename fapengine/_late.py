"""Libraries that are imported on first use; a missing one is reported with the command that installs it.

With numpy alone, in a small container or a browser, fapengine plans, encodes and converts. Rendering, playing sound and
reading images need more.
"""

from importlib import import_module
from importlib.util import find_spec
from types import ModuleType
from typing import Any

from fapengine.errors import ResourceError

_PACKAGES = {
    "video": "av pillow font-source-sans-pro", "voice": "espeak-ng num2words",
    "live": "aiohttp prometheus_client msgspec", "lab": "matplotlib trimesh", "piper": "piper-tts onnx",
    "piper-plus": "piper-plus", "kokoro": "kokoro-onnx", "recognizer": "PocketSphinx", "recognizer-onnx": "onnxruntime",
    "batch": "distributed", "window": "glfw", "webrtc": "aiortc", "camera": "pyvirtualcam", "nats": "nats-py",
    "pipecat": "pipecat-ai", "usd": "usd-core", "draco": "DracoPy", "sign": "c2pa-python", "mcp": "mcp",
}  # fmt: skip
EXTRAS = {package: f'"fapengine[{extra}]"' for extra, packages in _PACKAGES.items() for package in packages.split()} | {
    "fapengine-native": "fapengine-native (in a checkout: make native)"
}
"""Extra that contains each package, as pip spells it."""


class Late(ModuleType):
    """A module that is imported on first use. Stateful.

    Parameters
    ----------
    name : str
        Module name.
    package : str
        Name for pip.
    use : str
        Purpose, for the error message.
    """

    def __init__(self, name: str, package: str, use: str) -> None:
        super().__init__(name)
        self.__dict__["_late"] = name, package, use

    def __getattr__(self, key: str) -> Any:
        name, package, use = self.__dict__["_late"]
        if key.startswith("__"):  # introspection does not need the library
            raise AttributeError(key)
        try:
            module = import_module(name)
            value = getattr(module, key) if hasattr(module, key) else import_module(f"{name}.{key}")
        except ImportError as error:
            raise missing(package, use) from error
        except OSError as error:
            raise ResourceError(f"{use}: {package} cannot be loaded ({error}); see fapengine doctor") from error
        self.__dict__[key] = value
        return value


def require(use: str, **modules: str) -> None:
    """Check that libraries are installed before long work starts; none is imported.

    Parameters
    ----------
    use : str
        Purpose, for the error message.
    **modules : str
        Module name and its name for pip.

    Raises
    ------
    ResourceError
        If one is not installed; the message says how to install it.
    """
    for name, package in modules.items():
        if find_spec(name) is None:
            raise missing(package, use)


def needed(module: str, package: str, use: str) -> Any:
    """Import a library that an extra installs; the parameters are those of :class:`Late`.

    Raises
    ------
    ResourceError
        If it is not installed; the message says how to install it.
    """
    try:
        return import_module(module)
    except ImportError as error:
        raise missing(package, use) from error


def missing(package: str, use: str) -> ResourceError:
    """Return the error that says how to install a package."""
    return ResourceError(f"{use}: {package} is not installed. {how_to_install(EXTRAS.get(package, package))}")


def how_to_install(requirement: str) -> str:
    """Return the sentence that ends an error message about a missing library.

    Examples
    --------
    >>> how_to_install('"fapengine[live]"')
    'Install it with: pip install "fapengine[live]" (in a checkout: pip install -e ".[live]")'
    """
    in_checkout = requirement.replace('"fapengine[', '-e ".[')
    hint = f" (in a checkout: pip install {in_checkout})" if in_checkout != requirement else ""
    return f"Install it with: pip install {requirement}{hint}"

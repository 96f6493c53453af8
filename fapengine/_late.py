"""Libraries that are imported when they are first used, and missed with the line that mends the lack.

Whoever has numpy alone, in a small container or a browser, can plan, code and convert; what draws, plays or
reads pictures asks for its library when it is called.
"""

from importlib import import_module
from importlib.util import find_spec
from types import ModuleType
from typing import Any

from fapengine.errors import ResourceError

_EXTRAS = {
    **dict.fromkeys(("av", "pillow", "font-source-sans-pro"), '"fapengine[video]"'),
    "aiohttp": '"fapengine[live]"',
    "piper-tts": '"fapengine[piper]"',
    "onnx": '"fapengine[piper]"',
    "kokoro-onnx": '"fapengine[kokoro]"',
    "usd-core": '"fapengine[usd]"',
    "DracoPy": '"fapengine[draco]"',
}
"""Extra of each package that is part of one, as pip is told it."""


class Late(ModuleType):
    """A module that is not there yet. Stateful.

    Parameters
    ----------
    name : str
        Of the module.
    package : str
        Name to install it by.
    use : str
        What it is for, for the message.
    """

    def __init__(self, name: str, package: str, use: str) -> None:
        super().__init__(name)
        self.__dict__["_late"] = name, package, use

    def __getattr__(self, key: str) -> Any:
        name, package, use = self.__dict__["_late"]
        if key.startswith("__"):  # what inspectors of modules ask for is no use of it
            raise AttributeError(key)
        try:
            module = import_module(name)
            value = getattr(module, key) if hasattr(module, key) else import_module(f"{name}.{key}")
        except ImportError as error:
            raise _missing(package, use) from error
        except OSError as error:
            raise ResourceError(f"{use}: {package} cannot be loaded ({error}); see fapengine doctor") from error
        self.__dict__[key] = value
        return value


def require(use: str, **modules: str) -> None:
    """Refuse long work whose last step would lack a library; none is imported.

    Parameters
    ----------
    use : str
        What it is for, for the message.
    **modules : str
        Name to install each by, by its module.

    Raises
    ------
    ResourceError
        For the first that is not installed, with the line that mends it.
    """
    for name, package in modules.items():
        if find_spec(name) is None:
            raise _missing(package, use)


def _missing(package: str, use: str) -> ResourceError:
    return ResourceError(
        f"{use}: {package} is not installed; mend it with: pip install {_EXTRAS.get(package, package)}"
    )

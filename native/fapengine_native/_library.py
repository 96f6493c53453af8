"""The compiled library, and how its functions are called."""

import ctypes
from pathlib import Path
from typing import Any

VERSION = 2
"""Of the library's interface."""


def _load(path: Path) -> ctypes.CDLL:
    library = ctypes.CDLL(str(path))
    pointer, number, long = ctypes.c_void_p, ctypes.c_int, ctypes.c_int64
    bits = [pointer, long, long]  # array, its length, and where to begin
    forms: dict[str, tuple[Any, list[Any]]] = {
        "version": (number, []),
        "select": (ctypes.c_char_p, [ctypes.c_char_p]),
        "open": (pointer, [pointer, number, pointer, pointer, number, pointer, pointer]),
        "close": (None, [pointer]),
        "canvas": (number, [pointer, number, number, pointer]),
        "skin": (number, [pointer, number, number, pointer]),
        "draw": (number, [pointer, pointer, number, number, number, pointer]),
        "resize": (None, [pointer, number, number, pointer, number, number]),
        "reset_models": (number, [pointer]),
        "encode_plane": (number, [pointer, number, pointer, pointer, pointer, number, *bits, pointer]),
        "encode_predicted": (number, [pointer, pointer, pointer, pointer, long, pointer, number, *bits, pointer]),
        "decode_settled": (number, [pointer, number, *bits, pointer, pointer, pointer, pointer, pointer]),
        "keep_plane": (number, [pointer, number, pointer, pointer]),
        "decode_predicted": (
            number,
            [pointer, *bits, number, number, pointer, pointer, pointer, pointer, long, pointer, pointer, pointer,
             pointer],
        ),
        "find_intra": (long, [*bits, number]),
    }  # fmt: skip
    for name, (result, arguments) in forms.items():
        function = getattr(library, f"fapengine_native_{name}", None)
        if function is None:
            raise ImportError(f"fapengine_native: {path.name} has no {name}")
        function.restype, function.argtypes = result, arguments
    if library.fapengine_native_version() != VERSION:
        raise ImportError(f"fapengine_native: got version {library.fapengine_native_version()}, expected {VERSION}")
    return library


def _path() -> Path:
    found = sorted(Path(__file__).parent.glob("libfapengine_native.*"))
    if not found:
        raise ImportError("fapengine_native: the compiled library is missing")
    return found[0]


library = _load(_path())

"""Coverage-guided search in every reader of :mod:`.readers`: the first byte of an input chooses the reader.

Run ``python -m tests.fuzz.fuzz_readers out/fuzz/readers -max_total_time=60``; the folder is filled with the good
examples first. An input that breaks the law (a value or an error of ours) is left beside it as ``crash-*``.
"""

import sys
from pathlib import Path

import atheris

with atheris.instrument_imports(include=["fapengine"], exclude=["fapengine.mesh", "fapengine.render"]):
    from fapengine.codec import kernels
    from tests.fuzz.readers import readers
from fapengine.errors import FapEngineError

kernels.loops = kernels


def one_input(data: bytes) -> None:
    """Give the bytes to the reader that the first of them chooses."""
    if not data:
        return
    reader = readers()[data[0] % len(readers())]
    try:
        reader.read(data[1:])
    except FapEngineError:
        return


def write_examples(folder: Path) -> None:
    """Lay the good examples there, each with the byte that chooses its reader; long ones are left out."""
    folder.mkdir(parents=True, exist_ok=True)
    for number, reader in enumerate(readers()):
        for index, good in enumerate(reader.good):
            if len(good) < 20_000:
                (folder / f"good-{number}-{index}").write_bytes(bytes([number]) + good)


if __name__ == "__main__":
    write_examples(Path(sys.argv[1]))
    atheris.Setup(sys.argv, one_input)
    atheris.Fuzz()

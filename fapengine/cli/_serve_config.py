"""What ``fapengine serve`` was told: its file, and its options, which go before the file."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from fapengine.errors import UsageError
from fapengine.live.config import FORMATS, RATES_HZ, ServeConfig, parse_config
from fapengine.live.protocol.schema import check_session
from fapengine.live.server.sinks import parse_sink
from fapengine.trajectory.style import GENERATORS, Style


def configured(path: Path | None, given: Mapping[str, Any]) -> ServeConfig:
    """Join the file and the options.

    Parameters
    ----------
    path : Path, optional
        A TOML file.
    given : mapping
        Options by their names; None where one was not given.

    Raises
    ------
    DataError
        If the file is wrong.
    UsageError
        If an option is, or the file cannot be read.
    """
    try:
        own = ServeConfig() if path is None else parse_config(path.read_bytes(), str(path))
    except OSError as error:
        raise UsageError(f"--config: got {path}, expected a file that can be read: {error.strerror}") from error
    if given["fps"] is not None and not RATES_HZ[0] <= given["fps"] <= RATES_HZ[1]:
        raise UsageError(f"--fps: got {given['fps']:g}, expected {RATES_HZ[0]:g}..{RATES_HZ[1]:g}")
    if given["log"] is not None and given["log"] not in FORMATS:
        raise UsageError(f"--log: got {given['log']!r}, expected {' or '.join(FORMATS)}")
    for url in (*own.sinks, *given["sink"]):
        parse_sink(url)

    def told(**names: str) -> dict[str, Any]:
        return {field: given[name] for field, name in names.items() if given[name] is not None}

    listen = replace(
        own.listen, **told(host="host", port="port", web_port="web_port", token="token", metrics_port="metrics")
    )
    listen = replace(listen, token=listen.token or None)  # an empty variable of the environment is none
    sound = replace(own.sound, **told(session="sound", device="device"))
    sound = replace(sound, session=sound.session or None, device=sound.device or None)
    if sound.session is not None:
        check_session(sound.session)
    elif sound.device is not None:
        raise UsageError(f"--device: got {sound.device!r}, expected --sound SESSION with it")
    return replace(
        own,
        listen=replace(listen, web_port=None) if given["no_page"] else listen,
        face=replace(own.face, **told(profile="profile", head="head", rate_hz="fps", seed="seed")),
        style=_still(own.style, given["without"]),
        sound=sound,
        log=replace(own.log, **told(format="log"), **({"level": "debug"} if given["verbose"] else {})),
        sinks=(*own.sinks, *given["sink"]),
    )


def _still(style: Style, without: list[str]) -> Style:
    names = [name.replace("-", "_") for name in without]
    for name in names:
        if name not in (*GENERATORS, "all"):
            known = ", ".join(one.replace("_", "-") for one in GENERATORS)
            raise UsageError(f"--without: got {name!r}, expected one of {known}, all")
    switched: dict[str, Any] = dict.fromkeys(GENERATORS if "all" in names else names, False)
    return replace(style, **switched)

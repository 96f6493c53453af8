"""Servers that speak OpenAI's protocol: language models (``/chat/completions``) and recognizers (``/audio/…``)."""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

from fapengine._late import Late
from fapengine.errors import ResourceError, UsageError

if TYPE_CHECKING:
    import aiohttp
else:
    aiohttp = Late("aiohttp", "aiohttp", "agent")

LIMIT_S = 10.0
"""Time for the answer to the question which models there are."""
KEYS = {"llm": "FAPENGINE_LLM_KEY", "stt": "FAPENGINE_STT_KEY"}
"""Environment variables with the keys, by option."""


@dataclass(frozen=True, slots=True)
class Endpoint:
    """One server and the model to use there."""

    option: str
    """Name of the option, for error messages: ``llm`` or ``stt``."""
    url: str
    """Base address, such as ``http://127.0.0.1:11434/v1``."""
    model: str | None = None
    """None: the first that the server lists."""
    key: str | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        parts = urlsplit(self.url)
        if parts.scheme not in ("http", "https") or not parts.netloc:
            raise UsageError(f"{self.option}: got {self.url!r}, expected a URL such as http://127.0.0.1:11434/v1")

    async def checked(self) -> "Endpoint":
        """Ask the server for its models, and return this endpoint with one of them.

        A server that answers but does not list its models is accepted if a model is given. Raises ResourceError if it
        does not answer, or refuses the key; UsageError if it has no such model.
        """
        url = f"{self.url.rstrip('/')}/models"
        headers = {"Authorization": f"Bearer {self.key}"} if self.key else {}
        try:
            async with (
                aiohttp.ClientSession(timeout=aiohttp.ClientTimeout(LIMIT_S)) as http,
                http.get(url, headers=headers) as answer,
            ):
                status = answer.status
                listed = await answer.json(content_type=None) if status == 200 else None
        except (aiohttp.ClientError, TimeoutError) as error:
            reason = getattr(error, "strerror", None) or str(error) or f"no answer within {LIMIT_S:g} s"
            raise ResourceError(
                f"{self.option}: {self.url} cannot be reached ({reason}); is the server running?"
            ) from error
        except ValueError:  # not JSON
            listed = None
        if status in (401, 403):
            which = "a key is missing" if not self.key else "the key is refused"
            raise ResourceError(f"{self.option}: {self.url} answered {status}: {which}; set it in {KEYS[self.option]}")
        return self._chosen(_names(listed), status)

    def _chosen(self, names: list[str], status: int) -> "Endpoint":
        if self.model is None and not names:
            raise UsageError(
                f"{self.option}_model: missing; {self.url}/models answered {status} and lists no models. A base URL"
                " usually ends with /v1"
            )
        if self.model is not None and names and self.model not in names:
            raise UsageError(f"{self.option}_model: got {self.model!r}, expected one of {', '.join(names[:20])}")
        return Endpoint(self.option, self.url, self.model or names[0], self.key)


def _names(listed: Any) -> list[str]:
    """Return the names of an answer: ``{"data": [{"id": NAME}, ...]}``."""
    models = listed.get("data") if isinstance(listed, dict) else None
    return [str(model["id"]) for model in models or () if isinstance(model, dict) and "id" in model]

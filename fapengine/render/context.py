"""An OpenGL context without a window, on a GPU or on Mesa's software renderer."""

from typing import Any

import moderngl

from fapengine.errors import ResourceError

REQUIRED = 330
"""OpenGL 3.3 core."""


def create_context() -> moderngl.Context:
    """Make a context through EGL.

    Raises
    ------
    ResourceError
        If there is no OpenGL 3.3; the message says what to install.
    """
    settings: dict[str, Any] = {"backend": "egl"}
    try:
        return moderngl.create_context(standalone=True, require=REQUIRED, **settings)
    except Exception as error:
        raise ResourceError(
            f"OpenGL: no context ({error}); on Debian or Ubuntu: sudo apt-get install -y libegl1 libgl1"
        ) from error

"""VTube Studio's public API, version 1.0: one face as tracking parameters, in JSON texts over a WebSocket.

The dialog: request a token, which the user grants in VTube Studio's window; authenticate with it; request the list of
parameters, since an unknown one invalidates a whole request; then send one request per frame. Source of the messages:
the README of DenchiSoft/VTubeStudio.

Values (:func:`vts_values`): X is positive to the viewer's right, which is the model's left, Y up; smile and brows rest
at 0.5; an eye is closed at 0 and wide at 1. VTube Studio maps the values to each model's range. Its documentation does
not define the rest values: these are ours.
"""

import json
from collections.abc import Mapping
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from fapengine._arrays import frozen
from fapengine.errors import DataError
from fapengine.retarget.blend import ARKIT_NAMES
from fapengine.retarget.visemes import OCULUS_NAMES
from fapengine.wire.shapes import turns_rad

PORT = 8001
API = {"apiName": "VTubeStudioPublicAPI", "apiVersion": "1.0"}
PLUGIN = {"pluginName": "fapengine", "pluginDeveloper": "fapengine"}
"""Names that VTube Studio shows; a token is valid for these only."""
DENIED, NO_LONGER_ALLOWED = 50, 8
"""Errors: the user refused; the user withdrew the permission."""
MAX_TOKEN = 64
OPEN_AT_REST = 0.8
GAZE_DEG = 30.0
"""Turn of an eye at which its X or Y is 1."""
VOWELS = {"VoiceA": "aa", "VoiceI": "ih", "VoiceU": "ou", "VoiceE": "E", "VoiceO": "oh"}
"""Viseme of Oculus for each parameter."""

DialogState = Literal["closed", "asking", "checking", "listing", "ready", "denied"]


def vts_values(arkit: ArrayLike, visemes: ArrayLike, faps: ArrayLike) -> dict[str, float]:
    """Convert one frame to parameters.

    Parameters
    ----------
    arkit : (52,)
        Weights of ARKit's shapes.
    visemes : (15,)
        Shares of Oculus' visemes.
    faps : (68,) FAPU
        For head and eye angles.

    Examples
    --------
    >>> rest = vts_values([0.0] * 52, [1.0] + [0.0] * 14, [0] * 68)
    >>> rest["MouthOpen"], rest["MouthSmile"], rest["EyeOpenLeft"], rest["FaceAngleX"]
    (0.0, 0.5, 0.8, 0.0)
    """
    weights = frozen(arkit, "arkit", (len(ARKIT_NAMES),), np.float64)
    shape = dict(zip(ARKIT_NAMES, weights.tolist(), strict=True))
    shares = frozen(visemes, "visemes", (len(OCULUS_NAMES),), np.float64)
    mouth = dict(zip(OCULUS_NAMES, shares.tolist(), strict=True))
    turns = np.degrees(turns_rad(faps))
    (yaw, pitch, roll), *eyes = turns.tolist()

    def both(name: str) -> float:
        return float(shape[f"{name}Left"] + shape[f"{name}Right"]) / 2

    values = {
        "MouthOpen": shape["jawOpen"] - shape["mouthClose"],
        "MouthSmile": 0.5 + 0.5 * (both("mouthSmile") - both("mouthFrown")),
        "CheekPuff": shape["cheekPuff"],
        "Brows": 0.5 + 0.5 * (both("browOuterUp") / 2 + shape["browInnerUp"] / 2 - both("browDown")),
    }
    for side in ("Left", "Right"):
        values[f"EyeOpen{side}"] = (1 - shape[f"eyeBlink{side}"]) * (
            OPEN_AT_REST + (1 - OPEN_AT_REST) * shape[f"eyeWide{side}"]
        )
        up = (shape[f"browOuterUp{side}"] + shape["browInnerUp"]) / 2 - shape[f"browDown{side}"]
        values[f"Brow{side}Y"] = 0.5 + 0.5 * up
    values |= {name: mouth[viseme] for name, viseme in VOWELS.items()}
    shown = {name: min(max(value, 0.0), 1.0) for name, value in values.items()}
    for side, (eye_yaw, eye_pitch, _) in zip(("Left", "Right"), eyes, strict=True):
        shown[f"Eye{side}X"] = min(max(eye_yaw / GAZE_DEG, -1.0), 1.0)
        shown[f"Eye{side}Y"] = min(max(-eye_pitch / GAZE_DEG, -1.0), 1.0)
    shown |= {"FaceAngleX": yaw, "FaceAngleY": -pitch, "FaceAngleZ": -roll}
    return {name: round(value, 4) + 0.0 for name, value in shown.items()}


def request(kind: str, data: Mapping[str, Any]) -> str:
    """Encode one request."""
    return json.dumps({**API, "requestID": kind, "messageType": kind, "data": dict(data)})


class VtsDialog:
    """The dialog with VTube Studio, over one connection after another: texts in, texts out.

    Stateful.

    Parameters
    ----------
    token : str, optional
        Granted earlier; without a valid one the user is asked.
    """

    def __init__(self, token: str | None = None) -> None:
        self.token = token
        self.state: DialogState = "closed"
        self.names: frozenset[str] = frozenset()
        """Parameters that exist."""
        self.unanswered = 0
        """Number of frames without an answer."""
        self.complaint = ""
        """Last error about a frame."""
        self._is_fresh = False

    @property
    def is_denied(self) -> bool:
        """Whether the user has refused or withdrawn the permission."""
        return self.state == "denied"

    def begin(self) -> str:
        """Start a connection: return the first request."""
        self.unanswered, self._is_fresh = 0, False
        return self._authenticate() if self.token else self._ask()

    def take(self, text: str) -> str | None:
        """Process a message of VTube Studio; return the next request, if one follows.

        Raises DataError if it is not a message of the API, or an error that ends the connection.
        """
        kind, data = _read(text)
        if kind == "APIError":
            self._take_error(data)
            return None
        if kind == "AuthenticationTokenResponse" and self.state == "asking":
            token = data.get("authenticationToken")
            if not isinstance(token, str) or not 0 < len(token) <= MAX_TOKEN:
                raise DataError(f"VTube Studio: got no token of 1 to {MAX_TOKEN} characters")
            self.token, self._is_fresh = token, True
            return self._authenticate()
        if kind == "AuthenticationResponse" and self.state == "checking":
            if data.get("authenticated") is True:
                self.state = "listing"
                return request("InputParameterListRequest", {})
            self.token = None
            if self._is_fresh:
                raise DataError(f"VTube Studio: refused its own token: {str(data.get('reason'))!r:.100}")
            return self._ask()
        if kind == "InputParameterListResponse" and self.state == "listing":
            rows = data.get("defaultParameters")
            if not isinstance(rows, list):
                raise DataError("VTube Studio: got no list of parameters")
            self.names = frozenset(str(row["name"]) for row in rows if isinstance(row, dict) and "name" in row)
            self.state = "ready"
        elif kind == "InjectParameterDataResponse":
            self.unanswered = max(0, self.unanswered - 1)
        return None

    def inject(self, values: Mapping[str, float]) -> str:
        """Encode a frame; unknown parameters are left out."""
        self.unanswered += 1
        rows = [{"id": name, "value": value} for name, value in values.items() if name in self.names]
        return request("InjectParameterDataRequest", {"faceFound": True, "mode": "set", "parameterValues": rows})

    def _ask(self) -> str:
        self.state = "asking"
        return request("AuthenticationTokenRequest", PLUGIN)

    def _authenticate(self) -> str:
        self.state = "checking"
        return request("AuthenticationRequest", {**PLUGIN, "authenticationToken": self.token})

    def _take_error(self, data: dict[str, Any]) -> None:
        number, message = data.get("errorID"), f"{str(data.get('message'))!r:.200}"
        if (number == DENIED and self.state == "asking") or number == NO_LONGER_ALLOWED:
            self.state, self.token = "denied", None
        elif self.state == "ready":
            self.unanswered = max(0, self.unanswered - 1)
            self.complaint = f"error {number}: {message}"
        else:
            raise DataError(f"VTube Studio: error {number}: {message}")


def _read(text: str) -> tuple[str, dict[str, Any]]:
    try:
        message = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise DataError(f"VTube Studio: got {text!r:.60}, expected JSON") from error
    kind = message.get("messageType") if isinstance(message, dict) else None
    data = message.get("data") if isinstance(message, dict) else None
    if not isinstance(kind, str):
        raise DataError(f"VTube Studio: got {text!r:.60}, expected an object with a messageType")
    return kind, data if isinstance(data, dict) else {}

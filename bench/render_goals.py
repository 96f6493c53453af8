"""Goals of the renderer's speed, and the names of its cases and peers: shared by bench/render and its page."""

REFERENCE = "default head"
"""Name of the case that all others are compared with."""
GOALS_FPS = {REFERENCE: 60, "26,000 vertices": 40, "71,000 vertices": 20, "720p": 30}
"""Case to the frames a second that it must reach."""
MAX_DEFORMING = 1.3
"""Time of a frame to that of an undeformed mesh."""
PEERS = ("PyVista", "PyVista, bare", "pygfx", "pygfx, default settings", "pygfx, bare", "vispy, bare", "pyrender")
BROWSER_PEERS = ("three.js", "three.js, bare", "three.js, morphs", "our page")
"""In headless Chromium: :mod:`bench.browser_peers`, run by this interpreter."""
MIN_PEER_RATIO = 6.0
"""Time of a peer's frame to ours."""
MIN_PEER_RATIOS = {"three.js": 2.0, "three.js, bare": None, "three.js, morphs": None, "our page": None}
"""Peer to such a ratio where it is not :data:`MIN_PEER_RATIO`; None: there is no goal."""
STAIRS, SOFT, FINE = "aliased, light at pixels", "light at pixels", "multisampled, light at pixels"
"""Our cases with light worked out at every pixel, as peers do it: without anti-aliasing, softened, four samples."""
SAME_QUALITY = {
    "PyVista": SOFT, "PyVista, bare": STAIRS, "pygfx": SOFT, "pygfx, default settings": FINE, "pygfx, bare": STAIRS,
    "vispy, bare": STAIRS, "pyrender": FINE, "three.js": FINE, "three.js, bare": STAIRS, "three.js, morphs": FINE,
    "our page": REFERENCE,
}  # fmt: skip
"""Peer to our case with the same edges and light."""
NATIVE = "default head, fapengine-native"
"""Case that is drawn without OpenGL."""
FILM = "default head into a film"
"""Case that does what ``say`` and ``render`` do: draws with their defaults, and encodes as H.264."""

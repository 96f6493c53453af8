"""WebRTC: watch a session by WHEP, drive it with audio by WHIP. Needs the extra ``webrtc``."""

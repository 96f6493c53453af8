"""WebRTC: a session watched by WHEP, moved by sound that comes by WHIP. Needs the extra ``webrtc``."""

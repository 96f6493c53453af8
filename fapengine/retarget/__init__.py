"""FAPs to other rigs and back."""

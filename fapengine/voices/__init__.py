"""Edge: text to sound and phone timings."""

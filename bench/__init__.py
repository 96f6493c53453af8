"""Speed and fidelity, as figures against named yardsticks in the same run."""

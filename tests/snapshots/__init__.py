"""Snapshots of what the program says and makes: texts, results of jobs, and live sessions frame by frame."""

"""The laboratory's report: HTML with its figures."""

"""Imported heads: a scan with feature points, or a mesh with blendshapes, moved by FAPs."""

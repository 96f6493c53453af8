"""glTF 2.0 and VRM files: the document, the scene as one mesh with blendshapes, its textures."""

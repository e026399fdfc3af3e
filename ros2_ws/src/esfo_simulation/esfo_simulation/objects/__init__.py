"""Objects of the laboratory: parametric models, and meshes of files."""

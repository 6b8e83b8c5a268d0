"""People rendered from body meshes with clothes, for generated pictures."""

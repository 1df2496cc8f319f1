"""Read mesh, URDF, image and description files."""

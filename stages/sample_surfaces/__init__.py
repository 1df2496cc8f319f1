"""From mesh files to normalised meshes and points on their exterior."""

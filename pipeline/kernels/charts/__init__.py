"""Touch charts and vision charts: their meshes, and how touch charts are fitted."""

"""The meshes of touch charts and vision charts, and how touch charts are fitted."""

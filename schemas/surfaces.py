"""Schema of `surfaces`, from `sample-surfaces`: the object's exterior surface as points, and the normalised mesh."""

from schemas.base import Array, Artifact

SURFACES = Artifact(
    name="surfaces",
    stage="sample-surfaces",
    order=0,
    version=5,
    summary="The exterior surface of every object as points, and its normalised mesh with its look.",
    arrays={
        "points": Array("object point xyz", "float32", "m", "S^obj: points drawn area-uniformly from the exterior surface, world frame."),
        "normals": Array("object point xyz", "float32", "1", "Outward unit normals at `points`."),
        "placement": Array(
            "object pose_row pose_column",
            "float64",
            "m / unit of the file; m",
            "object_to_world: how points of the source file, homogeneous, come into the world: turned upright, scaled, moved.",
        ),
        "source_file": Array("object", "string", "1", "The file the object was read from, from its folder of meshes, or the toy object."),
        "source_sha256": Array("object", "string", "1", "SHA-256 of that file; empty for a toy object."),
        "licence": Array("object", "string", "1", "Licence of the mesh, as the manifest states it."),
        "unread": Array("object", "string", "1", "What the file holds or names and the mesh lacks, with reasons, one per line."),
        "metres_per_unit": Array("object", "float64", "m", "Unit of the file where objects keep their sizes; 0 where scaled to one size."),
        "watertight": Array("object", "bool", "1", "Every edge of the mesh has two faces."),
        "degenerate_faces": Array("object", "int32", "1", "Faces without area that the gate removed."),
        "duplicate_faces": Array("object", "int32", "1", "Repeated faces that the gate removed."),
    },
    ragged={
        "meshes/vertices": Array("vertex xyz", "float64", "m", "The normalised mesh, world frame."),
        "meshes/faces": Array("face corner", "int32", "1", "Rows of `vertices`."),
        "meshes/uv": Array("vertex uv", "float32", "1", "Texture coordinates, v upwards."),
        "meshes/face_material": Array("face", "int32", "1", "Row of `base_color` that paints the face."),
        "meshes/base_color": Array("material rgba", "uint8", "1/255", "sRGB colour and opacity of a material."),
        "meshes/material_texture": Array("material", "int32", "1", "N of the `texture_N` a material wears, -1 for none."),
        "meshes/vertex_color": Array(
            "vertex rgba", "uint8", "1/255", "sRGB and opacity, linear over faces, times `base_color`; of files with them.", optional=True
        ),
        "meshes/texture_*": Array("texture_row texture_column rgba", "uint8", "1/255", "A texture, top row first."),
    },
)

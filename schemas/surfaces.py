"""What `sample-surfaces` writes: the object's exterior surface as points, and the normalised mesh itself."""

from schemas.base import Array, Artifact

SURFACES = Artifact(
    name="surfaces",
    order=0,
    version=2,
    summary="The exterior surface of every object as points, and its normalised mesh with its look.",
    arrays={
        "points": Array(
            dims=("object", "point", "xyz"),
            dtype="float32",
            units="m",
            description="S^obj: points drawn area-uniformly from the exterior surface, world frame.",
        ),
        "normals": Array(dims=("object", "point", "xyz"), dtype="float32", units="1", description="Outward unit normals at `points`."),
        "watertight": Array(dims=("object",), dtype="bool", units="1", description="Every edge of the mesh has two faces."),
        "degenerate_faces": Array(dims=("object",), dtype="int32", units="1", description="Faces without area that the gate removed."),
        "duplicate_faces": Array(dims=("object",), dtype="int32", units="1", description="Repeated faces that the gate removed."),
    },
    ragged={
        "meshes/vertices": Array(dims=("vertex", "xyz"), dtype="float64", units="m", description="The normalised mesh, world frame."),
        "meshes/faces": Array(dims=("face", "corner"), dtype="int32", units="1", description="Rows of `vertices`."),
        "meshes/uv": Array(dims=("vertex", "uv"), dtype="float32", units="1", description="Texture coordinates, v upwards."),
        "meshes/face_material": Array(dims=("face",), dtype="int32", units="1", description="Row of `base_color` that paints the face."),
        "meshes/base_color": Array(
            dims=("material", "rgba"), dtype="uint8", units="1/255", description="sRGB colour and opacity of a material."
        ),
        "meshes/material_texture": Array(
            dims=("material",), dtype="int32", units="1", description="N of the `texture_N` a material wears, -1 for none."
        ),
        "meshes/texture_*": Array(
            dims=("texture_row", "texture_column", "rgba"), dtype="uint8", units="1/255", description="A texture, top row first."
        ),
    },
)

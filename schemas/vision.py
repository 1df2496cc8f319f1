"""What `render-vision` writes: the object alone, the object in every grasp, and what each pixel shows."""

from schemas.base import Array, Artifact, coordinates

VISION = Artifact(
    name="vision",
    order=2,
    version=2,
    summary="Images of every object alone and in every grasp, with what each pixel shows.",
    arrays={
        **coordinates("grasp"),
        "unoccluded": Array(("object", "row", "col", "rgb"), "uint8", "1/255", "V_u: the object alone, sRGB."),
        "occluded": Array(
            ("object", "grasp", "row", "col", "rgb"),
            "uint8",
            "1/255",
            "V_o: the object with the hand as it stood in each grasp, sRGB.",
            optional=True,
        ),
        "segmentation": Array(
            ("object", "view", "row", "col"),
            "uint8",
            "1",
            "What the ray through a pixel's centre meets: 0 background, 1 object, 2 hand. "
            "View 0 is the unoccluded one, view 1 + g that of grasp g.",
        ),
        "camera": Array(
            ("image_axis", "homogeneous"),
            "float64",
            "pixel; pixel / m",
            "Projection of homogeneous world points, m, to (column, row, 1) times depth; pixel centres at 1/2.",
        ),
    },
)

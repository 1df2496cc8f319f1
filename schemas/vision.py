"""What `render-vision` writes: the object alone, the object in every grasp, and what each pixel shows."""

from schemas.base import Array, Artifact, coordinates

VISION = Artifact(
    name="vision",
    stage="render-vision",
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
        "further_unoccluded": Array(
            ("object", "further_camera", "further_row", "further_col", "rgb"),
            "uint8",
            "1/255",
            "The object alone from each of the scene's further cameras, sRGB.",
            optional=True,
        ),
        "further_occluded": Array(
            ("object", "grasp", "further_camera", "further_row", "further_col", "rgb"),
            "uint8",
            "1/255",
            "The object with the hand from each of them, sRGB.",
            optional=True,
        ),
        "further_segmentation": Array(
            ("object", "view", "further_camera", "further_row", "further_col"),
            "uint8",
            "1",
            "As `segmentation`, from each of them.",
            optional=True,
        ),
        "further_depth": Array(
            ("object", "view", "further_camera", "further_row", "further_col"),
            "float32",
            "m",
            "How far along the viewing direction the ray through a pixel's centre meets a surface, from each of them; +inf where it meets "
            "none. Right to 10 µm a metre away.",
            infinite=True,
            optional=True,
        ),
        "further_camera": Array(("further_camera",), "string", "1", "Name of the camera in the scene file.", optional=True),
        "further_projection": Array(
            ("further_camera", "image_axis", "homogeneous"),
            "float64",
            "pixel; pixel / m",
            "Projection of each further camera, as `camera`.",
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

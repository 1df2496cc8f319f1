"""Schema of `vision`, from `render-vision`: images of the object alone and in every grasp, and what each pixel shows."""

from schemas.base import Array, Artifact, coordinates

VISION = Artifact(
    name="vision",
    stage="render-vision",
    order=2,
    version=6,
    summary="Images of every object alone and in every grasp from each camera of the scene, with what each pixel shows.",
    arrays={
        **coordinates("grasp"),
        "camera": Array("camera", "string", "1", "Name of the camera in the scene file. Networks are shown the first one's images."),
        "unoccluded": Array("object camera row col rgb", "uint8", "1/255", "V_u: the object alone, sRGB."),
        "occluded": Array("object grasp camera row col rgb", "uint8", "1/255", "V_o: with the hand in each grasp, sRGB.", optional=True),
        "segmentation": Array(
            "object view camera row col",
            "uint8",
            "1",
            "What the ray through a pixel's centre meets: 0 background, 1 object, 2 hand. "
            "View 0 is the unoccluded one, view 1 + g that of grasp g.",
        ),
        "camera_depth": Array(
            "object view camera row col",
            "float32",
            "m",
            "Distance along the viewing direction at which the ray through a pixel's centre meets a surface; +inf where it meets none. "
            "Right to 10 µm a metre away. Where the scene file asks for `depth`.",
            infinite=True,
            optional=True,
        ),
        "projection": Array(
            "object view camera image_axis homogeneous",
            "float64",
            "pixel; pixel / m",
            "Projection of homogeneous world points, m, to (column, row, 1) times depth; pixel centres at 1/2. "
            "Cameras are where the scene has or draws them, and are zoomed to each object.",
        ),
    },
)

"""The networks as data: the inputs and the size of each; the deformation networks are the supplement's (Tables 6-11)."""

from collections.abc import Mapping
from typing import ClassVar, Literal, Self

from pydantic import Field

from pipeline.entries import Entries
from pipeline.kernels.charts.touch_chart import MAX_SIDE, SIDE
from pipeline.kernels.charts.vision_charts import MAX_SPLITS
from pipeline.kernels.geometry.mesh_cleaning import DIAGONAL, POSITION

Norm = Literal["batch", "instance", "group"]
ImageKind = Literal["occluded", "unoccluded", "rendering", "any"]
Seams = Literal["open", "tied"]
TouchEdges = Literal["centres", "all"]

RADIUS = DIAGONAL / 2  # m, of the ball that objects lie in, as networks see them; settings of trainings are for these


class NetworkInputs(Entries):
    """The inputs of any network that reconstructs, and its image encoder; a family adds its own sizes."""

    image: ImageKind | None = None
    """The image it takes, if any; "rendering" is one of several images of the object, each with its own camera; "any"
    is an occluded image, an unoccluded one or none, which may differ between items."""
    touch: bool = False  # whether it takes touch charts and which of them touched
    encoder_layers: Literal[12, 15, 18, 25] = 18  # of the image encoder, whose plan it names
    encoder_kernel: Literal[3, 5] = 3  # pixels per side
    encoder_norm: Norm = "batch"
    encoder_width: float = Field(default=1.0, gt=0, le=64)  # channels over the plan's
    side: int = Field(default=SIDE, ge=3, le=MAX_SIDE)  # vertices along a side of a touch chart
    centre: tuple[float, float, float] = tuple(POSITION.tolist())  # of the ball that objects lie in, m, world
    radius: float = Field(default=RADIUS, gt=0)  # m; networks see positions in radii from the centre

    of_points: ClassVar[bool] = False  # takes touches as points; else as charts of side² vertices

    @property
    def takes_charts(self) -> bool:
        """Whether the touches that it learns from are touch charts."""
        return self.touch

    def restricted_to(self, inputs: "NetworkInputs") -> Self:
        """Describe this network with no other inputs than these."""
        return self.model_copy(update={"image": inputs.image, "touch": inputs.touch})


INPUT_CHOICES: Mapping[str, NetworkInputs] = {
    "none": NetworkInputs(),
    "touch": NetworkInputs(touch=True),
    "occluded": NetworkInputs(image="occluded"),
    "occluded-touch": NetworkInputs(image="occluded", touch=True),
    "unoccluded": NetworkInputs(image="unoccluded"),
    "unoccluded-touch": NetworkInputs(image="unoccluded", touch=True),
}
"""The combinations of inputs of a network that takes any."""


class NetworkConfig(NetworkInputs):
    """The inputs and sizes of a `DeformationNetwork`, whose sphere of vision charts starts as the ball of `radius`."""

    encoder_linear: int | None = Field(default=None, gt=0, le=2**16)  # of a layer with ReLU after pooling (Table 11)
    gcn_layers: int = Field(default=20, ge=2, le=1000)  # in all
    gcn_features: int = Field(default=200, ge=1, le=2**16)  # of each layer but the last
    mixed: float = Field(default=1 / 3, ge=0, le=1)  # share of these features that are averaged over neighbours
    passes: int = Field(default=3, ge=1, le=100)  # how often the vertices are moved, with the same weights
    splits: int = Field(default=1, ge=0, le=MAX_SPLITS)  # there are 24 · 4^splits vision charts
    seams: Seams = "open"
    """Whether vision vertices that coincide move as one ("tied"), by the mean of their predicted displacements, or each
    by its own ("open")."""
    touch_edges: TouchEdges = "centres"
    """Whether each vision vertex has the centres of its item's touch charts as neighbours, but not the reverse ("all"),
    or the centres of vision charts and of touch charts are each other's neighbours ("centres")."""


CONFIGURATIONS: Mapping[str, NetworkConfig] = {
    "none": NetworkConfig(gcn_layers=20, gcn_features=200),  # the size of Table 8
    "touch": NetworkConfig(touch=True, gcn_layers=15, gcn_features=250),  # Table 6
    "occluded-touch": NetworkConfig(image="occluded", touch=True, gcn_layers=20, gcn_features=250),  # Table 7
    "occluded": NetworkConfig(image="occluded", gcn_layers=20, gcn_features=200),  # Table 8
    "unoccluded-touch": NetworkConfig(image="unoccluded", touch=True, gcn_layers=25, gcn_features=200),  # Table 9
    "unoccluded": NetworkConfig(image="unoccluded", encoder_layers=12, gcn_layers=20, gcn_features=250),  # Table 10
}
"""The supplement's networks by name; a table's layers are one fewer here than it counts (its index is off by one)."""

SINGLE_IMAGE = NetworkConfig(
    image="rendering", encoder_layers=25, encoder_norm="instance", encoder_linear=250, gcn_layers=25, gcn_features=250
)
"""The network of the supplement's last experiment, Table 11."""


class ImplicitConfig(NetworkInputs):
    """The inputs and sizes of an `ImplicitNetwork`."""

    of_points = True
    touch_points: Literal["charts", "gels"] = "charts"
    """What the touched points are: vertices of touch charts, or points of the gels of any sensor, each with its gel's width."""
    encoder_layers: Literal[12, 15, 18, 25] = 12
    encoder_kernel: Literal[3, 5] = 5
    encoder_width: float = Field(default=0.25, gt=0, le=64)
    features: int = Field(default=128, ge=2, le=2**12)  # of each layer of the decoder
    blocks: int = Field(default=3, ge=0, le=100)  # of the decoder: residual, of two layers
    attention: int = Field(default=0, ge=0, le=2**10, multiple_of=4)  # features of the attention to touches; 0: none
    of_camera: bool = False  # whether a query is told where it is as the camera sees it; else the camera is the same in all images
    band: float = Field(default=0.03, gt=0)  # m: distances beyond, on either side, count the same
    spacing: float = Field(default=0.004, gt=0)  # of the grid that a reconstruction's mesh is made on, m
    touch_reach: float = Field(default=0.01, ge=0, le=1)
    """Largest distance, m, to which a reconstruction follows touches: the weight is 1/e there. 0: the network alone."""

    @property
    def takes_charts(self) -> bool:
        """Whether the touches that it learns from are touch charts."""
        return self.touch and self.touch_points == "charts"


IMPLICIT_CONFIGURATIONS: Mapping[str, ImplicitConfig] = {
    "implicit-touch": ImplicitConfig(touch=True),
    "implicit-occluded": ImplicitConfig(image="occluded"),
    "implicit-occluded-touch": ImplicitConfig(image="occluded", touch=True),
    "implicit-unoccluded": ImplicitConfig(image="unoccluded"),
    "implicit-unoccluded-touch": ImplicitConfig(image="unoccluded", touch=True),
    "implicit-any": ImplicitConfig(image="any", touch=True, encoder_norm="group"),  # batches of it have more or fewer images
    "implicit-gels": ImplicitConfig(image="any", touch=True, encoder_norm="group", touch_points="gels", attention=64, of_camera=True),
}
"""The implicit networks by name, with the inputs of the supplement's networks; `implicit-any` takes any of them, and `implicit-gels`
too, with touches of any sensor."""

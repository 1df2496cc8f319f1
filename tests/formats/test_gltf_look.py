"""Colours, opacity and textures of glTF files."""

import io
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from pipeline.formats import gltf_look
from pipeline.kernels.geometry.mesh import Mesh
from tests.formats.gltf_builder import CORNERS, Gltf, data_uri

RED, GREEN, BLUE, BLACK = [200, 30, 30], [0, 200, 0], [0, 0, 200], [0, 0, 0]
MIDDLE = np.full((8, 2), 0.5, np.float32)
GLOSS, STRENGTH = "KHR_materials_pbrSpecularGlossiness", "KHR_materials_emissive_strength"


def painted(folder: Path, material: dict[str, Any], *pixels: Any, uv: NDArray[np.float32] = MIDDLE, **attributes: Any) -> Mesh:
    """Read a box with this material; each further argument is a texture."""
    document = Gltf()
    for image in pixels:
        document.texture(image)
    primitive = document.box(TEXCOORD_0=uv, **attributes) | {"material": 0}
    return document.read(folder, primitive, materials=[material])


def base(factor: tuple[float, ...] = (1, 1, 1, 1), **texture: Any) -> dict[str, Any]:
    entry = {"baseColorTexture": {"index": 0} | texture} if texture else {}
    return {"pbrMetallicRoughness": {"baseColorFactor": factor} | entry}


def seen(mesh: Mesh) -> list[int]:
    """Return the colour (4,) of all vertices, as the nearest pixel of a texture that repeats."""
    (color,) = mesh.look.base_color
    if mesh.look.textures:
        color = np.rint(color / 255 * sample(mesh)[0])
    return [int(value) for value in color]


def sample(mesh: Mesh) -> NDArray[np.uint8]:
    """Return the pixels (V, 4) at the vertices."""
    (texture,) = mesh.look.textures
    height, width = texture.shape[:2]
    column = np.floor(mesh.look.uv[:, 0] * width).astype(int) % width
    row = np.floor((1 - mesh.look.uv[:, 1]) * height).astype(int) % height
    return np.asarray(texture[row, column])


@pytest.mark.parametrize(
    ("mode", "opacities", "expected"),
    [
        ({}, [0, 255], [255, 255]),
        ({"alphaMode": "MASK"}, [127, 128], [0, 255]),
        ({"alphaMode": "MASK", "alphaCutoff": 0.2}, [50, 51], [0, 255]),
        ({"alphaMode": "BLEND"}, [0, 100], [0, 100]),
    ],
)
def test_opacity_counts_as_the_material_says(tmp_path: Path, mode: dict[str, Any], opacities: list[int], expected: list[int]) -> None:
    pixels = [[[*RED, opacity] for opacity in opacities]]
    (texture,) = painted(tmp_path, base(index=0) | mode, pixels).look.textures
    assert texture[0].tolist() == [[*RED, opacity] for opacity in expected]


def test_opacity_of_vertices_is_read_for_blending_and_named_for_masks(tmp_path: Path) -> None:
    colors = np.tile(np.float32([1, 1, 1, 0.2]), (8, 1))
    for mode, opacity, unread in (
        ("OPAQUE", 255, ()),
        ("BLEND", 51, ()),
        ("MASK", 255, ("the opacity of vertices with material 0 is not read",)),
    ):
        mesh = painted(tmp_path, {"alphaMode": mode}, COLOR_0=colors)
        assert mesh.look.vertex_color is not None
        assert (mesh.look.vertex_color[0, 3], mesh.unread) == (opacity, unread)
    document = Gltf()
    plain = document.read(tmp_path, document.box(COLOR_0=colors)).look.vertex_color
    assert plain is not None
    assert (plain[:, 3] == 255).all()


DARK = (0, 0, 0, 1)


@pytest.mark.parametrize(
    ("material", "color", "unread"),
    [
        (base(DARK) | {"emissiveFactor": [1, 0, 0]}, [255, 0, 0, 255], ()),
        (base(DARK) | {"emissiveFactor": [1, 1, 1], "emissiveTexture": {"index": 1}}, [*GREEN, 255], ()),
        (base(DARK) | {"emissiveTexture": {"index": 1}}, [*BLACK, 255], ()),  # multiplied by the factor, which is 0 by default
        (base(index=2) | {"emissiveFactor": [1, 1, 1], "emissiveTexture": {"index": 1}}, [*GREEN, 255], ()),  # a black texture
        (base(DARK) | {"emissiveFactor": [0.5, 0, 0], "extensions": {STRENGTH: {"emissiveStrength": 2}}}, [255, 0, 0, 255], ()),
        (base(DARK) | {"emissiveFactor": [1, 0, 0], "extensions": {"KHR_materials_unlit": {}}}, [*BLACK, 255], ()),
        (base(index=0) | {"emissiveFactor": [0, 1, 0]}, [*RED, 255], ("the light that material 0 emits is not read",)),
        ({"extensions": {GLOSS: {"diffuseTexture": {"index": 1}}}}, [*GREEN, 255], ()),
        ({"extensions": {GLOSS: {"diffuseFactor": [1, 0, 0, 1]}}} | base(index=1), [255, 0, 0, 255], ()),
        ({"extensions": {GLOSS: {"diffuseFactor": DARK, "specularFactor": [0, 0, 1]}}}, [0, 0, 255, 255], ()),  # a metal
        ({"extensions": {GLOSS: {"diffuseFactor": DARK, "specularFactor": [0.04] * 3}}}, [*BLACK, 255], ()),
        (
            base(index=0) | {"name": "glass", "extensions": {"KHR_materials_transmission": {"transmissionFactor": 1}}},
            [*RED, 255],
            ("the light that passes through material glass is not read",),
        ),
    ],
)
def test_material_shows_its_base_colour_or_else_its_light(tmp_path: Path, material: Any, color: list[int], unread: tuple[str, ...]) -> None:
    mesh = painted(tmp_path, material, [[[*RED, 255]]], [[[*GREEN, 255]]], [[[*BLACK, 255]]])
    assert (seen(mesh), mesh.unread) == (color, unread)


WRAPS = {10497: lambda x: x % 1, 33071: lambda x: np.clip(x, 0, 1 - 1e-9), 33648: lambda x: 1 - np.abs(x % 2 - 1)}
"""Where each mode of a sampler looks, in 0..1, as functions of any coordinates."""


@pytest.mark.parametrize("across", list(WRAPS))
@pytest.mark.parametrize("down", list(WRAPS))
@pytest.mark.parametrize("spread", [0.9, 3])
def test_samplers_that_clamp_and_mirror_show_the_same_pixels(
    tmp_path: Path, rng: np.random.Generator, across: int, down: int, spread: float
) -> None:
    pixels = rng.integers(0, 255, (5, 7, 3))
    uv = rng.uniform(0.5 - spread / 2, 0.5 + spread / 2, (8, 2)).astype(np.float32)
    document = Gltf()
    document.texture(pixels, sampler=document.add("samplers", {"wrapS": across, "wrapT": down}))
    mesh = document.read(tmp_path, document.box(TEXCOORD_0=uv) | {"material": 0}, materials=[base(index=0)])
    column, row = WRAPS[across](uv[:, 0].astype(float)) * 7, WRAPS[down](uv[:, 1].astype(float)) * 5
    expected = pixels[row.astype(int), column.astype(int)]
    away = (np.abs(uv * [7, 5] - np.rint(uv * [7, 5])) > 0.01).all(axis=1)  # from rims of pixels, where rounding decides
    assert away.sum() > 5
    np.testing.assert_array_equal(sample(mesh)[away, :3], expected[away])
    assert mesh.unread == ()


def test_clamped_texture_that_would_grow_too_large_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gltf_look, "MAX_PIXELS", 100)
    document = Gltf()
    document.texture([[RED, BLUE]], sampler=document.add("samplers", {"wrapS": 33071}))
    primitive = document.box(TEXCOORD_0=MIDDLE + np.float32([100, 0])) | {"material": 0}
    mesh = document.read(tmp_path, primitive, materials=[base(index=0)])
    limit = "it has 203 pixels in a clamped texture with what is seen outside it, 100 are the most; make it smaller"
    assert mesh.unread == (f"what a texture shows outside 0..1 cannot be read ({limit})",)
    assert mesh.look.textures[0].shape == (1, 2, 4)


def test_set_of_coordinates_and_transform_are_those_of_the_texture(tmp_path: Path) -> None:
    """The extension's own example: the lower left quadrant of the image, turned clockwise by 90 degrees."""
    transform = {"offset": [0, 1], "rotation": np.pi / 2, "scale": [0.5, 0.5]}
    corners = np.float32([[0, 0], [1, 0], [1, 1], [0, 1]] * 2)  # v downwards
    material = base(index=0, texCoord=7, extensions={"KHR_texture_transform": {**transform, "texCoord": 1}})
    mesh = painted(tmp_path, material, [[RED, GREEN]], TEXCOORD_1=corners)
    lower_left_turned = np.float32([[0, 1], [0, 0.5], [0.5, 0.5], [0.5, 1]] * 2)
    np.testing.assert_allclose(mesh.look.uv, lower_left_turned * [1, -1] + [0, 1], atol=1e-6)
    plain = painted(tmp_path, base(index=0, texCoord=1), [[RED, GREEN]], TEXCOORD_1=corners).look
    np.testing.assert_allclose(plain.uv, corners * [1, -1] + [0, 1], atol=1e-6)


@pytest.mark.parametrize(
    ("missing", "reason"),
    [
        ({"index": 0, "texCoord": 3}, "the texture of material 0 cannot be read (a part of it has no TEXCOORD_3; export it again)"),
        ({"index": 5}, "the texture of material 0 cannot be read (its JSON names number 5 of 1 textures"),
        ({"index": 0, "extensions": {"KHR_texture_transform": {"scale": "x"}}}, "the texture of material 0 cannot be read ("),
    ],
)
def test_texture_that_cannot_be_read_is_named_and_the_shape_is_kept(tmp_path: Path, missing: dict[str, Any], reason: str) -> None:
    mesh = painted(tmp_path, base((1, 0, 0, 1)) | {"pbrMetallicRoughness": {"baseColorTexture": missing}}, [[RED]])
    assert mesh.look.textures == ()
    assert len(mesh.unread) == 1
    assert mesh.unread[0].startswith(reason)
    np.testing.assert_allclose(mesh.vertices, CORNERS)


def encoded(kind: str) -> str:
    Image.new("RGB", (2, 2), tuple(BLUE)).save(file := io.BytesIO(), kind)
    return data_uri(file.getvalue())


@pytest.mark.parametrize("extension", ["EXT_texture_webp", "KHR_texture_basisu", "EXT_texture_avif", "MSFT_texture_dds"])
@pytest.mark.parametrize("fallback", ["good", "none", "damaged"])
def test_image_in_another_format_is_read_or_named(tmp_path: Path, extension: str, fallback: str) -> None:
    """Only WebP can be read of the contents here; others are read from the image that stands in for them."""
    document = Gltf()
    content = encoded("WEBP") if extension == "EXT_texture_webp" else data_uri(b"KTX, AVIF or a kind of DDS that is not read")
    other = document.add("images", {"uri": content, "name": "paint"})
    texture: dict[str, Any] = {"extensions": {extension: {"source": other}}}
    if fallback != "none":
        texture["source"] = document.add("images", {"uri": encoded("PNG") if fallback == "good" else data_uri(b"damaged"), "name": "plain"})
    document.add("textures", texture)
    primitive = document.box(TEXCOORD_0=MIDDLE) | {"material": 0}
    mesh = document.read(tmp_path, primitive, materials=[base(index=0)], extensionsUsed=[extension])
    if fallback == "good" or extension == "EXT_texture_webp":
        np.testing.assert_allclose(seen(mesh), [*BLUE, 255], atol=8)
        assert mesh.unread == ()
    else:
        assert mesh.look.textures == ()
        assert [reason.partition(" ")[0] for reason in mesh.unread] == ["plain"] * (fallback == "damaged") + ["paint"]


@pytest.mark.parametrize("normalized", [True, False])
@pytest.mark.parametrize("material", [None, 0])
@pytest.mark.parametrize("kind", ["float32", "uint8", "uint16"])
def test_colours_of_vertices_are_linear_light_of_any_type(tmp_path: Path, kind: str, material: int | None, normalized: bool) -> None:
    light = np.tile([0.5, 0.25, 1], (8, 1))
    stored = light.astype(np.float32) if kind == "float32" else np.rint(light * np.iinfo(kind).max).astype(kind)
    document = Gltf()
    primitive = document.box()
    primitive["attributes"]["COLOR_0"] = document.array(stored, normalized=normalized)
    if material is not None:
        primitive["material"] = material
    look = document.read(tmp_path, primitive, materials=[{}]).look
    assert look.base_color.tolist() == [[255, 255, 255, 255]]
    assert look.vertex_color is not None
    np.testing.assert_allclose(look.vertex_color, np.tile([188, 137, 255, 255], (8, 1)), atol=1)


@pytest.mark.parametrize(("mode", "factor", "opacity"), [("OPAQUE", 0.2, 255), ("MASK", 0.4, 0), ("MASK", 0.6, 255), ("BLEND", 0.2, 51)])
def test_opacity_of_a_colour_counts_as_the_material_says(tmp_path: Path, mode: str, factor: float, opacity: int) -> None:
    look = painted(tmp_path, base((1, 1, 1, factor)) | {"alphaMode": mode}, COLOR_0=np.ones((8, 4), np.float32)).look
    assert look.base_color[0, 3] == opacity
    masked = painted(tmp_path, base((1, 1, 1, factor), index=0) | {"alphaMode": mode}, [[[*RED, 255]]]).look
    assert int(masked.base_color[0, 3]) * int(masked.textures[0][0, 0, 3]) == 255 * opacity

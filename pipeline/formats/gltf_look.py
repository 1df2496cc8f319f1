"""The looks of a glTF file's primitives: base colours, opacity, textures with their transforms and samplers, colours of vertices.

By glTF 2.0, sections 3.8 and 3.9, and the extensions of materials and textures that change a colour.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from trimesh.visual.color import linear_to_srgb, srgb_to_linear

from pipeline.formats.gltf import Document, GltfPrimitive, one_line, table
from pipeline.formats.mesh_parts import GREY, MAX_UV, OPAQUE_WHITE, check_count
from pipeline.formats.textures import Textures
from pipeline.kernels.arrays import Array
from pipeline.kernels.geometry.mesh import Look
from pipeline.kernels.geometry.transforms import sin_cos

BLACK = 0.01  # linear light up to which a base colour is black: such a material shows the light that it emits, if there is any
DIELECTRIC = 0.04  # part of the light that a surface reflects, whatever its colour, unless it is a metal, whose colour that is
WHITE_LIGHT = (1, 1, 1, 1)  # the factor of a colour where a material states none
Wrap = Literal["clamp", "mirror"]
STEPS = 8  # parts of its size by which a clamped texture is extended, so that parts of a mesh share the result
MAX_PIXELS = 2**24  # maximum number of pixels of a texture that is extended: one of 4096 × 4096
WRAPS: dict[Any, Wrap] = {33071: "clamp", 33648: "mirror"}  # the values of a sampler's `wrapS` and `wrapT`; others repeat


class Looks:
    """The materials and textures of a file."""

    def __init__(self, document: Document, textures: Textures) -> None:
        self._document, self._textures, self._unread = document, textures, textures.unread
        self._images: dict[int, NDArray[np.uint8] | None] = {}
        self._brightest: dict[int, Array] = {}
        self._cut: dict[tuple[int, float], NDArray[np.uint8]] = {}
        self._repeats = Repeats()

    def look(self, primitive: GltfPrimitive) -> Look:
        """Read the look of a primitive."""
        colors = None
        if "COLOR_0" in primitive.attributes:
            with self._noting("the colours of vertices"):
                colors = _vertex_colors(primitive)
        look = Look.plain(len(primitive.rows), len(primitive.faces), GREY[:3] if colors is None else OPAQUE_WHITE[:3])
        look = replace(look, vertex_color=colors)
        if primitive.material is not None:
            with self._noting(f"material {primitive.material}"):
                return self._painted(look, primitive)
        elif colors is not None:
            colors[:, 3] = 255  # the default material is opaque
        return look

    def _painted(self, look: Look, primitive: GltfPrimitive) -> Look:
        material = self._document.entry("materials", primitive.material)
        name = f"material {one_line(material.get('name', primitive.material))}"
        layers = ((np.array(factor, np.float64), entry, self._texture(name, entry)) for factor, entry in _layers(material))
        base = next(layers)
        shown = next((layer for layer in layers if not self._is_black(*layer)), base) if self._is_black(*base) else base
        (factor, entry, texture), colors, uv = shown, look.vertex_color, look.uv
        limit = {"MASK": material.get("alphaCutoff", 0.5), "BLEND": None}.get(material.get("alphaMode", ""), 0.0)
        if shown is not base:
            colors, limit = None, 0.0  # light that is emitted has no opacity, and colours of vertices do not change it
        elif not self._is_black(*base) and any(_emission(material)[0][:3]):
            self._note(f"the light that {name} emits is not read")
        if table(table(material, "extensions"), "KHR_materials_transmission").get("transmissionFactor"):
            self._note(f"the light that passes through {name} is not read")
        if limit is not None:
            if colors is not None:
                if limit and (colors[:, 3] < 255).any():
                    self._note(f"the opacity of vertices with {name} is not read")
                colors[:, 3] = 255
            texture = None if texture is None else self._opaque(texture, limit / max(factor[3], 1e-9))
            factor[3] = texture is not None or factor[3] >= limit
        if (image := texture) is not None:
            texture = None
            with self._noting(f"the texture of {name}"):
                texture, uv = self._place(primitive, entry, image)
        return replace(
            look,
            uv=uv,
            base_color=_srgb(factor)[None],
            material_texture=np.array([-1 if texture is None else 0], np.int32),
            textures=() if texture is None else (texture,),
            vertex_color=colors,
        )

    def _texture(self, name: str, entry: dict[str, Any]) -> NDArray[np.uint8] | None:
        """Decode the texture that a material names: the first of its images that can be read."""
        if not entry:
            return None
        with self._noting(f"the texture of {name}"):
            texture, before = self._document.entry("textures", entry["index"]), len(self._unread)
            others = [other.get("source") for other in table(texture, "extensions").values()]
            numbers = [number for number in (texture.get("source"), *others) if number is not None]
            for number in numbers:
                if (image := self._image(number)) is not None:
                    del self._unread[before:]  # about the same image in other formats
                    return image
            if not numbers:
                self._note(f"the texture of {name} has no image")
        return None

    def _image(self, number: int) -> NDArray[np.uint8] | None:
        if number not in self._images:
            name, content = self._document.image(number)
            image = None if content is None else self._textures.read(name, content)  # one that is missing is listed already
            self._images[number] = image
            if image is not None:
                self._brightest[id(image)] = srgb_to_linear(image[..., :3].max(axis=(0, 1)))
        return self._images[number]

    def _is_black(self, factor: Array, _: dict[str, Any], texture: NDArray[np.uint8] | None) -> bool:
        return bool((factor[:3] * self._brightest.get(id(texture), 1.0)).max() <= BLACK)

    def _opaque(self, texture: NDArray[np.uint8], limit: float) -> NDArray[np.uint8]:
        """Make a texture opaque where its opacity reaches a limit, 0..1, and transparent elsewhere."""
        if (id(texture), limit) not in self._cut:
            opacity = np.where(texture[..., 3:] >= 255 * limit, 255, 0).astype(np.uint8)
            same = np.array_equal(opacity, texture[..., 3:])
            self._cut[id(texture), limit] = texture if same else np.concatenate([texture[..., :3], opacity], axis=2)
        return self._cut[id(texture), limit]

    def _place(
        self, primitive: GltfPrimitive, entry: dict[str, Any], texture: NDArray[np.uint8]
    ) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
        """Return a texture that repeats, and the coordinates (V, 2) of vertices in it, v upwards."""
        transform = table(table(entry, "extensions"), "KHR_texture_transform")
        uv = primitive.read(f"TEXCOORD_{transform.get('texCoord', entry.get('texCoord', 0))}", 2)
        if transform:  # as engines turn it, and the extension's examples; the matrix in its text turns the other way
            uv = uv * transform.get("scale", (1, 1))
            sine, cosine = sin_cos(transform.get("rotation", 0))
            uv = np.stack([cosine * uv[:, 0] + sine * uv[:, 1], cosine * uv[:, 1] - sine * uv[:, 0]], axis=1)
            uv += transform.get("offset", (0, 0))
        uv = np.where(np.abs(uv) < MAX_UV, uv, 0)  # NaN too
        number = self._document.entry("textures", entry["index"]).get("sampler")
        sampler = {} if number is None else self._document.entry("samplers", number)
        for axis, wrap in ((1, sampler.get("wrapS")), (0, sampler.get("wrapT"))):
            with self._noting("what a texture shows outside 0..1"):
                texture, uv[:, 1 - axis] = self._repeats.make(texture, uv[:, 1 - axis], axis, WRAPS.get(wrap))
        uv[:, 1] = 1 - uv[:, 1]
        return texture, uv.astype(np.float32)

    @contextmanager
    def _noting(self, what: str) -> Iterator[None]:
        """Note a part of the look that cannot be read: the shape is still usable."""
        try:
            yield
        except MemoryError:
            raise
        except Exception as error:
            self._note(f"{what} cannot be read ({error})")

    def _note(self, text: str) -> None:
        self._unread.append(" ".join(text.split())[:300])


def _layers(material: dict[str, Any]) -> Iterator[tuple[ArrayLike, dict[str, Any]]]:
    """List the colours of a material, base first, then what shows where that is black: factor (4,), linear, and the entry of a texture."""
    extensions = table(material, "extensions")
    gloss = table(extensions, "KHR_materials_pbrSpecularGlossiness")
    rough = table(material, "pbrMetallicRoughness")
    if gloss:
        yield gloss.get("diffuseFactor", WHITE_LIGHT), table(gloss, "diffuseTexture")
    else:
        yield rough.get("baseColorFactor", WHITE_LIGHT), table(rough, "baseColorTexture")
    if "KHR_materials_unlit" not in extensions:
        yield _emission(material)
        if gloss and max(specular := gloss.get("specularFactor", (1, 1, 1))) > DIELECTRIC:
            yield [*specular, 1], table(gloss, "specularGlossinessTexture")


def _emission(material: dict[str, Any]) -> tuple[list[float], dict[str, Any]]:
    strength = table(table(material, "extensions"), "KHR_materials_emissive_strength").get("emissiveStrength", 1)
    return [*(strength * light for light in material.get("emissiveFactor", (0, 0, 0))), 1], table(material, "emissiveTexture")


def _vertex_colors(primitive: GltfPrimitive) -> NDArray[np.uint8]:
    """Return the (V, 4) sRGB colours of vertices, also where integers are not marked as normalised."""
    stored = primitive.stored("COLOR_0", 3, 4)
    return _srgb(primitive.read("COLOR_0", 3, 4) / (np.iinfo(stored.dtype).max if stored.dtype.kind == "u" else 1))


def _srgb(light: Array) -> NDArray[np.uint8]:
    """Turn linear colours (..., 3 or 4) in 0..1 into (..., 4) sRGB and opacity."""
    light = np.clip(np.nan_to_num(light), 0, 1)
    colors = np.full((*light.shape[:-1], 4), 255, np.uint8)
    colors[..., : light.shape[-1]] = np.rint(255 * light)
    colors[..., :3] = np.rint(255 * linear_to_srgb(light[..., :3]))
    return colors


class Repeats:
    """The textures of one mesh file that were made to repeat; what several parts need is made once."""

    def __init__(self) -> None:
        self._made: dict[tuple[int, int, int, int], tuple[NDArray[np.uint8], NDArray[np.uint8]]] = {}

    def make(
        self,
        texture: NDArray[np.uint8],  # (height, width, 4)
        coordinates: Array,  # (V,) of the vertices along the axis, 0..1 within the texture, in the direction of its pixels
        axis: int,  # 0 along a column, 1 along a row
        wrap: Wrap | None,  # None: it repeats
    ) -> tuple[NDArray[np.uint8], Array]:
        """Make a texture that shows repeated what another shows clamped or mirrored along one axis, and the coordinates in it.

        It is the same one if the vertices lie within it to half a pixel.
        """
        size, low, high = texture.shape[axis], coordinates.min(initial=0), coordinates.max(initial=0)
        if wrap is None:
            return texture, coordinates
        if low > -0.5 / size and high < 1 + 0.5 / size:
            return texture, np.clip(coordinates, 0, 1)
        first, last = 0, 2 * size
        if wrap == "clamp":  # one pixel more at each end: colours are interpolated
            first, last = int(np.floor(low * STEPS) * size / STEPS) - 1, int(np.ceil(high * STEPS) * size / STEPS) + 1
        key = (id(texture), axis, first, last)
        if key not in self._made:
            pixels = texture.size // (4 * size) * (last - first)
            check_count("pixels in a clamped texture with what is seen outside it", pixels, MAX_PIXELS, "make it smaller")
            outside = np.arange(first, last)
            source = np.minimum(outside, last - 1 - outside) if wrap == "mirror" else np.clip(outside, 0, size - 1)
            self._made[key] = texture, texture.take(source, axis)  # with the original, so that its id stays taken
        return self._made[key][1], (coordinates * size - first) / (last - first)

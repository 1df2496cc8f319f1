"""Models of knives."""

from collections.abc import Sequence

import numpy as np

from pipeline.contrib.toy_objects.model import BLACK, GOLD, PLASTICS, STEELS, WOODS, Model, Palette, Stretch
from pipeline.contrib.toy_objects.solids import Rows, Solid, ball, bar, box, loft, rod, smooth, sweep

BLADES: Palette = (*STEELS, *STEELS, (76, 78, 82))
LEATHERS: Palette = ((104, 62, 34), (60, 58, 40), (36, 34, 34), (150, 100, 58), (96, 92, 66))


class Knife(Model):
    """Along x with the tip at +x, the edge down; blade and handle meet at x = 0.

    An outline has rows (x, top, bottom) in shares of a blade's length and height, a handle rows (x, bottom z, top z, width).
    """

    proportions = (Stretch("x", 0.8, 1.2, start=0), Stretch("x", 0.9, 1.12, end=0), Stretch("yz", 0.88, 1.12))

    def blade(
        self,
        size: Sequence[float],  # length, height, and thickness at the spine
        outline: Rows,  # the silhouette
        *,
        teeth: int = 0,  # along the edge
        double: bool = False,  # whether the spine is an edge too
    ) -> Solid:
        """Loft a blade that reaches a little into the handle and bends up or down towards its tip."""
        length, height, thick = size
        table, share = smooth(outline, 8), np.linspace(-0.04, 1.0, max(50, 8 * teeth))
        bend = (0.0 if double else self.uniform(-0.15, 0.1)) * share * share
        top, bottom = (np.interp(share, table[:, 0], column) + bend for column in table[:, 1:].T)
        if teeth:
            bottom = bottom + 0.15 * (1.0 - np.abs(np.sin(np.pi * teeth * share))) * ((share > 0.04) & (share < 0.94))
        half = np.minimum(thick / 2.0 * np.interp(share, [0.0, 0.6, 1.0], [1.0, 0.9, 0.4]), 0.35 * height * (top - bottom) + 0.1)
        edge, spine = 0.14 * half, (0.14 if double else 0.85) * half
        shoulder = bottom + (0.5 if double else self.uniform(0.2, 0.9)) * (top - bottom)
        corners = ((-spine, top), (-half, shoulder), (-edge, bottom), (edge, bottom), (half, shoulder), (spine, top))
        return loft(np.stack([np.stack([share * length, y, z * height], axis=-1) for y, z in corners], axis=1))

    def riveted(self, z: float) -> None:
        """Add slabs of wood or plastic held by rivets, a steel bolster in front; the butt drops in some."""
        trim, (drop, belly) = self.pick(*STEELS, GOLD), self.uniform(0.0, (8, 4))
        rows = [(-115, -drop, 23 - drop, 15), (-98, -drop - belly, 24 - 0.8 * drop, 17), (-57, belly, 23, 17), (0, 1, 23, 15)]
        self.add(self.pick(*WOODS, *PLASTICS, BLACK), bar(rows, 3.0, trim, [(-self.uniform(9, 16), 0)]).moved(z=z))
        self.add(trim, *(rod(-9, 9, 3.2, "y").moved(x, z=z + 11) for x in np.linspace(-92, -23, self.integers(2, 5))))

    def moulded(self, z: float) -> None:
        """Add a plastic handle with waves for the fingers and a rounded butt, a ring of another colour around it."""
        x, butt = np.linspace(-115, 0, 12), self.uniform(-109, -92)
        wave, swell = self.uniform(0, 2) * np.cos(self.uniform(0.1, 0.17) * x), 3 * np.sin(np.pi * x / 115) ** 2
        rows = np.column_stack([x, wave + swell - 1.5, 23 + swell, 15 + swell])
        rows[0, 1:] = 5, 19, 9
        trim = self.pick(*PLASTICS, BLACK, *STEELS)
        self.add((*PLASTICS, BLACK), bar(rows, 2.7, trim, [(butt, butt + 17)]).moved(z=z))

    def octagonal(self, z: float) -> None:
        """Add a Japanese handle: long, slightly swelling, nearly square, with a ferrule of another colour."""
        swell, collar = self.uniform((0, -32), (2, -18))
        rows = [(-115, -swell, 24 + swell, 18 + swell), (collar, 2, 22, 16), (0, 2, 22, 15)]
        trim = self.pick(BLACK, (220, 206, 176), WOODS[2])
        self.add(WOODS, bar(rows, 4.5, trim, [(collar, 0)]).moved(z=z))

    def hollow_steel(self, z: float) -> None:
        """Add a handle all of steel, with a waist and dark rings."""
        waist, rings = self.uniform(0.5, 3), np.linspace(-98, -23, self.integers(4, 9))
        rows = [(-115, 2, 19, 10), (-109, -1, 24, 17), (-57, waist, 24 - waist, 17 - waist), (0, 0.5, 23, 15)]
        self.add(self.pick(*STEELS), bar(rows, 2.3, self.pick(BLACK), [(x, x + 3) for x in rings]).moved(z=z))

    def stacked(self, z: float) -> None:
        """Add a handle of leather or cord discs one behind the other, with grooves between them."""
        edges = np.linspace(-110, 0, 2 * self.integers(5, 12) + 1)
        half = (10.5 - 1.8 * np.sin(np.pi * edges / 110)) * np.where(np.arange(len(edges)) % 2, 1.0, 0.9)
        rows, discs = np.column_stack([edges, 12 - half, 12 + half, 1.8 * half]), [*zip(edges[:-2:4], edges[2::4], strict=False)]
        self.add(self.pick(*LEATHERS[:3]), bar(rows, 2.4, self.pick(*LEATHERS), discs).moved(z=z))

    def kitchen(self, size: Sequence[float], outline: Rows, *, teeth: int = 0) -> None:
        """Add a blade and a handle flush with its spine."""
        self.add(self.pick(*BLADES), self.blade(size, outline, teeth=teeth))
        self.one_of(self.riveted, self.moulded, self.octagonal, self.hollow_steel)(size[1] - 23)

    def chef(self) -> None:  # a chef's knife: a broad triangle with a curved belly, the heel below the handle
        outline = [(0, 1, 0), (0.25, 1, -0.02), (0.6, 0.97, 0.04), (0.85, 0.92, 0.3), (0.97, 0.85, 0.56), (1, 0.82, 0.68)]
        self.kitchen((215, 48, 5.5), outline)

    def santoku(self) -> None:  # a santoku: a straight edge, the spine falling to the tip
        self.kitchen((165, 46, 5), [(0, 1, 0), (0.55, 1, 0), (0.78, 0.96, 0.03), (0.92, 0.72, 0.09), (0.985, 0.42, 0.16), (1, 0.3, 0.2)])

    def cleaver(self) -> None:  # a cleaver: a tall blade, square or rounded at the end, with a hole to hang it by
        nose = self.uniform(0.0, 0.35)
        self.kitchen((180, 94, 6), [(0, 1, 0), (0.5, 1.03, -0.03), (0.93, 1 - 0.2 * nose, 0.02), (1, 1 - nose, 0.1 * nose + 0.02)])
        if self.chance(0.7):
            self.add(self.pick(BLACK), rod(-3.4, 3.4, self.uniform(6, 9), "y").moved(158, z=72))

    def bread(self) -> None:  # a bread knife: long and even, with scalloped teeth and a blunt end
        outline = [(0, 1, 0), (0.5, 1, self.uniform(-0.15, 0)), (0.9, 0.98, 0.02), (0.97, 0.9, 0.16), (1, 0.7, 0.4)]
        self.kitchen((225, 30, 5), outline, teeth=self.integers(14, 28))

    def paring(self) -> None:  # a paring knife: a short pointed blade, shorter than its handle; straight, or curved like a beak
        straight = [(0, 1, 0), (0.4, 1, -0.02), (0.75, 0.94, 0.12), (0.95, 0.82, 0.5), (1, 0.76, 0.64)]
        beak = [(0, 1, 0.02), (0.4, 0.98, 0.06), (0.75, 0.72, -0.02), (0.95, 0.22, -0.22), (1, -0.06, -0.28)]
        self.kitchen((84, 24, 4.5), beak if self.chance(0.35) else straight)

    def fillet(self) -> None:  # a fillet knife: slim and flexible, sweeping up to the tip
        up = self.uniform(0.2, 0.9)
        outline = [(0, 1, 0), (0.15, 0.96, 0.1), (0.55, 0.92, 0.1), (0.85, 0.95 + 0.4 * up, 0.3 + 0.4 * up), (1, 1.05 + up, 0.86 + up)]
        self.kitchen((200, 26, 5), outline)

    def hunting(self) -> None:  # a Bowie knife: clip or drop point, guard; a riveted handle or stacked leather
        clip = [(0, 1, 0), (0.55, 1, 0), (0.64, 0.97, 0.0), (0.8, 0.74, 0.1), (0.94, 0.66, 0.4), (1, 0.66, 0.6)]
        drop = [(0, 1, 0), (0.4, 1.04, -0.04), (0.75, 0.9, 0.06), (0.95, 0.56, 0.34), (1, 0.48, 0.42)]
        self.add(self.pick(*BLADES), self.blade((self.uniform(120, 190), 34, 7), clip if self.chance(0.6) else drop))
        (self.riveted if self.chance(0.4) else self.stacked)(5)
        over, under = self.uniform((2, 6), (14, 20))
        self.add((*STEELS, GOLD), box((9, 26, 34 + over + under), 4, 2.5, "x").moved(z=17 + (over - under) / 2))

    def dagger(self) -> None:  # a dagger: symmetric, double-edged, with a cross-guard, a grip of rings and a pommel
        leaf, reach, lean = self.uniform((0.0, 26, -16), (0.12, 52, 22))
        outline = [(0, 0.5 - leaf, leaf - 0.5), (0.35, 0.5, -0.5), (0.75, 0.4, -0.4), (0.95, 0.16, -0.16), (1, 0.06, -0.06)]
        self.add(self.pick(*BLADES), self.blade((215, 34, 8), outline, double=True).moved(z=12))
        self.stacked(0)
        guard = sweep([(lean * z * z, 0, 12 + reach * z) for z in np.linspace(-1, 1, 5)], 14, 10)
        ends = [ball((7, 7, 7)).moved(lean, z=12 + side * reach) for side in (-1, 1)] if self.chance(0.5) else []
        self.add((*STEELS, GOLD, (70, 72, 76)), guard, *ends, ball((10, 11, 13)).moved(-113, z=12))

    def folding(self) -> None:  # a pocket knife opened, straight or at an angle: bolster, pivot, clip
        spear = [(0, 0.9, 0.1), (0.45, 0.98, 0), (0.8, 0.8, 0.12), (0.96, 0.56, 0.4), (1, 0.52, 0.46)]
        tanto = [(0, 0.9, 0.1), (0.1, 1, 0), (0.7, 0.98, 0), (0.76, 0.96, 0.06), (0.96, 0.88, 0.72), (1, 0.88, 0.8)]
        sheep = [(0, 0.9, 0.1), (0.5, 1, 0), (0.8, 0.94, 0), (0.95, 0.5, 0.02), (1, 0.2, 0.06)]
        solid = self.blade((86, 21, 5), self.one_of(spear, tanto, sheep)).moved(-4, z=-10)
        self.add(self.pick(*BLADES), solid if self.chance(0.5) else solid.turned("y", self.uniform(-1.3, -0.5), (-6, 0, 0)))
        trim, (butt, bend, bolster) = self.pick(*STEELS, GOLD), self.uniform((8, -1, 3), (10, 2, 27))
        rows = [(-107, 2 - butt, butt - 2, 12), (-102, -butt, butt, 17)]
        rows += [(-54, -10 - bend, 11 - bend, 17), (-10, -12, 12, 17), (0, -7, 7, 14)]
        self.add((*WOODS, *PLASTICS, BLACK), bar(rows, 3.5, trim, [(-bolster, 0)]))
        self.add(trim, rod(-9, 9, 5, "y").moved(-6))
        if self.chance(0.6):
            self.add(trim, box((48, 3, 6), 6).moved(-75, -9))

    def table_knife(self) -> None:  # a dinner or butter knife: round tip, handle swelling to the butt, a ring or two; steak teeth in some
        metal, broad, teeth = self.pick(*BLADES), self.uniform(0.0, 0.15), self.integers(18, 34) if self.chance(0.4) else 0
        outline = [(0, 0.78, 0.2), (0.12, 0.86, 0.04), (0.6, 0.9 + broad, -broad), (0.85, 0.92 + broad, -broad), (1, 0.64, 0.36)]
        self.add(metal, self.blade((110, 20, 4.5), outline, teeth=teeth))
        rows = [(-105, 5, 13, 5), (-100, 0, 20, 9), (-84, 0, 22, 10), (-32, 3, 17, 7.5), (4, 5, 16, 5)]
        rings = [(x, x + 3) for x in np.linspace(-15, -5, self.integers(1, 4))]
        self.add(metal if self.chance(0.4) else self.pick(*PLASTICS, *WOODS, BLACK), bar(rows, 2.6, self.pick(BLACK, *STEELS), rings))

    kinds = (chef, santoku, cleaver, bread, paring, fillet, hunting, dagger, folding, table_knife)

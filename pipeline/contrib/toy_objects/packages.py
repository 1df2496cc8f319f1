"""Models of boxes and cans."""

from collections.abc import Sequence

import numpy as np

from pipeline.contrib.toy_objects.model import BLACK, GOLD, PLASTICS, RED, STEELS, WHITE, WOODS, Model, Palette, Stretch
from pipeline.contrib.toy_objects.pictures import label
from pipeline.contrib.toy_objects.solids import Array, Rows, Solid, ball, block, bow, box, column, lathe, rod, sweep, vessel

CARDBOARD: Palette = ((176, 136, 92), (198, 160, 112), (226, 222, 210), *PLASTICS)
TINS: Palette = (*STEELS, GOLD, (228, 226, 218))


class Box(Model):
    """Standing on z = 0, the front faces -y."""

    proportions = (Stretch("x", 0.88, 1.14), Stretch("y", 0.88, 1.14), Stretch("z", 0.86, 1.16))

    def standing(self, size: Sequence[float] | Array, exponent: float = 14.0, bevel: float = 1.0, *, printed: bool = True) -> Solid:
        """Make a box that stands on z = 0, with sides (x, y, z); a label covers its front if it is printed."""
        solid = box(size, exponent, bevel, "z", 40).moved(z=size[2] / 2)
        if not printed:
            return solid
        uv = solid.vertices[:, [0, 2]] / [size[0], size[2]] + [0.5, 0.0]
        front = solid.vertices[solid.faces, 1].max(axis=1) < -0.46 * size[1]
        return solid.painted(label(self.rng, size[0] / size[2]), front, uv)

    def carton(self) -> None:  # an upright packet of cereals, tea or medicine; a flap open in some
        size = self.uniform((60, 25, 90), (190, 75, 280))
        self.add(self.pick(*CARDBOARD), self.standing(size))
        flap = box((0.9 * size[0], 2.4, self.uniform(0.3, 0.7) * size[1]), 9, 0.6).moved(z=0.2 * size[1])
        if self.chance(0.5):
            self.add(self.pick(*CARDBOARD), flap.turned("x", self.uniform(-1.2, 1.2)).moved(y=0.44 * size[1], z=size[2]))
        else:
            self.add(CARDBOARD, box((0.5 * size[0], 0.4 * size[1], 2.0), 9, 0.5, "z").moved(z=size[2]))

    def milk(self) -> None:  # a drink carton with a screw cap: a gable with a fold on top, or flat
        side, high, deep = self.uniform((32, 95, 0.7), (48, 200, 1.0))
        self.add(self.pick(WHITE, *PLASTICS), self.standing((2 * side, 2 * deep * side, high)))
        if self.chance(0.6):
            top = high + self.uniform(0.6, 0.9) * side
            roof = [(high - 1, side, deep * side, 14), (top, side, 3, 8), (top + 14, side, 2.5, 8)]
            self.add((WHITE, *PLASTICS), column(roof, count=40))
        self.add((WHITE, *PLASTICS), rod(-7, 7, 12, "z").turned("x", 0.6).moved(y=-0.45 * deep * side, z=high + 0.3 * side))

    def shoe_box(self) -> None:  # a box with a lid over it, which is askew in some
        size = self.uniform((140, 90, 60), (320, 200, 130))
        lid = box((size[0] + 6, size[1] + 6, 0.28 * size[2]), 16, 1.5, "z", 40).moved(z=size[2])
        self.add(self.pick(*CARDBOARD), self.standing(size))
        self.add(self.pick(*CARDBOARD), lid.turned("z", self.uniform(-0.3, 0.3)) if self.chance(0.3) else lid)

    def toolbox(self) -> None:  # a case with a handle and two latches in front
        size, metal = self.uniform((160, 80, 80), (300, 150, 160)), self.pick(*STEELS, BLACK, GOLD)
        top, reach = size[2], 0.28 * size[0]
        self.add(self.pick(*PLASTICS, *WOODS, BLACK), self.standing(size, self.uniform(5, 12), 5.0, printed=False))
        self.add(metal, box((size[0] + 1.5, size[1] + 1.5, 5), 12, 1.0, "z").moved(z=0.62 * top))
        self.add((BLACK, *STEELS), bow([(reach, top - 4), (0.9 * reach, top + 26)], 18, 10))
        self.add(metal, *(box((16, 6, 30), 6, 1.5).moved(x * size[0], -size[1] / 2 - 1, 0.62 * top) for x in (-0.3, 0.3)))

    def matches(self) -> None:  # a match or pill box lying flat, its drawer pulled out
        x, y, z = self.uniform((40, 60, 14), (70, 110, 32))
        pulled = self.uniform(0.1, 0.7) * y
        self.add(self.pick(*CARDBOARD), self.standing((x, y, z)))
        self.add((*WOODS, WHITE), vessel([(1, x / 2 - 3, y / 2 - 2, 14), (z - 2, x / 2 - 3, y / 2 - 2, 14)], 2.5, 4.0).moved(y=-pulled))
        for number in range(self.integers(1, 7)):
            self.add((RED, BLACK), rod(-0.4 * y, 0.4 * y, 1.8, "y").moved((number - 3) * 0.11 * x, -pulled, z / 2))

    def book(self) -> None:  # books, one or a stack: covers, pages, a rounded spine
        z = 0.0
        for _ in range(self.integers(1, 4)):
            wide, long, thick = self.uniform((100, 140, 14), (170, 240, 42))
            turn, cover = self.uniform(-0.35, 0.35) * (z > 0), self.pick(*PLASTICS, *WOODS, BLACK)
            slabs = [box((wide, long, 3), 14, 0.8, "z").moved(z=z + at) for at in (1.5, thick - 1.5)]
            pages = box((wide - 8, long - 8, thick - 3), 14, 0.8, "z").moved(-2, z=z + thick / 2)
            spine = column([(-long / 2, 4, thick / 2, 4), (long / 2, 4, thick / 2, 4)], "y", 24).turned("y", np.pi / 2)
            spine = spine.moved(-wide / 2, z=z + thick / 2)
            self.add(cover, *(solid.turned("z", turn) for solid in (*slabs, spine)))
            self.add(((236, 230, 214),), pages.turned("z", turn))
            z += thick - 0.4

    def brick(self) -> None:  # a toy brick with round studs, or a stack of two or three
        across, deep, levels = (self.integers(low, high) for low, high in ((2, 6), (1, 4), (1, 4)))
        for level in range(levels):
            shade, shift = self.pick(*PLASTICS, RED), 16 * self.integers(-1, 2) * (level > 0)
            solid = box((16 * across, 16 * deep, 19.2), 24, 0.8, "z").moved(shift, z=19.2 * level + 9.6)
            studs = [(16 * (i - (across - 1) / 2) + shift, 16 * (j - (deep - 1) / 2)) for i in range(across) for j in range(deep)]
            self.add(shade, solid, *(rod(0, 4, 4.8, "z").moved(x, y, 19.2 * (level + 1) - 0.4) for x, y in studs))
        self.add(PLASTICS, box((15 * across, 15 * deep, 2), 24, 0.5, "z"))

    def present(self) -> None:  # a gift box with a ribbon both ways and a bow
        size, ribbon = self.uniform((70, 60, 40), (160, 150, 150)), self.pick(*PLASTICS, RED, GOLD)
        x, y, z = size
        self.add(self.pick(*CARDBOARD), self.standing(size, printed=False))
        wide = self.uniform(0.1, 0.2) * min(x, y)
        self.add(ribbon, box((wide, y + 2, z + 2), 14, 0.8, "z").moved(z=z / 2), box((x + 2, wide, z + 2), 14, 0.8, "z").moved(z=z / 2))
        loop = [(0, 0, z), (18, 0, z + 22), (38, 0, z + 20), (42, 0, z + 6), (16, 0, z + 2)]
        angle = self.uniform(-0.7, 0.7)
        self.add(ribbon, *(sweep(loop, wide, 4).turned("z", angle + turn) for turn in (0, np.pi)), ball((7, 7, 6)).moved(z=z + 3))

    def tissues(self) -> None:  # a box of tissues, cubic or flat, a tissue sticking out
        size = self.uniform((100, 90, 50), (240, 125, 130))
        self.add(self.pick(*CARDBOARD), self.standing(size))
        low, peak = size[2] - 2, size[2] + self.uniform(40, 75)
        self.add((BLACK,), column([(low, 0.3 * size[0], 0.2 * size[1], 2.0), (low + 3, 0.3 * size[0], 0.2 * size[1], 2.0)]))
        tissue = [(low, 0.22 * size[0], 6, 2.0), (0.4 * low + 0.6 * peak, 0.12 * size[0], 10, 2.0), (peak, 0.16 * size[0], 3, 2.0)]
        self.add(self.pick(WHITE), column(tissue, count=48, lobes=8, depth=[0.05, 0.25, 0.3]).turned("z", self.uniform(-0.5, 0.5)))

    def crate(self) -> None:  # an open crate of slats, or a plastic basket; something in it
        x, y, z = self.uniform((110, 90, 60), (220, 150, 130))
        shade, rows = self.pick(*WOODS, *PLASTICS), self.integers(2, 4)
        self.add(shade, box((x, y, 8), 14, 1.0, "z").moved(z=4))
        for at in np.linspace(0.25, 1, rows) * z:
            tall = 0.55 * z / rows
            long = [box((x, 6, tall), 14, 1.0).moved(y=s * (y / 2 - 3), z=at - tall / 2) for s in (-1, 1)]
            self.add(shade, *long, *(box((6, y, tall), 14, 1.0, "x").moved(s * (x / 2 - 3), z=at - tall / 2) for s in (-1, 1)))
        posts = [box((10, 10, z), 8, 1.0, "z").moved(s * (x / 2 - 8), t * (y / 2 - 8), z / 2) for s in (-1, 1) for t in (-1, 1)]
        self.add((*WOODS, *STEELS), *posts)
        for number in range(self.integers(0, 4)):
            r = self.uniform(0.2, 0.3) * min(x, y)
            self.add((RED, (230, 150, 40), (120, 160, 60)), ball((r, r, r)).moved((number - 1) * 0.28 * x, 0.1 * y * (-1) ** number, 7 + r))

    def camera(self) -> None:  # a camera or radio: body, lens, knobs on top
        x, y, z = self.uniform((95, 34, 58), (150, 60, 95))
        body, lens = self.pick(BLACK, *STEELS, *PLASTICS), self.uniform(0.3, 0.42) * z
        self.add(body, self.standing((x, y, z), self.uniform(5, 10), 3.0))
        self.add(body, block((-0.2 * x, 0.2 * x), (z - 4, z + self.uniform(8, 22)), 0.6 * y))
        out = y / 2 + self.uniform(12, 55)
        middle = -0.5 * (out + y / 2)
        rings = column([(-out, 0.9 * lens), (-out + 5, lens), (middle, lens), (2 + middle, 1.1 * lens), (0, 1.1 * lens)], "y", 36)
        self.add(self.pick(BLACK, *STEELS), rings.moved(self.uniform(-0.1, 0.2) * x, z=0.48 * z))
        self.add(self.pick(*STEELS), *(rod(z - 1, z + self.uniform(4, 11), 8, "z").moved(at * x) for at in (-0.38, 0.3, 0.42)))

    kinds = (carton, milk, shoe_box, toolbox, matches, book, brick, present, tissues, crate, camera)


class Can(Model):
    """Cans, jars and other round vessels with a label, standing on z = 0."""

    proportions = (Stretch("xy", 0.86, 1.16), Stretch("z", 0.86, 1.16))

    def labelled(self, rows: Rows, low: float, high: float, size: Sequence[float]) -> Solid:
        """Loft a can around z, with a label all around between two heights; `size` is its half width, half depth, and exponent there."""
        count, (u, v, square) = 48, size
        table = np.array(rows, float)
        solid = column(np.column_stack([table[:, 0], u * table[:, 1], v * table[:, 1], np.full(len(table), square)]), count=count)
        z = solid.vertices[:, 2]
        inside = (z > low - 1e-6) & (z < high + 1e-6)
        column_of = np.arange(len(z)) % count
        uv = np.column_stack([column_of / (count - 1), (z - low) / (high - low)]) * inside[:, None]
        is_seam = np.ptp(column_of[solid.faces], axis=1) > 1  # where the label's ends meet: all of it would be there once more, mirrored
        return solid.painted(label(self.rng, np.pi * (u + v) / (high - low)), np.all(inside[solid.faces], axis=1) & ~is_seam, uv)

    def drink(self) -> None:  # a drinks can: necks at both ends, a tab on its lid; a straw in some
        r, high = self.uniform((26, 115), (34, 170))
        rows = [(0, 0.78), (3, 0.82), (9, 1), (12, 1), (high - 20, 1), (high - 10, 0.93), (high - 3, 0.83), (high, 0.83), (high, 0.78)]
        rows[-1] = (high + 0.8, 0.78)
        self.add(self.pick(*STEELS, *PLASTICS), self.labelled(rows, 12, high - 20, (r, r, 2.0)))
        self.add(STEELS, box((12, 20, 1.8), 3, 0.5, "z", 20).moved(y=-4, z=high + 1.2))
        if self.chance(0.3):
            self.add(self.pick(*PLASTICS), rod(-10, self.uniform(30, 60), 3, "z").turned("y", self.uniform(-0.4, 0.4)).moved(y=4, z=high))

    def food(self) -> None:  # a food tin: rims, ribs or a label; half open in some
        r, high, ribs = *self.uniform((32, 48), (54, 125)), self.integers(0, 7)
        waves = np.linspace(0.2, 0.8, 2 * ribs + 2) * high
        depth = np.resize([1.0, 0.97], len(waves)) if ribs else np.ones(2)
        ends = [(0, 1.02), (3, 1.02), (4, 1)], [(high - 4, 1), (high - 3, 1.02), (high, 1.02)]
        rows = [*ends[0], *zip(waves, depth, strict=True), *ends[1]]
        self.add(self.pick(*TINS), self.labelled(rows, waves[0], waves[-1], (r, r, 2.0)))
        if self.chance(0.3):
            lid = rod(-1.2, 1.2, 0.98 * r, "z").turned("y", self.uniform(0.6, 1.3), (-r, 0, 0)).moved(z=high)
            self.add(TINS, lid)
        else:
            self.add(TINS, box((10, 22, 2.4), 2.4, 0.8, "z", 20).moved(y=-0.5 * r, z=high))

    def fish(self) -> None:  # a flat tin of sardines or shoe polish, oval, square or round, with a ring to pull
        u, v, high, square = self.uniform((42, 30, 20, 2.0), (58, 44, 34, 6.0))
        rows = [(0, 1.02), (2.5, 1.02), (3.5, 1), (high - 4, 1), (high - 3, 1.02), (high, 1.02)]
        self.add(self.pick(*TINS), self.labelled(rows, 3.5, high - 4, (u, v, square)))
        ring = vessel([(0, 11), (3, 11)], 3.0, 1.0).moved(0.45 * u, z=high - 1)
        self.add((*TINS, *PLASTICS), ring, box((0.9 * u, 0.8 * v, 2), square, 0.6, "z").moved(-0.4 * u, z=high))

    def spray(self) -> None:  # an aerosol: domed shoulder under a cap or a nozzle
        r, high = self.uniform((20, 120), (33, 190))
        rows = [(0, 0.95), (3, 1.03), (6, 1), (high - 6, 1), (high, 0.97), (high + 6, 0.8), (high + 12, 0.45)]
        self.add(self.pick(*TINS), self.labelled(rows, 6, high - 6, (r, r, 2.0)))
        cap = lathe([(high - 1, 1.0 * r), (high + 30, 0.97 * r), (high + 40, 0.9 * r), (high + 44, 0.6 * r)])
        nozzle = [rod(high + 8, high + 22, 7, "z"), rod(-2, 9, 3, "x").moved(z=high + 18)]
        self.add(self.pick(*PLASTICS, BLACK, WHITE), *([cap] if self.chance(0.5) else nozzle))

    def paint(self) -> None:  # a paint pot or bucket: lid with a rim, a wire bail
        r, high, drop = self.uniform((48, 90, -0.8), (80, 170, 0.8))
        rows = [(0, 0.98), (4, 1), (0.1 * high, 1), (0.9 * high, 1), (high - 6, 1.03), (high, 1.03)]
        self.add(self.pick(*TINS, WHITE), self.labelled(rows, 0.1 * high, 0.9 * high, (r, r, 2.0)))
        self.add((*TINS, *PLASTICS), column([(high - 1, 0.9 * r), (high + 3, 0.88 * r), (high + 3.5, 0.7 * r)], count=40))
        arch = bow([(r + 3, 0.8 * high), (0.8 * r, high + 0.4 * r), (0, high + 0.8 * r)], 4, 4)
        bail = arch.turned("x", drop, (0, 0, 0.8 * high))
        self.add((*STEELS, BLACK), bail, rod(-r - 5, r + 5, 5, "x").moved(z=0.8 * high))

    def jar(self) -> None:  # a preserving jar: shoulder, wide lid; round or square
        r, high, neck, square = self.uniform((28, 62, 0.72, 2.0), (48, 130, 0.92, 6.0))
        rows = [(0, 0.92), (5, 1), (0.15 * high, 1), (0.75 * high, 1), (0.88 * high, neck), (high, neck)]
        glass = self.pick((150, 60, 40), (196, 206, 206), (214, 160, 70), (90, 60, 40), (120, 150, 90))
        self.add(glass, self.labelled(rows, 0.15 * high, 0.75 * high, (r, r, 2.0 if self.chance(0.6) else square)))
        lid = [(0.9 * high, 1.1 * neck * r), (high + 3, 1.1 * neck * r), (high + 5, neck * r)]
        self.add((*TINS, RED, *PLASTICS), column(lid, count=60, lobes=20, depth=[0.015, 0.015, 0.0]))

    def caddy(self) -> None:  # a tea or biscuit tin, square or round, its lid slipped over; a knob on some
        u, v, high, square = self.uniform((35, 30, 60, 2.0), (75, 65, 150, 9.0))
        rows = [(0, 0.97), (3, 1), (0.08 * high, 1), (0.85 * high, 1), (high, 1)]
        self.add(self.pick(*TINS, *PLASTICS), self.labelled(rows, 0.08 * high, 0.85 * high, (u, v, square)))
        lid = [(0.9 * high, u + 2, v + 2, square), (high + 4, u + 2, v + 2, square)]
        lid += [(high + 7, u - 1, v - 1, square), (high + 8, 0.6 * u, 0.6 * v, square)]
        self.add((*TINS, *PLASTICS, BLACK), column(lid, count=48))
        if self.chance(0.4):
            self.add((GOLD, *STEELS, BLACK), rod(high + 6, high + 14, 4, "z"), ball((8, 8, 7)).moved(z=high + 18))

    def battery(self) -> None:  # a round cell with its pole, alone or up to four in a row
        r, high, count = *self.uniform((13, 62), (24, 110)), self.integers(1, 5)
        for number in range(count):
            rows = [(0, 0.94), (2, 1), (0.06 * high, 1), (0.94 * high, 1), (high - 2, 1), (high, 0.94)]
            x = 2 * r * (number - (count - 1) / 2)
            self.add(self.pick(GOLD, BLACK, *PLASTICS), self.labelled(rows, 0.06 * high, 0.94 * high, (r, r, 2.0)).moved(x))
            self.add(STEELS, rod(high - 1, high + 4, 0.34 * r, "z").moved(x))

    def candle(self) -> None:  # a candle in a glass, or one to three pillars of wax on a dish
        r, high, level = self.uniform((26, 50, 0.6), (48, 130, 0.9))
        wax, wick = self.pick(*PLASTICS, (238, 226, 196), WHITE), rod(-2, 12, 1.6, "z").turned("x", 0.2)
        if self.chance(0.4):
            self.add(((200, 210, 210), (120, 60, 30)), vessel([(0, 0.96 * r), (3, r), (high, r)], 3.0, level * high, wax))
            self.add((BLACK,), wick.moved(z=level * high))
            return
        for number in range(count := self.integers(1, 4)):
            x, top = 1.9 * r * (number - (count - 1) / 2), high * self.uniform(0.6, 1.0)
            rows = [(0, 0.96), (3, 1), (0.12 * top, 1), (0.8 * top, 1), (top, 0.94)]
            self.add(wax, self.labelled(rows, 0.12 * top, 0.8 * top, (r, r, 2.0)).moved(x))
            self.add((BLACK,), wick.moved(x, z=top))
        self.add((*TINS, *PLASTICS), column([(-4, count * r, r, 2.4), (3, (count + 0.3) * r, 1.3 * r, 2.4)], count=48))

    def watering(self) -> None:  # a watering or oil can: round body, long spout, handle behind and above
        r, high, out, rise = self.uniform((50, 90, 60, 0.9), (75, 140, 130, 1.5))
        shade = self.pick(*PLASTICS, *STEELS)
        rows = [(0, r), (4, r), (0.85 * high, 0.96 * r), (high, self.uniform(0.5, 0.9) * r)]
        self.add(shade, vessel(rows, 4.0, 0.8 * high, self.pick(BLACK, shade.color)))
        path = [(0.9 * r, 0, 0.25 * high), (r + 0.5 * out, 0, 0.55 * rise * high), (r + out, 0, rise * high)]
        self.add(shade, sweep(path, 16, 16, 2.0))
        tint, rose = self.pick(*PLASTICS, *STEELS), column([(0, 8), (18, self.uniform(9, 26))], "x", 20)
        self.add(tint, rose.turned("y", -0.6).moved(r + out - 4, z=rise * high - 2))
        arch = [(0.4 * r, 0, high - 6), (0, 0, 1.45 * high), (-0.9 * r, 0, 1.3 * high)]
        arch += [(-1.25 * r, 0, 0.8 * high), (-0.92 * r, 0, 0.4 * high)]
        self.add(shade, sweep(arch, 15, 9))

    kinds = (drink, drink, food, fish, spray, paint, jar, caddy, battery, candle, watering)

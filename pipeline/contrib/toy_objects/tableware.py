"""Models of bowls and mugs."""

from collections.abc import Sequence

import numpy as np

from pipeline.contrib.toy_objects.model import BLACK, GLAZES, GOLD, PLASTICS, STEELS, WHITE, WOODS, Model, Stretch
from pipeline.contrib.toy_objects.solids import Material, Rows, Solid, ball, bar, bow, column, lathe, rod, sweep, vessel

Bands = Sequence[tuple[float, float, Material]]


class Bowl(Model):
    """Bowls, plates, moulds, mortars, pans and baskets, standing on z = 0."""

    proportions = (Stretch("xy", 0.88, 1.12), Stretch("z", 0.84, 1.2))

    def dish(self, rows: Rows, *, wall: float = 4.0, floor: float = 8.0, edge: float = 0.0) -> Material:
        """Add a dish, its inside perhaps of another colour, its outside from the share `edge` of its height too; return the outside's."""
        outside, inside, rim, top = self.pick(*GLAZES), self.pick(*GLAZES), self.pick(*GLAZES, GOLD), rows[-1][0]
        self.add(outside, vessel(rows, wall, floor, inside, [(edge * top, top + 1, rim)] if edge else []))
        return outside

    def cereal(self) -> None:  # a round bowl on a small ring; a spoon in some
        rim, high, belly = self.uniform((62, 45, 0.75), (82, 72, 0.95))
        self.dish([(0, 0.45 * rim), (5, 0.48 * rim), (0.4 * high, belly * rim), (high, rim)], edge=self.one_of(0.0, 0.8))
        if self.chance(0.35):
            lean = self.uniform(-0.5, 0.5)
            spoon = sweep([(-0.3 * rim, 0, 14), (0.2 * rim, 0, 0.5 * high), (rim, 0, high + 8), (1.9 * rim, 0, high + 30)], 9, 4)
            self.add((*STEELS, *WOODS), *(solid.turned("z", lean) for solid in (spoon, ball((22, 15, 6)).moved(-0.3 * rim, z=14))))

    def soup(self) -> None:  # a soup plate: shallow, with a broad flat rim
        rim, well = self.uniform((100, 0.55), (125, 0.72))
        self.dish([(0, 0.4 * rim), (3, 0.45 * rim), (28, well * rim), (33, 0.8 * rim), (38, rim)], floor=6.0, edge=self.one_of(0.0, 0.88))

    def mixing(self) -> None:  # a deep bowl with a thick rim and a grip or a spout at its side
        rim, high, slope = self.uniform((85, 80, 0.6), (125, 130, 0.8))
        rows = [(0, 0.55 * rim), (4, 0.6 * rim), (0.5 * high, (0.5 + 0.5 * slope) * rim)]
        rows += [(high - 12, 0.95 * rim), (high - 10, rim), (high, rim)]
        outside = self.dish(rows, edge=1 - 11 / high)
        spout = sweep([(0.9 * rim, 0, high - 16), (rim + 4, 0, high - 6), (rim + 18, 0, high)], 34, 8, 2.2)
        grip = sweep([(0.95 * rim, 0, high - 6), (rim + 22, 0, high - 4), (rim + 28, 0, high - 16)], self.uniform(30, 60), 7)
        self.add(outside, *([spout] if self.chance(0.4) else [grip, grip.turned("z", np.pi)]))

    def fluted(self) -> None:  # a solid jelly or cake mould, ripples around it, upside down
        rim, high, lobes = *self.uniform((60, 45), (95, 95)), self.integers(6, 15)
        depth = [0.09, 0.09, 0.08, 0.06, 0.03]
        rows = [(0, rim), (6, rim), (0.55 * high, 0.85 * rim), (0.9 * high, 0.6 * rim), (high, 0.4 * rim)]
        self.add((*GLAZES, *STEELS), column(rows, count=6 * lobes, lobes=lobes, depth=depth))
        self.add(self.pick(*STEELS, *GLAZES), rod(-4, 1, 1.12 * rim, "z"), rod(high - 2, high + self.uniform(2, 8), 0.25 * rim, "z"))

    def footed(self) -> None:  # a fruit bowl or ice cup on a stem; fruit in some
        rim, stem, deep = self.uniform((50, 24, 35), (110, 90, 60))
        high = stem + 20 + deep
        rows = [(0, 0.55 * rim), (5, 0.5 * rim), (12, 9), (stem, 8)]
        rows += [(stem + 8, 0.4 * rim), (stem + 20 + 0.4 * deep, 0.85 * rim), (high, rim)]
        self.dish(rows, floor=stem + 14, wall=3.5)
        for number in range(self.integers(0, 4)):
            size, angle = self.uniform(0.25, 0.4) * rim, 2.1 * number
            fruit = ball((size, size, 0.95 * size)).moved(0.4 * rim * np.cos(angle), 0.4 * rim * np.sin(angle), high - 0.3 * size)
            self.add(((200, 50, 40), (230, 150, 40), (120, 160, 60)), fruit)

    def pet(self) -> None:  # a dog's bowl: wider at its foot, on a rubber ring
        foot, high, rim = self.uniform((80, 45, 0.7), (115, 75, 0.85))
        self.dish([(0, foot), (5, 0.98 * foot), (high - 3, (rim + 0.04) * foot), (high, rim * foot)], wall=7.0, edge=self.one_of(0.0, 0.5))
        self.add((BLACK, *PLASTICS), rod(-4, 2, 0.97 * foot, "z"))

    def plate(self) -> None:  # a stack of dinner plates, or a single one
        rim, count = self.uniform(85, 135), self.integers(1, 5)
        for level in range(count):
            z = 11 * level
            rows = [(z, 0.55 * rim), (z + 2, 0.6 * rim), (z + 10, 0.75 * rim), (z + 20, rim)]
            self.dish(rows, floor=z + 6, wall=3.5)

    def mortar(self) -> None:  # a heavy bowl of stone or wood with its pestle leaning in it
        rim, high, lean, turn = self.uniform((48, 70, 0.3, -1.5), (62, 100, 0.6, 1.5))
        stone = self.pick((150, 150, 146), (90, 92, 96), *WOODS)
        self.add(stone, vessel([(0, 0.7 * rim), (10, 0.66 * rim), (22, 0.72 * rim), (0.6 * high, rim), (high, rim)], 11.0, 24.0))
        club = lathe([(26, 4), (30, 15), (48, 14), (90, 8), (0.9 * high + 90, 9), (0.9 * high + 98, 5)], count=24)
        self.add(((170, 170, 164), *WOODS), club.turned("x", lean, (0, 0, 30)).turned("z", turn))

    def pan(self) -> None:  # a frying pan, wok or saucepan with one long handle
        rim, high, slope, long = self.uniform((80, 38, 0.72, 120), (120, 95, 0.97, 190))
        metal, z = self.pick(BLACK, *STEELS, (160, 82, 50)), 0.85 * high
        self.add(metal, vessel([(0, slope * rim - 3), (4, slope * rim), (high, rim)], 3.5, 6.0, self.pick(BLACK, *STEELS)))
        rise = self.uniform(0, 40)
        rows = [(-5, z - 5, z + 5, 18), (20, z - 6, z + 5, 14)]
        rows += [(50, z - 9 + 0.3 * rise, z + 7 + 0.3 * rise, 22), (long, z - 8 + rise, z + 7 + rise, 26)]
        self.add((BLACK, *WOODS), bar(rows).moved(rim - 2), rod(-4, 4, 4, "y").moved(rim + 10, z=z))

    def basket(self) -> None:  # a square or oval tray or basket; with a bail over it in some
        u, v, high, square = self.uniform((70, 50, 35, 2.0), (115, 85, 90, 7.0))
        flare = self.uniform(1.02, 1.25)
        rows = [(0, u - 3, v - 3, square), (4, u, v, square), (high, flare * u, flare * v, square)]
        shade = self.pick(*WOODS, *PLASTICS)
        self.add(shade, vessel(rows, 5.0, 7.0, self.pick(*WOODS, *GLAZES), [(0.75 * high, high + 1, self.pick(*WOODS, *PLASTICS))]))
        if self.chance(0.6):
            side, top = flare * u - 2, high + self.uniform(60, 110)
            arch = bow([(side, high - 15), (0.85 * side, 0.6 * top + 0.4 * high), (0, top)], 13, 7)
            self.add((*WOODS, *PLASTICS), arch)

    kinds = (cereal, soup, mixing, fluted, footed, pet, plate, mortar, pan, basket)


class Mug(Model):
    """Mugs, cups, steins and jugs, standing on z = 0, the handle at +x, turned a little towards the front at -y."""

    proportions = (Stretch("xy", 0.86, 1.16), Stretch("z", 0.86, 1.14))

    def handle(self, rows: Rows, low: float, high: float, reach: float, thick: float = 11.0) -> Solid:
        """Bend a handle, round or angular, between two heights of a wall with these rows; turned about z."""
        below, above = np.interp([low, high], *np.array(rows, float).T)
        middle, out = (low + high) / 2, max(below, above) + reach
        curve = [(above - 4, high), (0.4 * above + 0.6 * out, high + 3)]
        curve += [(out, middle + 4), (0.4 * below + 0.6 * out, low - 2), (below - 4, low)]
        corners = [(above - 4, high), (out - 3, high - 1), (out, middle), (out - 5, low + 1), (below - 4, low)]
        path = [(x, 0, z) for x, z in (curve if self.chance(0.6) else corners)]
        return sweep(path, self.uniform(0.9, 1.6) * thick, 0.75 * thick).turned("z", self.uniform(-0.7, 0.2))

    def cup(self, rows: Rows, reach: float, bands: Bands = (), *, low: float = 0.22, high: float = 0.8) -> Material:
        """Add a cup, its handle between two shares of its height, its inside perhaps of another colour; return its outside's."""
        glaze, inside, top = self.pick(*GLAZES), self.pick(WHITE, *GLAZES), rows[-1][0]
        self.add(glaze, vessel(rows, self.uniform(3.0, 5.0), 7.0, inside, bands))
        self.add(glaze if self.chance(0.8) else inside, self.handle(rows, low * top, high * top, reach))
        return glaze

    def plain(self) -> None:  # a straight office mug, perhaps with a stripe
        high, low, wide = self.uniform((88, 16, 6), (112, 40, 40))
        stripe = [(low, low + wide, self.pick(*GLAZES, BLACK))] if self.chance(0.5) else []
        self.cup([(0, 37), (3, 40), (high - 2, 40), (high, 39)], self.uniform(22, 32), stripe)

    def tapered(self) -> None:  # a latte mug, wider at the top, or at the foot; on a rubber ring in some
        foot, top, high = self.uniform((26, 40, 95), (34, 52, 135))
        if self.chance(0.25):
            foot, top = top, foot + 4
        self.cup([(0, foot - 3), (3, foot), (high - 2, top), (high, top - 1)], self.uniform(20, 32))
        if self.chance(0.4):
            self.add((BLACK, *PLASTICS), rod(-4, 3, foot - 1, "z"))

    def barrel(self) -> None:  # a pottery mug with a belly, a foot ring, and a rim dipped in another glaze
        belly, rim, high = self.uniform((41, 33, 80), (52, 41, 105))
        rows = [(0, 0.72 * belly), (4, 0.78 * belly), (0.42 * high, belly), (0.85 * high, rim), (high, rim + self.uniform(0, 5))]
        dip = (self.uniform(0.6, 0.85) * high, high + 1, self.pick(*GLAZES))
        self.add(self.cup(rows, self.uniform(18, 28), [dip]), rod(-3, 2, 0.6 * belly, "z"))

    def tea(self) -> None:  # a low, wide cup with a fine handle; on a saucer in some
        rim, high, wide = self.uniform((44, 50, 1.35), (54, 66, 1.6))
        self.cup([(0, 22), (4, 24), (0.35 * high, 0.78 * rim), (0.85 * high, 0.96 * rim), (high, rim)], self.uniform(14, 22), low=0.35)
        if self.chance(0.6):
            plate = np.multiply([(1, 0.45), (1, 0.5), (1, 0.85), (1, 1)], [1, wide * rim])
            plate[:, 0] = -9, -7, -1, 5
            self.add(GLAZES, vessel(plate, 4.0, 1.0))

    def espresso(self) -> None:  # a small thick cup with a looped handle and a rim of gold or another colour
        rim, high = self.uniform((27, 52), (33, 64))
        edge = (high - self.uniform(3, 9), high + 1, self.pick(GOLD, BLACK, *GLAZES))
        self.cup([(0, 19), (3, 21), (0.5 * high, 0.94 * rim), (high, rim)], self.uniform(14, 22), [edge], low=0.35, high=0.85)

    def enamel(self) -> None:  # a camping mug of thin metal: straight wall, rolled rim of another colour
        (radius, high), coat = self.uniform((38, 70), (47, 92)), self.pick(WHITE, *PLASTICS, (36, 62, 110))
        rows = [(0, radius - 4), (4, radius), (high - 4, radius), (high - 2, radius + 2), (high, radius + 2)]
        rim = (high - 4, high + 1, self.pick(BLACK, (36, 62, 110), *STEELS))
        self.add(coat, vessel(rows, 3.0, 5.0, self.pick(WHITE), [rim]), self.handle(rows, 0.2 * high, 0.82 * high, 30, 8))

    def travel(self) -> None:  # an insulated beaker with a grip and a lid; with a handle in some
        foot, top, high = self.uniform((28, 38, 150), (34, 44, 205))
        rows, z = [(0, foot - 2), (4, foot), (0.45 * high, self.uniform(foot, top)), (0.6 * high, top), (high, top)], 0.6 * high
        self.add((*STEELS, *PLASTICS, BLACK), lathe(rows, count=36))
        self.add(grip := self.pick(BLACK, *PLASTICS), rod(z, z + self.uniform(15, 40), top + 0.8, "z"))
        lid = lathe([(high - 4, top + 2), (high + 8, top + 2), (high + 13, top - 5), (high + 16, top - 9)])
        self.add((BLACK, *PLASTICS), lid, ball((9, 5, 5)).moved(y=14 - top, z=high + 16))
        if self.chance(0.5):
            self.add(grip, self.handle(rows, 0.35 * high, 0.85 * high, 32))

    def stein(self) -> None:  # a tall beer mug with a heavy handle and rings around it; a lid on some
        (radius, high), rings = self.uniform((42, 130), (52, 190)), self.integers(2, 6)
        glass, waves = self.pick((226, 190, 96), (190, 206, 208), (176, 170, 156)), np.linspace(0.1, 0.85, 2 * rings + 1) * high
        rows = [(0, radius + 3), (6, radius + 3), *zip(waves, radius + np.resize([0, 4], len(waves)), strict=True), (high, radius)]
        foam = self.pick(WHITE, (238, 210, 130), *GLAZES)
        self.add(glass, vessel(rows, 6.0, 12.0, foam, [(0, 8, foam)]), self.handle(rows, 0.2 * high, 0.86 * high, 38, 18))
        if self.chance(0.4):
            dome = [(high - 2, radius + 1), (high + 8, radius), (high + 20, 0.5 * radius), (high + 26, 6), (high + 38, 7), (high + 40, 4)]
            self.add(STEELS, lathe(dome))

    def jug(self) -> None:  # a pitcher: belly, narrow neck, wide handle, a lip to pour from
        belly, neck, high = self.uniform((55, 30, 150), (72, 44, 230))
        rows = [(0, 0.66 * belly), (5, 0.72 * belly), (0.35 * high, belly), (0.75 * high, neck), (high, neck + self.uniform(3, 12))]
        stripe = (0.3 * high, self.uniform(0.33, 0.45) * high, self.pick(*GLAZES, BLACK))
        glaze = self.cup(rows, self.uniform(24, 38), [stripe] if self.chance(0.5) else [], low=0.4, high=0.92)
        self.add(glaze, sweep([(-neck + 2, 0, high - 22), (-neck - 8, 0, high - 8), (-neck - 20, 0, high + 1)], 30, 9, 2.2))

    kinds = (plain, tapered, barrel, tea, espresso, enamel, travel, stein, jug)

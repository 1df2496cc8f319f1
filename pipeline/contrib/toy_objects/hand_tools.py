"""Models of hammers and screwdrivers."""

import numpy as np

from pipeline.contrib.toy_objects.model import BLACK, GOLD, PLASTICS, RED, STEELS, WOODS, Model, Palette, Stretch
from pipeline.contrib.toy_objects.solids import Solid, ball, bar, box, coil, column, lathe, rod, smooth, sweep

IRON: Palette = (*STEELS, (70, 74, 80), (44, 46, 50))


def face(low: float, high: float, radius: float, waist: float) -> Solid:
    """Make the poll of a hammer along z: a waist behind its striking face."""
    way = np.sign(high - low)
    rows = [(low, waist * radius), (0.45 * low + 0.55 * high, waist * radius)]
    rows += [(high - 9 * way, radius), (high - 2 * way, radius), (high, 0.9 * radius)]
    return column(rows if way > 0 else rows[::-1], "z", 28)


class Hammer(Model):
    """The shaft along x, the head at +x."""

    proportions = (Stretch("x", 0.85, 1.2, end=-20), Stretch("y", 0.88, 1.12), Stretch("z", 0.86, 1.16))

    def shaft(self, length: float, width: float = 26.0) -> None:
        """Add a shaft from x = -length to the head: turned wood, or a tube with a rubber grip."""
        swell, neck = self.uniform(1.0, 1.35) * width, self.uniform(0.6, 0.9) * width
        rows = [(-length, 0.8 * swell), (-0.96 * length, swell), (-0.7 * length, 0.85 * swell), (-0.35 * length, neck), (8, neck)]
        outline = [(x, -w / 2, w / 2, 0.8 * w) for x, w in rows]
        if self.chance(0.5):
            self.add(self.pick(*WOODS), bar(outline, 2.4, self.pick(*PLASTICS, BLACK), [(-length, -self.uniform(0.9, 0.98) * length)]))
        else:
            rubber = [*outline[:3], (-0.45 * length, -0.4 * width, 0.4 * width, 0.7 * width)]
            grip = bar(rubber, 2.6, self.pick(*PLASTICS), [(-0.75 * length, -0.7 * length)])
            self.add((*STEELS, *PLASTICS), rod(-0.5 * length, 8, 0.33 * width))
            self.add((BLACK, *PLASTICS), grip)

    def claw(self) -> None:  # a carpenter's hammer: round face, two curved claws
        self.shaft(self.uniform(220, 300))
        metal, out, droop = self.pick(*IRON), self.uniform(62, 85), self.uniform(5, 38)
        claws = [sweep([(0, 4 * s, 12), (2, 6 * s, 0.6 * out), (-droop, 12 * s, out + 8)], 9, 11, 2.6) for s in (-1, 1)]
        self.add(metal, box((34, 30, 36), 5, 3.0, "z"), face(-10, -self.uniform(48, 62), self.uniform(13, 18), 0.75), *claws)

    def ball_peen(self) -> None:  # an engineer's hammer: a face, and a ball at the other end
        self.shaft(self.uniform(200, 300))
        metal, r, out = self.pick(*IRON), self.uniform(13, 19), self.uniform(36, 52)
        self.add(metal, box((30, 28, 36), 4, 3.0, "z"), face(-10, -out - 8, r, 0.8))
        self.add(metal, rod(10, out, 0.62 * r, "z"), ball((r, r, r)).moved(z=out))

    def sledge(self) -> None:  # a heavy hammer: one thick bar for a head, its edges cut off
        self.shaft(self.uniform(240, 420), 31)
        half, side, square = self.uniform((52, 24, 4.0), (78, 33, 9.0))
        rows = [(-half, 0.8 * side), (10 - half, side), (half - 10, side), (half, 0.8 * side)]
        self.add(IRON, column([(at, u, u, square) for at, u in rows], "z", 40))
        self.add(self.pick(*WOODS, *IRON), rod(side - 2, side + self.uniform(3, 12), 11))

    def mallet(self) -> None:  # a rubber or wooden mallet: a barrel or a block
        self.shaft(self.uniform(190, 290))
        half, r, belly = self.uniform((42, 30, 0.9), (66, 44, 1.1))
        ends = self.uniform(0.75, 0.92)
        barrel = lathe([(-half, ends * r), (4 - half, r), (0, belly * r), (half - 4, r), (half, ends * r)], "z", 36)
        wooden = box((1.7 * r, 1.4 * r, 2 * half), 9, 4.0, "z").turned("y", self.uniform(-0.1, 0.1))
        self.add(self.pick(BLACK, *PLASTICS, *WOODS), barrel if self.chance(0.6) else wooden)
        if self.chance(0.4):
            self.add((*PLASTICS, GOLD), *(rod(s * half - 6, s * half + 6, 0.94 * ends * r, "z") for s in (-1, 1)))

    def gavel(self) -> None:  # a judge's hammer, turned from wood with rings; or a croquet mallet
        wood, half, r = self.pick(*WOODS), *self.uniform((38, 24), (58, 34))
        waves = np.linspace(-half, half, 2 * self.integers(3, 6) + 1)
        profile = np.column_stack([waves, r * np.where(np.arange(len(waves)) % 2, 0.82, 1.0)])
        length = self.uniform(170, 260)
        handle = [(-length, 6), (4 - length, 11), (16 - length, 9), (-0.6 * length, 8), (-0.4 * length, 11), (-0.1 * length, 7), (4, 7)]
        self.add(wood, lathe(profile, "z", 36), lathe(handle, "x", 24))
        self.add((GOLD, BLACK, *WOODS), rod(-8, 8, 1.03 * r, "z"))

    def tenderiser(self) -> None:  # a kitchen hammer: a square head with rows of teeth on one face
        self.shaft(self.uniform(170, 240), 22)
        side, half, teeth = *self.uniform((24, 26), (32, 40)), self.integers(2, 5)
        metal, pitch = self.pick(*STEELS, *WOODS), 2 * side / teeth
        self.add(metal, box((2 * side, 2 * side, 2 * half), 9, 3.0, "z"))
        cone = [(half - 2, 0.46 * pitch), (half + 0.3 * pitch, 0.24 * pitch), (half + 0.5 * pitch, 0.08 * pitch)]
        centres = [pitch * (at - (teeth - 1) / 2) for at in range(teeth)]
        self.add(metal, *(column(cone, count=8).moved(x, y) for x in centres for y in centres))

    def hatchet(self) -> None:  # an axe: a wedge with a broad curved edge, a poll behind
        self.shaft(self.uniform(230, 420))
        out, broad, beard, poll = self.uniform((70, 32, 0, 12), (110, 52, 34, 34))
        rows = [(-poll, 17, 13.0), (14, 19, 14.0), (0.4 * out, 15, 9.0)]
        rows += [(0.8 * out, 0.7 * broad, 5), (out - 6, broad, 2.4), (out, 0.9 * broad, 0.8)]
        table = smooth([(z, u, v, 3.0) for z, u, v in rows])
        lean = -beard * (np.clip(table[:, 0], 0, None) / out) ** 1.5
        blade = column(table, "z", 36)
        blade.vertices[:, 0] += np.interp(blade.vertices[:, 2], table[:, 0], lean)
        self.add((*IRON, *PLASTICS), blade)

    def pickaxe(self) -> None:  # a pick or ice axe: a curved spike; opposite it a spike, a blade or a hammer face
        self.shaft(self.uniform(260, 420))
        metal, out, droop = self.pick(*IRON), self.uniform(90, 140), self.uniform(10, 50)
        spikes = [[(2, 0, 8 * s), (4, 0, 0.5 * out * s), (-droop, 0, out * s)] for s in (-1, 1)]
        adze = box((30, 50, 6), 5, 1.5).moved(-0.4 * droop, z=-0.75 * out)
        other = self.one_of(sweep(spikes[0], 12, 14, 2.6), face(-8, -46, 15, 0.8), adze)
        neck = [] if other is not adze else [sweep([(2, 0, -8), (0, 0, -0.4 * out), (-0.4 * droop, 0, -0.75 * out)], 16, 13)]
        self.add(metal, box((32, 30, 34), 4, 3.0, "z"), sweep(spikes[1], 12, 14, 2.6), other, *neck)

    def tack(self) -> None:  # a slim hammer: square face, flat peen
        self.shaft(self.uniform(200, 290), 20)
        metal, low, out = self.pick(*IRON), self.uniform(34, 58), self.uniform(45, 75)
        peen = column([(-6, 9, 10, 4), (0.4 * out, 8, 9, 4), (out - 3, 3, 14, 5), (out, 1.6, 14, 5)], "z", 28)
        self.add(metal, box((26, 24, 26), 4, 2.0, "z"), column([(-low, 12, 12, 8), (3 - low, 13, 13, 8), (-8, 9, 9, 4)], "z", 28), peen)

    kinds = (claw, claw, ball_peen, sledge, mallet, gavel, tenderiser, hatchet, pickaxe, tack)


def shank(length: float, radius: float, tip: str) -> list[Solid]:
    """Make a round bar and its tip: slotted, crossed, or pointed."""
    x = length
    if tip == "slotted":
        blade = [(x - 1, radius, radius, 2), (x + 12, 0.45 * radius, 1.5 * radius, 4), (x + 18, 0.3 * radius, 1.4 * radius, 6)]
        end = column(blade, "x", 24)
    elif tip == "crossed":
        profile = [(x - 1, radius), (x + 6, 0.7 * radius), (x + 10, 0.25 * radius)]
        return [rod(-2, x, radius), column(profile, "x", 32, lobes=4, depth=[0.0, 0.3, 0.2])]
    else:
        end = column([(x - 1, radius), (x + 14, 0.45 * radius), (x + 24, 0.12 * radius)], "x", 24)
    return [rod(-2, x, radius), end]


class Screwdriver(Model):
    """Tools with a shank, along x with the tip at +x; the shank begins at x = 0."""

    proportions = (Stretch("x", 0.8, 1.2, start=0), Stretch("x", 0.9, 1.12, end=0), Stretch("yz", 0.88, 1.12))

    def grip(self, length: float, radius: float) -> None:
        """Add a handle from x = -length to 0: fluted plastic with a cap and a collar, or turned, with a ferrule."""
        trim, lobes = self.pick(*PLASTICS, BLACK, *STEELS, GOLD), self.integers(5, 9)
        fluted = [(-length, 0.7 * radius), (-0.96 * length, 0.95 * radius), (-0.8 * length, radius)]
        fluted += [(-0.3 * length, radius), (-0.18 * length, 0.7 * radius), (0, 0.55 * radius)]
        turned = [(-length, 0.6 * radius), (-0.93 * length, radius), (-0.6 * length, 1.15 * radius)]
        turned += [(-0.25 * length, 0.75 * radius), (0, 0.6 * radius)]
        if self.chance(0.6):
            depth = np.array([0.0, 0.06, 0.09, 0.09, 0.0, 0.0]) * self.uniform(0.5, 1.0)
            self.add((*PLASTICS, RED), column(fluted, "x", 6 * lobes, lobes=lobes, depth=depth))
            self.add(trim, rod(-length - self.uniform(0, 6), -0.9 * length, 0.66 * radius), rod(-0.2 * length, 2, 0.62 * radius))
        else:
            self.add((*WOODS, BLACK, *PLASTICS), lathe(turned, "x", 30))
            self.add(trim, rod(-0.12 * length, 4, 0.68 * radius))

    def slotted(self) -> None:  # a screwdriver with a flat or a crossed tip, long or short
        self.grip(self.uniform(85, 115), self.uniform(13, 18))
        self.add(self.pick(*STEELS), *shank(self.uniform(70, 190), self.uniform(2.8, 5.0), "slotted" if self.chance(0.5) else "crossed"))

    def stubby(self) -> None:  # a screwdriver with a short thick handle and a short shank
        self.grip(self.uniform(52, 66), self.uniform(16, 21))
        self.add(self.pick(*STEELS), *shank(self.uniform(20, 38), self.uniform(3.5, 5.0), "crossed" if self.chance(0.5) else "slotted"))

    def precision(self) -> None:  # a watchmaker's screwdriver: a slim rod with knurls and a turning cap
        radius, length = self.uniform((4.5, 80), (6.5, 110))
        rings = np.linspace(-0.9, -0.1, 2 * self.integers(6, 12)) * length
        rows = [(-length, 0.9 * radius), *zip(rings, np.resize([radius, 0.86 * radius], len(rings)), strict=True), (0, 0.5 * radius)]
        self.add((*STEELS, *PLASTICS, GOLD), column(rows, "x", 28))
        self.add((*PLASTICS, *STEELS, BLACK), rod(-length - 9, -length + 1, 1.3 * radius))
        self.add(self.pick(*STEELS), *shank(self.uniform(30, 60), 1.9, "slotted"))

    def t_handle(self) -> None:  # a hexagon key or nut driver with a bar across its end
        half, radius, length, socket = self.uniform((38, 9, 120, 7), (60, 14, 210, 14))
        cross = [(-half, 0.8 * radius), (6 - half, radius), (0, 1.15 * radius), (half - 6, radius), (half, 0.8 * radius)]
        self.add((*PLASTICS, BLACK, RED), lathe(cross, "z", 28), rod(-radius, 22, 0.9 * radius))
        end = rod(length - 24, length, socket) if self.chance(0.5) else rod(length - 2, length + 4, 3.4)
        self.add(STEELS, rod(0, length, 4.5), end)

    def awl(self) -> None:  # an awl or ice pick: pear-shaped handle, a point
        pear, steel = self.uniform(17, 24), self.pick(*STEELS)
        rows = [(-78, 0.5 * pear), (-72, 0.9 * pear), (-56, pear), (-26, 0.6 * pear), (0, 0.4 * pear)]
        self.add((*WOODS, *PLASTICS), lathe(rows, "x", 32))
        self.add(steel, *shank(self.uniform(45, 110), self.uniform(2.4, 4.0), "pointed"), rod(-8, 6, 0.46 * pear))

    def chisel(self) -> None:  # a wood chisel or putty knife: flat blade, bevelled at its end
        self.grip(self.uniform(100, 135), self.uniform(13, 17))
        long, wide, broad = self.uniform((95, 6, 1.0), (150, 18, 2.4))
        rows = [(-4, 4, 4, 3), (14, 4, 4, 3), (24, 3, wide, 8), (long - 14, 2.2, broad * wide, 10), (long, 0.5, broad * wide, 10)]
        self.add(STEELS, lathe(rows, "x", 28))

    def file(self) -> None:  # a file or rasp, flat to nearly round, on a handle
        self.grip(self.uniform(95, 125), self.uniform(13, 17))
        long, u, v, square = self.uniform((150, 3, 8, 2.0), (230, 9, 16, 9.0))
        table = [(-3, 3, 4, 3), (14, 0.9 * u, 0.9 * v, square), (0.6 * long, u, v, square)]
        table += [(long, 0.6 * u, self.uniform(0.3, 0.9) * v, square)]
        self.add((*STEELS, (70, 74, 80)), column(smooth(table, 10), "x", 32))

    def gimlet(self) -> None:  # a gimlet or corkscrew: a cross handle and a screw
        half, turns, thread, long = self.uniform((34, 3.5, 3.0, 70), (52, 7.0, 6.5, 130))
        cross = [(-half, 7), (6 - half, 9), (0, 12), (half - 6, 9), (half, 7)]
        self.add((*WOODS, *PLASTICS), lathe(cross, "z", 26))
        screw = [(6, 0.3, 2.4), *((6 + share * long, thread, 2.4) for share in (0.2, 0.4, 0.6, 0.8)), (6 + long, 0.3 * thread, 0.8)]
        self.add(STEELS, coil(screw, turns, "x"), rod(-4, 14, 4))

    def spanner(self) -> None:  # a spanner: jaws at one end or both, a thicker end opposite
        length, size, thick = self.uniform((110, 11, 7), (200, 19, 11))
        metal = self.pick(*STEELS, (70, 74, 80))
        waist = [(-0.5 * length, -0.55 * size, 0.55 * size, thick)]
        waist += [(0, -0.4 * size, 0.4 * size, 0.7 * thick), (0.5 * length, -0.55 * size, 0.55 * size, thick)]
        self.add(metal, bar(waist, 3.0, self.pick(BLACK, *PLASTICS), [(-0.1 * length, 0.1 * length)]))
        for end in (-1, 1) if self.chance(0.5) else (1,):
            x, lean = 0.5 * length, self.uniform(-0.3, 0.3)
            jaw = np.array([(x - 4, 0, 0.3 * size), (x + 0.5 * size, 0, 1.05 * size), (x + 1.9 * size, 0, 0.75 * size)])
            jaws = [sweep(jaw * [1, 1, s], thick, 0.75 * size).turned("y", lean, (x, 0, 0)) for s in (-1, 1)]
            self.add(metal, *(solid.turned("y", 0.0 if end > 0 else np.pi) for solid in jaws))
        self.add(metal, ball((1.3 * size, 0.5 * thick, 1.1 * size)).moved(-0.5 * length))

    def trowel(self) -> None:  # a trowel, spatula or palette knife: a cranked neck and a broad leaf
        self.grip(self.uniform(90, 120), self.uniform(12, 17))
        long, wide, drop, nose = self.uniform((80, 22, -36, 0.1), (150, 48, -6, 0.9))
        leaf = [(50, 1.6, 8, 4), (64, 1.6, wide, 4), (50 + 0.5 * long, 1.6, (0.6 + 0.4 * nose) * wide, 4), (50 + long, 1.2, nose * wide, 4)]
        self.add((*STEELS, *PLASTICS), sweep([(-3, 0, 0), (20, 0, 0), (34, 0, drop), (62, 0, drop)], 9, 7))
        self.add((*STEELS, *PLASTICS), lathe(leaf, "x", 32).turned("x", np.pi / 2).moved(z=drop))

    kinds = (slotted, slotted, stubby, precision, t_handle, awl, chisel, file, gimlet, spanner, trowel)

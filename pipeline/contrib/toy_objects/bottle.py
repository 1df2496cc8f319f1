"""Models of bottles."""

import numpy as np

from pipeline.contrib.toy_objects.model import BLACK, GOLD, PLASTICS, RED, WHITE, Model, Palette, Stretch
from pipeline.contrib.toy_objects.pictures import label
from pipeline.contrib.toy_objects.solids import Rows, Solid, ball, bar, box, column, lathe, rod, smooth, sweep

GREEN, AMBER, CLEAR, COBALT = (38, 74, 44), (112, 62, 24), (176, 200, 204), (32, 52, 128)
GLASS: Palette = (GREEN, AMBER, CLEAR, COBALT)


def cap(z: float, radius: float, height: float, top: float = 0.9, ridges: int = 20) -> Solid:
    """Make a ridged cap from z upwards that narrows to the share `top` of its radius."""
    rows = [(z, radius), (z + 0.8 * height, 0.5 * (1 + top) * radius), (z + height, top * radius)]
    return column(rows, count=3 * ridges, lobes=ridges, depth=[0.04, 0.04, 0.01])


class Bottle(Model):
    """Standing on z = 0, the front faces -y. A body has rows (z, half its width) from the foot to the mouth."""

    proportions = (Stretch("xy", 0.86, 1.16), Stretch("z", 0.86, 1.14))

    def body(
        self,
        rows: Rows,  # the silhouette
        low: float,  # of the label
        high: float,  # of the label
        angle: float,  # rad about the front that the label covers
        *,
        flat: float = 1.0,  # depth over width at the belly; the mouth is round
        square: float = 2.0,  # exponent of the cross-section there, see `superellipse`
        lobes: int = 0,  # flutes around the lower half
    ) -> Solid:
        """Loft a bottle's body with a label."""
        z, half = smooth(rows, at=[low, high]).T
        belly, count = np.clip((half - half[-1]) / (half.max() - half[-1]), 0.0, 1.0), 6 * lobes or 40
        table = np.column_stack([z, half, half * (1.0 + (flat - 1.0) * belly), 2.0 + (square - 2.0) * belly])
        flutes = 0.045 * np.sin(np.pi * np.clip(z / (0.55 * z[-1]), 0.0, 1.0)) ** 2 if lobes else 0.0
        solid = column(table, count=count, lobes=lobes, depth=flutes)
        x, y, z = solid.vertices.T
        around, turn = (np.arange(len(z)) % count + 0.5) / count - 0.5, np.arctan2(x, -y)
        inside = (np.abs(around) < angle / (4.0 * np.pi)) & (z > low - 1e-6) & (z < high + 1e-6)
        uv = np.column_stack([0.5 + 0.5 * turn / np.abs(turn[inside]).max(), (z - low) / (high - low)]) * inside[:, None]
        return solid.painted(label(self.rng, angle * half.max() / (high - low)), inside[solid.faces].all(axis=1), uv)

    def wine(self) -> None:  # a Bordeaux, Burgundy or flute, by its shoulders; foil or cork
        shoulder, throat = self.one_of((195, 230), (152, 242), (127, 260))
        rows = [(0, 36), (6, 40), (shoulder, 40), (throat, 15), (294, 14), (296, 16), (310, 16)]
        self.add(self.pick(GREEN, *GLASS), self.body(rows, self.uniform(18, 40), shoulder - 8, self.uniform(2.0, 3.6)))
        if self.chance(0.65):
            self.add(self.pick((120, 24, 34), BLACK, GOLD, GREEN), column([(self.uniform(238, 262), 16), (311, 17.5)]))
        else:
            self.add(self.pick((196, 156, 108)), rod(309, self.uniform(314, 324), 12, "z"))

    def beer(self) -> None:  # a longneck or stubby with a crown cap and a label; a coloured band around its neck in some
        h, r, shoulder = (178, 36, self.uniform(96, 107)) if self.chance(0.4) else (242, 32, self.uniform(131, 145))
        rows = [(0, r - 3), (6, r), (shoulder, r), (0.5 * shoulder + 0.38 * h, 0.68 * r), (0.77 * h, 16.5), (h - 16, 14), (h, 13)]
        self.add(self.pick(*GLASS[:3]), self.body(rows, 0.15 * h, shoulder - 5, self.uniform(2.2, 5.9)))
        if self.chance(0.6):
            self.add((WHITE, RED, GOLD, COBALT), column([(0.76 * h, 17.8), (h - 22, 15.5)]))
        self.add((GOLD, RED, (200, 204, 208), COBALT), cap(h - 5.5, 16, 8, top=0.75))

    def spirit(self) -> None:  # a square or flat bottle with a short neck and a stopper: ball, block or screw cap
        shoulder, w, waist, flat, square = self.uniform((130, 38, 0.9, 0.45, 3.5), (160, 50, 1.0, 1.0, 9))
        rows = [(0, w - 3), (4, w), (0.5 * shoulder, w * waist), (shoulder, w), (shoulder + 12, 0.8 * w), (shoulder + 24, 15), (215, 16)]
        self.add(self.pick(*GLASS[1:]), self.body(rows, 28, 0.85 * shoulder, self.uniform(1.4, 1.9), flat=flat, square=square))
        stopper = self.one_of(ball((18, 18, 14)), box((36, 36, 24), 6, 3, "z"), cap(-13, 20, 24))
        self.add((GOLD, BLACK, (150, 100, 60)), stopper.moved(z=224))

    def water(self) -> None:  # a plastic bottle: grip rings below the label, waist, screw cap on a collar
        r, waist, rings, shoulder = self.uniform(30, 42), self.uniform(0.72, 0.95), self.integers(3, 8), self.uniform(170, 195)
        grip = np.column_stack([np.linspace(20, 100, 2 * rings), r - r * (1 - waist) * np.tile([0.4, 1.0], rings)])
        rows = [(0, 0.85 * r), (4, 0.97 * r), *grip, (110, r), (shoulder, r), (224, 14), (230, 17), (232, 13), (250, 13)]
        self.add(self.pick(CLEAR, (150, 206, 190), (120, 170, 214)), self.body(rows, 110, shoulder - 6, 5.9))
        self.add((WHITE, RED, *PLASTICS), cap(237, 15.5, 17))

    def soda(self) -> None:  # a contour bottle: fluted below, pinched waist, label on the bulge; crown or screw cap
        waist, bulge = self.uniform((23, 108), (28, 126))
        rows = [(0, 26), (4, 29), (26, 31), (66, waist), (bulge - 16, 32), (bulge + 16, 32), (170, 18), (200, 14), (218, 13)]
        solid = self.body(rows, bulge - 17, bulge + 17, self.uniform(3.4, 5.9), lobes=self.integers(8, 13))
        self.add(((150, 196, 170), (60, 28, 20), CLEAR), solid)
        self.add(self.pick(RED, WHITE, GOLD), cap(212.5, 16, 8, top=0.75) if self.chance(0.5) else cap(206, 16, 17))

    def detergent(self) -> None:  # a jug with a side handle and a large measuring cap on an off-centre neck
        plastic, offset, waist = self.pick(*PLASTICS), self.uniform(-38, -19), self.uniform(64, 75)
        rows = [(0, 69), (6, 75), (80, waist), (142, 69), (180, 50), (198, 24), (214, 22)]
        jug = self.body(rows, 28, 127, 1.6, flat=self.uniform(0.42, 0.6), square=self.uniform(2.6, 4.2))
        jug.vertices[:, 0] += offset * (jug.vertices[:, 2] - 129).clip(0.0, None) / 76  # lean above the label only
        self.add(plastic, jug, sweep([(2, 0, 184), (41, 0, 200), (74, 0, 175), (74, 0, 120), (54, 0, 83)], 21, 16))
        self.add(self.pick(*PLASTICS), cap(207, 31, self.uniform(32, 52), ridges=30).moved(offset))

    def spray(self) -> None:  # a trigger sprayer: oval body, collar, pistol head with nozzle and lever
        w, waist, reach, flat, square = self.uniform((37, 28, 40, 0.6, 2.0), (48, 40, 56, 0.95, 3.6))
        rows = [(0, w - 4), (5, w), (90, w), (130, waist), (151, 0.72 * w), (175, 14), (180, 13)]
        self.add(self.pick(*PLASTICS, CLEAR), self.body(rows, 18, 88, self.uniform(1.7, 2.4), flat=flat, square=square))
        head = bar([(-26, 225, 233, 16), (-20, 221, 238, 20), (0, 215, 239, 23), (reach, 224, 236, 15)])
        self.add(PLASTICS, head, sweep([(-2, 0, 188), (-3, 0, 204), (-4, 0, 231)], 20, 25))
        lever = sweep([(0.55 * reach, 0, 227), (0.6 * reach, 0, 213), (0.5 * reach, 0, 205), (0.6 * reach, 0, 194)], 10.5, 7)
        self.add((*PLASTICS, BLACK), cap(174, 18.5, 19), lever, rod(reach - 1, reach + 10, 8.5).moved(z=230))

    def pump(self) -> None:  # a soap dispenser: round or square body, collar, stem and beak
        taper, top, reach, turn, flat = self.uniform((27, 182, 34, -0.6, 0.6), (36, 204, 52, 0.6, 1.0))
        flat, square, angle = (1.0, 2.0, self.uniform(2.0, 3.4)) if self.chance(0.6) else (flat, 5.0, 1.5)
        rows = [(0, 33), (4, 36), (122, taper), (140, 22), (157, 14)]
        self.add(self.pick(*PLASTICS, CLEAR, AMBER), self.body(rows, 27, 106, angle, flat=flat, square=square))
        beak = sweep([(0, 0, top + 3), (0.65 * reach, 0, top + 4), (reach, 0, top - 5)], 12, 9).turned("z", turn)
        self.add((*PLASTICS, BLACK, GOLD), cap(152, 18, 15), rod(162, top, 4.8, "z"), rod(top - 5, top + 9, 13, "z"), beak)

    def squeeze(self) -> None:  # a sauce bottle: soft waisted body under a long nozzle, or standing on a broad cap
        waist, flat, tall = self.uniform((24, 0.62, 200), (31, 1.0, 224))
        upright = self.chance(0.55)
        rows = [(0, 29), (6, 33), (64, waist), (122, 33), *([(146, 20), (160, 16)] if upright else [(154, 30), (160, 23)])]
        sauce = self.body(rows, 32, 118, self.uniform(1.8, 2.6), flat=flat, square=2.4).moved(z=0 if upright else 25)
        self.add((RED, (238, 190, 32), (92, 52, 28), (240, 236, 220), (76, 132, 56)), sauce)
        nozzle = lathe([(158, 16), (174, 8), (tall, 3.2), (tall + 3, 2.4)])
        foot = column([(0, 28, 28 * flat, 2.4), (28, 31, 31 * flat, 2.4)])
        self.add((WHITE, RED, GREEN, GOLD), *((cap(150, 20, 16), nozzle) if upright else (foot,)))

    def medicine(self) -> None:  # a pill jar or syrup bottle: short neck, wide ridged cap, label around it
        h, shoulder, neck = (115, 80, self.uniform(12, 15)) if self.chance(0.5) else (76, 62, self.uniform(19, 24))
        rows = [(0, 25.5), (2.5, 28), (shoulder, 28), (shoulder + 0.12 * h, neck), (h, neck)]
        self.add(self.pick(AMBER, (214, 122, 40), WHITE), self.body(rows, 0.12 * h, shoulder - 4, self.uniform(3.0, 5.9)))
        self.add(self.pick(WHITE, BLACK, (52, 110, 180)), cap(h - 9, 1.18 * neck + 1, self.uniform(16, 28)))

    def sport(self) -> None:  # a drinking flask: finger grip, coloured band, broad lid with a pull spout or a carrying loop
        grip, pinch = self.uniform((115, 28), (145, 33))
        rows = [(0, 34), (4, 37), (grip - 26, 37), (grip - 12, pinch), (grip + 12, pinch), (grip + 26, 37), (205, 35)]
        self.add(self.pick(*PLASTICS, (60, 66, 74)), self.body(rows, 37, grip - 28, self.uniform(1.6, 3.0)))
        spout = lathe([(205, 26), (225, 13), (241, 11)])
        loop = sweep([(-23, 0, 205), (-18, 0, 239), (0, 0, 251), (18, 0, 239), (23, 0, 205)], 14.0, 6.5)
        self.add(self.pick(*PLASTICS, BLACK), rod(16, 27, 37.6, "z"), cap(201, 38, 19, ridges=30), spout if self.chance(0.5) else loop)

    def swing_top(self) -> None:  # a flip-top bottle: porcelain stopper held by a wire bail
        rows = [(0, 35), (4, 39), (self.uniform(130, 168), 39), (200, 20), (236, 15), (262, 17), (270, 17)]
        self.add(self.pick(*GLASS), self.body(rows, 32, 113, self.uniform(2.0, 5.5)))
        self.add(((240, 238, 230),), lathe([(269, 17), (276, 15), (286, 10), (288, 5)]))
        bail = [sweep([(0, 20 * s, 244), (0, 22 * s, 264), (0, 18 * s, 278), (0, 0, 287)], 3.6, 3.6) for s in (-1, 1)]
        self.add(((180, 184, 188),), *bail, rod(241, 245, 18.5, "z"))

    kinds = (wine, beer, spirit, water, soda, detergent, spray, pump, squeeze, medicine, sport, swing_top)

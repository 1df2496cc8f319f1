"""Models of brushes."""

import numpy as np

from pipeline.contrib.toy_objects.model import BLACK, GOLD, PLASTICS, STEELS, WHITE, WOODS, Model, Palette, Stretch
from pipeline.contrib.toy_objects.solids import Rows, ball, bar, bow, box, column, lathe, rod, smooth, sweep

HAIRS: Palette = ((236, 226, 200), (60, 48, 40), (140, 96, 58), WHITE, BLACK, *PLASTICS)


class Brush(Model):
    """Along x, the bristles at +x or below."""

    proportions = (Stretch("x", 0.85, 1.15, end=-10), Stretch("x", 0.88, 1.14, start=20), Stretch("y", 0.88, 1.14), Stretch("z", 0.9, 1.1))

    def stick(self, outline: Rows, trim: float) -> None:
        """Add a flat handle with rows (x, low z, high z, width), its end of another colour up to the position `trim`."""
        rows = np.array(outline, float)
        self.add(self.pick(*WOODS, *PLASTICS), bar(rows, 3.0, self.pick(*PLASTICS, BLACK, *WOODS), [(rows[0, 0], trim)]))

    def tufts(self, x: tuple[float, float], y: float, z: tuple[float, float], rows: tuple[int, int]) -> None:
        """Add tufts of bristles between two heights over a field of rows along x and y: each a cone that widens downwards or upwards."""
        along, across = np.linspace(*x, rows[0]), np.linspace(-y, y, rows[1]) if rows[1] > 1 else [0.0]
        pitch = (x[1] - x[0]) / max(rows[0] - 1, 1)
        thick = [self.uniform(0.32, 0.42) * pitch, self.uniform(0.38, 0.5) * pitch]
        heights = z if z[0] < z[1] else z[::-1]
        radii = thick if z[0] < z[1] else thick[::-1]
        one = column(list(zip(heights, radii, strict=True)), count=9)
        self.add(HAIRS, *(one.moved(a, b) for a in along for b in across))

    def paint(self) -> None:  # a painter's brush: beavertail handle, ferrule, flat bristles cut straight or slanting
        wide, long, hair = self.uniform((14, 110, 35), (42, 170, 70))
        neck = 0.55 * wide
        rows = [(-long - 20, -4, 4, 8), (-long, -8, 8, 2.2 * 8), (-0.5 * long, -6, 6, 15), (-25, -7, 7, 1.3 * neck), (4, -7, 7, 2 * neck)]
        self.stick(rows, -long)
        ferrule = column([(-4, neck, 8, 3), (8, 0.9 * wide, 9, 6), (30, wide, 9, 8)], "x", 32)
        slant = self.uniform(-0.4, 0.4) * self.integers(0, 2)
        tuft = [(26, 0.95 * wide, 8, 8), (30 + 0.6 * hair, 1.04 * wide, 8, 7), (30 + hair, 0.9 * wide, self.uniform(1.5, 6), 6)]
        bristles = lathe(tuft, "x", 36)
        share = ((bristles.vertices[:, 0] - 30) / hair).clip(0)
        bristles.vertices[:, 0] += slant * share * bristles.vertices[:, 1]
        self.add((*STEELS, GOLD, BLACK), ferrule)
        self.add(HAIRS, bristles)

    def artist(self) -> None:  # an artist's or make-up brush: thin handle, round or fan-shaped hair
        long, r, hair, full = self.uniform((120, 3.5, 18, 1.0), (190, 6.0, 48, 2.6))
        self.add((*WOODS, *PLASTICS, BLACK), lathe([(-long, 1.6), (4 - long, 2.4), (-0.4 * long, r), (0, 0.8 * r)], "x", 26))
        self.add((*STEELS, GOLD), column([(-6, 0.95 * r), (20, 0.85 * r), (28, r)], "x", 26))
        tip = self.uniform(0.1, 0.5)
        tuft = [(26, 0.9 * r), (26 + 0.5 * hair, full * r), (26 + 0.85 * hair, 0.75 * full * r), (26 + hair, tip * r)]
        self.add(HAIRS, lathe(tuft, "x", 30))

    def hair(self) -> None:  # a hairbrush: oval or square cushion with pins, handle behind
        wide, long, square = self.uniform((24, 85, 2.2), (38, 120, 5.0))
        self.stick([(-125, -7, 7, 12), (-115, -9, 9, 22), (-60, -9, 9, 24), (-10, -7, 7, 16), (12, -7, 7, 24)], -self.uniform(100, 118))
        rows = [(-2, 8, 7, 3), (18, 0.85 * wide, 8, square), (0.6 * long, wide, 8, square)]
        rows += [(long, 0.7 * wide, 7, square), (long + 6, 0.3 * wide, 5, 3)]
        self.add((*WOODS, *PLASTICS, BLACK), lathe(rows, "x", 36))
        self.add((BLACK, *PLASTICS), box((0.8 * long, 1.4 * wide, 10), 3.0, 3.0, "z").moved(0.55 * long, z=-6))
        self.tufts((0.22 * long, 0.88 * long), 0.45 * wide, (-8, -self.uniform(20, 28)), (self.integers(6, 10), self.integers(3, 6)))

    def tooth(self) -> None:  # a toothbrush: a bent handle with a soft grip, a small head
        bend, head = self.uniform((-8, 24), (8, 36))
        z = np.array([0, bend, 0.4 * bend, 0])
        path = [(-130, z[0] - 4, z[0] + 4, 10), (-90, z[1] - 5, z[1] + 5, 13), (-40, z[2] - 4, z[2] + 4, 10)]
        path += [(0, -2.5, 2.5, 5), (12, -3, 3, 11), (head, -3, 3, 12), (head + 5, -2.4, 2.4, 8)]
        self.stick(path, -self.uniform(70, 125))
        self.tufts((12, head), 3.6, (-2, -self.uniform(10, 14)), (self.integers(6, 9), 3))

    def scrubbing(self) -> None:  # a scrubbing brush: a waisted block with stiff bristles below; a bow to hold it on some
        half, wide, deep, square = self.uniform((55, 22, 10, 2.4), (95, 36, 18, 6.0))
        rows = [(-half, 0.5 * wide, deep, square), (8 - half, 0.9 * wide, deep, square)]
        rows += [(0, self.uniform(0.75, 1.0) * wide, deep, square), (half - 8, 0.9 * wide, deep, square), (half, 0.5 * wide, deep, square)]
        shade = self.pick(*WOODS, *PLASTICS)
        self.add(shade, lathe(rows, "x", 32))
        if self.chance(0.4):
            self.add(shade, bow([(half - 6, deep - 6), (0.6 * half, deep + 30)], 24, 10))
        low = -deep - self.uniform(14, 28)
        self.tufts((16 - half, half - 16), 0.6 * wide, (2 - deep, low), (self.integers(7, 12), self.integers(3, 5)))

    def dish(self) -> None:  # a dish brush: long bent handle, round head
        long, r, rise = self.uniform((150, 22, 10), (200, 32, 40))
        self.add((*WOODS, *PLASTICS, WHITE), sweep([(-long, 0, rise), (-0.5 * long, 0, 0.7 * rise), (0, 0, 4), (2 * r, 0, 0)], 16, 10))
        self.add((*WOODS, *PLASTICS), rod(-8, 6, r, "z").moved(1.2 * r))
        bunch = column(smooth([(-34, 1.12 * r), (-30, 1.18 * r), (-6, 0.85 * r)]), count=54, lobes=18, depth=self.uniform(0.03, 0.09))
        self.add(HAIRS, bunch.moved(1.2 * r))

    def bottle(self) -> None:  # a bottle or toilet brush: wire or plastic stem, bristles all around in rings
        long, r, rings = *self.uniform((70, 16), (150, 34)), self.integers(6, 13)
        along = np.linspace(0, long, 2 * rings + 1)
        shape = np.interp(along / long, [0, 0.12, 0.8, 1], [0.7, 1, 1, self.uniform(0.3, 0.9)])
        self.add(HAIRS, column(np.column_stack([along, r * shape * np.where(np.arange(len(along)) % 2, 0.78, 1.0)]), "x", 32))
        stem = self.uniform(120, 190)
        self.add(self.pick(*STEELS, WHITE), rod(-stem, 6, self.uniform(2.6, 5.0)))
        self.add((*PLASTICS, *WOODS, WHITE), lathe([(-stem - 60, 6), (-stem - 50, 10), (-stem - 20, 8), (6 - stem, 6)], "x", 28))

    def roller(self) -> None:  # a paint roller: sleeve across, a cranked wire, a grip
        half, r, reach = self.uniform((30, 13, 60), (62, 24, 110))
        wire = sweep([(-10, 0, 0), (0.4 * reach, 0, 0), (0.55 * reach, half + 16, 0), (reach, half + 16, 0)], 7, 7)
        self.add(STEELS, wire, rod(-half - 4, half + 18, 4, "y").moved(reach))
        self.add(HAIRS, lathe([(-half, 0.92 * r), (4 - half, r), (half - 4, r), (half, 0.92 * r)], "y", 36).moved(reach))
        self.add((*PLASTICS, *WOODS), lathe([(-130, 9), (-120, 14), (-60, 11), (-15, 14), (0, 6)], "x", 30))

    def broom(self) -> None:  # a hand broom, or a besom of twigs that spread
        self.stick([(-150, -7, 7, 14), (-140, -9, 9, 20), (-60, -8, 8, 18), (0, -9, 9, 22)], -self.uniform(118, 140))
        spread, long, flat = self.uniform((36, 80, 0.25), (70, 140, 0.9))
        twigs = [(-4, 12, 10, 2.2), (20, 0.5 * spread, 0.5 * flat * spread + 5, 2.2)]
        twigs += [(long, spread, flat * spread, 2.2), (long + 6, 0.95 * spread, 0.9 * flat * spread, 2.2)]
        self.add(HAIRS, column(smooth(twigs), "x", 60, lobes=20, depth=0.05))
        high = 0.5 * flat * spread + 8
        bands = [column([(x - 2, w, high, 2.2), (x + 2, w, high, 2.2)], "x", 32) for x, w in ((2, 17), (12, 0.45 * spread + 6))]
        self.add((*PLASTICS, GOLD), *bands)

    def shaving(self) -> None:  # a shaving or powder brush lying down: stout turned handle, full round hair
        r, hair_, full = self.uniform((13, 40, 1.3), (20, 62, 2.0))
        rows = [(-62, 0.8 * r), (-56, r), (-40, 0.75 * r), (-24, self.uniform(0.5, 0.8) * r), (-8, r), (0, 0.8 * r)]
        self.add((*WOODS, *PLASTICS, WHITE, BLACK), lathe(rows, "x", 36))
        self.add((GOLD, *STEELS), rod(-4, 4, 0.88 * r))
        self.add(HAIRS, lathe([(0, 0.7 * r), (0.5 * hair_, 0.9 * full * r), (0.85 * hair_, full * r), (hair_, 0.6 * full * r)], "x", 40))

    def wire(self) -> None:  # a wire brush: a straight or curved wooden back, a few rows of steel tufts at its front
        rise, long = self.uniform((0, 90), (26, 130))
        rows = [(-140, -8 + rise, 8 + rise, 18), (-100, -9 + 0.6 * rise, 9 + 0.6 * rise, 24)]
        rows += [(-20, -9, 9, 22), (long, -8, 8, 24), (long + 8, -5, 5, 16)]
        self.stick(rows, -self.uniform(115, 130))
        self.tufts((0, long), 8, (-5, -self.uniform(26, 38)), (self.integers(9, 15), self.integers(2, 4)))
        self.add(STEELS, ball((5, 8, 8)).moved(-138, z=rise))

    kinds = (paint, paint, artist, hair, tooth, scrubbing, dish, bottle, roller, broom, shaving, wire)

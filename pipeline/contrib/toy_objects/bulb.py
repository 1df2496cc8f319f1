"""Models of bulbs."""

import numpy as np

from pipeline.contrib.toy_objects.model import BLACK, GOLD, PLASTICS, STEELS, WHITE, Model, Palette, Stretch
from pipeline.contrib.toy_objects.solids import ball, bow, coil, column, lathe, rod, smooth, sweep

GLASS: Palette = (WHITE, (250, 240, 206), (236, 236, 226), (210, 222, 226), (244, 206, 130))
SHELL: Palette = (WHITE, (210, 210, 206), *STEELS)


class Bulb(Model):
    """Bulbs and lamps, standing on about z = 0."""

    proportions = (Stretch("xy", 0.88, 1.14), Stretch("z", 0.88, 1.14))

    def cap(self, high: float = 26.0) -> None:
        """Add a screw cap from z = 0 upwards, or a bayonet cap with its two pins."""
        metal = self.pick(*STEELS, GOLD)
        self.add((BLACK,), column([(-3, 5), (-1, 9), (1, 10)], count=28))
        if self.chance(0.75):
            turns = np.linspace(0, high, 11)
            self.add(metal, column(np.column_stack([turns, 13 - 1.3 * (np.arange(11) % 2)]), count=32))
        else:
            self.add(metal, rod(0, high, 11.5, "z"), rod(-15, 15, 2.2).moved(z=0.4 * high))

    def pear(self) -> None:  # a bulb of the common shape: neck and round head; half of it a shell with fins in some
        r, top, neck = self.uniform((27, 95, 13), (36, 125, 17))
        self.cap()
        z = top - r
        head = [(24, 12), (34, neck), (0.5 * (34 + z), 0.75 * r), (z, r)]
        head += [(top - 0.3 * r, 0.71 * r), (top - 0.05 * r, 0.3 * r), (top, 0.08 * r)]
        self.add(GLASS, lathe(head, count=40))
        if self.chance(0.4):
            shell = [(24, 13), (36, neck + 1), (0.5 * (34 + z), 0.78 * r), (0.85 * z, 0.96 * r)]
            self.add(SHELL, column(smooth(shell), count=48, lobes=12, depth=0.05))

    def globe(self) -> None:  # a large ball on a short neck
        r = self.uniform(40, 64)
        self.cap()
        self.add(GLASS, ball((r, r, r)).moved(z=34 + 0.93 * r))
        self.add((*SHELL, *GLASS), lathe([(22, 13), (34, 15), (44, 0.5 * r)], count=32))

    def candle(self) -> None:  # a slim candle bulb, smooth, twisted or with a bent tip
        r, top, twist = *self.uniform((16, 98), (21, 130)), self.uniform(0.0, 0.02) * self.integers(0, 2)
        self.cap()
        rows = smooth([(24, 11), (34, 0.8 * r), (52, r), (0.75 * top, 0.62 * r), (top - 4, 3), (top, 1.6)])
        flame = column(rows, count=36, lobes=6, depth=0.08 if twist else 0.0)
        angle = twist * flame.vertices[:, 2]
        x, y = flame.vertices[:, :2].T.copy()
        flame.vertices[:, 0], flame.vertices[:, 1] = x * np.cos(angle) - y * np.sin(angle), x * np.sin(angle) + y * np.cos(angle)
        flame.vertices[:, 0] += self.uniform(0, 9) * ((flame.vertices[:, 2] - 52).clip(0) / (top - 52)) ** 2
        self.add(GLASS, flame)

    def reflector(self) -> None:  # a spot bulb: a cone with a flat or domed lens on top
        r, top, dome = self.uniform((30, 75, 2), (60, 130, 16))
        self.cap()
        self.add(SHELL, lathe([(22, 12), (32, 14), (0.6 * top, 0.72 * r), (top - 4, r), (top, r)], count=40))
        lens = lathe([(top - 1, 0.96 * r), (top + 0.5 * dome, 0.8 * r), (top + dome, 0.3 * r)], count=40)
        self.add(GLASS, lens)

    def tubes(self) -> None:  # an energy-saving lamp of two to four bent tubes on a ballast
        count, r, top = self.integers(2, 5), *self.uniform((5.5, 100), (8.0, 160))
        self.cap(22)
        self.add((WHITE, *SHELL), lathe([(18, 13), (26, 24), (44, 25), (52, 21)], count=36))
        for number in range(count):
            d = 11.0 if count > 2 else 9.0
            path = [(-d, 0, 46), (-d, 0, top - 16), (-0.7 * d, 0, top - 4)]
            path += [(0, 0, top), (0.7 * d, 0, top - 4), (d, 0, top - 16), (d, 0, 46)]
            tube = sweep(path, 1.6 * r, 1.6 * r, 2.0).moved(y=(number - (count - 1) / 2) * 1.7 * r)
            self.add(GLASS[:3], tube.turned("z", 0.0 if count < 4 else 0.4))

    def spiral(self) -> None:  # an energy-saving lamp with a coiled tube
        turns, r, pitch, thick = self.uniform((2.2, 17, 15, 5.0), (4.2, 24, 19, 6.6))
        self.cap(22)
        self.add((WHITE, *SHELL), lathe([(18, 13), (26, 23), (44, r + 5), (50, r)], count=36))
        top = 46 + pitch * turns
        rows = [(44, 0.5 * r, thick), (47, r, thick)]
        rows += [*((44 + (top - 44) * share, r, thick) for share in (0.2, 0.5, 0.8)), (top, 0.35 * r, thick)]
        self.add(GLASS[:3], coil(rows, turns))

    def halogen(self) -> None:  # a small spot on two pins: a faceted cup and its lens
        r, high, lobes = *self.uniform((22, 38), (30, 52)), self.integers(9, 15)
        self.add(STEELS, *(rod(-12, 6, 1.8, "z").moved(x) for x in (-3.5, 3.5)))
        base = column([(-2, 9, 5, 5), (14, 9, 6, 5)], count=28)
        cup = column(smooth([(8, 7), (16, 12), (0.6 * high, 0.75 * r), (high, r)]), count=4 * lobes, lobes=lobes, depth=0.02)
        self.add(SHELL, base, cup)
        self.add(GLASS, column([(high - 1, r), (high + 3, 0.98 * r), (high + 5, 0.7 * r)], count=40))

    def lantern(self) -> None:  # a camping lantern: base, glass between posts, roof, a ring to carry it
        r, high, roof = self.uniform((32, 70, 14), (46, 115, 34))
        metal = self.pick(BLACK, *PLASTICS, GOLD)
        self.add(metal, lathe([(0, r), (4, 1.05 * r), (18, r), (24, 0.85 * r)], count=36))
        self.add(GLASS, rod(22, high, 0.7 * r, "z"))
        angles = np.arange(4) * np.pi / 2 + 0.6
        self.add(metal, *(rod(20, high, 2.4, "z").moved(0.85 * r * np.cos(a), 0.85 * r * np.sin(a)) for a in angles))
        self.add(metal, column([(high - 2, r), (high + 3, 1.02 * r), (high + roof, 0.35 * r), (high + roof + 8, 0.3 * r)], count=36))
        top = high + roof + 4
        ring = bow([(0.6 * r, top - 8), (0.6 * r, top + 14), (0, top + self.uniform(26, 45))], 5, 5)
        self.add((*STEELS, BLACK), ring)

    def desk_lamp(self) -> None:  # a table lamp: foot, bent arm or straight stem, a shade over its bulb
        foot, high, shade = self.uniform((48, 150, 34), (75, 240, 60))
        metal = self.pick(*PLASTICS, *STEELS, BLACK, GOLD)
        self.add(metal, lathe([(0, foot), (6, foot), (12, 0.8 * foot), (18, 0.2 * foot)], count=36))
        reach, tilt = (self.uniform(40, 90), self.uniform(0.2, 0.9)) if self.chance(0.6) else (0.0, 0.0)
        self.add(metal, sweep([(0, 0, 10), (-0.3 * reach, 0, 0.5 * high), (0.2 * reach, 0, 0.9 * high), (reach, 0, high)], 9, 9))
        hood = [(-shade, shade), (4 - shade, shade), (-0.3 * shade, 0.72 * shade), (6, 0.35 * shade), (10, 0.2 * shade)]
        bulb = ball((0.5 * shade, 0.5 * shade, 0.5 * shade)).moved(z=-0.95 * shade)
        self.add((*PLASTICS, *GLASS), lathe(hood, count=40).turned("y", -tilt).moved(reach, z=high))
        self.add(GLASS, bulb.turned("y", -tilt).moved(reach, z=high))

    def torch(self) -> None:  # a flashlight standing on its end: knurled body, wider head, switch
        r, high, head = self.uniform((11, 80, 1.2), (18, 150, 2.2))
        body, waves = self.pick(BLACK, *STEELS, *PLASTICS), np.linspace(8, 0.8 * high, 2 * self.integers(4, 12))
        rows = [(0, 0.9 * r), (3, r), *zip(waves, np.resize([r, 0.93 * r], len(waves)), strict=True), (high, r)]
        self.add(body, column(rows, count=36))
        self.add(body, lathe([(0.86 * high, r), (high, head * r), (high + 22, head * r), (high + 26, 0.95 * head * r)], count=40))
        self.add(GLASS, rod(high + 20, high + 27.5, 0.85 * head * r, "z"))
        self.add((*PLASTICS, BLACK), ball((5, 4, 8)).moved(y=-r, z=0.7 * high))

    kinds = (pear, pear, globe, candle, reflector, tubes, spiral, halogen, lantern, desk_lamp, torch)

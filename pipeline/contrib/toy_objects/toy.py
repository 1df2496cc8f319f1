"""Models of toys."""

import numpy as np

from pipeline.contrib.toy_objects.model import BLACK, GOLD, PLASTICS, RED, STEELS, WHITE, WOODS, Model, Palette, Stretch
from pipeline.contrib.toy_objects.solids import Solid, ball, bar, block, box, column, lathe, rod, smooth, sweep

COLOURS: Palette = (*PLASTICS, RED, GOLD, (120, 80, 160), (60, 150, 160))
FURS: Palette = ((150, 100, 60), (90, 64, 46), (200, 160, 110), (120, 120, 124), (236, 226, 210), BLACK)


class Toy(Model):
    """Standing on z = 0, the front faces -y; vehicles lie along x."""

    proportions = (Stretch("x", 0.85, 1.18), Stretch("y", 0.85, 1.18), Stretch("z", 0.85, 1.18))

    def doll(self) -> None:  # a figure with head, body, arms and legs, as a teddy or a doll; ears on some
        skin, belly, high, head = self.pick(*FURS, *COLOURS), *self.uniform((20, 62, 17), (32, 84, 27))
        z, spread, swing = high + 0.8 * head, self.uniform(0.3, 1.2), self.uniform(-0.5, 0.9)
        self.add(skin, ball((head, head, head)).moved(z=z + 0.6 * head))
        self.add((*FURS, *COLOURS), lathe([(24, 0.55 * belly), (36, belly), (0.75 * high, 0.8 * belly), (high + 4, 0.35 * belly)]))
        arm = rod(0, 1.5 * belly + 14, 0.33 * belly).moved(0.5 * belly)
        leg = lathe([(0, 0.5 * belly), (8, 0.45 * belly), (40, 0.4 * belly)])
        for side in (0.0, np.pi):
            bent = arm.turned("y", spread, (0.5 * belly, 0, 0)).turned("x", swing if side else -swing)
            self.add(skin, bent.turned("z", side).moved(z=high - 6), leg.moved(0.55 * belly * np.cos(side)))
            if self.chance(0.6):
                self.add(skin, ball((0.4 * head, 0.25 * head, 0.4 * head)).moved(0.75 * head * np.cos(side), z=z + 1.4 * head))
        eyes = [ball((2.6, 2.6, 3.2)).moved(x, -0.92 * head, z + 0.75 * head) for x in (-0.32 * head, 0.32 * head)]
        self.add((BLACK,), *eyes, ball((4, 4, 3)).moved(y=-head, z=z + 0.4 * head))

    def robot(self) -> None:  # a robot of boxes and rods, an antenna on its head
        x, y, z = self.uniform((26, 18, 36), (46, 32, 62))
        metal, dark = self.pick(*STEELS, *COLOURS), self.pick(BLACK, *COLOURS)
        legs, head = self.uniform((22, 22), (48, 34))
        self.add(metal, box((x, y, z), 8, 2.0, "z").moved(z=legs + z / 2))
        self.add(metal, box((0.75 * x, 0.8 * y, head), 6, 2.0, "z").moved(z=legs + z + 4 + head / 2))
        self.add(dark, rod(legs + z - 2, legs + z + 6, 6, "z"), rod(legs + z + head, legs + z + head + self.uniform(10, 26), 1.8, "z"))
        for side in (-1, 1):
            self.add(dark, rod(-2, legs + 2, 0.16 * x, "z").moved(0.28 * side * x))
            self.add(metal, box((0.42 * x, 1.2 * y, 9), 5, 1.5, "z").moved(0.28 * side * x, -3, 4))
            arm = box((0.22 * x, 0.3 * y, 0.8 * z), 5, 1.5, "z").moved(z=-0.36 * z).turned("x", self.uniform(-1.6, 0.3))
            eye = ball((0.11 * x, 3, 0.11 * x)).moved(0.18 * side * x, -0.42 * y, legs + z + 0.6 * head)
            self.add(dark, arm.moved(0.62 * side * x, z=legs + 0.88 * z), eye)

    def animal(self) -> None:  # a four-legged animal: horse, dog, elephant …, by the lengths of legs, neck, snout, ears and tail
        fur, long, belly, leg = self.pick(*FURS, *COLOURS), *self.uniform((34, 15, 24), (58, 25, 62))
        z = leg + belly
        self.add(fur, lathe([(-long, 0.5 * belly), (-0.7 * long, belly), (0.4 * long, 0.9 * belly), (long, 0.5 * belly)], "x").moved(z=z))
        foot = lathe([(0, 0.34 * belly), (5, 0.3 * belly), (leg + 6, 0.38 * belly)], count=20)
        self.add(fur, *(foot.moved(a * long, b * belly) for a in (-0.7, 0.65) for b in (-0.5, 0.5)))
        reach, rise, skull = self.uniform((4, 0.2, 0.5), (26, 2.6, 0.85))
        x, top = long + reach, z + rise * belly
        neck = [(0.7 * long, 0, z), (0.5 * (0.7 * long + x), 0, 0.5 * (z + top) + 4), (x, 0, top)]
        self.add(fur, sweep(neck, 0.9 * belly, 0.8 * belly, 2.0))
        head = ball((1.3 * skull * belly, 0.8 * skull * belly, 0.85 * skull * belly)).moved(x + 0.5 * skull * belly, z=top)
        nose = (x + 2.3 * skull * belly, 0, top - self.uniform(4, 34))
        snout = [(x + skull * belly, 0, top), (x + 1.8 * skull * belly, 0, top - 4), nose]
        self.add(fur, head, *([sweep(snout, 0.6 * skull * belly, 0.5 * skull * belly, 2.0)] if self.chance(0.7) else []))
        ear = ball((4, self.uniform(5, 13), self.uniform(5, 13)))
        self.add((*FURS, fur.color), *(ear.moved(x, s * 0.7 * skull * belly, top + 0.8 * skull * belly) for s in (-1, 1)))
        tail = [(6 - long, 0, z + 4), (-long - 10, 0, z + self.uniform(-4, 12)), (-long - 16, 0, z + self.uniform(-34, 30))]
        self.add((*FURS, fur.color), sweep(tail, 5, 5))

    def bird(self) -> None:  # a duck, chick or penguin: egg-shaped body, head, beak, wings
        r, upright, head = self.uniform((24, 0.0, 0.45), (36, 1.0, 0.7))
        long = self.uniform(1.1, 1.6)
        plume, lean = self.pick(*COLOURS, WHITE, BLACK), upright * 1.1
        self.add(plume, ball((long * r, 0.85 * r, 0.8 * r)).turned("y", -lean).moved(z=0.8 * r + 0.5 * upright * r))
        x, z = long * r * np.cos(lean) * 0.75, 0.8 * r + 0.5 * upright * r + 0.95 * r * (0.9 + 0.45 * upright)
        self.add(plume, ball((head * r, head * r, head * r)).moved(x, z=z))
        beak = column([(0, 0.32 * head * r), (0.45 * r, 0.12 * head * r)], "x", 20)
        self.add((GOLD, RED, (236, 150, 40)), beak.moved(x + 0.85 * head * r, z=z - 1), rod(-0.1, 5, 0.5 * r, "z"))
        wing = ball((0.75 * r, 4, 0.4 * r)).turned("y", -0.8 * lean)
        self.add((*COLOURS, plume.color), *(wing.moved(-0.1 * r, s * 0.83 * r, 0.95 * r + 0.5 * upright * r) for s in (-1, 1)))
        self.add((BLACK,), *(ball((2.4, 2.4, 2.4)).moved(x + 0.5 * head * r, s * 0.75 * head * r, z + 0.3 * head * r) for s in (-1, 1)))

    def wheels(self, at: list[float], radius: float, wide: float) -> None:
        """Add pairs of wheels with hubs at some x, so that they stand on z = 0."""
        tyre, hub = rod(-6, 6, radius, "y"), rod(-7.5, 7.5, 0.5 * radius, "y")
        self.add((BLACK, *COLOURS), *(tyre.moved(x, s * wide, radius) for x in at for s in (-1, 1)))
        self.add((*STEELS, *COLOURS), *(hub.moved(x, s * wide, radius) for x in at for s in (-1, 1)))

    def car(self) -> None:  # a car or van: body, cabin, wheels; a digger's arm on some
        half, wide, tall, r = self.uniform((48, 20, 22, 10), (78, 30, 34, 17))
        rows = [(-half, 0.7 * r, r + 0.7 * tall, 2 * wide - 6), (4 - half, 0.6 * r, r + tall, 2 * wide)]
        rows += [(half - 10, 0.6 * r, r + 0.9 * tall, 2 * wide), (half, 0.8 * r, r + 0.5 * tall, 2 * wide - 6)]
        self.add(COLOURS, bar(rows, 6))
        start, end = self.uniform((-0.9, 0.1), (-0.3, 0.6)) * half
        roof = r + tall + self.uniform(14, 36)
        cabin = [(start, r, r + tall, 1.8 * wide), (start + min(9, 0.3 * (end - start)), r, roof, 1.7 * wide)]
        cabin += [(end - min(12, 0.4 * (end - start)), r, roof, 1.7 * wide), (end, r, r + tall, 1.8 * wide)]
        self.add((*COLOURS, WHITE, (150, 190, 210)), bar(cabin, 6))
        self.wheels([-0.62 * half, 0.62 * half], r, wide)
        if self.chance(0.3):
            boom = sweep([(0, 0, roof - 4), (0.5 * half, 0, roof + 30), (1.2 * half, 0, roof + 10), (1.3 * half, 0, roof - 24)], 10, 9)
            self.add(COLOURS, boom, box((18, 22, 16), 5, 2.0).moved(1.3 * half, z=roof - 28))

    def train(self) -> None:  # a steam engine: boiler, cabin, chimney, dome; three pairs of wheels
        half, r, wide = self.uniform((48, 15, 17), (70, 22, 24))
        floor = 14.0
        self.add((BLACK, *COLOURS), block((-half, half), (floor - 6, floor + 8), 2 * wide))
        self.add(COLOURS, rod(-0.3 * half, 0.95 * half, r).moved(z=floor + r + 4))
        cabin = self.uniform(2.1, 2.7) * r + floor
        self.add(COLOURS, block((-half, -0.25 * half), (floor, cabin), 2 * wide - 2))
        self.add((*COLOURS, BLACK), box((0.95 * half, 2 * wide + 6, 5), 6, 1.5, "z").moved(-0.62 * half, z=cabin + 1))
        top = floor + 2 * r
        chimney = column([(top, 5), (top + 18, 6), (top + 22, self.uniform(7, 12)), (top + 26, self.uniform(7, 12))], count=24)
        self.add((BLACK, GOLD, *COLOURS), chimney.moved(0.7 * half), ball((8, 8, 9)).moved(0.2 * half, z=top + 2))
        self.wheels([-0.65 * half, 0.0, 0.65 * half], 11, wide)

    def boat(self) -> None:  # a boat: hull with a pointed bow, a house with a funnel, or a mast with a sail
        half, wide, deep = self.uniform((60, 20, 20), (95, 32, 34))
        hull = [(-half, 0.75 * wide, 0.8 * deep / 2, 4.0), (-0.6 * half, wide, deep / 2, 4.0)]
        hull += [(0.3 * half, 0.95 * wide, deep / 2, 4), (0.8 * half, 0.5 * wide, deep / 2, 3), (half, 2, 0.3 * deep, 2.4)]
        rise = [0.1 * deep, 0, 0, 0.1 * deep, 0.25 * deep]
        self.add((*COLOURS, *WOODS, WHITE), column(hull, "x", 32, centre=np.add(rise, deep / 2)))
        if self.chance(0.5):
            bridge = block((-0.3 * half, 0.1 * half), (deep, deep + 34), 0.9 * wide)
            self.add((WHITE, *COLOURS), block((-0.5 * half, 0.2 * half), (0.8 * deep, deep + 20), 1.2 * wide), bridge)
            shade, funnels = self.pick(RED, BLACK, *COLOURS), (-0.2, 0.0) if self.chance(0.5) else (-0.1,)
            self.add(shade, *(rod(deep + 20, deep + 52, 6, "z").moved(x * half) for x in funnels))
        else:
            mast = self.uniform(90, 140)
            self.add(WOODS, rod(0.5 * deep, deep + mast, 3, "z"))
            sail = [(deep + 10, 0.55 * half, 2.2, 4), (deep + 0.5 * mast, 0.34 * half, 2.2, 4), (deep + 0.95 * mast, 2.5, 2.2, 3)]
            shade, shift, turn = self.pick(WHITE, *COLOURS), self.uniform(-0.2, 0.2), self.uniform(-0.4, 0.4)
            self.add(shade, column(sail, count=28).moved(shift * half).turned("z", turn))

    def plane(self) -> None:  # an aeroplane: fuselage, wings, tail, a propeller or two jets; on wheels
        half, r, span, sweep_back = self.uniform((60, 10, 50, 0), (90, 17, 85, 36))
        z = r + 16
        body = smooth([(-half, 0.25 * r), (-0.6 * half, 0.65 * r), (0.1 * half, r), (0.7 * half, 0.9 * r), (half, 0.25 * r)])
        self.add((*COLOURS, WHITE, *STEELS), column(body, "x", 30).moved(z=z))
        shade, chord = self.pick(*COLOURS, WHITE), self.uniform(15, 24)
        rows = [(-span, 1.8, 0.5 * chord, 2.4), (0, 3.2, chord, 2.4), (span, 1.8, 0.5 * chord, 2.4)]
        wing = column(rows, "y", 28, centre=[-sweep_back, 0, -sweep_back])
        rows = [(-0.4 * span, 1.5, 0.35 * chord, 2.4), (0, 2.4, 0.6 * chord, 2.4), (0.4 * span, 1.5, 0.35 * chord, 2.4)]
        tail = column(rows, "y", 24, centre=[-8, 0, -8])
        high = self.one_of(-0.3, 0.6) * r
        self.add(shade, wing.moved(0.1 * half, z=z + high), tail.moved(-0.85 * half, z=z + 2))
        self.add(shade, column([(0, 0.6 * chord, 2, 2.4), (r + 20, 0.35 * chord, 1.5, 2.4)], "z", 24).moved(-0.85 * half, z=z))
        engine, at = rod(-12, 14, 0.5 * r), 0.45 * span
        if self.chance(0.5):
            self.add((*STEELS, BLACK), *(engine.moved(0.1 * half - 0.45 * sweep_back + 6, s * at, z + high - 5) for s in (-1, 1)))
        else:
            shade, blades = self.pick(BLACK, GOLD), box((4, self.uniform(40, 64), 8), 3, 1.2, "x")
            self.add(shade, blades.moved(half + 1, z=z), ball((5, 5, 5)).moved(half + 2, z=z))
        self.add((BLACK,), *(rod(-3, 3, 7, "y").moved(x * half, y, 7) for x, y in ((0.0, -14), (0.0, 14), (0.7, 0))))
        self.add(STEELS, *(rod(6, z, 2.2, "z").moved(x * half, y) for x, y in ((0.0, -14), (0.0, 14), (0.7, 0))))

    def rocket(self) -> None:  # a rocket: pointed body, fins, a window, a nozzle
        r, high, fins = *self.uniform((14, 110), (26, 170)), self.integers(3, 5)
        rows = [(10, 0.75 * r), (18, 0.9 * r), (0.4 * high, r), (0.72 * high, 0.85 * r), (0.93 * high, 0.3 * r), (high, 0.06 * r)]
        self.add((*COLOURS, WHITE, *STEELS), lathe(rows, count=36))
        fin = sweep([(0.5 * r, 0, 0.35 * high), (1.5 * r, 0, 0.22 * high), (2.1 * r, 0, 0)], 5, 0.16 * high)
        self.add(COLOURS, *(fin.turned("z", 2 * np.pi * n / fins + 0.5) for n in range(fins)))
        self.add((*STEELS, BLACK), column([(0, 0.7 * r), (12, 0.5 * r)], count=28), rod(-r - 2, 2, 0.36 * r, "y").moved(z=0.6 * high))

    def rings(self) -> None:  # a stacking tower: rings of falling size on a pole, a ball on top; or blocks piled askew
        count, z, pile = self.integers(3, 7), 8.0, self.chance(0.4)
        size = self.uniform(30, 46)
        self.add((*WOODS, *COLOURS), lathe([(0, size), (3, 1.05 * size), (9, size)], count=36))
        for number in range(count):
            tall, r = self.uniform(13, 21), size * (1 - 0.6 * number / count)
            if pile:
                turn, (x, y) = self.uniform(-0.7, 0.7), self.uniform(-3, 3, 2)
                solid = box((1.7 * r, 1.7 * r, tall), self.uniform(3, 12), 1.5, "z").turned("z", turn).moved(x, y, z + tall / 2)
            else:
                solid = lathe([(z, 0.8 * r), (z + 0.25 * tall, 0.97 * r), (z + 0.75 * tall, 0.97 * r), (z + tall, 0.8 * r)], count=36)
            self.add(COLOURS, solid)
            z += tall - 0.5
        self.add((*COLOURS, *WOODS), ball((11, 11, 11)).moved(z=z + 8), rod(0, z + 2, 6, "z"))

    def skittle(self) -> None:  # a skittle, chess piece, nesting doll, spinning top or hand bell: turned, its outline drawn
        waves = self.integers(3, 7)
        along = np.concatenate([[0, 0.04], np.sort(self.uniform(0.1, 0.9, waves)), [0.97, 1.0]])
        along = along[np.concatenate([[True], np.diff(along) > 0.03])]
        high = self.uniform(80, 150)
        radius = high * self.uniform(0.08, 0.3, len(along))
        radius[[0, -1]] = high * self.uniform((0.12, 0.02), (0.25, 0.1))
        turned = column(smooth(np.column_stack([high * along, radius]), 8), count=40)
        low, tall = self.uniform((0.1, 0.1), (0.6, 0.3)) * high
        middle = turned.vertices[turned.faces, 2].mean(axis=1)
        self.add(self.pick(*WOODS, *COLOURS), turned.painted(self.pick(*COLOURS), (middle > low) & (middle < low + tall)))
        for number in range(self.integers(0, 3)):
            self.add((*COLOURS, GOLD), ball((7, 7, 7)).moved(z=high + 5 + 11 * number))

    def part(self, size: float) -> Solid:
        """Draw a ball, box, rod, cone or drop of about a size, turned any way."""
        a, b, c = size * self.uniform(0.35, 1.0, 3)
        shapes = (
            ball((a, b, c)),
            box((1.7 * a, 1.7 * b, 1.7 * c), self.uniform(2.5, 10), 0.1 * size),
            lathe([(-a, 0.6 * b), (a, 0.6 * b)]),
            lathe([(-a, 0.9 * b), (a, 0.9 * b * self.uniform(0.1, 0.6))]),
            lathe([(-a, 0.3 * b), (-0.5 * a, b), (a, 0.2 * b)], count=28),
        )
        return self.one_of(*shapes).turned("x", self.uniform(-np.pi, np.pi)).turned("z", self.uniform(-np.pi, np.pi))

    def figure(self) -> None:  # a figure of three to nine random shapes, each stuck onto one of the others
        centres, sizes = [np.zeros(3)], [self.uniform(22, 40)]
        for _ in range(self.integers(2, 9)):
            to, size = self.integers(0, len(centres)), self.uniform(10, 34)
            way = self.uniform(-1, 1, 3)
            centres.append(centres[to] + 0.75 * (0.6 * sizes[to] + 0.6 * size) * way / np.sqrt((way * way).sum()))
            sizes.append(size)
        solids = [self.part(size).moved(*centre) for centre, size in zip(centres, sizes, strict=True)]
        shades = [self.pick(*COLOURS, *WOODS) for _ in range(3)]
        low = min(solid.vertices[:, 2].min() for solid in solids)
        for number, solid in enumerate(solids):
            self.add(shades[number % 3], solid.moved(z=-low))

    kinds = (doll, robot, animal, animal, bird, car, train, boat, plane, rocket, rings, skittle, figure, figure, figure)

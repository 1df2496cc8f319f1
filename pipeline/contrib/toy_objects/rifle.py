"""Models of rifles."""

import numpy as np

from pipeline.contrib.toy_objects.model import BLACK, GOLD, STEELS, WOODS, Model, Palette, Stretch
from pipeline.contrib.toy_objects.solids import Material, Solid, ball, bar, block, column, rod, sweep

BLUED: Palette = ((46, 48, 54), (62, 64, 70), (34, 34, 38), (84, 86, 90), (150, 152, 156))
SYNTHETICS: Palette = ((40, 42, 44), (84, 90, 66), (170, 148, 108), (98, 104, 108), (60, 68, 56))
BUTT = ((-440, -150, -38, 43), (-315, -115, -30, 41), (-225, -64, -12, 34))  # of a classic stock, from the pad to the wrist


def ribbed(start: float, end: float, radius: float) -> Solid:
    """Make a round bar with rings around it."""
    return column(np.column_stack([np.linspace(start, end, 15), radius * np.resize([0.88, 1.0], 15)]), "x", 24)


class Rifle(Model):
    """The bore lies along x at y = z = 0, the muzzle at +x. Bars have rows (x, low z, high z, width)."""

    proportions = (Stretch("x", 0.75, 1.3, start=150), Stretch("x", 0.88, 1.12, end=-225), Stretch("z", 0.92, 1.08))

    def __init__(self, rng: np.random.Generator) -> None:
        super().__init__(rng)
        self.metal, self.synthetic = self.pick(*BLUED), self.pick(*SYNTHETICS)
        self.wood = self.pick(*WOODS) if self.chance(0.8) else self.synthetic

    def barrel(self, muzzle: float, radius: float, devices: float = 0.6) -> None:
        """Add a tapering barrel, with a muzzle brake or a suppressor on a share of the rifles."""
        self.add(self.metal, column([(0, radius), (0.2 * muzzle, radius), (muzzle, self.uniform(0.75, 1.0) * radius)], "x", 24))
        if self.chance(devices):
            brake, suppressor = rod(muzzle - 36, muzzle + 4, 1.4 * radius), rod(muzzle - 20, muzzle + 130, 18)
            self.add(self.pick(*BLUED[:4]), brake if self.chance(0.6) else suppressor)

    def stock(self, color: Material, *rows: tuple[float, float, float, float], exponent: float = 2.8) -> None:
        """Add furniture, rear first, with a pad at its butt, which drops more or less."""
        table, rear = np.array(rows, float), rows[0][0]
        table[:, 1:3] += self.uniform(-0.06, 0.08) * (table[:, :1] + 225).clip(max=0)
        self.add(color, bar(table, exponent, self.pick(BLACK, (90, 44, 34), (70, 72, 74)), [(rear, rear + 14)]))

    def trigger(self, x: float, low: float) -> None:
        """Add a trigger in its guard below height `low`, the guard's rear end at x."""
        guard = [(x - 6, 0, low + 6), (x, 0, low - 22), (x + 27, 0, low - 31), (x + 57, 0, low - 22), (x + 67, 0, low + 6)]
        self.add(self.metal, sweep(guard, 10, 6), sweep([(x + 37, 0, low + 6), (x + 33, 0, low - 12), (x + 40, 0, low - 22)], 7, 6))

    def grip(self, color: Material, x: float, low: float) -> None:
        """Add a pistol grip that hangs from height `low`, raked backwards."""
        long, rake = self.uniform((84, 0.2), (104, 0.5))
        self.add(color, sweep([(x + 14 * rake, 0, low + 14), (x - rake * long, 0, low - long)], 31, 44))

    def magazine(self, x: float, low: float, *, bend: float, deep: float) -> None:
        """Add a box magazine below height `low`, its foot swept forwards by about the share `bend` of its depth."""
        bend, deep = self.uniform(0.6, 1.4, 2) * (bend, deep)
        path = [(x, 0, low + 0.25 * deep), (x + 0.16 * bend * deep, 0, low - 0.4 * deep), (x + bend * deep, 0, low - deep)]
        self.add(self.pick(*BLUED, *SYNTHETICS, (150, 70, 30)), sweep(path, 25, self.uniform(52, 68), 7))

    def sights(self, rear: float, front: float, top: float) -> None:
        """Add a leaf on a surface at height `top`, and a post on the barrel."""
        post = block((front - 6, front + 6), (0, top + self.uniform(12, 26)), 7)
        self.add(self.metal, block((rear, rear + 36), (top - 6, top + 13), 13), post, rod(front - 9, front + 9, 12.5))

    def scope(self, x: float, top: float, share: float = 1.0) -> None:
        """Add a telescopic sight over a surface at height `top` to a share of the rifles: bells, turret, mounts."""
        half, r, bell = self.uniform((60, 12.5, 1.25), (170, 16, 2.0))
        z = top + bell * r + 8
        tube = column(np.multiply([(-1, 1.35), (-0.68, 1.35), (-0.5, 1), (0.36, 1), (0.62, bell), (1, bell)], [half, r]), "x", 24)
        mounts = [block((x + at * half - 9, x + at * half + 9), (top - 8, z), 17) for at in (-0.32, 0.22)]
        if self.chance(share):
            self.add((BLACK, (84, 80, 66)), tube.moved(x, z=z), rod(z, z + r + 14, 9.5, "z").moved(x), *mounts)

    def bolt_action(self) -> None:  # a hunting or service rifle: one-piece stock, short or full; round receiver, bolt, scope or sights
        self.barrel(680, 11)
        fore = self.one_of(300, 360, 570)
        grasp = [(-165, -72, -24, 38), (-115, -52, -6, 44), (-40, -46, -3, 48), (70, -45, -4, 48), (fore - 12, -26, 0, 32)]
        self.stock(self.wood, *BUTT, *grasp, (fore, -18, -2, 22))
        self.add(self.metal, rod(-110, 75, 17))
        self.add(STEELS, rod(-125, -8, 10), sweep([(-78, 0, 2), (-78, -54, -20)], 9, 9), ball((10, 10, 10)).moved(-78, -54, -20))
        self.trigger(-118, -48)
        self.magazine(0, -44, bend=0.0, deep=20)
        self.sights(80, 660, 14)
        self.scope(-30, 17, share=0.7)

    def kalashnikov(self) -> None:  # a Kalashnikov: stamped receiver, curved magazine, gas tube above, wooden or folding stock, raked grip
        self.barrel(490, 10)
        self.add(self.metal, block((-190, 70), (-44, 4), 34), block((325, 355), (-12, 36), 22), rod(60, 345, 9).moved(z=27))
        self.add(self.metal, bar([(-188, -2, 10, 24), (-170, -2, 24, 32), (-20, -2, 25, 32), (-6, -2, 18, 28)]))
        self.add(self.wood, bar([(70, -30, 12, 36), (130, -36, 12, 44), (260, -30, 12, 38), (270, -24, 10, 32)]))
        self.add(self.wood if self.chance(0.7) else self.metal, bar([(80, 12, 36, 30), (140, 12, 40, 34), (270, 12, 36, 28)]))
        if self.chance(0.6):
            self.stock(self.wood, *BUTT, (-180, -42, -4, 32))
        else:
            strut = sweep([(-420, 0, -100), (-180, 0, -38)], 13, 13)
            plate = sweep([(-420, 0, -12), (-426, 0, -60), (-420, 0, -110)], 30, 10)
            self.add(self.metal, rod(-420, -170, 7).moved(z=-24), strut, plate)
        self.trigger(-118, -44)
        self.grip(self.wood if self.chance(0.6) else self.synthetic, -135, -42)
        self.magazine(10, -40, bend=0.34, deep=170)
        self.sights(28, 445, 26)

    def modular(self) -> None:  # an AR: straight or open stock behind a buffer tube, handguard, carry handle or scope, front sight
        self.barrel(450, 10)
        self.add(self.metal, block((-175, 40), (-6, 27), 32), rod(-340, -170, 15))
        self.add(self.metal, bar([(-175, -44, -6, 28), (-110, -44, -4, 30), (-60, -50, -4, 34), (30, -52, -4, 34)], 6))
        self.add(self.synthetic, ribbed(40, 290, 29) if self.chance(0.6) else bar([(40, -31, 24, 44), (290, -24, 18, 38)]))
        whole, frame = [(-330, -98, 20, 38), (-250, -26, 20, 40)], [(-366, -100, 20, 36), (-360, -30, 20, 38)]
        self.stock(self.synthetic, (-390, -115, 20, 36), *(whole if self.chance(0.5) else frame), (-195, -22, 19, 38), exponent=4.0)
        self.add(self.synthetic, sweep([(-240, 0, -16), (-300, 0, -40), (-378, 0, -95)], 22, 18, 4))
        if self.chance(0.5):
            self.add(self.metal, block((-150, -128), (20, 64), 20), block((-30, -12), (20, 58), 16), block((-154, -8), (54, 67), 20))
        else:
            self.scope(-70, 28)
        self.add(self.metal, bar([(280, -15, 15, 18), (298, -15, 62, 12), (308, -15, 62, 12), (324, -15, 15, 18)]))
        self.trigger(-112, -44)
        for x, low in ((-125, -42), (210, -24))[: self.integers(1, 3)]:
            self.grip(self.synthetic, x, low)
        self.magazine(-8, -48, bend=0.15, deep=115)

    def sniper(self) -> None:  # a sniper rifle: heavy barrel, big scope, bipod, pistol grip; thumb-hole or skeleton stock, cheek piece
        self.barrel(740, 15)
        self.add(self.metal, rod(-150, 60, 20))
        self.add(self.synthetic, bar([(-190, -44, -4, 40), (-150, -56, -3, 50), (60, -58, -2, 52), (320, -46, -2, 48), (350, -38, -6, 40)]))
        self.add(self.synthetic, bar([(-400, -40, 2, 38), (-320, -46, -6, 38), (-230, -40, -8, 38), (-170, -44, -4, 42)]))
        if self.chance(0.5):
            self.stock(self.synthetic, (-465, -130, -8, 46), (-370, -124, -6, 44), (-330, -96, -8, 42), (-300, -90, -14, 34))
            self.add(self.synthetic, sweep([(-330, 0, -90), (-250, 0, -122), (-190, 0, -112)], 34, 26))
        else:
            self.stock(self.synthetic, (-465, -130, -4, 44), (-441, -130, -4, 44), (-431, -100, -8, 36), exponent=4.0)
            self.add(self.metal, rod(-455, -380, 9).moved(z=-22), rod(-445, -260, 7).moved(z=-94), block((-280, -255), (-104, -12), 26))
        self.trigger(-135, -50)
        self.grip(self.synthetic, -155, -45)
        self.magazine(-6, -54, bend=0.0, deep=50)
        self.scope(-20, 20)
        leg, fold = rod(-180, 0, 7, "z"), -1.3 if self.chance(0.3) else 0.0
        self.add(self.metal, *(leg.turned("x", side * 0.35).turned("y", fold).moved(310, 12 * side, -42) for side in (-1, 1)))

    def lever_action(self) -> None:  # a lever gun: flat receiver, finger loop, tube magazine under the barrel, hammer, wooden stock
        self.barrel(540, 12, devices=0.0)
        self.add(self.metal, rod(0, self.uniform(340, 520), 9.5).moved(z=-23), block((300, 312), (-34, 13), 24))
        receiver = bar([(-150, -44, 2, 26), (-120, -52, 14, 30), (-20, -54, 17, 32), (10, -50, 16, 32)], 6)
        self.add((*BLUED, *STEELS, GOLD), receiver)
        self.add(self.wood, bar([(6, -46, -2, 40), (120, -46, 0, 42), (227, -40, -2, 36), (235, -34, -8, 28)]))
        loop = [(-136, 0, -52), (-180, 0, -64), (-245, 0, -82), (-235, 0, -108), (-180, 0, -100), (-134, 0, -76)]
        self.add(self.metal, sweep(loop, 11, 6.5), sweep([(-135, 0, -4), (-148, 0, 14), (-164, 0, 22)], 9, 10))
        self.stock(self.wood, *BUTT, (-140, -42, -2, 28))
        self.trigger(-140, -50)
        self.sights(90, 520, 11)
        self.scope(-60, 16, share=0.3)

    def pump(self) -> None:  # a pump gun: wide barrel over a tube, ribbed sliding fore-end; a stock, or a pistol grip on some
        self.barrel(560, 13, devices=0.0)
        tube, slide = self.uniform(330, 520), self.uniform(110, 200)
        self.add(self.metal, rod(0, tube, 13).moved(z=-30), block((tube - 40, tube - 26), (-42, 12), 20))
        self.add(self.metal, bar([(-190, -36, -8, 28), (-160, -52, 14, 36), (-60, -54, 20, 38), (0, -52, 19, 38), (8, -46, 16, 34)], 4.5))
        self.add(self.wood, ribbed(slide, slide + 145, 25).moved(z=-30))
        self.trigger(-150, -48)
        if self.chance(0.25):
            self.grip(self.wood, -175, -24)
        else:
            self.stock(self.wood, *BUTT, (-170, -44, 0, 34))

    def bullpup(self) -> None:  # a bullpup with the magazine behind the grip, a long shell, a carrying handle or a scope
        self.barrel(390, 10)
        high = self.uniform(66, 84)
        shell = [(-285, -92, 30, 50), (-150, -58, 30, 50), (0, -36, 28, 46), (150, -44, 24, 46), (220, -26, 18, 36)]
        self.stock(self.synthetic, (-355, -100, 26, 44), *shell, exponent=3.4)
        if self.chance(0.5):
            self.add(self.synthetic, sweep([(-170, 0, 22), (-130, 0, high), (40, 0, high), (90, 0, 20)], 24, 17, 4))
        else:
            self.scope(-30, 34)
        self.trigger(22, -34)
        for x in (10, 170)[: self.integers(1, 3)]:
            self.grip(self.synthetic, x, -30)
        self.magazine(-170, -66, bend=0.16, deep=115)

    def carbine(self) -> None:  # a self-loader in a wooden stock: gas cylinder, upper handguard, short magazine, sights
        self.barrel(530, 11)
        self.stock(self.wood, *BUTT, (-170, -66, -16, 36), (-115, -48, -5, 44), (60, -42, -3, 46), (270, -32, 2, 38), (335, -26, 2, 32))
        self.add(self.wood, bar([(70, -4, 20, 34), (210, -4, 20, 34), (335, -4, 16, 28)]))
        receiver = bar([(-150, -10, 8, 28), (-120, -10, 22, 36), (50, -10, 20, 34), (72, -10, 16, 30)])
        self.add(self.metal, receiver, rod(315, 470, 8).moved(z=-19), block((329, 345), (-30, 20), 34))
        self.trigger(-122, -44)
        self.magazine(20, -38, bend=0.12, deep=self.uniform(40, 110))
        self.sights(-135, 505, 21)
        self.scope(-50, 26, share=0.3)

    def double_barrel(self) -> None:  # a break action: two barrels side by side or over each other, splinter fore-end
        self.barrel(615, 8, devices=0.0)
        pipe, over = column([(0, 15), (120, 13.5), (620, 12)], "x", 24), self.chance(0.5)
        self.add(self.metal, *(pipe.moved(z=13 * side - 13) if over else pipe.moved(y=12 * side) for side in (-1, 1)))
        low, wide = (-39, 42) if over else (-13, 58)
        receiver = [(-120, low - 18, -6, 28), (-80, low - 22, 10, 36), (-10, low - 12, 16, wide), (8, low - 8, 16, wide)]
        self.add((*BLUED, *STEELS, GOLD), bar(receiver))
        fore = [(10, low - 16, low + 13, wide - 3), (140, low - 14, low + 13, wide - 8), (235, low - 5, low + 13, wide / 2)]
        self.add(self.wood, bar(fore))
        self.stock(self.wood, *BUTT, (-180, low - 34, -8, 34), (-100, low - 20, 4, 36))
        self.trigger(-128, low - 18)

    kinds = (bolt_action, kalashnikov, modular, sniper, lever_action, pump, bullpup, carbine, double_barrel)

"""Models of cellphones."""

from collections.abc import Sequence

from PIL import Image, ImageDraw

from pipeline.contrib.toy_objects.model import BLACK, PLASTICS, RED, STEELS, WHITE, Model, Palette, Stretch
from pipeline.contrib.toy_objects.pictures import home_screen, liquid_crystal, textured, write
from pipeline.contrib.toy_objects.solids import Color, Material, box, column, rod

SHELLS: Palette = (*PLASTICS, BLACK, (60, 66, 78), (178, 182, 188), (36, 62, 116), (150, 34, 44), (92, 112, 96), (196, 168, 110))
DIAL = ("123", "456", "789", "*0#")
QWERTY = ("QWERTYUIOP", "ASDFGHJKL.", "ZXCVBNM,-/")
SCALE = 2.5  # pixels per millimetre of a front's picture


class Leaf:
    """A slab of a phone, standing on z = 0, with a picture on its front and keys that stand out of it.

    Positions on the front are millimetres: x from the middle, z from the foot. A share `plate` has a face plate of another colour.
    """

    def __init__(self, phone: Model, size: tuple[float, float, float], shade: Material, plate: float = 0.0) -> None:
        self.phone, self.shade = phone, shade
        self.width, self.thick, self.height = size
        self.image = Image.new("RGB", (round(SCALE * self.width), round(SCALE * self.height)), shade.color)
        self.key_exponent = 2.2 if phone.chance(0.35) else 5.0
        self.solids = [box(size, phone.uniform(5, 12), phone.uniform(1.5, 3.0), count=40).moved(z=self.height / 2)]
        if phone.chance(plate):
            self.rectangle(0, 0.5 * self.height, 0.88 * self.width, 0.92 * self.height, phone.pick(*SHELLS).color, phone.uniform(4, 14))

    def rectangle(self, x: float, z: float, width: float, height: float, color: Color, round_by: float = 1.0) -> None:
        """Draw a rectangle about (x, z), its corners rounded by a radius."""
        left, top = self.width / 2 + x - width / 2, self.height - z - height / 2
        corners = [SCALE * edge for edge in (left, top, left + width, top + height)]
        ImageDraw.Draw(self.image).rounded_rectangle(corners, SCALE * round_by, color)

    def grille(self, z: float) -> None:
        """Draw slots, one above the other from z on."""
        for slot in range(self.phone.integers(2, 6)):
            self.rectangle(0, z + 4.5 * slot, 0.45 * self.width, 2.4, BLACK)

    def screen(self, z: float, width: float, height: float, lit: float = 0.3, rim: float = 2.0) -> None:
        """Draw a screen in a dark rim under an earpiece: a home screen in a share `lit` of the draws, else one of the old kind."""
        self.rectangle(0, z, width + 2 * rim, height + 2 * rim, BLACK, 3.0)
        self.rectangle(0, z + height / 2 + rim + 3.0, 12, 2.2, BLACK)
        picture = (home_screen if self.phone.chance(lit) else liquid_crystal)(self.phone.rng, round(SCALE * width), round(SCALE * height))
        self.image.paste(picture, (round(SCALE * (self.width - width) / 2), round(SCALE * (self.height - z - height / 2))))

    def key(self, x: float, z: float, width: float, height: float, color: Color, legend: str = "") -> None:
        """Raise a key of one colour with a legend."""
        self.rectangle(x, z, width + 0.5, height + 0.5, color, min(width, height) / self.key_exponent)
        write(self.image, (SCALE * (self.width / 2 + x), SCALE * (self.height - z)), 0.85 * SCALE * min(width, height), legend)
        self.solids.append(box((width, 1.6, height), self.key_exponent, 0.6, count=16).moved(x, -self.thick / 2 - 0.5, z))

    def keypad(self, low: float, high: float, legends: Sequence[str] = DIAL) -> None:
        """Raise rows of keys from z `low` to `high`, one letter of the legends each."""
        color, fill = self.phone.pick(BLACK, WHITE, *STEELS[2:]).color, self.phone.uniform(0.74, 0.88)
        pitch, tall = 0.82 * self.width / len(legends[0]), (high - low) / len(legends)
        for row, line in enumerate(legends):
            for index, letter in enumerate(line):
                x, z = (index + 0.5 - len(line) / 2) * pitch, high - (row + 0.5) * tall
                self.key(x, z, fill * pitch, fill * tall, color, letter)

    def navigation(self, z: float) -> None:
        """Raise a pad between a green and a red key."""
        r, color = self.phone.uniform(0.11, 0.15) * self.width, self.phone.pick(*STEELS, *SHELLS).color
        for x, width, shade in ((-2.3 * r, 1.5 * r, (50, 160, 70)), (0.0, 2.2 * r, color), (2.3 * r, 1.5 * r, RED)):
            self.key(x, z, width, 1.3 * r, shade)
        self.rectangle(0, z, r, 0.7 * r, BLACK, 0.35 * r)

    def antenna(self, share: float, tall: float, side: int = 1) -> None:
        """Raise an antenna of about this height, thinner towards its end, on the right or the left of a share of the phones."""
        h, end, r = self.height, self.height + tall * self.phone.uniform(0.6, 1.4), self.phone.uniform(3.2, 4.4)
        if self.phone.chance(share):
            rows = [(h - 5, r), (0.4 * h + 0.6 * end, 0.9 * r), (0.3 * h + 0.7 * end, 0.5 * r), (end, 0.5 * r)]
            self.solids.append(column(rows, count=16).moved(side * 0.3 * self.width))

    def add(self, y: float = 0.0, z: float = 0.0, lean: float = 0.0) -> None:
        """Add the slab and its keys, leaning forward by an angle (rad), standing at (0, y, z)."""
        picture = textured(self.image)
        for solid in self.solids:
            uv = solid.vertices[:, [0, 2]] / [self.width, self.height] + [0.5, 0.0]
            front = solid.vertices[solid.faces, 1].max(axis=1) < 0.9 - self.thick / 2
            self.phone.add(self.shade, solid.painted(picture, front, uv).turned("x", lean).moved(y=y, z=z))


class Cellphone(Model):
    """The front faces -y."""

    proportions = (Stretch("x", 0.9, 1.1), Stretch("y", 0.8, 1.25), Stretch("z", 0.92, 1.08))

    def smartphone(self) -> None:  # a slab of glass with icons; a home key, or a notch or punch hole; a camera bump behind
        h, old = self.uniform(122, 155), self.chance(0.5)
        leaf = Leaf(self, (68, 9, h), self.pick(*SHELLS))
        leaf.rectangle(0, h / 2, 66, h - 2, self.pick(BLACK, WHITE).color, 6)
        leaf.screen(h / 2, 61, h - (30 if old else 10), lit=1.0, rim=0.0)
        leaf.rectangle(self.one_of(-20, 0, 0, 20), h - 9, self.one_of(5, 16, 28), 5, BLACK, 2.4)
        if old:
            leaf.key(0, 7.5, self.uniform(9, 21), 9, self.pick(*STEELS).color)
        leaf.add()
        back = self.pick(*SHELLS)
        self.add(back, box((15, 4, self.uniform(17, 40)), 5, 1.2).moved(17, 5.5, h - 27), box((3, 3, 14)).moved(34, z=0.75 * h))

    def bar_phone(self) -> None:  # a candy bar: display, pad, twelve keys; a stub antenna on some
        leaf, tall = Leaf(self, (47, 18, 117), self.pick(*SHELLS), plate=0.6), self.uniform(23, 31)
        leaf.screen(103 - 0.5 * tall, 31, tall)
        leaf.navigation(64)
        leaf.keypad(9, 54)
        leaf.antenna(0.45, 24, side=self.one_of(-1, 1))
        leaf.add()

    def brick(self) -> None:  # an early phone: deep body, battery behind, narrow display, big keys, long antenna
        leaf, high = Leaf(self, (55, 39, 185), self.pick((60, 60, 62), (206, 200, 184), (90, 92, 88), BLACK)), self.uniform(92, 111)
        leaf.screen(high + 24, 35, 17, lit=0)
        leaf.keypad(22, high)
        leaf.grille(high + 46)
        leaf.antenna(1.0, 65)
        leaf.add()
        self.add(self.pick(BLACK, (120, 116, 106)), box((47, self.uniform(12, 22), 115), 10, 3).moved(y=23, z=78))

    def flip(self) -> None:  # a clamshell open at an angle: keys below, hinge, leaf with the screen leaning forward
        shade, tall = self.pick(*SHELLS), self.uniform(80, 91)
        lower, upper = Leaf(self, (48, 13, 87), shade, plate=0.7), Leaf(self, (48, 10, tall), shade, plate=0.7)
        lower.navigation(64)
        lower.keypad(8, 52)
        lower.antenna(0.5, 19)
        lower.add()
        upper.screen(0.48 * tall, 32, self.uniform(0.5, 0.66) * tall)
        upper.add(z=89, lean=self.uniform(0.15, 0.6))
        self.add((*STEELS, *SHELLS), rod(-22, 22, 6.2).moved(y=-1.3, z=88.5))

    def folded(self) -> None:  # a clamshell closed: two leaves, hinge on top, small outer display on a disc, camera
        shade, disc = self.pick(*SHELLS), self.uniform(15, 40)
        front, rear = Leaf(self, (49, 12, 93), shade), Leaf(self, (49, 12, 93), self.pick(*SHELLS) if self.chance(0.3) else shade)
        for z, size, color in ((50, disc, self.pick(*STEELS).color), (82, 13, self.pick(*STEELS).color), (82, 7, BLACK)):
            front.rectangle(0, z, size, size, color, size / 2)
        front.screen(50, 22, self.uniform(14, 20))
        front.grille(11)
        front.add(y=-5.8)
        rear.antenna(0.55, 19)
        rear.add(y=5.8)
        self.add((*STEELS, *SHELLS), rod(-15, 15, 9.5).moved(z=91))

    def slider(self) -> None:  # two leaves pushed apart: screen and pad on the front one, keys on the rear one
        rear, front = Leaf(self, (48, 8.5, 97), self.pick(*SHELLS)), Leaf(self, (48, 8.5, 97), self.pick(*SHELLS), plate=0.3)
        travel, tall = self.uniform((37, 45), (50, 54))
        rear.keypad(5, 0.97 * travel)
        rear.add()
        front.screen(87 - tall / 2, 36, tall)
        front.navigation(17)
        front.add(y=-8.3, z=travel)

    def keyboard_phone(self) -> None:  # a broad phone with a small letter keyboard under a landscape screen
        leaf, split = Leaf(self, (66, 13.5, 114), self.pick(*SHELLS), plate=0.9), self.uniform(44, 53)
        leaf.screen(86, 49, 30, lit=0.9)
        leaf.navigation(split + 7)
        leaf.keypad(9, split - 4, QWERTY)
        leaf.add()

    def organiser(self) -> None:  # a pocket computer with a phone: large pane, row of hard keys, pen in a slot, thick antenna on some
        leaf, color = Leaf(self, (74, 18, 125), self.pick(*SHELLS), plate=0.7), self.pick(*SHELLS).color
        leaf.screen(72, 52, self.uniform(65, 75), lit=0.6)
        for x in (-25, -15, 0, 15, 25):
            leaf.key(x, 20, 7.5 if x else 15, 11, color if x else self.pick(*STEELS).color)
        leaf.antenna(0.6, 22, side=-1)
        leaf.add()
        self.add((BLACK, *STEELS), rod(117, 130, 2.6, "z").moved(25, 3.6))

    kinds = (smartphone, smartphone, bar_phone, brick, flip, folded, slider, keyboard_phone, organiser)

"""Puts furniture and things into a room without collisions."""

from __future__ import annotations

from collections.abc import Callable

import bpy

from nunet_models.rendering import clutter, equipment, furniture, materials, people, shell
from nunet_models.rendering.floorplan import SIDES, FloorPlan
from nunet_models.rendering.shapes import Maker

TONES = (
    (0.36, 0.22, 0.11),
    (0.15, 0.08, 0.045),
    (0.5, 0.33, 0.17),
    (0.06, 0.04, 0.03),
    (0.55, 0.48, 0.38),
)


class Furnisher:
    """Puts things into a room without collisions."""

    def __init__(self, maker: Maker, room: shell.Shell, photos: list[str]) -> None:
        self.maker, self.room, self.photos = maker, room, photos
        self.random = maker.random
        self.plan = FloorPlan(room.width, room.depth, maker.random)
        self.tone = self.random.choice(TONES)
        self.walls_taken: list[tuple[str, float, float]] = []

    @property
    def density(self) -> float:
        """Factor on the number of objects: large rooms hold more."""
        return min(2.2, max(0.8, self.room.width * self.room.depth / 13))

    def some(self, call: Callable[[], None], low: int, high: int) -> None:
        """Call between `low` and `high` times, more often in large rooms."""
        for _ in range(round(self.random.randint(low, high) * self.density)):
            call()

    def cloth(self) -> bpy.types.Material:
        """A random cloth."""
        random = self.random
        first = tuple(random.uniform(0.02, 0.6) for _ in range(3))
        if random.random() < 0.25:
            second = tuple(random.uniform(0.02, 0.6) for _ in range(3))
            return materials.striped(first, second, random.uniform(0.02, 0.12), random.choice("xy"))
        return materials.fabric(first, random.uniform(150, 320), random.uniform(0.05, 0.35))

    def at_wall(self, width: float, depth: float, gap: float = 0.02) -> Maker | None:
        """A maker at a free place of a wall, its back at y = 0."""
        found = self.plan.against_wall(width, depth, gap=gap)
        if found is None:
            return None
        side, x = found
        self.walls_taken.append((side, x - width / 2, x + width / 2))
        facing, _ = self.room.wall(self.maker, side)
        return facing.at(x, -gap)

    def on_floor(self, width: float, depth: float, turn_deg: float | None = None) -> Maker | None:
        """A maker in the middle of a free place of the floor."""
        found = self.plan.free_place(width, depth, turn_deg=turn_deg)
        return None if found is None else self.maker.at(found.x, found.y, turn=found.turn_deg)

    def small_things(self, top: Maker, width: float, depth: float, count: int) -> None:
        """Small things on a surface whose middle is the maker's origin, side by side."""
        plan = FloorPlan(width, depth, self.random)
        for _ in range(count):
            place = plan.free_place(0.24, 0.24)
            if place is not None:
                equipment.small_thing(top.at(place.x - width / 2, place.y - depth / 2))

    # Furniture, each with its place.

    def sofa(self) -> None:
        """A sofa at a wall, cushions on it."""
        random = self.random
        width = random.choice((0.9, 1.5, 2.1, 2.5))
        place = self.at_wall(width, 0.95, random.uniform(0.02, 0.3))
        if place is None:
            return
        furniture.sofa(place, width, self.cloth())
        for _ in range(random.randint(0, 3)):
            x = random.uniform(-0.5, 0.5) * (width - 0.8)
            clutter.cushion(
                place.at(x, -0.42, 0.47, turn=random.uniform(-20, 20)), self.cloth(), size=0.42
            )

    def bed(self) -> None:
        """A bed."""
        width = self.random.choice((0.9, 1.4, 1.8))
        place = self.at_wall(width + 0.15, 2.15)
        if place is not None:
            furniture.bed(place, width, self.tone, self.cloth())

    def bookcase(self) -> None:
        """A bookcase with books and other things."""
        random = self.random
        width, height = random.uniform(0.5, 1.2), random.uniform(0.8, 2.1)
        place = self.at_wall(width, 0.32)
        if place is None:
            return
        count = max(2, round(height / 0.36))
        for shelf in furniture.bookcase(place, (width, 0.3, height), count, self.tone)[:-1]:
            if random.random() < 0.65:
                end = random.uniform(-width / 2 + 0.2, width / 2 - 0.06)
                clutter.books(shelf, -width / 2 + 0.04, end, height / count * 0.8)
            elif random.random() < 0.6:
                equipment.bottle(shelf.at(0, 0.14), (0.3, 0.2, 0.1))

    def cupboard(self) -> None:
        """A cupboard, a sideboard or a wardrobe with things on it."""
        random = self.random
        width = random.uniform(0.45, 1.8)
        height = random.choice((0.5, 0.75, 0.9, 1.3, 2.0))
        depth = random.uniform(0.35, 0.6)
        place = self.at_wall(width, depth + 0.05)
        if place is None:
            return
        tone = None if random.random() < 0.4 else self.tone
        doors = max(1, round(width / 0.5)) if random.random() < 0.8 else 0
        drawers = random.choice((0, 1)) if doors else max(2, round(height / 0.22))
        furniture.cupboard(place, (width, depth, height), tone, doors=doors, drawers=drawers)
        top = place.at(0, -depth / 2, height)
        if height < 1 and random.random() < 0.3 and width > 1.1:
            furniture.television(top.at(0, 0.05), min(width, 1.2))
        elif height < 1.5:
            self.small_things(top, width, depth, random.randint(0, 4))

    def desk(self) -> None:
        """A desk with a monitor and a chair."""
        random = self.random
        width, depth = random.uniform(1.1, 1.8), random.uniform(0.6, 0.85)
        place = self.at_wall(width, depth + 0.85)
        if place is None:
            return
        place = place.at(0, -depth / 2)
        furniture.table(place, (width, depth, 0.74), self.tone)
        top = place.at(0, 0, 0.74)
        for x in random.choice(((0.0,), (-0.32, 0.32), ())):
            clutter.monitor(top.at(x, depth * 0.2, turn=random.uniform(-15, 15)))
        if random.random() < 0.7:
            clutter.keyboard(top.at(random.uniform(-0.1, 0.1), -depth * 0.25))
        equipment.small_thing(top.at(width * 0.38, random.uniform(-0.1, 0.1)))
        if random.random() < 0.4:
            clutter.desk_lamp(top.at(-width * 0.4, depth * 0.2))
        chair = place.at(
            random.uniform(-0.2, 0.2), -depth / 2 - 0.3, turn=180 + random.uniform(-50, 50)
        )
        self.any_chair(chair)

    def any_chair(self, place: Maker) -> None:
        """A chair, an office chair, or a person on a chair."""
        random = self.random
        if random.random() < 0.45:
            furniture.office_chair(place, self.cloth())
        else:
            furniture.chair(
                place, random.choice(TONES), self.cloth() if random.random() < 0.6 else None
            )
        if random.random() < 0.1:
            people.person(place, sitting=True)

    def table(self) -> None:
        """A table with chairs around and things on it."""
        random = self.random
        width, depth = random.uniform(0.7, 2.0), random.uniform(0.7, 1.0)
        height = random.uniform(0.7, 0.78)
        place = self.on_floor(
            width + 1.1, depth + 1.2, random.choice((0, 90, random.uniform(0, 360)))
        )
        if place is None:
            return
        furniture.table(place, (width, depth, height), self.tone)
        self.small_things(place.at(0, 0, height), width, depth, random.randint(1, 7))
        for side in (-1, 1):
            for x in (-width / 4, width / 4) if width > 1.2 else (0.0,):
                if random.random() < 0.75:
                    y = side * (depth / 2 + random.uniform(0.05, 0.3))
                    turn = random.gauss(180 if side < 0 else 0, 15)
                    self.any_chair(place.at(x, y, turn=turn))

    def low_table(self) -> None:
        """A coffee table."""
        random = self.random
        size = (random.uniform(0.5, 1.2), random.uniform(0.45, 0.7), random.uniform(0.35, 0.5))
        place = self.on_floor(size[0] + 0.1, size[1] + 0.1)
        if place is not None:
            furniture.low_table(place, size, self.tone)
            self.small_things(place.at(0, 0, size[2]), *size[:2], random.randint(0, 5))

    def chair(self) -> None:
        """A chair that stands alone."""
        place = self.on_floor(0.6, 0.65)
        if place is not None:
            self.any_chair(place)

    def rack(self) -> None:
        """A rack with boxes."""
        random = self.random
        size = (random.uniform(0.8, 2.4), random.uniform(0.35, 0.8), random.uniform(1.4, 2.6))
        place = self.at_wall(size[0], size[1])
        if place is not None:
            equipment.rack(place, size, random.randint(3, 5))

    def rack_row(self) -> None:
        """A free row of racks, as in warehouses."""
        random = self.random
        width, depth = random.uniform(2.0, 2.8), random.uniform(0.6, 1.1)
        height = min(random.uniform(2.0, 4.5), self.room.height - 0.3)
        count = random.randint(1, 3)
        place = self.on_floor(width * count + 0.1, depth + 0.1, random.choice((0, 90)))
        for i in range(count if place is not None else 0):
            x = (i - (count - 1) / 2) * width
            equipment.rack(place.at(x, depth / 2), (width, depth, height), random.randint(3, 5))

    def kitchen(self) -> None:
        """Kitchen units and a refrigerator."""
        random = self.random
        width = random.uniform(1.2, 3.2)
        place = self.at_wall(width, 0.66, 0.01)
        if place is not None:
            equipment.kitchen(place, width, upper=random.random() < 0.7)

    def fridge(self) -> None:
        """A refrigerator."""
        place = self.at_wall(0.65, 0.75)
        if place is not None:
            equipment.fridge(place)

    def stairs(self) -> None:
        """Stairs at a wall."""
        random = self.random
        width = random.uniform(0.8, 1.4)
        steps = min(int((self.room.height - 0.3) / 0.19), random.randint(5, 14))
        length = steps * 0.3
        place = self.at_wall(length, width + 0.05, 0.01)
        if place is not None:
            flipped = place.at(-length / 2, 0)
            equipment.stairs(flipped, width, steps)

    def boxes(self) -> None:
        """Boxes on the floor, alone or as stacks."""
        random = self.random
        width, depth = random.uniform(0.2, 0.7), random.uniform(0.2, 0.6)
        place = self.on_floor(width + 0.05, depth + 0.05)
        if place is not None:
            tall = random.choice((random.uniform(0.1, 0.5), random.uniform(0.4, 1.8)))
            equipment.box_stack(place, width, depth, tall)

    def person(self) -> None:
        """A standing person."""
        place = self.on_floor(0.7, 0.6)
        if place is not None:
            people.person(place)

    def floor_thing(self) -> None:
        """A small thing on the floor: bag, basket, plant, shoes, lamp, toy."""
        random = self.random
        place = self.on_floor(0.36, 0.36)
        if place is None:
            return
        color = tuple(random.uniform(0.02, 0.5) for _ in range(3))
        kind = random.randrange(6)
        if kind == 0:
            equipment.bag(place)
        elif kind == 1:
            clutter.basket(place, color)
        elif kind == 2:
            clutter.plant(
                place,
                random.uniform(0.5, 1.5),
                random.randint(12, 26),
                pot=random.uniform(0.1, 0.17),
            )
        elif kind == 3:
            clutter.slippers(place, color)
        else:
            equipment.small_thing(place)

    def floor_lamp(self) -> None:
        """A standing lamp, on or off."""
        place = self.on_floor(0.46, 0.46)
        if place is not None:
            clutter.floor_lamp(place, self.random.choice((0, 9, 20)))

    def cable(self) -> None:
        """A cable on the floor, under everything."""
        x = self.random.uniform(0.2, self.room.width * 0.6)
        y = self.random.uniform(0.3, self.room.depth - 0.3)
        reach = min(self.random.uniform(0.5, 4), self.room.width - x - 0.3)
        if reach > 0.3:
            equipment.cable(self.maker.at(x, y), reach)

    def rug(self) -> None:
        """A rug under everything."""
        random = self.random
        size = (random.uniform(0.8, 2.5), random.uniform(0.6, 2.0))
        if size[0] + 0.3 > self.room.width or size[1] + 0.3 > self.room.depth:
            return
        x = random.uniform(size[0] / 2 + 0.1, self.room.width - size[0] / 2 - 0.1)
        y = random.uniform(size[1] / 2 + 0.1, self.room.depth - size[1] / 2 - 0.1)
        colors = [tuple(random.uniform(0.03, 0.5) for _ in range(3)) for _ in range(2)]
        cloth = materials.rug(*colors) if random.random() < 0.6 else materials.carpet(colors[0])
        furniture.rug(self.maker.at(x, y), size, cloth)

    def wall_decoration(self, flat: float = 0.5) -> None:
        """A painting, poster, mirror, screen or clock; `flat` is the probability of a photo."""
        random = self.random
        side = random.choice(SIDES)
        facing, length = self.room.wall(self.maker, side)
        mural = random.random() < flat * 0.35
        width = random.uniform(1.2, 3.0) if mural else random.uniform(0.4, 1.1)
        width = min(width, length - 0.4)
        height = min(
            width * random.choice((0.75, 0.66, 1.3 if width < 0.9 else 0.75)),
            self.room.height - 0.3,
        )
        x = random.uniform(width / 2 + 0.1, length - width / 2 - 0.1)
        z = random.uniform(0.05, 0.5) if mural else random.uniform(0.9, 1.4)
        z = max(0.02, min(z, self.room.height - height - 0.1))
        low, high = x - width / 2 - 0.05, x + width / 2 + 0.05
        if any(s == side and low < b and a < high for s, a, b in self.walls_taken):
            return
        self.walls_taken.append((side, low, high))
        if random.random() < flat and self.photos:
            glow = random.uniform(0.5, 2) if random.random() < 0.25 and not mural else 0
            equipment.poster(facing, x, z, (width, height), random.choice(self.photos), glow)
        elif random.random() < 0.3:
            equipment.mirror(
                facing,
                x,
                random.choice((0.05, z)),
                (width, min(height * 1.4, self.room.height - z - 0.1)),
            )
        elif random.random() < 0.25:
            clutter.clock(facing, x, random.uniform(1.6, 2.1))
        else:
            furniture.painting(facing, x, z, (width, height), random.randrange(100))

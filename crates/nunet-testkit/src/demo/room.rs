//! The room and its furniture.
//!
//! Nothing here is symmetric: the window is on the left and the books are on the right, the floor is dark and
//! the ceiling light, each wall has its own color.

use super::class;
use super::noise::unit;
use super::solid::{FACES, Finish, Shape, Solid};
use super::texture::{Material, Reflectance};
use super::vector::Vec3;

/// Width (x), depth (y) and height (z) of the room, meters.
pub(super) const SIZE: Vec3 = Vec3::new(5.2, 6.2, 2.6);

/// The source of daylight: the middle of the window, in the wall at x = 0.
pub(super) const WINDOW: Vec3 = Vec3::new(0.0, 3.1, 1.5);
/// Width (along y) and height of the window.
pub(super) const WINDOW_SIZE: (f32, f32) = (1.9, 1.3);

/// The ceiling lamp.
pub(super) const LAMP: Vec3 = Vec3::new(2.9, 3.5, 2.3);
pub(super) const LAMP_RADIUS: f32 = 0.22;

const OAK: Material = Material::Wood(Reflectance::new(0.42, 0.26, 0.13));
const WALNUT: Material = Material::Wood(Reflectance::new(0.20, 0.11, 0.06));
const WHITE_PAINT: Material = Material::Paint(Reflectance::new(0.75, 0.74, 0.70));
const BLACK_PAINT: Material = Material::Paint(Reflectance::new(0.04, 0.04, 0.045));

/// All solids of the room; the room itself is the first.
pub(super) fn furnished(seed: u64) -> Vec<Solid> {
    let mut room = Room { solids: vec![walls()], seed: (seed ^ (seed >> 32)) as u32 };
    room.window();
    room.ceiling_lamp();
    room.bed();
    room.television();
    room.bookshelf();
    room.sofa();
    room.table();
    room.chairs();
    room.plant();
    room.floor_lamp();
    room.pictures();
    room.solids
}

fn walls() -> Solid {
    let wall =
        |r, g, b| Finish { label: class::WALL, material: Material::Plaster(Reflectance::new(r, g, b)) };
    let floor =
        Finish { label: class::FLOOR, material: Material::Boards(Reflectance::new(0.36, 0.21, 0.11)) };
    let ceiling =
        Finish { label: class::CEILING, material: Material::Plaster(Reflectance::new(0.80, 0.80, 0.77)) };
    let half = SIZE * 0.5;
    Solid {
        shape: Shape::Hollow { half },
        center: half,
        turn: (1.0, 0.0),
        faces: [
            wall(0.34, 0.46, 0.44),
            wall(0.62, 0.36, 0.24),
            wall(0.58, 0.56, 0.50),
            wall(0.66, 0.58, 0.42),
            floor,
            ceiling,
        ],
    }
}

/// The origin of a piece of furniture; its parts are relative to it.
#[derive(Clone, Copy)]
struct FurniturePlace {
    at: Vec3,
    turn: (f32, f32),
}

/// A place on the floor.
fn at(x: f32, y: f32) -> FurniturePlace {
    FurniturePlace { at: Vec3::new(x, y, 0.0), turn: (1.0, 0.0) }
}

impl FurniturePlace {
    /// Turned to the left by twice the angle of this tangent: sine and cosine without either function.
    fn turned(self, half_angle_tangent: f32) -> Self {
        let square = half_angle_tangent * half_angle_tangent;
        Self { turn: ((1.0 - square) / (1.0 + square), 2.0 * half_angle_tangent / (1.0 + square)), ..self }
    }
}

fn finish(label: u8, material: Material) -> Finish {
    Finish { label, material }
}

struct Room {
    solids: Vec<Solid>,
    seed: u32,
}

impl Room {
    /// -1 to 1, another for each `what`.
    fn chance(&self, what: u32) -> f32 {
        2.0 * unit(self.seed, what) - 1.0
    }

    /// A color that differs a little from seed to seed.
    fn dyed(&self, what: u32, r: f32, g: f32, b: f32) -> Reflectance {
        let by = |i| 1.0 + 0.25 * self.chance(100 + 3 * what + i);
        Reflectance::new(r * by(0), g * by(1), b * by(2))
    }

    fn put(&mut self, place: FurniturePlace, shape: Shape, x: f32, y: f32, z: f32, faces: [Finish; FACES]) {
        let mut solid = Solid { shape, center: place.at, turn: place.turn, faces };
        solid.center = solid.room_point(Vec3::new(x, y, z));
        self.solids.push(solid);
    }

    /// A cuboid over the rectangle from `min` to `max`, between two heights.
    fn block(
        &mut self,
        place: FurniturePlace,
        min: (f32, f32),
        max: (f32, f32),
        height: (f32, f32),
        faces: [Finish; FACES],
    ) {
        let half = Vec3::new(max.0 - min.0, max.1 - min.1, height.1 - height.0) * 0.5;
        let (x, y) = ((min.0 + max.0) * 0.5, (min.1 + max.1) * 0.5);
        self.put(place, Shape::Cuboid { half }, x, y, (height.0 + height.1) * 0.5, faces);
    }

    fn post(&mut self, place: FurniturePlace, at: (f32, f32), height: (f32, f32), radius: f32, of: Finish) {
        let shape = Shape::Cylinder { radius, half_height: (height.1 - height.0) * 0.5 };
        self.put(place, shape, at.0, at.1, (height.0 + height.1) * 0.5, [of; FACES]);
    }

    fn ball(&mut self, place: FurniturePlace, at: (f32, f32, f32), radius: f32, of: Finish) {
        self.put(place, Shape::Ball { radius }, at.0, at.1, at.2, [of; FACES]);
    }

    fn window(&mut self) {
        let (width, height) = WINDOW_SIZE;
        let pane = finish(class::WINDOW, Material::Window { width, height });
        let mut faces = [finish(class::WINDOW, WHITE_PAINT); FACES];
        faces[1] = pane;
        let (bottom, top) = (WINDOW.z - height / 2.0, WINDOW.z + height / 2.0);
        self.block(at(0.0, WINDOW.y), (0.0, -width / 2.0), (0.03, width / 2.0), (bottom, top), faces);
        let sill = [finish(class::WINDOW, WHITE_PAINT); FACES];
        self.block(at(0.0, WINDOW.y), (0.0, -1.05), (0.16, 1.05), (bottom - 0.05, bottom), sill);
    }

    fn ceiling_lamp(&mut self) {
        let glass = finish(class::OBJECTS, Material::Glow(Reflectance::new(1.0, 0.93, 0.78)));
        let cord = finish(class::OBJECTS, BLACK_PAINT);
        let lamp = at(LAMP.x, LAMP.y);
        self.post(lamp, (0.0, 0.0), (LAMP.z + 0.08, SIZE.z), 0.012, cord);
        self.post(lamp, (0.0, 0.0), (LAMP.z - 0.08, LAMP.z + 0.08), LAMP_RADIUS, glass);
    }

    fn bed(&mut self) {
        let place = at(0.12, 4.15 + 0.1 * self.chance(1));
        let frame = [finish(class::BED, WALNUT); FACES];
        let blanket = [finish(class::BED, Material::Fabric(self.dyed(1, 0.16, 0.24, 0.46))); FACES];
        let sheet = [finish(class::BED, Material::Fabric(Reflectance::new(0.66, 0.64, 0.60))); FACES];
        let pillow = [finish(class::OBJECTS, Material::Fabric(Reflectance::new(0.74, 0.70, 0.62))); FACES];
        self.block(place, (0.0, 0.0), (1.45, 1.92), (0.06, 0.30), frame);
        self.block(place, (0.0, 1.86), (1.45, 1.92), (0.30, 0.95), frame);
        self.block(place, (0.03, 0.03), (1.42, 1.85), (0.30, 0.50), sheet);
        self.block(place, (0.01, 0.01), (1.44, 1.25), (0.31, 0.54), blanket);
        self.block(place, (0.12, 1.42), (0.66, 1.80), (0.50, 0.63), pillow);
        self.block(place, (0.78, 1.42), (1.32, 1.80), (0.50, 0.63), pillow);
    }

    fn television(&mut self) {
        let place = at(2.75 + 0.15 * self.chance(2), SIZE.y);
        let cabinet = [finish(class::FURNITURE, OAK); FACES];
        let (width, height) = (1.25, 0.72);
        let mut faces = [finish(class::TV, BLACK_PAINT); FACES];
        faces[2] = finish(class::TV, Material::Screen { width, height });
        self.block(place, (-0.85, -0.48), (0.85, -0.02), (0.08, 0.50), cabinet);
        self.block(place, (-0.80, -0.44), (0.80, -0.06), (0.0, 0.08), cabinet);
        self.block(place, (-0.2, -0.36), (0.2, -0.14), (0.50, 0.53), [finish(class::TV, BLACK_PAINT); FACES]);
        self.block(
            place,
            (-0.04, -0.25),
            (0.04, -0.2),
            (0.53, 0.62),
            [finish(class::TV, BLACK_PAINT); FACES],
        );
        self.block(place, (-width / 2.0, -0.25), (width / 2.0, -0.19), (0.60, 0.60 + height), faces);
        let speaker = [finish(class::OBJECTS, BLACK_PAINT); FACES];
        self.block(place, (0.68, -0.34), (0.80, -0.18), (0.50, 0.72), speaker);
    }

    fn bookshelf(&mut self) {
        const SHELVES: u8 = 5;
        const SPACING: f32 = 0.40;
        let place = at(SIZE.x, 4.55 + 0.1 * self.chance(3));
        let wood = [finish(class::FURNITURE, OAK); FACES];
        let top = f32::from(SHELVES) * SPACING;
        self.block(place, (-0.34, 0.0), (-0.02, 0.03), (0.0, top + 0.03), wood);
        self.block(place, (-0.34, 1.27), (-0.02, 1.30), (0.0, top + 0.03), wood);
        self.block(place, (-0.04, 0.03), (-0.02, 1.27), (0.0, top), wood);
        for shelf in 0..=SHELVES {
            let z = f32::from(shelf) * SPACING;
            self.block(place, (-0.34, 0.03), (-0.04, 1.27), (z, z + 0.03), wood);
        }
        for shelf in 0..SHELVES {
            let seed = self.seed.wrapping_add(u32::from(shelf));
            let spines = Material::Books { height: 0.30, seed };
            let end = 1.22 - 0.35 * unit(seed, 4);
            let z = f32::from(shelf) * SPACING + 0.03;
            self.block(
                place,
                (-0.30, 0.05),
                (-0.05, end),
                (z, z + 0.29),
                [finish(class::BOOKS, spines); FACES],
            );
        }
        let vase = finish(class::OBJECTS, Material::Paint(self.dyed(3, 0.55, 0.30, 0.08)));
        self.ball(place, (-0.19, 0.5, top + 0.15), 0.12, vase);
    }

    fn sofa(&mut self) {
        let place = at(SIZE.x - 0.08, 2.15 + 0.1 * self.chance(4));
        let cloth = self.dyed(4, 0.42, 0.13, 0.12);
        let body = [finish(class::SOFA, Material::Fabric(cloth)); FACES];
        let seat = [finish(class::SOFA, Material::Fabric(cloth * 1.2)); FACES];
        let cushion = [finish(class::OBJECTS, Material::Fabric(self.dyed(5, 0.62, 0.50, 0.14))); FACES];
        self.block(place, (-0.95, 0.0), (0.0, 1.85), (0.08, 0.30), body);
        self.block(place, (-0.25, 0.0), (0.0, 1.85), (0.30, 0.85), body);
        self.block(place, (-0.95, 0.0), (-0.25, 0.20), (0.30, 0.60), body);
        self.block(place, (-0.95, 1.65), (-0.25, 1.85), (0.30, 0.60), body);
        self.block(place, (-0.93, 0.21), (-0.25, 0.92), (0.30, 0.44), seat);
        self.block(place, (-0.93, 0.93), (-0.25, 1.64), (0.30, 0.44), seat);
        self.block(place, (-0.42, 1.15), (-0.27, 1.60), (0.45, 0.82), cushion);
    }

    fn table(&mut self) {
        let place = at(2.35 + 0.1 * self.chance(6), 3.55 + 0.1 * self.chance(7)).turned(0.06);
        let rug = Material::Stripes(self.dyed(6, 0.46, 0.40, 0.30), Reflectance::new(0.16, 0.20, 0.24));
        self.block(place, (-1.1, -0.85), (1.1, 0.85), (0.0, 0.012), [finish(class::FLOOR, rug); FACES]);
        let oak = finish(class::TABLE, OAK);
        self.block(place, (-0.65, -0.42), (0.65, 0.42), (0.70, 0.74), [oak; FACES]);
        for (x, y) in [(-0.58, -0.35), (0.58, -0.35), (-0.58, 0.35), (0.58, 0.35)] {
            self.post(place, (x, y), (0.012, 0.70), 0.03, oak);
        }
        let china = finish(class::OBJECTS, Material::Paint(Reflectance::new(0.20, 0.36, 0.50)));
        let orange = finish(class::OBJECTS, Material::Paint(Reflectance::new(0.80, 0.34, 0.04)));
        let mug = finish(class::OBJECTS, Material::Paint(Reflectance::new(0.58, 0.06, 0.07)));
        self.post(place, (0.30, 0.10), (0.74, 0.98), 0.055, china);
        self.ball(place, (0.30, 0.10, 1.02), 0.085, finish(class::OBJECTS, Material::Leaves));
        self.ball(place, (-0.15, 0.05, 0.785), 0.045, orange);
        self.ball(place, (-0.06, 0.09, 0.785), 0.045, orange);
        self.post(place, (-0.38, -0.15), (0.74, 0.83), 0.04, mug);
        let book = [finish(class::BOOKS, Material::Paint(self.dyed(8, 0.10, 0.28, 0.16))); FACES];
        self.block(place, (0.0, -0.30), (0.24, -0.12), (0.74, 0.775), book);
    }

    fn chairs(&mut self) {
        let black = self.dyed(9, 0.06, 0.06, 0.07);
        self.chair(at(1.35 + 0.05 * self.chance(8), 3.35).turned(-0.45), OAK, Material::Fabric(black));
        let green = self.dyed(10, 0.10, 0.24, 0.16);
        self.chair(at(2.75, 2.75 + 0.05 * self.chance(9)).turned(0.12), WALNUT, Material::Fabric(green));
    }

    /// A chair whose back is towards its place's -y.
    fn chair(&mut self, place: FurniturePlace, wood: Material, cloth: Material) {
        let (wood, cloth) = (finish(class::CHAIR, wood), finish(class::CHAIR, cloth));
        self.block(place, (-0.22, -0.22), (0.22, 0.22), (0.42, 0.47), [cloth; FACES]);
        self.block(place, (-0.22, -0.24), (0.22, -0.20), (0.62, 0.92), [wood; FACES]);
        for (x, y, top) in
            [(-0.19, -0.22, 0.90), (0.19, -0.22, 0.90), (-0.19, 0.19, 0.42), (0.19, 0.19, 0.42)]
        {
            self.post(place, (x, y), (0.0, top), 0.02, wood);
        }
    }

    fn plant(&mut self) {
        let place = at(0.45, 1.75 + 0.1 * self.chance(10));
        let pot = finish(class::OBJECTS, Material::Paint(Reflectance::new(0.48, 0.20, 0.10)));
        let leaves = finish(class::OBJECTS, Material::Leaves);
        self.post(place, (0.0, 0.0), (0.0, 0.34), 0.17, pot);
        self.post(place, (0.0, 0.0), (0.34, 0.70), 0.02, finish(class::OBJECTS, WALNUT));
        for (x, y, z, radius) in [(0.0, 0.0, 0.86, 0.22), (0.13, 0.08, 0.68, 0.14), (-0.10, 0.10, 1.05, 0.15)]
        {
            self.ball(place, (x, y, z), radius, leaves);
        }
    }

    fn floor_lamp(&mut self) {
        let place = at(4.05 + 0.1 * self.chance(11), 5.75);
        let metal = finish(class::OBJECTS, BLACK_PAINT);
        let shade = finish(class::OBJECTS, Material::Glow(Reflectance::new(0.93, 0.70, 0.38)));
        self.post(place, (0.0, 0.0), (0.0, 0.03), 0.14, metal);
        self.post(place, (0.0, 0.0), (0.03, 1.35), 0.012, metal);
        self.post(place, (0.0, 0.0), (1.35, 1.62), 0.16, shade);
    }

    fn pictures(&mut self) {
        let seed = self.seed;
        let side = finish(class::PICTURE, WALNUT);
        let canvas = |width, height, seed| finish(class::PICTURE, Material::Painting { width, height, seed });
        let mut faces = [side; FACES];
        faces[2] = canvas(0.95, 0.65, seed);
        self.block(at(0.35, SIZE.y), (0.0, -0.03), (0.95, 0.0), (1.35, 2.0), faces);
        faces[2] = canvas(0.42, 0.55, seed ^ 7);
        self.block(at(4.35, SIZE.y), (0.0, -0.03), (0.42, 0.0), (1.75, 2.30), faces);
        faces = [side; FACES];
        faces[0] = canvas(1.1, 0.75, seed ^ 9);
        self.block(at(SIZE.x, 2.6), (-0.03, 0.0), (0.0, 1.1), (1.30, 2.05), faces);
    }
}

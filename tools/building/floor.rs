//! A floor: its units one after the other, each with objects named for it.

use clerestory::base::Result;

use super::canvas::{Canvas, Facing};
use super::furniture;
use super::lamp;
use super::material::Material;
use super::obj::{Counts, Obj};
use super::place::Place;
use super::plan::{BAY, CORRIDORS, Core, HEIGHT, Plan, Row, STOREY, WALL};
use super::random::Random;
use super::room::{self, Behind, Corner, INSIDE};
use super::wall::wall;
use super::{atrium, corridor, stairs};

/// What a floor is among others.
#[derive(Clone, Copy, Debug)]
pub struct Level {
    /// From 0.
    pub number: usize,
    /// Nothing is below.
    pub is_ground: bool,
    /// Nothing is above.
    pub is_top: bool,
    /// Rooms are furnished, and light comes from luminaires.
    pub is_furnished: bool,
    /// Of all that is drawn by lot.
    pub seed: u64,
}

/// Draws a floor into its file; what was drawn.
pub fn draw(obj: Obj, plan: &Plan, level: Level) -> Result<Counts> {
    let mut floor = Floor { obj, plan, level, rooms: 0 };
    for bay in 0..plan.bays {
        for (name, y) in ["south", "north"].into_iter().zip(CORRIDORS) {
            let (prefix, is_furnished) = (format!("corridor_{name}_{bay}"), level.is_furnished);
            corridor::draw(&mut floor.building(&prefix), plan.bay(bay), y, is_furnished);
        }
        floor.room(Row::SouthOuter, bay);
        floor.core(bay);
        floor.room(Row::NorthOuter, bay);
    }
    atrium::draw(&mut floor.building("atrium"), plan, level);
    corridor::gables(&mut floor.building("building"), plan);
    floor.obj.finish()
}

struct Floor<'a> {
    obj: Obj,
    plan: &'a Plan,
    level: Level,
    /// Drawn so far.
    rooms: usize,
}

impl Floor<'_> {
    fn z(&self) -> f64 {
        self.level.number as f64 * STOREY
    }

    /// A canvas in the building's frame at the floor's height.
    fn building<'a>(&'a mut self, prefix: &'a str) -> Canvas<'a> {
        let place = Place::new(0.0, 0.0, self.z());
        Canvas::new(&mut self.obj, place, prefix)
    }

    fn core(&mut self, bay: usize) {
        match self.plan.core(bay) {
            Core::Stairs => {
                let (south, north) = (Row::SouthInner.place(bay, self.z()), Row::NorthInner.place(bay, self.z()));
                stairs::draw(&mut Canvas::new(&mut self.obj, south, "stairs"), self.level);
                let canvas = &mut Canvas::new(&mut self.obj, north, "stairs");
                wall(canvas, ("wall_far", Material::Plaster), (Facing::South, -WALL), ([0.0, BAY], [0.0, HEIGHT]), &[]);
            }
            Core::TwoRooms => {
                self.room(Row::SouthInner, bay);
                self.room(Row::NorthInner, bay);
            }
            Core::DeepRoom => self.room(Row::SouthInner, bay),
            Core::Atrium => {}
        }
    }

    fn room(&mut self, row: Row, bay: usize) {
        self.rooms += 1;
        let behind = self.behind(row, bay);
        let prefix = format!("room_{:03}", self.rooms);
        let place = row.place(bay, self.z());
        let canvas = &mut Canvas::new(&mut self.obj, place, &prefix);
        room::draw(canvas, behind);
        let rows = if behind == Behind::Room { 1 } else { 2 };
        lamp::panels(canvas, self.level.is_furnished, (INSIDE, [0.0, behind.depth()]), [2, rows]);
        if self.level.is_furnished {
            furniture::draw(canvas, behind, &mut Random::new(self.level.seed, self.level.number, self.rooms));
        }
    }

    fn behind(&self, row: Row, bay: usize) -> Behind {
        let is_outer = matches!(row, Row::SouthOuter | Row::NorthOuter);
        if !is_outer {
            return if self.plan.core(bay) == Core::DeepRoom { Behind::Corridor } else { Behind::Room };
        }
        // Units of the south look the other way along the building.
        let ends = if row == Row::NorthOuter { [0, self.plan.bays - 1] } else { [self.plan.bays - 1, 0] };
        Behind::Facade(if bay == ends[0] {
            Corner::Low
        } else if bay == ends[1] {
            Corner::High
        } else {
            Corner::No
        })
    }
}

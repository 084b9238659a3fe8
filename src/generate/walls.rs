//! Rooms of solid walls with rectangular openings.

use glam::Vec3;

use super::build::Builder;

/// A rectangle cut out of a wall, in the wall's own coordinates: along it, and up from the floor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Opening {
    /// Lowest corner (along, up).
    pub low: [f32; 2],
    /// Highest corner (along, up).
    pub high: [f32; 2],
}

/// A box-shaped room: inner corners and wall thickness.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Room {
    /// Inner corner of lowest coordinates; its y is the floor.
    pub low: Vec3,
    /// Inner corner of highest coordinates; its y is the ceiling.
    pub high: Vec3,
    /// Thickness of walls, floor and ceiling.
    pub wall: f32,
}

/// One of the four walls, by the direction that it lies in.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Side {
    /// Towards −x; its openings run along z.
    West,
    /// Towards +x; its openings run along z.
    East,
    /// Towards −z; its openings run along x.
    North,
    /// Towards +z; its openings run along x.
    South,
}

impl Side {
    /// All four.
    pub const ALL: [Self; 4] = [Self::West, Self::East, Self::North, Self::South];

    /// The unit vector out of the room.
    pub fn outwards(self) -> Vec3 {
        match self {
            Self::West => Vec3::NEG_X,
            Self::East => Vec3::X,
            Self::North => Vec3::NEG_Z,
            Self::South => Vec3::Z,
        }
    }
}

impl Room {
    /// Floor and ceiling, wide enough to close the corners.
    pub fn add_floor_and_ceiling(&self, builder: &mut Builder, floor: &str, ceiling: &str) {
        let flat = Vec3::new(self.wall, 0.0, self.wall);
        let (low, high) = (self.low - flat, self.high + flat);
        builder.add_block("floor", Vec3::new(low.x, low.y - self.wall, low.z), Vec3::new(high.x, low.y, high.z), floor);
        builder.add_block(
            "ceiling",
            Vec3::new(low.x, high.y, low.z),
            Vec3::new(high.x, high.y + self.wall, high.z),
            ceiling,
        );
    }

    /// One wall, as blocks around its openings. Openings must lie side by side, within the wall, in rising order.
    pub fn add_wall(&self, builder: &mut Builder, side: Side, openings: &[Opening], material: &str) {
        let [start, end] = self.along(side);
        let (floor, ceiling) = (self.low.y, self.high.y);
        // Corners belong to the walls of one axis only; the other two would otherwise have faces in the same plane.
        let reach = if matches!(side, Side::North | Side::South) { self.wall } else { 0.0 };
        let mut from = start - reach;
        for opening in openings {
            self.block(builder, side, [from, floor], [opening.low[0], ceiling], material);
            self.block(builder, side, [opening.low[0], floor], [opening.high[0], opening.low[1]], material);
            self.block(builder, side, [opening.low[0], opening.high[1]], [opening.high[0], ceiling], material);
            from = opening.high[0];
        }
        self.block(builder, side, [from, floor], [end + reach, ceiling], material);
    }

    /// First and last inner coordinate along a wall.
    pub fn along(&self, side: Side) -> [f32; 2] {
        match side {
            Side::West | Side::East => [self.low.z, self.high.z],
            Side::North | Side::South => [self.low.x, self.high.x],
        }
    }

    /// The point of a wall's inner face at (along, up).
    pub fn on_wall(&self, side: Side, [along, up]: [f32; 2]) -> Vec3 {
        match side {
            Side::West => Vec3::new(self.low.x, up, along),
            Side::East => Vec3::new(self.high.x, up, along),
            Side::North => Vec3::new(along, up, self.low.z),
            Side::South => Vec3::new(along, up, self.high.z),
        }
    }

    fn block(&self, builder: &mut Builder, side: Side, from: [f32; 2], to: [f32; 2], material: &str) {
        if to[0] - from[0] <= 0.0 || to[1] - from[1] <= 0.0 {
            return;
        }
        let inner = self.on_wall(side, from);
        let outer = self.on_wall(side, to) + side.outwards() * self.wall;
        builder.add_block("wall", inner.min(outer), inner.max(outer), material);
    }
}

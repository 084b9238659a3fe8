//! Elements of the hierarchy: nodes with eight children and packets of four triangles, both one array per coordinate, so that a
//! vector instruction works on all of them. Packets of eight are no faster and stay emptier.

use glam::Vec3;

/// Children of a node.
pub const WIDTH: usize = 8;
/// Triangles of a packet.
pub const LANES: usize = 4;

/// A reference to a node, a packet, or another primitive.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Child(pub u32);

/// The target of a [`Child`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// Index of a node.
    Node(usize),
    /// Index of a packet.
    Packet(usize),
    /// Index of a primitive that is not a triangle.
    Other(usize),
}

impl Child {
    const LEAF: u32 = 1 << 31;
    const OTHER: u32 = 1 << 30;
    /// No child: an index that no primitive has, in a box that no ray meets.
    pub const EMPTY: Self = Self(u32::MAX);

    /// The node at `index`, below 2³¹.
    pub fn node(index: usize) -> Self {
        Self(index as u32)
    }

    /// The packet at `index`, below 2³⁰.
    pub fn packet(index: usize) -> Self {
        Self(index as u32 | Self::LEAF)
    }

    /// The other primitive at `index`, below 2³⁰ − 1.
    pub fn other(index: usize) -> Self {
        Self(index as u32 | Self::LEAF | Self::OTHER)
    }

    /// The same reference once its target follows `nodes` and `packets` others.
    pub fn moved(self, nodes: usize, packets: usize) -> Self {
        match self.kind() {
            Kind::Node(index) => Self::node(index + nodes),
            Kind::Packet(index) => Self::packet(index + packets),
            Kind::Other(_) => self,
        }
    }

    /// The node, packet or primitive that this refers to.
    #[inline(always)]
    pub fn kind(self) -> Kind {
        if self.0 & Self::LEAF == 0 {
            Kind::Node(self.0 as usize)
        } else if self.0 & Self::OTHER == 0 {
            Kind::Packet((self.0 & !Self::LEAF) as usize)
        } else {
            Kind::Other((self.0 & !(Self::LEAF | Self::OTHER)) as usize)
        }
    }
}

/// A node with up to eight children.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(C, align(32))]
pub struct Node {
    /// Lower x, y, z, then upper x, y, z of each child's box; inverted and infinite where there is no child.
    pub planes: [[f32; WIDTH]; 6],
    /// The children.
    pub children: [Child; WIDTH],
}

impl Node {
    /// A node without children.
    pub const EMPTY: Self = {
        let (low, high) = ([f32::INFINITY; WIDTH], [f32::NEG_INFINITY; WIDTH]);
        Self { planes: [low, low, low, high, high, high], children: [Child::EMPTY; WIDTH] }
    };

    /// Sets the child in a slot and the corners of its box.
    pub fn set(&mut self, slot: usize, child: Child, low: Vec3, high: Vec3) {
        self.children[slot] = child;
        for axis in 0..3 {
            self.planes[axis][slot] = low[axis];
            self.planes[3 + axis][slot] = high[axis];
        }
    }

    /// The same node with the child of slot `from[i]` in slot i.
    pub fn permuted(&self, from: [usize; WIDTH]) -> Self {
        Self {
            planes: self.planes.map(|plane| from.map(|slot| plane[slot])),
            children: from.map(|slot| self.children[slot]),
        }
    }
}

/// Up to four triangles.
#[derive(Debug, Clone, Copy)]
#[repr(C, align(16))]
pub struct Packet {
    /// Coordinates by vertex, axis and triangle; NaN where there is no triangle, which no test takes for a hit.
    pub vertices: [[[f32; LANES]; 3]; 3],
    /// Shape of each triangle.
    pub shapes: [u32; LANES],
    /// Index of each triangle in its mesh.
    pub triangles: [u32; LANES],
}

impl Packet {
    /// A packet without triangles.
    pub const EMPTY: Self =
        Self { vertices: [[[f32::NAN; LANES]; 3]; 3], shapes: [u32::MAX; LANES], triangles: [u32::MAX; LANES] };

    /// Sets the triangle in a slot.
    pub fn set(&mut self, slot: usize, triangle: &Triangle) {
        for (coordinates, vertex) in self.vertices.iter_mut().zip(triangle.vertices) {
            for axis in 0..3 {
                coordinates[axis][slot] = vertex[axis];
            }
        }
        self.shapes[slot] = triangle.shape;
        self.triangles[slot] = triangle.index;
    }

    /// Whether a triangle is in one of the slots.
    pub fn holds(&self, triangle: &Triangle) -> bool {
        self.shapes.iter().zip(&self.triangles).any(|held| held == (&triangle.shape, &triangle.index))
    }

    /// The vertices of the triangle in a slot.
    #[inline]
    pub fn triangle(&self, slot: usize) -> [Vec3; 3] {
        self.vertices.map(|[x, y, z]| Vec3::new(x[slot], y[slot], z[slot]))
    }
}

/// A triangle with its place in the scene.
#[derive(Debug, Clone, Copy)]
pub struct Triangle {
    /// Corners.
    pub vertices: [Vec3; 3],
    /// Index of the shape.
    pub shape: u32,
    /// Index in the shape's mesh.
    pub index: u32,
}

//! Guiding by complete paths (Reibold, Hanika, Jung and Dachsbacher 2018, *Selective Guided Sampling with Complete Light Transport Paths*).
//!
//! Paths that a path tracer finds too rarely are kept. Around each a Gaussian is placed in the picture, and around each of its further
//! vertices one that is conditional on the vertex before; new paths are drawn from all of them together. Nothing is learned of the rest of
//! the paths, which the path tracer draws well enough.
//!
//! - [`path`]: a complete path, and the kinds of paths that are compared with one another.
//! - [`kernel`]: the Gaussian of a vertex given the one before, [`spatial`]: the same in media, [`transition`]: either of them;
//!   [`neighbours`]: the paths that they are made of.
//! - [`tiles`]: which kept paths may have drawn a place in the picture.
//! - [`guide`]: all kept paths as a density that is drawn from; [`cache`]: the kept paths while they are learned.
//!
//! Densities of paths are with respect to area of the picture, in pixels, times the solid angles of all directions from vertex to vertex, times
//! the distances to vertices in media; that of a delta lobe is its probability. All techniques have the same measure, so no Jacobian between
//! surfaces remains: eq. 7's factor G(x, x_v) / G(x, x') is the change from area to solid angle at x' and back at x_v.

pub mod cache;
pub mod guide;
pub mod kernel;
pub mod neighbours;
pub mod path;
pub mod spatial;
pub mod tiles;
pub mod transition;

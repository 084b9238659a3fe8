//! Materials: how surfaces scatter light, and the textures that vary it.

pub mod image;
pub mod texture;

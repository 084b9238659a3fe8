//! The effects that the tracers' loops are compiled for.
//!
//! Effects that a scene does not need must not cost anything, so the tracers' loops are compiled several times: the code of an
//! effect is there only where its constant is true. [`Needs`] says which of them a scene takes.

/// The effects that a scene needs beyond plain diffuse surfaces and lights.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Needs {
    /// Materials other than plain diffuse ones, holes, bumps.
    pub materials: bool,
    /// Participating media or their borders.
    pub media: bool,
}

/// The effects that a loop is compiled with.
pub trait Effects {
    /// Guided directions.
    const GUIDING: bool;
    /// Materials other than plain diffuse ones, holes, bumps.
    const MATERIALS: bool;
    /// Participating media.
    const MEDIA: bool;
}

/// A set of effects, fixed at compile time.
pub struct With<const GUIDING: bool, const MATERIALS: bool, const MEDIA: bool>;

/// All effects.
pub type Everything = With<true, true, true>;

impl<const GUIDING: bool, const MATERIALS: bool, const MEDIA: bool> Effects for With<GUIDING, MATERIALS, MEDIA> {
    const GUIDING: bool = GUIDING;
    const MATERIALS: bool = MATERIALS;
    const MEDIA: bool = MEDIA;
}

//! Everything that is sampled follows its density, against quadrature and against second implementations.

#[path = "../support/mod.rs"]
#[allow(dead_code, reason = "no unit of tests needs all of it")]
mod support;

mod guides;
mod lights;
mod materials;
mod oracle;
mod oracle_materials;
mod oracle_principled;
mod values;

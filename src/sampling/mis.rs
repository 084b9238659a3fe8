//! Multiple importance sampling (Veach and Guibas 1995).

/// Balance heuristic weight of the strategy with density `p` against one with density `q`, one sample each.
/// Both in the same measure; 0 where `p` is 0.
pub fn balance(p: f32, q: f32) -> f32 {
    if p > 0.0 { if p.is_infinite() { 1.0 } else { p / (p + q) } } else { 0.0 }
}

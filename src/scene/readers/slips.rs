//! Slips of the pen in names.

/// The name in `known` that `name` is, whatever its capitals and underscores: `toWorld` is `to_world`.
pub fn same<'k>(name: &str, known: &[&'k str]) -> Option<&'k str> {
    let exact = known.iter().find(|other| **other == name);
    exact.or_else(|| known.iter().find(|other| bare(other) == bare(name))).copied()
}

fn bare(name: &str) -> String {
    name.replace(['_', '-', ' '], "").to_ascii_lowercase()
}

/// The name in `known` that `name` seems to be a slip of: other capitals or underscores, or few letters wrong, left out, added or
/// exchanged: none in names of up to three letters, two in those of eight and more, else one. A name in `known` is no slip.
pub fn meant<'k>(name: &str, known: &[&'k str]) -> Option<&'k str> {
    if known.contains(&name) {
        return None;
    }
    let wrong = |near: &str| {
        // Far longer names need not be compared letter by letter.
        if name.len().abs_diff(near.len()) > 2 {
            return usize::MAX;
        }
        strsim::osa_distance(name, near)
    };
    let most = |near: &str| match near.len().min(name.len()) {
        ..4 => 0,
        4..8 => 1,
        _ => 2,
    };
    let same = known.iter().find(|near| bare(near) == bare(name));
    let near = || known.iter().filter(|near| wrong(near) <= most(near)).min_by_key(|near| wrong(near));
    same.or_else(near).copied()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_in_any_case() {
        let known = ["to_world", "int_ior", "fov"];
        for (name, found) in [("toWorld", "to_world"), ("intIOR", "int_ior"), ("FOV", "fov"), ("to_world", "to_world")]
        {
            assert_eq!(same(name, &known), Some(found));
        }
        assert_eq!(same("to_wolrd", &known), None);
    }

    #[test]
    fn slips_are_told_from_other_names() {
        let known = ["reflectance", "alpha", "to_world", "int_ior", "fov", "k"];
        for (name, near) in [
            ("reflectence", "reflectance"),
            ("relfectance", "reflectance"),
            ("Reflectance", "reflectance"),
            ("toWorld", "to_world"),
            ("intIOR", "int_ior"),
            ("aplha", "alpha"),
            ("alphas", "alpha"),
            ("FOV", "fov"),
        ] {
            assert_eq!(meant(name, &known), Some(near), "{name}");
        }
        for name in ["alpha_u", "specular_reflectance", "ext_ior", "fox", "g", "material", "", "k", "sampling_weight"] {
            assert_eq!(meant(name, &known), None, "{name}");
        }
    }
}

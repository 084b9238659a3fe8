//! Scene files and meshes as text that a person can read and edit.

use std::fmt::Write;

use crate::base::{Error, Result};
use crate::geometry::mesh::Mesh;
use crate::scene::file::SceneFile;

/// A scene file as JSON with every list of numbers on one line.
///
/// # Errors
/// [`Error::Options`] where the scene cannot be encoded.
pub fn json(scene: &SceneFile) -> Result<String> {
    let pretty =
        serde_json::to_string_pretty(scene).map_err(|e| Error::Options(format!("the scene cannot be encoded: {e}")))?;
    let mut text = String::with_capacity(pretty.len());
    let mut lines = pretty.lines().peekable();
    while let Some(line) = lines.next() {
        text.push_str(line);
        while line.ends_with('[') && lines.peek().is_some_and(|next| is_number(next)) {
            let number = lines.next().unwrap_or_default().trim();
            text.push_str(number);
            if number.ends_with(',') {
                text.push(' ');
            } else if let Some(end) = lines.next() {
                text.push_str(end.trim());
            }
        }
        text.push('\n');
    }
    Ok(text)
}

fn is_number(line: &str) -> bool {
    line.trim_start().starts_with(|c: char| c.is_ascii_digit() || c == '-')
}

/// A mesh as Wavefront OBJ, coordinates rounded to six decimals.
pub fn obj(mesh: &Mesh) -> String {
    let mut text = String::new();
    for (key, points) in [("v", &mesh.positions), ("vn", &mesh.normals)] {
        for p in points {
            let [x, y, z] = p.to_array().map(rounded);
            // Writing to a string cannot fail.
            let _ = writeln!(text, "{key} {x} {y} {z}");
        }
    }
    for triangle in &mesh.triangles {
        let [a, b, c] =
            triangle.map(|i| if mesh.normals.is_empty() { format!("{}", i + 1) } else { format!("{0}//{0}", i + 1) });
        let _ = writeln!(text, "f {a} {b} {c}");
    }
    text
}

/// Rounds to six decimals, so that a file does not depend on the last bit of a sine; −0 becomes 0.
pub fn rounded(x: f32) -> f32 {
    (f64::from(x) * 1e6).round() as f32 / 1e6 + 0.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn json_is_compact_and_means_the_same() {
        let scene = crate::generate::scene(crate::generate::Family::Caustics, 3, [8, 8]);
        let text = json(&scene).unwrap();
        assert_eq!(serde_json::from_str::<SceneFile>(&text).unwrap(), scene);
        assert!(text.lines().filter(|l| l.trim_end().ends_with("],")).all(|l| l.contains('[') || l.trim() == "],"));
    }
}

//! Extensions that a document uses: which are read, and what becomes of the others.

use crate::base::Result;

use super::document::Document;
use super::warnings::Warnings;

/// Extensions that are read, at least in part.
const READ: [&str; 16] = [
    "EXT_mesh_gpu_instancing",
    "EXT_texture_webp",
    "KHR_lights_punctual",
    "KHR_materials_anisotropy",
    "KHR_materials_clearcoat",
    "KHR_materials_emissive_strength",
    "KHR_materials_ior",
    "KHR_materials_pbrSpecularGlossiness",
    "KHR_materials_sheen",
    "KHR_materials_specular",
    "KHR_materials_transmission",
    "KHR_materials_unlit",
    "KHR_materials_volume",
    "KHR_mesh_quantization",
    "KHR_node_visibility",
    "KHR_texture_transform",
];

/// Checks the extensions of `document`, and warns of those that are used but not read.
///
/// # Errors
/// [`Error::Unsupported`](crate::base::Error::Unsupported) that names all extensions which are required but not read.
pub fn check(document: &Document, warnings: &mut Warnings) -> Result<()> {
    let unread = |names: &[String]| -> Vec<String> {
        let mut names: Vec<String> = names.iter().filter(|name| !READ.contains(&name.as_str())).cloned().collect();
        names.sort();
        names.dedup();
        names
    };
    let required = unread(&document.root.extensions_required);
    if !required.is_empty() {
        let plural = if required.len() == 1 { "extension" } else { "extensions" };
        let what = format!("the required {plural} {}", required.join(", "));
        return Err(document.unsupported("extensionsRequired", what, READ.join(", ")));
    }
    for name in unread(&document.root.extensions_used) {
        warnings.add("extensionsUsed", format_args!("the extension {name} is left out"));
    }
    Ok(())
}

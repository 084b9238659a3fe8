//! The hierarchy of nodes (specification, §3.5): which are in the scene, and where.

use ::gltf::json::scene::Node;
use glam::{DMat4, DQuat, DVec3};
use serde_json::Value;

use crate::base::Result;

use super::document::Document;
use super::warnings::Warnings;

/// Deepest nesting of nodes.
const MOST_NESTED: usize = 1024;

/// Scale of a direction that a node flattens, relative to its others.
const FLAT: f64 = 1e-4;

/// A node of the scene.
#[derive(Debug, Clone)]
pub struct Placed<'a> {
    /// Its index in the document.
    pub index: usize,
    /// The node.
    pub node: &'a Node,
    /// Node to world.
    pub to_world: DMat4,
}

impl Placed<'_> {
    /// Its part of the document, with its name if it has one.
    pub fn part(&self) -> String {
        match self.node.name.as_deref() {
            Some(name) if !name.is_empty() => format!("nodes[{}] \"{name}\"", self.index),
            _ => format!("nodes[{}]", self.index),
        }
    }
}

/// The nodes of the document's own scene, or else the first one, or else all that are no other's child; parents come first.
///
/// # Errors
/// [`Error::Malformed`](crate::base::Error::Malformed) for nodes that hold themselves, are nested too deep or are not there.
pub fn placed<'a>(document: &'a Document, warnings: &mut Warnings) -> Result<Vec<Placed<'a>>> {
    let mut walk = Walk { document, seen: vec![Seen::Not; document.root.nodes.len()], found: Vec::new() };
    let mut again = Vec::new();
    for index in roots(document, warnings)? {
        walk.visit(index, &mut again)?;
    }
    for index in again {
        warnings.add(format!("nodes[{index}]"), "the node has several parents: only the first counts");
    }
    Ok(walk.found)
}

fn roots(document: &Document, warnings: &mut Warnings) -> Result<Vec<usize>> {
    let root = &document.root;
    let scene = match (root.scene, root.scenes.first()) {
        (Some(index), _) => Some(document.item(&root.scenes, "scenes", index, "scene")?),
        (None, Some(first)) => Some(first),
        (None, None) => None,
    };
    if root.scenes.len() > 1 {
        let index = root.scene.map_or(0, |index| index.value());
        warnings.add("scenes", format_args!("only scenes[{index}] of {} scenes is read", root.scenes.len()));
    }
    if let Some(scene) = scene {
        return Ok(scene.nodes.iter().map(|index| index.value()).collect());
    }
    let mut is_child = vec![false; root.nodes.len()];
    for child in root.nodes.iter().flat_map(|node| node.children.iter().flatten()) {
        if let Some(is_child) = is_child.get_mut(child.value()) {
            *is_child = true;
        }
    }
    Ok((0..root.nodes.len()).filter(|&index| !is_child[index]).collect())
}

/// What is known of a node.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Seen {
    Not,
    /// It is above the node that is being visited.
    Above,
    Done,
}

/// A step of the walk.
enum Step {
    Enter { index: usize, depth: usize, parent: DMat4 },
    Leave(usize),
}

struct Walk<'a> {
    document: &'a Document,
    seen: Vec<Seen>,
    found: Vec<Placed<'a>>,
}

impl Walk<'_> {
    /// Visits a root and all below it. Nodes that have been visited are added to `again`.
    fn visit(&mut self, root: usize, again: &mut Vec<usize>) -> Result<()> {
        let mut steps = vec![Step::Enter { index: root, depth: 0, parent: DMat4::IDENTITY }];
        while let Some(step) = steps.pop() {
            let (index, depth, parent) = match step {
                Step::Enter { index, depth, parent } => (index, depth, parent),
                Step::Leave(index) => {
                    self.seen[index] = Seen::Done;
                    continue;
                }
            };
            let part = format!("nodes[{index}]");
            let node = self.document.at(&self.document.root.nodes, "nodes", index, "scenes")?;
            match self.seen[index] {
                Seen::Not => {}
                Seen::Above => return Err(self.document.malformed(part, "the node is inside itself")),
                Seen::Done => {
                    again.push(index);
                    continue;
                }
            }
            if depth == MOST_NESTED {
                return Err(self.document.malformed(part, format!("nodes more than {MOST_NESTED} deep")));
            }
            if is_hidden(node) {
                self.seen[index] = Seen::Done;
                continue;
            }
            let to_world = parent * local(node);
            self.found.push(Placed { index, node, to_world });
            self.seen[index] = Seen::Above;
            steps.push(Step::Leave(index));
            let children = node.children.iter().flatten().rev();
            steps.extend(children.map(|child| Step::Enter {
                index: child.value(),
                depth: depth + 1,
                parent: to_world,
            }));
        }
        Ok(())
    }
}

/// Whether a node is not shown with all below it (KHR_node_visibility).
fn is_hidden(node: &Node) -> bool {
    let given = node.extensions.as_ref().and_then(|extensions| extensions.others.get("KHR_node_visibility"));
    given.and_then(|given| given.get("visible")).and_then(Value::as_bool) == Some(false)
}

/// The transform of a node relative to its parent.
fn local(node: &Node) -> DMat4 {
    if let Some(matrix) = node.matrix {
        return DMat4::from_cols_array(&matrix.map(f64::from));
    }
    let vector = |given: Option<[f32; 3]>, default| given.map_or(default, |v| DVec3::from_array(v.map(f64::from)));
    let rotation = node.rotation.unwrap_or_default().0.map(f64::from);
    let rotation = DQuat::from_array(rotation);
    let rotation = if rotation.length_squared() > 0.0 { rotation.normalize() } else { DQuat::IDENTITY };
    let scale = vector(node.scale, DVec3::ONE);
    // What is flattened is thin: without an inverse it would have no normals.
    let least = FLAT * scale.abs().max_element();
    let scale = DVec3::select(scale.cmpeq(DVec3::ZERO), DVec3::splat(least), scale);
    DMat4::from_scale_rotation_translation(scale, rotation, vector(node.translation, DVec3::ZERO))
}

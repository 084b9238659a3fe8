//! The pose of a mesh: its morph targets (specification, §3.7.2.2) with the weights that the document gives, and its skin (§3.7.3) with
//! the joints where the nodes are.

use std::collections::BTreeMap;

use ::gltf::json::accessor::Type;
use ::gltf::json::mesh::{Primitive, Semantic};
use ::gltf::json::validation::Checked;
use glam::{DMat4, Mat3, Mat4, Vec3};

use crate::base::Result;

use super::accessor::Column;
use super::buffers::Buffers;
use super::document::Document;
use super::nodes::Placed;

/// How a node poses its mesh.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Pose {
    /// Weights of the morph targets.
    pub weights: Vec<f32>,
    /// For each joint the matrix from mesh to world; none without a skin.
    pub joints: Option<Vec<Mat4>>,
}

impl Pose {
    /// The pose of the mesh of `placed`, where the nodes of the scene are `at` these places.
    ///
    /// # Errors
    /// [`Error::Malformed`](crate::base::Error::Malformed) for a skin or its matrices that are not there.
    pub fn of(
        document: &Document,
        buffers: &Buffers<'_>,
        placed: &Placed,
        at: &BTreeMap<usize, DMat4>,
    ) -> Result<Self> {
        let mesh = placed.node.mesh.and_then(|index| document.root.meshes.get(index.value()));
        let weights = placed.node.weights.as_ref().or(mesh.and_then(|mesh| mesh.weights.as_ref()));
        let mut weights = weights.cloned().unwrap_or_default();
        if weights.iter().all(|&weight| weight == 0.0) {
            weights.clear();
        }
        let Some(index) = placed.node.skin else { return Ok(Self { weights, joints: None }) };
        let skin = document.item(&document.root.skins, "skins", index, &placed.part())?;
        let part = format!("skins[{}]", index.value());
        let inverses = match skin.inverse_bind_matrices {
            Some(accessor) => Some(Column::new(document, buffers, accessor, &part, &[Type::Mat4])?),
            None => None,
        };
        let mut joints = Vec::new();
        for (i, joint) in skin.joints.iter().enumerate() {
            let Some(to_world) = at.get(&joint.value()) else {
                return Err(document.malformed(part, format!("its joint nodes[{}] is not in the scene", joint.value())));
            };
            let inverse = match &inverses {
                Some(column) if i < column.count => Mat4::from_cols_array(&column.get::<16>(i)),
                _ => Mat4::IDENTITY,
            };
            joints.push((*to_world * inverse.as_dmat4()).as_mat4());
        }
        Ok(Self { weights, joints: Some(joints) })
    }

    /// Whether it leaves the mesh as it is.
    pub fn is_plain(&self) -> bool {
        *self == Self::default()
    }
}

/// The columns that a pose of one primitive needs.
pub struct Posed<'a> {
    targets: Vec<(f32, [Option<Column<'a>>; 2])>,
    joints: &'a [Mat4],
    influences: Vec<[Column<'a>; 2]>,
}

impl<'a> Posed<'a> {
    /// The primitive called `part` in this pose; its vertices number `count`.
    ///
    /// # Errors
    /// [`Error::Malformed`](crate::base::Error::Malformed) for columns that are not there or do not fit.
    pub fn new(
        document: &Document,
        buffers: &'a Buffers<'_>,
        primitive: &Primitive,
        pose: &'a Pose,
        part: &str,
        count: usize,
    ) -> Result<Self> {
        let open = |accessor, kinds: &[Type]| {
            let column = Column::new(document, buffers, accessor, part, kinds)?;
            if column.count != count {
                return Err(document.malformed(part, format!("{} elements for {count} vertices", column.count)));
            }
            Ok(column)
        };
        let mut targets = Vec::new();
        for (target, &weight) in primitive.targets.iter().flatten().zip(&pose.weights).filter(|(_, w)| **w != 0.0) {
            let column = |accessor: Option<_>| accessor.map(|accessor| open(accessor, &[Type::Vec3])).transpose();
            targets.push((weight, [column(target.positions)?, column(target.normals)?]));
        }
        let mut influences = Vec::new();
        if pose.joints.is_some() {
            for set in 0.. {
                let column = |semantic| primitive.attributes.get(&Checked::Valid(semantic)).copied();
                let (Some(joints), Some(weights)) = (column(Semantic::Joints(set)), column(Semantic::Weights(set)))
                else {
                    break;
                };
                influences.push([open(joints, &[Type::Vec4])?, open(weights, &[Type::Vec4])?]);
            }
        }
        Ok(Self { targets, joints: pose.joints.as_deref().unwrap_or_default(), influences })
    }

    /// Poses the position and normal of a vertex.
    pub fn apply(&self, vertex: usize, [mut position, mut normal]: [Vec3; 2]) -> [Vec3; 2] {
        for (weight, [positions, normals]) in &self.targets {
            let add = |column: &Option<Column>| column.as_ref().map_or(Vec3::ZERO, |c| Vec3::from_array(c.get(vertex)));
            position += *weight * add(positions);
            normal += *weight * add(normals);
        }
        let (mut sum, mut total) = (Mat4::ZERO, 0.0);
        for [joints, weights] in &self.influences {
            for (joint, weight) in joints.indices(vertex).into_iter().zip(weights.get::<4>(vertex)) {
                if let Some(matrix) = self.joints.get(joint as usize).filter(|_| weight > 0.0) {
                    sum += *matrix * weight;
                    total += weight;
                }
            }
        }
        if total > 0.0 {
            let matrix = sum * (1.0 / total);
            position = matrix.transform_point3(position);
            let linear = Mat3::from_mat4(matrix);
            let turned = if linear.determinant() == 0.0 { linear } else { linear.inverse().transpose() };
            normal = (turned * normal).normalize_or_zero();
        } else if let Some(first) = self.joints.first() {
            position = first.transform_point3(position);
        }
        [position, normal]
    }
}

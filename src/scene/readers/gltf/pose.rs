//! The pose of a mesh: its morph targets (specification, §3.7.2.2) with the weights that the document gives, and its skin (§3.7.3) with
//! the joints where the nodes are.

use std::collections::BTreeMap;
use std::sync::Arc;

use ::gltf::json::accessor::Type;
use ::gltf::json::mesh::{Primitive, Semantic};
use ::gltf::json::validation::Checked;
use ::gltf::json::{Index, Skin};
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
    pub weights: Arc<[f32]>,
    /// For each joint the matrix from mesh to world; none without a skin.
    pub joints: Option<Arc<[Mat4]>>,
}

impl Pose {
    /// Whether it leaves the mesh as it is.
    pub fn is_plain(&self) -> bool {
        *self == Self::default()
    }
}

/// The poses of all nodes. What many nodes have in common is there once.
pub struct Poses<'a> {
    document: &'a Document,
    buffers: &'a Buffers<'a>,
    /// Where the nodes of the scene are.
    places: BTreeMap<usize, DMat4>,
    weights: BTreeMap<usize, Arc<[f32]>>,
    skins: BTreeMap<usize, Arc<[Mat4]>>,
}

impl<'a> Poses<'a> {
    /// The poses of the scene's nodes.
    pub fn new(document: &'a Document, buffers: &'a Buffers<'a>, nodes: &[Placed]) -> Self {
        let places = nodes.iter().map(|placed| (placed.index, placed.to_world)).collect();
        Self { document, buffers, places, weights: BTreeMap::new(), skins: BTreeMap::new() }
    }

    /// The pose of the mesh of `placed`.
    ///
    /// # Errors
    /// [`Error::Malformed`](crate::base::Error::Malformed) for a skin or its matrices that are not there.
    pub fn of(&mut self, placed: &Placed) -> Result<Pose> {
        let is_zero = |weights: &[f32]| weights.iter().all(|&weight| weight == 0.0);
        let weights = match (&placed.node.weights, placed.node.mesh) {
            (Some(own), _) if is_zero(own) => Arc::default(),
            (Some(own), _) => own.as_slice().into(),
            (None, Some(mesh)) => {
                let given = self.document.root.meshes.get(mesh.value()).and_then(|mesh| mesh.weights.as_deref());
                let given = given.filter(|weights| !is_zero(weights)).unwrap_or_default();
                self.weights.entry(mesh.value()).or_insert_with(|| given.into()).clone()
            }
            (None, None) => Arc::default(),
        };
        let Some(skin) = placed.node.skin else { return Ok(Pose { weights, joints: None }) };
        if let Some(joints) = self.skins.get(&skin.value()) {
            return Ok(Pose { weights, joints: Some(joints.clone()) });
        }
        let joints: Arc<[Mat4]> = self.joints(skin, &placed.part())?.into();
        self.skins.insert(skin.value(), joints.clone());
        Ok(Pose { weights, joints: Some(joints) })
    }

    /// The matrices of a skin's joints.
    fn joints(&self, index: Index<Skin>, user: &str) -> Result<Vec<Mat4>> {
        let Self { document, buffers, places, .. } = self;
        let skin = document.item(&document.root.skins, "skins", index, user)?;
        let part = format!("skins[{}]", index.value());
        let inverses = match skin.inverse_bind_matrices {
            Some(accessor) => Some(Column::new(document, buffers, accessor, &part, &[Type::Mat4])?),
            None => None,
        };
        let mut joints = Vec::new();
        for (i, joint) in skin.joints.iter().enumerate() {
            let Some(to_world) = places.get(&joint.value()) else {
                return Err(document.malformed(part, format!("its joint nodes[{}] is not in the scene", joint.value())));
            };
            let inverse = match &inverses {
                Some(column) if i < column.count => Mat4::from_cols_array(&column.get::<16>(i)),
                _ => Mat4::IDENTITY,
            };
            joints.push((*to_world * inverse.as_dmat4()).as_mat4());
        }
        Ok(joints)
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
        for (target, &weight) in primitive.targets.iter().flatten().zip(pose.weights.iter()).filter(|(_, w)| **w != 0.0)
        {
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

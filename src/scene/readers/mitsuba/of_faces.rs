//! Shapes with several materials: those of an OBJ file's faces, by their names there (Mitsuba 0.5 and 0.6).

use crate::base::Result;
use crate::scene::readers::missing::is_absent;
use crate::scene::readers::{obj, path};

use super::Reader;
use super::element::Element;
use super::object::{Object, follow, kind};

/// Faces of a shape with one material.
pub struct Faces<'a> {
    /// The materials that they have in the file; none for all faces.
    pub of: Vec<String>,
    /// The material that is read for them.
    pub material: Option<&'a Element>,
}

impl<'a> Reader<'a> {
    /// The faces of a shape by the materials that are inside it. Each is for faces of its name; one without a name, or else grey, for those
    /// that have none.
    pub(super) fn faces(&mut self, object: &Object<'a>) -> Result<Vec<Faces<'a>>> {
        let given = self.given(object)?;
        let first = given.first().map(|(_, material)| *material);
        let all = || vec![Faces { of: Vec::new(), material: first }];
        let Some((_, second)) = given.get(1) else { return Ok(all()) };
        let names = self.names_of_faces(object)?;
        if !given.iter().any(|(name, _)| name.is_some_and(|name| is_in(&names, name))) {
            self.warn(second, "a second material of a shape: the first one is used everywhere");
            return Ok(all());
        }
        let (mut faces, mut left, mut unnamed) = (Vec::new(), names.clone(), None);
        for (name, material) in given {
            match name {
                Some(name) if is_in(&left, name) => {
                    left.retain(|other| other != name);
                    faces.push(Faces { of: vec![name.to_owned()], material: Some(material) });
                }
                Some(name) => {
                    let why =
                        if is_in(&names, name) { "these have another one already" } else { "there are no such faces" };
                    self.warn(material, format_args!("the material of faces of \"{name}\" is left out: {why}"));
                }
                None if unnamed.is_none() => unnamed = Some(material),
                None => self.warn(material, "a second material for the other faces is left out"),
            }
        }
        if !left.is_empty() {
            if unnamed.is_none() {
                let listed = left.join("\", \"");
                self.warn(object.element, format_args!("faces of \"{listed}\" have no material here: they are grey"));
            }
            faces.push(Faces { of: left, material: unnamed });
        }
        Ok(faces)
    }

    /// The materials inside a shape with the names that they are given there.
    fn given(&self, object: &Object<'a>) -> Result<Vec<(Option<&'a str>, &'a Element)>> {
        let mut given = Vec::new();
        for child in &object.element.children {
            let target = follow(child, &self.ids)?;
            if target.tag == "bsdf" {
                given.push((child.attribute("name"), target));
            }
        }
        Ok(given)
    }

    /// The materials of faces in a shape's file, if it is one that has some. Instances do not read it again.
    fn names_of_faces(&mut self, object: &Object<'a>) -> Result<Vec<String>> {
        if kind(object.element)? != "obj" {
            return Ok(Vec::new());
        }
        let file = self.located(object.required_string("filename")?);
        if is_absent(&self.folder, &file) {
            return Ok(Vec::new());
        }
        if let Some(names) = self.names_of_faces.get(&file) {
            return Ok(names.clone());
        }
        let names = obj::materials(&path::resolve(&self.folder, &file, &object.element.place)?)?;
        self.names_of_faces.insert(file, names.clone());
        Ok(names)
    }
}

fn is_in(names: &[String], name: &str) -> bool {
    names.iter().any(|other| other == name)
}

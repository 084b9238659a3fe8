//! Participating media.

use crate::base::Result;
use crate::scene::file::MediumFile;
use crate::scene::readers::spectrum::Use;

use super::Reader;
use super::element::Element;
use super::object::{Object, follow, kind};

impl<'a> Reader<'a> {
    /// The names of the media inside `element`, one for each of `roles`.
    pub(super) fn media<const N: usize>(
        &mut self,
        element: &'a Element,
        owner: &str,
        roles: [&str; N],
    ) -> Result<[Option<String>; N]> {
        let mut found = [const { None }; N];
        for child in &element.children {
            let medium = follow(child, &self.ids)?;
            if medium.tag != "medium" {
                continue;
            }
            let role = child.attribute("name").unwrap_or(roles[0]);
            let Some(index) = roles.iter().position(|known| *known == role) else {
                return Err(child.unsupported(format!("a medium named \"{role}\" here"), &roles));
            };
            if found[index].is_some() {
                return Err(child.malformed(format!("a second medium named \"{role}\"")));
            }
            let name = match medium.attribute("id") {
                Some(id) => id.to_owned(),
                None => self.free_name(&format!("{owner} {role}")),
            };
            self.add_medium(name.clone(), medium)?;
            found[index] = Some(name);
        }
        Ok(found)
    }

    /// Adds the medium under `name`, unless it is there already.
    fn add_medium(&mut self, name: String, element: &'a Element) -> Result<()> {
        if !self.file.media.contains_key(&name) {
            let medium = self.medium(element)?;
            self.places.set(format!("media.{name}"), element.place.clone());
            self.file.media.insert(name, medium);
        }
        Ok(())
    }

    fn medium(&self, element: &'a Element) -> Result<MediumFile> {
        if kind(element)? != "homogeneous" {
            return Err(element.unsupported(format!("medium \"{}\"", kind(element)?), &["homogeneous"]));
        }
        // Which emitters are sampled, and how channels are told apart, is the renderer's own affair.
        let known = ["albedo", "sigma_t", "sigma_a", "sigma_s", "scale", "sample_emitters", "has_spectral_extinction"];
        let object = Object::new(element, &self.ids, &known, &["phase"])?;
        let scale = object.float("scale")?.unwrap_or(1.0) as f32;
        let g = object.single("phase")?.map_or(Ok(0.0), |phase| self.phase(phase))?;
        let (mut sigma_t, albedo) =
            match (object.color_for("sigma_a", Use::Index)?, object.color_for("sigma_s", Use::Index)?) {
                (None, None) => (
                    object.color_for("sigma_t", Use::Index)?.unwrap_or([1.0; 3]),
                    object.color("albedo")?.unwrap_or([0.75; 3]),
                ),
                (absorption, scattering) => {
                    if object.property("sigma_t").is_some() || object.property("albedo").is_some() {
                        return Err(element.malformed("sigma_a, sigma_s and sigma_t, albedo exclude each other"));
                    }
                    let [a, s] = [absorption, scattering].map(|sigma| sigma.unwrap_or([0.0; 3]));
                    let albedo = |c: usize| if s[c] > 0.0 { s[c] / (a[c] + s[c]) } else { 0.0 };
                    ([a[0] + s[0], a[1] + s[1], a[2] + s[2]], [0, 1, 2].map(albedo))
                }
            };
        sigma_t.iter_mut().for_each(|sigma| *sigma *= scale);
        Ok(MediumFile::Homogeneous { sigma_t, albedo, g })
    }

    /// The mean cosine of a phase function.
    fn phase(&self, element: &'a Element) -> Result<f32> {
        match kind(element)? {
            "isotropic" => Object::new(element, &self.ids, &[], &[]).map(|_| 0.0),
            "hg" => Ok(Object::new(element, &self.ids, &["g"], &[])?.float("g")?.unwrap_or(0.8) as f32),
            other => Err(element.unsupported(format!("phase function \"{other}\""), &["isotropic", "hg"])),
        }
    }
}

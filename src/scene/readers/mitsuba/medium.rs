//! Participating media.

use crate::base::Result;
use crate::scene::file::{GridMediumFile, MediumFile};
use crate::scene::readers::measured::{MEASURED, Measured, extinction, measured};

use super::Reader;
use super::element::Element;
use super::object::{Object, follow, kind, refuse_slip_of_kind};

/// Which emitters are sampled, how channels are told apart and how steps are made is the renderer's own affair.
const PROPERTIES: [&str; 12] = [
    "albedo",
    "sigma_t",
    "sigma_a",
    "sigma_s",
    "scale",
    "material",
    "density",
    "sample_emitters",
    "has_spectral_extinction",
    "method",
    "step_size",
    "majorant_resolution_factor",
];

/// Mitsuba's unit of the coefficients of measured media, per mm.
const PER_UNIT: f32 = 100.0;

/// The measured medium of the property `material`.
fn preset(object: &Object) -> Result<&'static Measured> {
    let name = object.string("material")?.unwrap_or_default();
    let names = || MEASURED.iter().map(|medium| medium.name).collect::<Vec<_>>();
    let unknown = || object.element.unsupported(format!("the measured medium \"{name}\""), &names());
    measured(name).ok_or_else(unknown)
}

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
            // Where there can be only one, it may have any name.
            let role = child.attribute("name").filter(|_| N > 1).unwrap_or(roles[0]);
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

    fn medium(&mut self, element: &'a Element) -> Result<MediumFile> {
        let kind = kind(element)?;
        if kind != "homogeneous" {
            refuse_slip_of_kind(element, &["homogeneous", "heterogeneous"])?;
        }
        let object = Object::new(element, &self.ids, &PROPERTIES, &["phase"])?;
        if kind == "heterogeneous"
            && let Some(medium) = self.grid_medium(&object)?
        {
            return Ok(MediumFile::Grid(Box::new(medium)));
        }
        if kind != "homogeneous" {
            self.warn(
                element,
                format_args!("the medium \"{kind}\" is read as homogeneous: the mean of what varies is used"),
            );
        }
        let scale = object.float("scale")?.unwrap_or(1.0) as f32;
        let mut g = object.single("phase")?.map_or(Ok(None), |phase| self.phase(phase).map(Some))?;
        let density = if object.property("density").is_some() { "density" } else { "sigma_t" };
        let (mut sigma_t, albedo) = match [self.varying(&object, "sigma_a")?, self.varying(&object, "sigma_s")?] {
            [None, None] if object.property("material").is_some() => {
                let preset = preset(&object)?;
                g = g.or(Some(preset.mean_cosine()));
                extinction([preset.absorption, preset.scattering].map(|sigma| sigma.map(|x| PER_UNIT * x)))
            }
            [None, None] => {
                let albedo = self.varying(&object, "albedo")?.unwrap_or([0.75; 3]).map(|x| x.clamp(0.0, 1.0));
                (self.varying(&object, density)?.unwrap_or([1.0; 3]), albedo)
            }
            both => {
                if object.property("sigma_t").is_some() || object.property("albedo").is_some() {
                    return Err(element.malformed("sigma_a, sigma_s and sigma_t, albedo exclude each other"));
                }
                extinction(both.map(|sigma| sigma.unwrap_or([0.0; 3])))
            }
        };
        sigma_t.iter_mut().for_each(|sigma| *sigma *= scale);
        Ok(MediumFile::Homogeneous { sigma_t, albedo, g: g.unwrap_or(0.0) })
    }

    /// The medium whose density is a grid; none where it is anything else.
    fn grid_medium(&mut self, object: &Object<'a>) -> Result<Option<GridMediumFile>> {
        let others = ["sigma_a", "sigma_s", "material"].iter().any(|name| object.property(name).is_some());
        let name = if object.property("density").is_some() { "density" } else { "sigma_t" };
        let Some(density) = self.grid(object, name)?.filter(|_| !others) else { return Ok(None) };
        let albedo_grid = self.grid(object, "albedo")?;
        let albedo = match &albedo_grid {
            Some(_) => [1.0; 3],
            None => self.varying(object, "albedo")?.unwrap_or([0.75; 3]).map(|x| x.clamp(0.0, 1.0)),
        };
        let scale = object.float("scale")?.unwrap_or(1.0) as f32;
        let g = object.single("phase")?.map_or(Ok(0.0), |phase| self.phase(phase))?;
        let (emission, emission_grid) = ([0.0; 3], None);
        Ok(Some(GridMediumFile { density, sigma_t: [scale; 3], albedo, albedo_grid, g, emission, emission_grid }))
    }

    /// The mean cosine of a phase function.
    fn phase(&mut self, element: &'a Element) -> Result<f32> {
        match kind(element)? {
            "isotropic" => Object::new(element, &self.ids, &[], &[]).map(|_| 0.0),
            "hg" => Ok(Object::new(element, &self.ids, &["g"], &[])?.float("g")?.unwrap_or(0.8) as f32),
            other => {
                refuse_slip_of_kind(element, &["isotropic", "hg"])?;
                self.warn(element, format_args!("the phase function \"{other}\" is read as isotropic"));
                Ok(0.0)
            }
        }
    }
}

//! The directives of a document, one after another.

use std::path::Path;

use glam::DMat4;

use crate::base::{Error, Place, Result};
use crate::scene::readers::path;
use crate::scene::readers::slips::meant;

use super::Reader;
use super::parameters::Parameters;
use super::spaces::{self, ColorSpace};
use super::state::Block;
use super::tokens::{Token, Tokens};

/// Deepest nesting of blocks.
const MOST_BLOCKS: usize = 4096;

/// Every directive there is.
const DIRECTIVES: [&str; 44] = [
    "Accelerator",
    "ActiveTransform",
    "AreaLightSource",
    "Attribute",
    "AttributeBegin",
    "AttributeEnd",
    "Camera",
    "ColorSpace",
    "ConcatTransform",
    "CoordinateSystem",
    "CoordSysTransform",
    "Film",
    "Identity",
    "Import",
    "Include",
    "Integrator",
    "LightSource",
    "LookAt",
    "MakeNamedMaterial",
    "MakeNamedMedium",
    "Material",
    "MediumInterface",
    "NamedMaterial",
    "ObjectBegin",
    "ObjectEnd",
    "ObjectInstance",
    "Option",
    "PixelFilter",
    "Renderer",
    "ReverseOrientation",
    "Rotate",
    "Sampler",
    "Scale",
    "Shape",
    "SurfaceIntegrator",
    "Texture",
    "Transform",
    "TransformBegin",
    "TransformEnd",
    "TransformTimes",
    "Translate",
    "VolumeIntegrator",
    "WorldBegin",
    "WorldEnd",
];

impl Reader {
    /// Reads the document at `path`, which is named at `place`.
    pub(super) fn document(&mut self, path: &Path, place: &Place) -> Result<()> {
        let text = self.sources.open(path, place)?;
        let mut tokens = Tokens::new(path, &text);
        while let Some(token) = tokens.next()? {
            let Token::Word(word) = token else { return Err(tokens.malformed("expected a directive")) };
            if self.world[1] {
                self.warn(&tokens.place(), "what follows WorldEnd is left out");
                break;
            }
            self.directive(word, &mut tokens)?;
        }
        self.sources.close();
        Ok(())
    }

    fn directive(&mut self, word: &str, tokens: &mut Tokens) -> Result<()> {
        match word {
            "Identity" | "Translate" | "Scale" | "Rotate" | "LookAt" | "Transform" | "ConcatTransform"
            | "CoordSysTransform" => self.transform(word, tokens),
            "CoordinateSystem" => {
                let name = tokens.text("a coordinate system's name")?;
                self.systems.insert(name, self.state.transform);
                Ok(())
            }
            "ActiveTransform" => self.active_transform(tokens),
            "AttributeBegin" => self.begin(Block::Attribute, tokens),
            "TransformBegin" => self.begin(Block::Transform, tokens),
            "AttributeEnd" => self.end(Block::Attribute, tokens),
            "TransformEnd" => self.end(Block::Transform, tokens),
            "ObjectEnd" => {
                self.object = None;
                self.end(Block::Object, tokens)
            }
            "ObjectBegin" => self.begin_object(tokens),
            "ObjectInstance" => {
                let name = tokens.text("an object's name")?;
                if self.ahead { Ok(()) } else { self.instance(&name, &tokens.place()) }
            }
            "ReverseOrientation" => {
                self.state.reversed = !self.state.reversed;
                Ok(())
            }
            "ColorSpace" => self.color_space(tokens),
            "WorldBegin" => {
                self.world[0] = true;
                self.settle_filter()?;
                (self.state.transform, self.state.moves_start) = (DMat4::IDENTITY, true);
                self.systems.insert("world".to_owned(), DMat4::IDENTITY);
                Ok(())
            }
            "WorldEnd" => {
                self.world[1] = true;
                Ok(())
            }
            "Include" | "Import" => self.include(word == "Import", tokens),
            _ => self.with_parameters(word, tokens),
        }
    }

    /// A directive with a parameter list.
    fn with_parameters(&mut self, word: &str, tokens: &mut Tokens) -> Result<()> {
        let place = tokens.place();
        match word {
            _ if self.ahead && !["Texture", "Attribute", "MediumInterface"].contains(&word) => {
                self.skip_quietly(tokens)
            }
            "NamedMaterial" => {
                let name = tokens.text("a material's name")?;
                self.use_material(&name);
                // v3's scenes write parameters here that mean nothing.
                Parameters::read(tokens, String::new(), self.state.space).map(drop)
            }
            "MediumInterface" => self.medium_interface(tokens),
            "Option" | "TransformTimes" | "Renderer" => self.skip(word, tokens),
            "Attribute" => {
                let target = tokens.text("what the attribute is for")?;
                let list = self.parameters(format!("the attribute \"{target}\""), tokens)?.into_list();
                self.state.defaults.entry(target).or_default().extend(list);
                Ok(())
            }
            "Texture" => self.texture_directive(tokens),
            "MakeNamedMaterial" | "MakeNamedMedium" => {
                let name = tokens.text("a name")?;
                let mut parameters = self.parameters(format!("the {} \"{name}\"", &word[9..]), tokens)?;
                if word == "MakeNamedMedium" {
                    self.make_medium(name, &mut parameters)
                } else {
                    self.make_material(name, &parameters)
                }
            }
            _ => {
                let kinds = ["Shape", "Material", "LightSource", "AreaLightSource", "Camera", "Film", "PixelFilter"];
                let others = ["Sampler", "Integrator", "SurfaceIntegrator", "Accelerator", "VolumeIntegrator"];
                if !kinds.contains(&word) && !others.contains(&word) {
                    return Err(unknown(word, place));
                }
                let kind = tokens.text("a type")?;
                let mut parameters = self.parameters(format!("the {word} \"{kind}\""), tokens)?;
                self.object_of(word, &kind, &mut parameters)
            }
        }
    }

    /// What a directive with a type and parameters adds to the scene.
    fn object_of(&mut self, word: &str, kind: &str, parameters: &mut Parameters) -> Result<()> {
        let target = match word {
            "Shape" => "shape",
            "Material" => "material",
            "LightSource" | "AreaLightSource" => "light",
            _ => "",
        };
        if let Some(defaults) = self.state.defaults.get(target) {
            parameters.add_defaults(defaults);
        }
        match word {
            "Shape" => self.shape(kind, parameters)?,
            "Material" => self.material_directive(kind, parameters)?,
            "LightSource" => self.light(kind, parameters)?,
            "AreaLightSource" => self.area_light(kind, parameters)?,
            "Camera" => {
                self.set_camera(kind, parameters.clone());
                return Ok(());
            }
            "Film" => {
                self.film(kind, parameters)?;
                self.settle_filter()?;
            }
            "PixelFilter" => {
                self.pixel_filter = Some((kind.to_owned(), parameters.clone()));
                // Its defaults are those of the version, which the film tells.
                return if self.has_film { self.settle_filter() } else { Ok(()) };
            }
            "Sampler" => self.sampler(kind, parameters)?,
            "Integrator" | "SurfaceIntegrator" => self.integrator(kind, parameters)?,
            // How rays are traced does not change the picture.
            _ => return Ok(()),
        }
        self.note_unused(parameters);
        Ok(())
    }

    /// The parameters that follow; of an included file's last directive those behind its name, too.
    pub(super) fn parameters(&mut self, owner: String, tokens: &mut Tokens) -> Result<Parameters> {
        let mut parameters = Parameters::read(tokens, owner, self.state.space)?;
        if !self.trailing.is_empty() && tokens.peek()?.is_none() {
            parameters.extend(std::mem::take(&mut self.trailing));
        }
        Ok(parameters)
    }

    /// Reads the pixel filter that was given last.
    fn settle_filter(&mut self) -> Result<()> {
        let Some((kind, parameters)) = self.pixel_filter.take() else { return Ok(()) };
        self.filter(&kind, &parameters)?;
        self.note_unused(&parameters);
        Ok(())
    }

    /// Leaves out a directive with all that belongs to it.
    fn skip(&mut self, word: &str, tokens: &mut Tokens) -> Result<()> {
        self.warn(&tokens.place(), format!("{word} is left out"));
        self.skip_quietly(tokens)
    }

    fn skip_quietly(&self, tokens: &mut Tokens) -> Result<()> {
        while tokens.peek()?.is_some_and(|token| !matches!(token, Token::Word(word) if DIRECTIVES.contains(word))) {
            tokens.next()?;
        }
        Ok(())
    }

    fn begin(&mut self, block: Block, tokens: &Tokens) -> Result<()> {
        if self.blocks.len() >= MOST_BLOCKS {
            let (place, what) = (tokens.place(), "depth of blocks".to_owned());
            return Err(Error::Limit { place, what, value: MOST_BLOCKS as u64 + 1, limit: MOST_BLOCKS as u64 });
        }
        self.blocks.push((block, self.state.clone()));
        Ok(())
    }

    fn end(&mut self, block: Block, tokens: &Tokens) -> Result<()> {
        match self.blocks.pop() {
            Some((begun, before)) if begun == block => {
                let transform = (before.transform, before.moves_start);
                match block {
                    // In v4 it is another name of AttributeEnd.
                    Block::Transform if self.old => (self.state.transform, self.state.moves_start) = transform,
                    _ => self.state = before,
                }
                Ok(())
            }
            Some((begun, _)) => {
                Err(tokens.malformed(format!("{}End inside what {}Begin began", block.name(), begun.name())))
            }
            None => Err(tokens.malformed(format!("{0}End without {0}Begin", block.name()))),
        }
    }

    fn begin_object(&mut self, tokens: &mut Tokens) -> Result<()> {
        let name = tokens.text("an object's name")?;
        if let Some(outer) = &self.object {
            return Err(tokens.malformed(format!("an object inside the object \"{outer}\"")));
        }
        self.begin(Block::Object, tokens)?;
        // They may be of another object of that name.
        self.add_strands()?;
        self.objects.insert(name.clone(), Vec::new());
        self.object = Some(name);
        Ok(())
    }

    fn color_space(&mut self, tokens: &mut Tokens) -> Result<()> {
        let name = tokens.text("a colour space's name")?;
        let (place, what) = (tokens.place(), format!("the colour space \"{name}\""));
        let unknown = || Error::Unsupported { place, what, supported: spaces::NAMES.join(", ") };
        self.state.space = ColorSpace::named(&name).ok_or_else(unknown)?;
        Ok(())
    }

    fn include(&mut self, import: bool, tokens: &mut Tokens) -> Result<()> {
        let name = self.locate(&tokens.text("a file's name")?);
        let place = tokens.place();
        let path = path::resolve(&self.folder, &name, &place)?;
        let inner = Path::new(&name).parent().unwrap_or(Path::new("")).to_owned();
        let outer = std::mem::replace(&mut self.inner, inner);
        // One stream of words, to pbrt: what follows belongs to the last directive of the file.
        self.trailing.extend(Parameters::read(tokens, String::new(), self.state.space)?.into_list());
        let state = import.then(|| self.state.clone());
        self.document(&path, &place)?;
        if let Some(parameter) = self.trailing.first().filter(|_| !self.ahead) {
            return Err(parameter.malformed("parameters behind a file whose last directive takes none"));
        }
        self.trailing.clear();
        if let Some(state) = state {
            self.state = state;
        }
        self.inner = outer;
        Ok(())
    }
}

fn unknown(word: &str, place: Place) -> Error {
    if let Some(near) = meant(word, &DIRECTIVES) {
        return Error::malformed(place, format!("there is no directive {word}; {near} seems to be meant"));
    }
    let word: String = word.chars().take(40).collect();
    Error::Unsupported { place, what: format!("the directive {word}"), supported: DIRECTIVES.join(", ") }
}

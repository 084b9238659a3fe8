//! The onnxruntime backend: runs a model folder's `encode_step.onnx` and `decode_step.onnx`, or those inside the program.
//!
//! The shared library is loaded at run time. onnxruntime's sessions are not used from two threads at once: each step has a
//! lock, and onnxruntime itself spreads a step over threads.

use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use ort::environment::Environment;
use ort::session::{Session, SessionInputValue};
use ort::value::TensorRef;

use super::built_in;
use crate::base::files::read_bytes;
use crate::base::{Error, Result};
use crate::network::backend::{Backend, DecodeInputs, DecodeOutput, EncodeInputs};
use crate::network::batch::SLOTS;
use crate::network::config::{Config, VERSION};
use crate::network::program::GEOMETRY;
use crate::network::seal;
use crate::network::weights::{DECODE_FILE, ENCODE_FILE, Model};

/// Name of this backend in messages.
const NAME: &str = "onnx";
/// Environment variable that names the library; it takes precedence over the usual places.
pub const LIBRARY_VARIABLE: &str = "ORT_DYLIB_PATH";
/// Largest ONNX file, bytes.
const MODEL_LIMIT: u64 = 1 << 30;
/// Folders where systems keep shared libraries.
const FOLDERS: [&str; 6] = [
    "/usr/local/lib",
    "/usr/lib",
    "/usr/lib64",
    "/usr/lib/x86_64-linux-gnu",
    "/usr/lib/aarch64-linux-gnu",
    "/opt/homebrew/lib",
];

fn fail(message: String) -> Error {
    Error::Backend { backend: NAME, message }
}

/// A model's two steps in onnxruntime.
pub struct OnnxBackend {
    config: Config,
    encode: Mutex<Session>,
    decode: Mutex<Session>,
}

impl OnnxBackend {
    /// Loads a model folder with the library that [`LIBRARY_VARIABLE`] names, or else the first found beside the program or
    /// in the system's folders.
    ///
    /// # Errors
    /// [`Error::Backend`] if the library is missing, too old or refuses the model; [`Error::Model`] and [`Error::Malformed`]
    /// for the folder's content, also where a checksum is wrong.
    pub fn load(folder: &Path) -> Result<Self> {
        Self::load_with(folder, &library()?)
    }

    /// As [`OnnxBackend::load`] with the library at `library`. A process keeps the first library that it loaded.
    ///
    /// # Errors
    /// As [`OnnxBackend::load`].
    pub fn load_with(folder: &Path, library: &Path) -> Result<Self> {
        let model = Model::load(folder)?;
        let environment = environment(library)?;
        let step = |file: &str| {
            let path = folder.join(file);
            if !path.is_file() {
                let message = format!("{file} is missing; `fanal-training export` writes it");
                return Err(Error::Model { path: folder.to_owned(), message });
            }
            session(&environment, &model, &read_bytes(&path, MODEL_LIMIT)?, &path)
        };
        Ok(Self { encode: step(ENCODE_FILE)?, decode: step(DECODE_FILE)?, config: model.config })
    }

    /// The model that was compiled into the program, with the library that [`OnnxBackend::load`] would take.
    ///
    /// # Errors
    /// As [`OnnxBackend::load`].
    pub fn built_in() -> Result<Self> {
        Self::built_in_with(&library()?)
    }

    /// As [`OnnxBackend::built_in`] with the library at `library`.
    ///
    /// # Errors
    /// As [`OnnxBackend::load`].
    pub fn built_in_with(library: &Path) -> Result<Self> {
        let model = built_in::model()?;
        let environment = environment(library)?;
        let step =
            |bytes: &[u8], file: &str| session(&environment, &model, bytes, &Path::new(built_in::NAME).join(file));
        let (encode, decode) = (step(built_in::ENCODE, ENCODE_FILE)?, step(built_in::DECODE, DECODE_FILE)?);
        Ok(Self { encode, decode, config: model.config })
    }
}

/// A step of `model` from the content of its ONNX file; `path` is named in errors.
fn session(environment: &Environment, model: &Model, bytes: &[u8], path: &Path) -> Result<Mutex<Session>> {
    let fail = |e: ort::Error| Error::Model { path: path.to_owned(), message: format!("onnxruntime refuses it: {e}") };
    seal::check(path, bytes)?;
    let session = Session::builder(environment).and_then(|mut b| b.commit_from_memory(bytes)).map_err(fail)?;
    check_metadata(&session, model, path)?;
    Ok(Mutex::new(session))
}

/// The library that the user names, or else the first found.
fn library() -> Result<PathBuf> {
    match std::env::var_os(LIBRARY_VARIABLE).filter(|path| !path.is_empty()) {
        Some(path) => Ok(PathBuf::from(path)),
        None => find_library().ok_or_else(|| missing("no onnxruntime library was found".into())),
    }
}

/// onnxruntime's environment, of which it allows one per process; the first library that loads stays.
fn environment(library: &Path) -> Result<Environment> {
    static SHARED: Mutex<Option<Environment>> = Mutex::new(None);
    let library = std::path::absolute(library).map_err(|e| Error::io(library, e))?;
    if !library.is_file() {
        return Err(missing(format!("there is no library {}", library.display())));
    }
    // It is set only when complete, so a panic elsewhere cannot leave it broken.
    let mut shared = SHARED.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(environment) = &*shared {
        return Ok(environment.clone());
    }
    let builder = ort::init_from(&library).map_err(|e| missing(e.to_string()))?;
    let environment = builder.with_name("fanal").build().map_err(|e| fail(e.to_string()))?;
    Ok(shared.insert(environment).clone())
}

fn missing(problem: String) -> Error {
    let least = ort::MINOR_VERSION;
    fail(format!(
        "{problem}. Install the shared library of onnxruntime 1.{least} or newer (it is also in the Python package \
         `onnxruntime`, folder capi) and set {LIBRARY_VARIABLE} to its path, or use the embedded backend"
    ))
}

/// The first file named like the library beside the program or in the system's folders.
fn find_library() -> Option<PathBuf> {
    let name = format!("{}onnxruntime{}", std::env::consts::DLL_PREFIX, std::env::consts::DLL_SUFFIX);
    let beside = std::env::current_exe().ok().and_then(|exe| Some(exe.parent()?.to_owned()));
    let folders = beside.into_iter().chain(FOLDERS.map(PathBuf::from));
    folders.map(|folder| folder.join(&name)).find(|path| path.is_file())
}

/// The exported file must be of the configuration and the weights beside it.
fn check_metadata(session: &Session, Model { config, weights }: &Model, path: &Path) -> Result<()> {
    let metadata = session.metadata().map_err(|e| fail(e.to_string()))?;
    let expected = [
        ("version", VERSION.to_string()),
        ("width", config.width.to_string()),
        ("convolutions", config.convolutions.to_string()),
        ("features", config.features.to_string()),
        ("per_level", config.per_level.to_string()),
        ("weights", format!("{:08x}", weights.checksum())),
    ];
    for (key, value) in expected {
        let found = metadata.custom(key).unwrap_or_default();
        if found != value {
            let message = format!("its {key} is '{found}', the model's is {value}; export the model again");
            return Err(Error::Model { path: path.to_owned(), message });
        }
    }
    Ok(())
}

/// Runs a session; returns the outputs of these names, each of `rows` times its columns.
fn run(
    session: &Mutex<Session>,
    inputs: Vec<(&str, SessionInputValue)>,
    rows: usize,
    outputs: &[(&str, usize)],
) -> Result<Vec<Vec<f32>>> {
    // A panic in another thread leaves no half-written state behind: sessions hold weights only.
    let mut session = session.lock().unwrap_or_else(PoisonError::into_inner);
    let results = session.run(inputs).map_err(|e| fail(format!("onnxruntime failed: {e}")))?;
    let take = |&(name, columns): &(&str, usize)| {
        let value = results.get(name).ok_or_else(|| fail(format!("the model has no output {name}")))?;
        let (_, data) = value.try_extract_tensor::<f32>().map_err(|e| fail(format!("output {name}: {e}")))?;
        if data.len() != rows * columns {
            return Err(fail(format!("output {name} has {} values for {rows} rows of {columns}", data.len())));
        }
        Ok(data.to_vec())
    };
    outputs.iter().map(take).collect()
}

fn floats<'a>(rows: usize, data: &'a [f32], columns: usize) -> Result<SessionInputValue<'a>> {
    let tensor = TensorRef::from_array_view(([rows, columns], data)).map_err(|e| fail(e.to_string()))?;
    Ok(tensor.into())
}

fn indices(data: &[u32]) -> Vec<i64> {
    data.iter().map(|&row| i64::from(row)).collect()
}

fn integers<'a>(shape: &[usize], data: &'a [i64]) -> Result<SessionInputValue<'a>> {
    let tensor = TensorRef::from_array_view((shape.to_vec(), data)).map_err(|e| fail(e.to_string()))?;
    Ok(tensor.into())
}

impl Backend for OnnxBackend {
    fn name(&self) -> &'static str {
        NAME
    }

    fn encode(&self, level: usize, inputs: &EncodeInputs) -> Result<Vec<f32>> {
        let (n, width) = (inputs.rows, self.config.width);
        if n == 0 {
            return Ok(vec![]);
        }
        let (neighbours, level) = (indices(inputs.neighbours), [level as i64]);
        let mut values = vec![
            ("features", floats(n, inputs.features, self.config.features)?),
            ("pooled", floats(n, inputs.pooled, width)?),
            ("neighbours", integers(&[n, SLOTS], &neighbours)?),
        ];
        if self.config.per_level {
            values.push(("level", integers(&[], &level)?));
        }
        Ok(run(&self.encode, values, n, &[("encoded", width)])?.swap_remove(0))
    }

    fn decode(&self, level: usize, inputs: &DecodeInputs) -> Result<DecodeOutput> {
        let (n, width) = (inputs.rows, self.config.width);
        if n == 0 {
            return Ok(DecodeOutput::default());
        }
        let (parent_index, neighbours) = (indices(inputs.parent_index), indices(inputs.neighbours));
        let level = [level as i64];
        let mut values = vec![
            ("parents", floats(inputs.parents.len() / width, inputs.parents, width)?),
            ("parent_index", integers(&[n], &parent_index)?),
            ("skip", floats(n, inputs.skip, width)?),
            ("geometry", floats(n, inputs.geometry, GEOMETRY)?),
            ("base", floats(n, inputs.base, 1)?),
            ("neighbours", integers(&[n, SLOTS], &neighbours)?),
        ];
        if self.config.per_level {
            values.push(("level", integers(&[], &level)?));
        }
        let names = [("decoded", width), ("share_logit", 1), ("share", 1), ("leaf_logit", 1), ("leaf", 1)];
        let outputs = run(&self.decode, values, n, &names)?;
        match <[_; 5]>::try_from(outputs) {
            Ok([decoded, share_logit, share, leaf_logit, leaf]) => {
                Ok(DecodeOutput { decoded, share_logit, share, leaf_logit, leaf })
            }
            Err(_) => Err(fail("the decoder does not have five outputs".into())),
        }
    }
}

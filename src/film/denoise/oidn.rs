//! The part of Open Image Denoise's C API, version 2, that is needed, behind a device that is safe to use.
//!
//! Declared after its header `oidn.h`. The library stays loaded until the program ends: its threads outlive devices.

use std::error::Error as _;
use std::ffi::{CStr, OsStr, c_char, c_int, c_void};
use std::ptr::{null, null_mut};

use glam::Vec3;
use libloading::Library;

/// A device or a filter of the library.
type Handle = *mut c_void;

/// `OIDN_DEVICE_TYPE_CPU`: the only kind of device that reads and writes any memory of the program.
const CPU: c_int = 1;
/// `OIDN_FORMAT_FLOAT3`.
const FLOAT3: c_int = 3;

// What the library takes for three floats.
const _: () = assert!(size_of::<Vec3>() == 12 && align_of::<Vec3>() == 4);

/// Declares functions of the library, which are all looked up when it is loaded.
macro_rules! functions {
    ($($name:ident: $symbol:literal ($($argument:ty),*) $(-> $result:ty)?;)+) => {
        struct Functions {
            $($name: unsafe extern "C" fn($($argument),*) $(-> $result)?,)+
        }

        impl Functions {
            fn of(library: &Library) -> Result<Self, libloading::Error> {
                // SAFETY: functions of these names have these types in every version 2 of the library; what version 1 calls by one
                // of these names has the same type, and most of them it lacks.
                unsafe { Ok(Self { $($name: *library.get($symbol)?,)+ }) }
            }
        }
    };
}

functions! {
    new_device: "oidnNewDevice" (c_int) -> Handle;
    set_device_int: "oidnSetDeviceInt" (Handle, *const c_char, c_int);
    set_device_bool: "oidnSetDeviceBool" (Handle, *const c_char, bool);
    get_device_int: "oidnGetDeviceInt" (Handle, *const c_char) -> c_int;
    commit_device: "oidnCommitDevice" (Handle);
    release_device: "oidnReleaseDevice" (Handle);
    get_device_error: "oidnGetDeviceError" (Handle, *mut *const c_char) -> c_int;
    new_filter: "oidnNewFilter" (Handle, *const c_char) -> Handle;
    set_shared_filter_image: "oidnSetSharedFilterImage"
        (Handle, *const c_char, *mut c_void, c_int, usize, usize, usize, usize, usize);
    set_filter_bool: "oidnSetFilterBool" (Handle, *const c_char, bool);
    commit_filter: "oidnCommitFilter" (Handle);
    execute_filter: "oidnExecuteFilter" (Handle);
    release_filter: "oidnReleaseFilter" (Handle);
}

/// A device that computes on the processor. Not shared between threads.
pub struct Device {
    functions: Functions,
    /// Of a device that was committed and not released; never null.
    handle: Handle,
}

/// Why something could not be done, in the library's words or the system's.
pub type Failure = String;

impl Device {
    /// Loads the library at a path, or by a name that the system looks up, and makes a device with so many threads.
    pub fn load(library: &OsStr, threads: usize) -> Result<Self, Failure> {
        // SAFETY: what Open Image Denoise does when it is loaded asks for nothing; that the file is no other library is the user's
        // word.
        let library = unsafe { Library::new(library) }.map_err(|e| told(&e))?;
        let functions = Functions::of(&library).map_err(|e| format!("{} (it is not of version 2)", told(&e)))?;
        // The functions stay where they are only as long as the library is loaded.
        std::mem::forget(library);
        // SAFETY: the argument is a value of the enumeration.
        let handle = unsafe { (functions.new_device)(CPU) };
        if handle.is_null() {
            return Err(failure(&functions, handle).unwrap_or_else(|| "no device could be made".into()));
        }
        let device = Self { functions, handle };
        let threads = c_int::try_from(threads).unwrap_or(c_int::MAX);
        // SAFETY: the device is alive; names end in zero and are only read during the calls.
        unsafe {
            (device.functions.set_device_int)(handle, c"numThreads".as_ptr(), threads);
            // Else threads of the renderer could be bound to one core.
            (device.functions.set_device_bool)(handle, c"setAffinity".as_ptr(), false);
            (device.functions.commit_device)(handle);
        }
        device.failure().map_or(Ok(device), Err)
    }

    /// Version of the library, for example 20303 for 2.3.3.
    pub fn version(&self) -> u32 {
        // SAFETY: the device is alive; the name ends in zero and is only read during the call.
        let version = unsafe { (self.functions.get_device_int)(self.handle, c"version".as_ptr()) };
        u32::try_from(version).unwrap_or(0)
    }

    /// Runs the filter `RT` once over pictures of `width` columns and `height` rows: from the `inputs`, by their names, to `output`,
    /// with switches turned on.
    pub fn filter(
        &self,
        [width, height]: [usize; 2],
        inputs: &[(&CStr, &[Vec3])],
        switches: &[&CStr],
        output: &mut [Vec3],
    ) -> Result<(), Failure> {
        let pixels = width.checked_mul(height).filter(|&pixels| pixels > 0);
        let mut lengths = inputs.iter().map(|(_, pixels)| pixels.len()).chain([output.len()]);
        if lengths.any(|length| Some(length) != pixels) {
            return Err("the pictures differ in size".into());
        }
        let functions = &self.functions;
        // SAFETY: the device is alive; the name ends in zero and is only read during the call.
        let filter = unsafe { (functions.new_filter)(self.handle, c"RT".as_ptr()) };
        if filter.is_null() {
            return Err(self.failure().unwrap_or_else(|| "no filter could be made".into()));
        }
        let output: (&CStr, *mut Vec3) = (c"output", output.as_mut_ptr());
        // Inputs are only read, though the type says otherwise.
        let images = inputs.iter().map(|&(name, pixels)| (name, pixels.as_ptr().cast_mut())).chain([output]);
        for (name, pixels) in images {
            // SAFETY: the filter is alive. The pointer is to `width` · `height` times three floats, as checked above, without gaps,
            // which is what strides of zero say. They are borrowed until this function ends, and so the filter does before.
            unsafe {
                let set = functions.set_shared_filter_image;
                set(filter, name.as_ptr(), pixels.cast(), FLOAT3, width, height, 0, 0, 0);
            }
        }
        for switch in switches {
            // SAFETY: the filter is alive; the name ends in zero and is only read during the call.
            unsafe { (functions.set_filter_bool)(filter, switch.as_ptr(), true) };
        }
        // SAFETY: the filter is alive and not used after its release. Executing returns when all is written; a filter that could not
        // be committed is not executed but leaves an error.
        unsafe {
            (functions.commit_filter)(filter);
            (functions.execute_filter)(filter);
            (functions.release_filter)(filter);
        }
        self.failure().map_or(Ok(()), Err)
    }

    /// The first failure since this was last asked.
    fn failure(&self) -> Option<Failure> {
        failure(&self.functions, self.handle)
    }
}

/// What the system says of an error; that itself only says which of the system's functions failed.
fn told(error: &libloading::Error) -> Failure {
    error.source().map_or_else(|| error.to_string(), ToString::to_string)
}

/// The first failure of a device since this was last asked; with a null handle that of making one.
fn failure(functions: &Functions, device: Handle) -> Option<Failure> {
    let mut text = null::<c_char>();
    // SAFETY: the handle is null or of a device that is alive; `text` may be written during the call.
    let code = unsafe { (functions.get_device_error)(device, &raw mut text) };
    if code == 0 {
        return None;
    }
    // SAFETY: where there is an error the library gives its text, which ends in zero and stays until it is called again.
    let text = (!text.is_null()).then(|| unsafe { CStr::from_ptr(text) }.to_string_lossy().into_owned());
    Some(text.unwrap_or_else(|| format!("error {code}")))
}

impl Drop for Device {
    fn drop(&mut self) {
        let handle = std::mem::replace(&mut self.handle, null_mut());
        // SAFETY: the device is alive, is released only here, and has no filter left.
        unsafe { (self.functions.release_device)(handle) };
    }
}

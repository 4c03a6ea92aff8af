//! Open Image Denoise, loaded while the program runs, so that it is not needed to build or to start it: the few functions of its C
//! interface (version 2) that a picture takes.
//!
//! All that is unsafe about a foreign library is in this file, and no process but `candela denoise` uses it.

use libloading::Library;
use std::ffi::{CStr, c_char, c_int, c_void};
use std::path::Path;
use std::ptr::NonNull;

/// `OIDN_DEVICE_TYPE_CPU`.
const CPU: c_int = 1;
/// `OIDN_FORMAT_FLOAT3`.
const FLOAT3: c_int = 3;
/// Versions whose interface is the one below, as 10000 major + 100 minor + patch.
const VERSIONS: std::ops::Range<c_int> = 20_000..30_000;

type Handle = *mut c_void;

/// Writes the table of functions once: name, symbol, arguments, result.
macro_rules! functions {
    ($($name:ident = $symbol:literal, ($($argument:ty),*) $(-> $result:ty)?;)+) => {
        struct Functions {
            $($name: unsafe extern "C" fn($($argument),*) $(-> $result)?,)+
        }

        impl Functions {
            fn of(library: &Library) -> Result<Self, libloading::Error> {
                // SAFETY: the types are those of `oidn.h` of version 2, on which the library's name insists.
                Ok(unsafe { Self { $($name: *library.get($symbol)?,)+ } })
            }
        }
    };
}

functions! {
    new_device = b"oidnNewDevice\0", (c_int) -> Handle;
    release_device = b"oidnReleaseDevice\0", (Handle);
    set_device_bool = b"oidnSetDeviceBool\0", (Handle, *const c_char, bool);
    device_int = b"oidnGetDeviceInt\0", (Handle, *const c_char) -> c_int;
    device_error = b"oidnGetDeviceError\0", (Handle, *mut *const c_char) -> c_int;
    commit_device = b"oidnCommitDevice\0", (Handle);
    new_filter = b"oidnNewFilter\0", (Handle, *const c_char) -> Handle;
    release_filter = b"oidnReleaseFilter\0", (Handle);
    set_image = b"oidnSetSharedFilterImage\0", (Handle, *const c_char, *mut c_void, c_int, usize, usize, usize, usize, usize);
    set_filter_bool = b"oidnSetFilterBool\0", (Handle, *const c_char, bool);
    set_filter_int = b"oidnSetFilterInt\0", (Handle, *const c_char, c_int);
    commit_filter = b"oidnCommitFilter\0", (Handle);
    execute_filter = b"oidnExecuteFilter\0", (Handle);
}

/// A picture of three f32 a pixel, row by row.
pub type Plane = [[f32; 3]];

/// What a filter reads.
pub struct Inputs<'a> {
    /// Images by the library's names: `color`, `albedo`, `normal`.
    pub images: &'a [(&'static CStr, &'a Plane)],
    /// Pixels across.
    pub width: usize,
    /// Pixels down.
    pub height: usize,
    /// The guides are without noise.
    pub clean: bool,
    /// Memory that the filter should keep to, where it can.
    pub memory: u64,
}

/// The library with its device for processors.
pub struct Oidn {
    functions: Functions,
    device: NonNull<c_void>,
    /// Last, as fields are dropped in order: the functions lie in it.
    _library: Library,
}

impl Oidn {
    /// Loads the library, by its path or as the system finds it, and opens its device.
    ///
    /// # Errors
    /// There is none, it is another version, or it does not run on this processor.
    pub fn load(path: &Path) -> Result<Self, String> {
        // SAFETY: whoever names the file vouches for what it does as it is loaded; this process has nothing to lose.
        let library = unsafe { Library::new(path) }.map_err(|error| error.to_string())?;
        let functions = Functions::of(&library).map_err(|error| error.to_string())?;
        // SAFETY: has no preconditions.
        let device = NonNull::new(unsafe { (functions.new_device)(CPU) }).ok_or("it has no device for processors")?;
        let oidn = Self { functions, device, _library: library };
        // SAFETY: the device is open, the name a C string.
        unsafe {
            // Threads tied to cores would get in the way of those that render.
            (oidn.functions.set_device_bool)(oidn.device.as_ptr(), c"setAffinity".as_ptr(), false);
            (oidn.functions.commit_device)(oidn.device.as_ptr());
        }
        oidn.check()?;
        if VERSIONS.contains(&oidn.number()) {
            Ok(oidn)
        } else {
            Err(format!("version 2 is needed, and it is {}", oidn.version()))
        }
    }

    /// Its version in words.
    pub fn version(&self) -> String {
        let number = self.number();
        format!("{}.{}.{}", number / 10_000, number / 100 % 100, number % 100)
    }

    fn number(&self) -> c_int {
        // SAFETY: the device is open, the name a C string.
        unsafe { (self.functions.device_int)(self.device.as_ptr(), c"version".as_ptr()) }
    }

    /// What the filter for ray traced pictures makes of its inputs.
    ///
    /// # Errors
    /// An input is not of that size, or the library says why it failed.
    pub fn filter(&self, inputs: &Inputs<'_>) -> Result<Vec<[f32; 3]>, String> {
        let Inputs { images, width, height, clean, memory } = inputs;
        let pixels = width.checked_mul(*height).filter(|&pixels| images.iter().all(|(_, image)| image.len() == pixels));
        let mut output = vec![[0.0; 3]; pixels.ok_or("an image is of another size")?];
        let f = &self.functions;
        let megabytes = c_int::try_from(memory >> 20).unwrap_or(c_int::MAX);
        // SAFETY: device and filter are open, names are C strings, and all images have width x height pixels of three f32 without
        // gaps (checked above) and outlive the filter, which reads the inputs and writes the output alone.
        unsafe {
            let filter = (f.new_filter)(self.device.as_ptr(), c"RT".as_ptr());
            let image = |name: &CStr, data: *mut c_void| {
                (f.set_image)(filter, name.as_ptr(), data, FLOAT3, *width, *height, 0, 0, 0);
            };
            images.iter().for_each(|(name, plane)| image(name, plane.as_ptr().cast_mut().cast()));
            image(c"output", output.as_mut_ptr().cast());
            (f.set_filter_bool)(filter, c"hdr".as_ptr(), images.iter().any(|(name, _)| *name == c"color"));
            (f.set_filter_bool)(filter, c"cleanAux".as_ptr(), *clean);
            (f.set_filter_int)(filter, c"maxMemoryMB".as_ptr(), megabytes);
            (f.commit_filter)(filter);
            (f.execute_filter)(filter);
            (f.release_filter)(filter);
        }
        self.check().map(|()| output)
    }

    /// The first fault since it was last asked.
    fn check(&self) -> Result<(), String> {
        let mut message = std::ptr::null();
        // SAFETY: the device is open; the message is a C string until the next call, or null.
        let (code, text) = unsafe {
            let code = (self.functions.device_error)(self.device.as_ptr(), &raw mut message);
            (code, (!message.is_null()).then(|| CStr::from_ptr(message).to_string_lossy().into_owned()))
        };
        if code == 0 { Ok(()) } else { Err(text.unwrap_or_else(|| format!("error {code}"))) }
    }
}

impl Drop for Oidn {
    fn drop(&mut self) {
        // SAFETY: the device is open, and nobody has it after this.
        unsafe { (self.functions.release_device)(self.device.as_ptr()) }
    }
}

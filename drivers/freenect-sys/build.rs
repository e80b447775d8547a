//! Reads the system's `libfreenect.h`; without the feature `usb` there is nothing to do.

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    #[cfg(feature = "usb")]
    if let Err(missing) = interface::write() {
        println!("cargo::error={missing}");
    }
}

#[cfg(feature = "usb")]
mod interface {
    use std::path::{Path, PathBuf};

    /// pkg-config tells 0.5 for every 0.5.x.
    const AT_LEAST: &str = "0.5";

    /// What the second library of this name, the player of recorded frames, does not have. A program that refers to one of
    /// these does not start with it: every symbol is looked up at the start. So they are left out here, and whoever needs
    /// one asks the dynamic linker.
    const NOT_IN_EVERY_LIBRARY: &str = "freenect_(camera_to_world|copy_registration|destroy_registration|map_rgb_to_depth\
        |enabled_subdevices|list_device_attributes|free_device_attributes|get_ir_brightness|set_ir_brightness|set_flag\
        |set_depth_chunk_callback|set_video_chunk_callback|start_audio|stop_audio|set_audio_in_callback\
        |set_audio_out_callback|set_fw_address_nui|set_fw_address_k4w|set_led_alt|set_tilt_degs_alt)";

    /// Writes `bindings.rs`.
    pub(super) fn write() -> Result<(), String> {
        let found = pkg_config::Config::new().atleast_version(AT_LEAST).probe("libfreenect").map_err(|error| {
            let why = error.to_string().lines().next().unwrap_or_default().to_owned();
            format!(
                "the feature kinect-usb needs libfreenect {AT_LEAST} or newer and pkg-config: on Debian `apt-get install \
                 libfreenect-dev libclang-dev pkg-config` ({why})"
            )
        })?;
        let header = header(&found.include_paths);
        println!("cargo::rerun-if-changed={}", header.display());
        // bindgen panics when it finds no libclang: the one way it has to say so.
        let generated = std::panic::catch_unwind(|| generate(&header, &found.include_paths)).map_err(|_panic| {
            "the feature kinect-usb needs libclang to read libfreenect.h: on Debian `apt-get install libclang-dev`"
                .to_owned()
        })??;
        let out = std::env::var_os("OUT_DIR").ok_or("cargo names no OUT_DIR")?;
        generated.write_to_file(Path::new(&out).join("bindings.rs")).map_err(|error| format!("bindings.rs: {error}"))
    }

    /// Debian has the header directly in the include folder, other builds in a folder of its own.
    fn header(include_paths: &[PathBuf]) -> PathBuf {
        let folders = include_paths
            .iter()
            .map(PathBuf::as_path)
            .chain([Path::new("/usr/include"), Path::new("/usr/local/include")]);
        let candidates =
            folders.flat_map(|folder| [folder.join("libfreenect.h"), folder.join("libfreenect/libfreenect.h")]);
        candidates.into_iter().find(|path| path.is_file()).unwrap_or_else(|| PathBuf::from("libfreenect.h"))
    }

    fn generate(header: &Path, include_paths: &[PathBuf]) -> Result<bindgen::Bindings, String> {
        bindgen::Builder::default()
            .header(header.to_string_lossy())
            .clang_args(include_paths.iter().map(|folder| format!("-I{}", folder.display())))
            .allowlist_function("freenect_.*")
            .allowlist_type("freenect_.*")
            .allowlist_var("FREENECT_.*")
            .blocklist_function(NOT_IN_EVERY_LIBRARY)
            // libc's is the same and has the methods.
            .blocklist_type("timeval")
            .blocklist_type("__time_t")
            .blocklist_type("__suseconds_t")
            .layout_tests(true)
            .generate_comments(false)
            .rust_edition(bindgen::RustEdition::Edition2024)
            .formatter(bindgen::Formatter::None)
            .generate()
            .map_err(|error| format!("libfreenect.h cannot be read: {error}"))
    }
}

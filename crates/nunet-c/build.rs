//! Gives `libnunet.so` a SONAME, and the name that programs then load beside it in Cargo's target folder.

use std::path::Path;

/// Changes with every incompatible change of `nunet.h`.
const SONAME: &str = "libnunet.so.0";

fn main() {
    println!("cargo:rerun-if-changed=build.rs");
    println!("cargo:rustc-cdylib-link-arg=-Wl,-soname,{SONAME}");
    // Cargo writes `libnunet.so`; the loader looks for the SONAME. Installed copies get the link from
    // `install.sh`, programs linked with Cargo's folder need it there: in `target/PROFILE` and, for tests, in
    // `deps`.
    let profile =
        std::env::var_os("OUT_DIR").and_then(|out| Path::new(&out).ancestors().nth(3).map(Path::to_owned));
    for folder in profile.iter().flat_map(|profile| [profile.clone(), profile.join("deps")]) {
        // It may exist already. Where links cannot be made, only running from Cargo's folder does not work.
        let _ = std::os::unix::fs::symlink("libnunet.so", folder.join(SONAME));
    }
}

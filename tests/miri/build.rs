//! Tells the kernels that burn is not there.

fn main() {
    println!("cargo::rustc-check-cfg=cfg(kernels_alone)");
    println!("cargo::rustc-cfg=kernels_alone");
}

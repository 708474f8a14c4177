//! What a data set's episodes were made with, so far as it may change a bit of them: libraries, the drawing, the processor.

use serde::{Deserialize, Serialize};

/// A machine's share in what its episodes are. The same seed and the same of these give the same bytes.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MadeWith {
    /// MuJoCo's version.
    pub mujoco: String,
    /// What draws, with its vectors' width, and the version of OpenGL and Mesa.
    pub opengl: String,
    /// The C library, whose mathematics rounds as its version and the processor have it.
    pub libc: String,
    /// Architecture and extensions that numbers may depend on.
    pub cpu: String,
}

impl MadeWith {
    /// With the processor of this machine.
    #[must_use]
    pub fn here(mujoco: String, opengl: String, libc: String) -> Self {
        Self { mujoco, opengl, libc, cpu: cpu() }
    }
}

/// The architecture, then the extensions that this processor has.
#[must_use]
pub fn cpu() -> String {
    let mut words = vec![std::env::consts::ARCH];
    #[cfg(target_arch = "x86_64")]
    {
        let extensions = [
            ("avx2", is_x86_feature_detected!("avx2")),
            ("fma", is_x86_feature_detected!("fma")),
            ("avx512f", is_x86_feature_detected!("avx512f")),
            ("avx512bf16", is_x86_feature_detected!("avx512bf16")),
        ];
        words.extend(extensions.iter().filter(|(_, has)| *has).map(|(name, _)| *name));
    }
    words.join(" ")
}

/// Adds one to a manifest's list, which is sorted and has none twice.
pub(super) fn add(list: &mut Vec<MadeWith>, made_with: MadeWith) {
    if let Err(place) = list.binary_search(&made_with) {
        list.insert(place, made_with);
    }
}

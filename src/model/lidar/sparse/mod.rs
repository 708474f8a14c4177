//! Sparse 3D convolutions: active sites, rulebooks, layers, and the encoder they make.
//!
//! Axes are (z, y, x) everywhere; a kernel's offsets run in that order too, x fastest.

mod conv;
mod encoder;
mod pairs;
mod rulebooks;
mod sites;

pub use encoder::SparseEncoder;
pub use rulebooks::EncoderRulebooks;
pub use sites::Sites;

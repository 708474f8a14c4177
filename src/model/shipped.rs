//! Networks that are part of the program, by name; `models/<name>.md` is each one's card.

/// A trained network inside the program.
#[derive(Debug)]
pub struct Shipped {
    /// Its name in commands.
    pub name: &'static str,
    /// A checkpoint's bytes.
    pub checkpoint: &'static [u8],
}

/// All of them; a static, so that the weights are in the program once.
pub static SHIPPED: [Shipped; 1] =
    [Shipped { name: "small", checkpoint: include_bytes!("../../models/small.safetensors") }];

impl Shipped {
    /// The network with this name, if any.
    #[must_use]
    pub fn named(name: &str) -> Option<&'static Self> {
        SHIPPED.iter().find(|shipped| shipped.name == name)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::files::sha256_hex;
    use crate::model::checkpoint;
    use burn::tensor::Device;
    use std::path::Path;

    #[test]
    fn each_loads_and_is_smaller_than_eight_mebibytes() {
        for Shipped { name, checkpoint } in &SHIPPED {
            assert!(checkpoint.len() < 8 << 20, "{name}: {} bytes", checkpoint.len());
            let detector = checkpoint::unpack(checkpoint, Path::new(name), &Device::flex()).unwrap();
            assert!(detector.config().use_lidar && detector.config().use_camera);
        }
        assert!(Shipped::named("small").is_some() && Shipped::named("Small").is_none());
    }

    #[test]
    fn the_card_is_of_these_weights() {
        let card = include_str!("../../models/small.md");
        let hash = sha256_hex(Shipped::named("small").unwrap().checkpoint);
        assert!(card.contains(&hash), "`make results` rewrites the card; the file's hash is {hash}");
    }
}

//! How libraries name the weights of a Swin Transformer, and what harmzone calls them.
//!
//! | | torchvision | timm | Microsoft | mmdet |
//! |---|---|---|---|---|
//! | patches | `features.0.0`, `.0.2` | `patch_embed.proj`, `.norm` | as timm | `patch_embed.projection`, `.norm` |
//! | block b of stage s | `features.{2s+1}.b` | `layers.s.blocks.b` | as timm | `stages.s.blocks.b` |
//! | merging behind stage s | `features.{2s+2}` | `layers.{s+1}.downsample` | `layers.s.downsample` | `stages.s.downsample` |
//! | attention | `attn` | `attn` | `attn` | `attn.w_msa` |
//! | feed-forward | `mlp.0`, `mlp.3` | `mlp.fc1`, `mlp.fc2` | as timm | `ffn.layers.0.0`, `ffn.layers.1` |
//! | merged channels | by neighbour | by neighbour | by neighbour | by channel |
//!
//! By neighbour: upper left, lower left, upper right, lower right, each with all of its channels. By channel:
//! each channel's four neighbours row by row, as torch's `unfold` gives them.

use std::fmt;

use crate::model::config::N_STAGES;

/// The library whose names a file uses.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scheme {
    Torchvision,
    Timm,
    /// The original; its detection code numbers output norms by stage.
    Microsoft,
    Mmdet,
}

impl fmt::Display for Scheme {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Torchvision => "torchvision",
            Self::Timm => "timm",
            Self::Microsoft => "Microsoft",
            Self::Mmdet => "mmdet",
        })
    }
}

/// Recognises the names of a file and their prefix; `None` if the file holds no Swin Transformer.
pub(super) fn recognise<'a>(keys: impl Iterator<Item = &'a str> + Clone) -> Option<(Scheme, String)> {
    let marks = [
        ("patch_embed.projection.weight", Scheme::Mmdet),
        ("patch_embed.proj.weight", Scheme::Timm),
        ("features.0.0.weight", Scheme::Torchvision),
    ];
    let of_key = |key: &'a str| {
        marks.into_iter().find_map(|(mark, scheme)| {
            let prefix = key.strip_suffix(mark)?;
            (prefix.is_empty() || prefix.ends_with('.')).then_some((scheme, prefix))
        })
    };
    // A file may hold a second copy of the weights, averaged; the plain one has the shorter prefix.
    let (scheme, prefix) =
        keys.clone().filter_map(of_key).min_by_key(|&(_, prefix)| (prefix.len(), prefix))?;
    let merges_behind_first = keys
        .clone()
        .any(|key| key.strip_prefix(prefix).is_some_and(|key| key.starts_with("layers.0.downsample.")));
    let scheme = if scheme == Scheme::Timm && merges_behind_first { Scheme::Microsoft } else { scheme };
    Some((scheme, prefix.to_owned()))
}

/// Parts of a block: a library's text, and ours.
const BLOCK_PARTS: [(&str, &str); 9] = [
    ("attn.w_msa.", "attention."),
    ("attn.", "attention."),
    ("mlp.0.", "mlp.hidden."),
    ("mlp.fc1.", "mlp.hidden."),
    ("ffn.layers.0.0.", "mlp.hidden."),
    ("mlp.3.", "mlp.out."),
    ("mlp.fc2.", "mlp.out."),
    ("ffn.layers.1.", "mlp.out."),
    ("relative_position_bias_table", "bias_table"),
];

impl Scheme {
    /// Translates a library's key, without its prefix, to our name; an unknown key stays as it is. `None` for
    /// constants and parts of a classifier, which the backbone does not need.
    ///
    /// # Arguments
    /// - `out_stages`: stages whose output norms the backbone has
    pub(super) fn translate(self, key: &str, out_stages: &[usize]) -> Option<String> {
        // timm's feature extractor writes `layers_0` for `layers.0`.
        let key = if self == Self::Timm { key.replacen("layers_", "layers.", 1) } else { key.to_owned() };
        let is_constant = key.ends_with(".relative_position_index") || key.ends_with(".attn_mask");
        if is_constant || key.starts_with("norm.") || key.starts_with("head.") {
            return None;
        }
        if let Some((stage, parameter)) = output_norm(&key) {
            let place = out_stages.iter().position(|&out| out == stage)?;
            return Some(format!("norms.{place}.{parameter}"));
        }
        let place = self.places().find_map(|(theirs, ours)| Some(ours + key.strip_prefix(&theirs)?));
        let name = place.unwrap_or(key);
        Some(BLOCK_PARTS.iter().fold(name, |name, (theirs, ours)| name.replacen(theirs, ours, 1)))
    }

    /// How keys begin, and our names of the same places.
    fn places(self) -> impl Iterator<Item = (String, String)> {
        let [conv, norm] = match self {
            Self::Torchvision => ["features.0.0.", "features.0.2."],
            Self::Timm | Self::Microsoft => ["patch_embed.proj.", "patch_embed.norm."],
            Self::Mmdet => ["patch_embed.projection.", "patch_embed.norm."],
        };
        let blocks = (0..N_STAGES).map(move |stage| {
            let theirs = match self {
                Self::Torchvision => format!("features.{}.", 2 * stage + 1),
                Self::Timm | Self::Microsoft => format!("layers.{stage}.blocks."),
                Self::Mmdet => format!("stages.{stage}.blocks."),
            };
            (theirs, format!("stages.{stage}.blocks."))
        });
        let merges = (0..N_STAGES - 1).map(move |stage| {
            let theirs = match self {
                Self::Torchvision => format!("features.{}.", 2 * stage + 2),
                Self::Timm => format!("layers.{}.downsample.", stage + 1),
                Self::Microsoft => format!("layers.{stage}.downsample."),
                Self::Mmdet => format!("stages.{stage}.downsample."),
            };
            (theirs, format!("stages.{stage}.merge."))
        });
        let patch = [(conv, "patch.conv."), (norm, "patch.norm.")].map(|(a, b)| (a.to_owned(), b.to_owned()));
        patch.into_iter().chain(blocks).chain(merges)
    }
}

/// Stage and parameter of an output norm, as detectors have it behind each stage: `norm2.bias`.
fn output_norm(key: &str) -> Option<(usize, &str)> {
    let (stage, parameter) = key.strip_prefix("norm")?.split_once('.')?;
    Some((stage.parse().ok().filter(|&stage: &usize| stage < N_STAGES)?, parameter))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_library_s_names_lead_to_the_same_weight() {
        let bias = "stages.2.blocks.5.attention.bias_table";
        for (scheme, key, ours) in [
            (Scheme::Torchvision, "features.5.5.attn.relative_position_bias_table", bias),
            (Scheme::Timm, "layers.2.blocks.5.attn.relative_position_bias_table", bias),
            (Scheme::Timm, "layers_2.blocks.5.attn.relative_position_bias_table", bias),
            (Scheme::Mmdet, "stages.2.blocks.5.attn.w_msa.relative_position_bias_table", bias),
            (Scheme::Torchvision, "features.7.1.mlp.3.weight", "stages.3.blocks.1.mlp.out.weight"),
            (Scheme::Mmdet, "stages.3.blocks.1.ffn.layers.1.weight", "stages.3.blocks.1.mlp.out.weight"),
            (Scheme::Torchvision, "features.4.reduction.weight", "stages.1.merge.reduction.weight"),
            (Scheme::Timm, "layers.2.downsample.reduction.weight", "stages.1.merge.reduction.weight"),
            (Scheme::Microsoft, "layers.1.downsample.reduction.weight", "stages.1.merge.reduction.weight"),
            (Scheme::Mmdet, "norm2.bias", "norms.1.bias"),
        ] {
            assert_eq!(scheme.translate(key, &[1, 2, 3]).as_deref(), Some(ours), "{scheme}: {key}");
        }
    }

    #[test]
    fn classifiers_and_constants_are_not_needed_and_what_is_not_known_keeps_its_name() {
        let translate = |scheme: Scheme, key| scheme.translate(key, &[1, 2, 3]);
        for key in ["head.fc.weight", "norm.bias", "layers.0.blocks.1.attn_mask"] {
            assert_eq!(translate(Scheme::Timm, key), None, "{key}");
        }
        assert_eq!(translate(Scheme::Mmdet, "norm0.weight"), None, "stage 0 stays inside");
        for (scheme, key) in [
            (Scheme::Timm, "layers.4.blocks.0.norm1.weight"),
            (Scheme::Timm, "layers.0.downsample.norm.weight"),
            (Scheme::Timm, "absolute_pos_embed"),
            (Scheme::Mmdet, "norm4.weight"),
            (Scheme::Torchvision, "features.8.norm.weight"),
        ] {
            assert_eq!(translate(scheme, key).as_deref(), Some(key));
        }
    }

    #[test]
    fn the_shortest_prefix_counts() {
        let keys = [
            "ema.backbone.patch_embed.projection.weight",
            "backbone.patch_embed.projection.weight",
            "neck.x",
        ];
        assert_eq!(recognise(keys.into_iter()), Some((Scheme::Mmdet, "backbone.".into())));
        assert_eq!(recognise(["conv1.weight"].into_iter()), None);
    }
}

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

/// Whose names a file uses.
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

/// What a key of the backbone stands for.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Meaning {
    /// A weight, by harmzone's name with PyTorch's names of parameters.
    Weight(String),
    /// A constant or a part of a classifier, which the backbone does without.
    Unneeded,
    Unknown,
}

/// The names of a file and what stands before them in each key of the backbone; `None` if it holds no Swin.
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

impl Scheme {
    /// What a key stands for, its prefix removed.
    ///
    /// # Arguments
    /// - `out_stages`: stages whose output norms the backbone has
    pub(super) fn meaning(self, key: &str, out_stages: &[usize]) -> Meaning {
        // timm's feature extractor writes `layers_0` for `layers.0`.
        let key = if self == Self::Timm { key.replacen("layers_", "layers.", 1) } else { key.to_owned() };
        let parts: Vec<&str> = key.split('.').collect();
        let (Some((&parameter, module)), true) = (parts.split_last(), parts.len() > 1) else {
            return Meaning::Unknown;
        };
        if matches!(parameter, "relative_position_index" | "attn_mask")
            || matches!(module[0], "norm" | "head")
        {
            return Meaning::Unneeded;
        }
        if let Some(stage) = output_norm(module) {
            return match out_stages.iter().position(|&out| out == stage) {
                Some(at) => Meaning::Weight(format!("norms.{at}.{parameter}")),
                None => Meaning::Unneeded,
            };
        }
        let module = match self {
            Self::Torchvision => of_torchvision(module),
            Self::Timm => of_timm_or_microsoft(module, 1),
            Self::Microsoft => of_timm_or_microsoft(module, 0),
            Self::Mmdet => of_mmdet(module),
        };
        let parameter = match parameter {
            "relative_position_bias_table" => "bias_table",
            other => other,
        };
        module.map_or(Meaning::Unknown, |module| Meaning::Weight(format!("{module}.{parameter}")))
    }
}

/// A stage's index; the last `without` stages do not count.
fn stage_idx(text: &str, without: usize) -> Option<usize> {
    text.parse().ok().filter(|&stage| stage < N_STAGES - without)
}

fn block_part(stage: usize, block: &str, part: &[&str]) -> Option<String> {
    let part = match part {
        ["norm1"] => "norm1",
        ["norm2"] => "norm2",
        ["attn"] | ["attn", "w_msa"] => "attention",
        ["attn", "qkv"] | ["attn", "w_msa", "qkv"] => "attention.qkv",
        ["attn", "proj"] | ["attn", "w_msa", "proj"] => "attention.proj",
        ["mlp", "fc1" | "0"] | ["ffn", "layers", "0", "0"] => "mlp.hidden",
        ["mlp", "fc2" | "3"] | ["ffn", "layers", "1"] => "mlp.out",
        _ => return None,
    };
    Some(format!("stages.{stage}.blocks.{block}.{part}"))
}

fn merge_part(stage: usize, part: &[&str]) -> Option<String> {
    matches!(part, ["norm" | "reduction"]).then(|| format!("stages.{stage}.merge.{}", part[0]))
}

fn of_torchvision(module: &[&str]) -> Option<String> {
    match module {
        ["features", "0", "0"] => Some("patch.conv".into()),
        ["features", "0", "2"] => Some("patch.norm".into()),
        ["features", at, rest @ ..] => {
            let before = at.parse::<usize>().ok()?.checked_sub(1)?;
            match (before % 2, rest) {
                (0, [block, part @ ..]) if before / 2 < N_STAGES => block_part(before / 2, block, part),
                (1, part) if before / 2 + 1 < N_STAGES => merge_part(before / 2, part),
                _ => None,
            }
        }
        _ => None,
    }
}

/// `merging_at`: 1 where a stage begins with its merging, 0 where it ends with it.
fn of_timm_or_microsoft(module: &[&str], merging_at: usize) -> Option<String> {
    match module {
        ["patch_embed", "proj"] => Some("patch.conv".into()),
        ["patch_embed", "norm"] => Some("patch.norm".into()),
        ["layers", stage, "blocks", block, part @ ..] => block_part(stage_idx(stage, 0)?, block, part),
        ["layers", stage, "downsample", part @ ..] => {
            let behind =
                stage_idx(stage, 0)?.checked_sub(merging_at).filter(|&behind| behind + 1 < N_STAGES)?;
            merge_part(behind, part)
        }
        _ => None,
    }
}

fn of_mmdet(module: &[&str]) -> Option<String> {
    match module {
        ["patch_embed", "projection"] => Some("patch.conv".into()),
        ["patch_embed", "norm"] => Some("patch.norm".into()),
        ["stages", stage, "blocks", block, part @ ..] => block_part(stage_idx(stage, 0)?, block, part),
        ["stages", stage, "downsample", part @ ..] => merge_part(stage_idx(stage, 1)?, part),
        _ => None,
    }
}

/// Stage of an output norm, as detectors have it behind each stage.
fn output_norm(module: &[&str]) -> Option<usize> {
    let [norm] = module else { return None };
    stage_idx(norm.strip_prefix("norm")?, 0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn weight(name: &str) -> Meaning {
        Meaning::Weight(name.into())
    }

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
            assert_eq!(scheme.meaning(key, &[1, 2, 3]), weight(ours), "{scheme}: {key}");
        }
    }

    #[test]
    fn classifiers_and_constants_are_not_needed_and_the_rest_is_unknown() {
        for key in ["head.fc.weight", "norm.bias", "layers.0.blocks.1.attn_mask"] {
            assert_eq!(Scheme::Timm.meaning(key, &[1, 2, 3]), Meaning::Unneeded, "{key}");
        }
        for key in
            ["layers.4.blocks.0.norm1.weight", "layers.0.downsample.norm.weight", "absolute_pos_embed", "x.y"]
        {
            assert_eq!(Scheme::Timm.meaning(key, &[1, 2, 3]), Meaning::Unknown, "{key}");
        }
        assert_eq!(
            Scheme::Mmdet.meaning("norm0.weight", &[1, 2, 3]),
            Meaning::Unneeded,
            "stage 0 stays inside"
        );
        assert_eq!(Scheme::Mmdet.meaning("norm4.weight", &[1, 2, 3]), Meaning::Unknown);
        assert_eq!(Scheme::Torchvision.meaning("features.8.norm.weight", &[1, 2, 3]), Meaning::Unknown);
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

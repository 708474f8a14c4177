//! How the figures were made: commands and resolved configs.

use fs_err as fs;

use super::Side;
use crate::episode::LabelManifest;
use crate::report::document::Block;
use crate::report::provenance::Provenance;

/// The section's blocks.
pub fn blocks(sides: &[Side], command: &str) -> Vec<Block> {
    let mut blocks = vec![Block::heading("This page"), Block::code(command)];
    for side in sides {
        let scores = &side.scores;
        blocks.push(Block::heading(side.name));
        match &scores.provenance {
            Some(source) => {
                blocks.push(Block::code(&source.command));
                if source.version != env!("CARGO_PKG_VERSION") {
                    blocks.push(Block::text(format!("Scored by harmzone {}.", source.version)));
                }
                blocks.extend(hashes(source));
            }
            None => blocks.push(Block::absent(
                "where the scores come from is not known (source.json)",
                side.command_of_scores(),
            )),
        }
        let source = scores.provenance.as_ref();
        let mut configs = vec![
            ("Scoring, eval.toml", scores.config_toml.clone()),
            ("Detector", source.and_then(|source| source.model_toml.clone())),
            ("Training, train.toml", source.and_then(|source| source.train_toml.clone())),
        ];
        if let Ok(dataset) = &side.dataset {
            configs.push(("Data set, gen.toml", fs::read_to_string(dataset.path.join("gen.toml")).ok()));
            let labels = LabelManifest::read(&dataset.path, &dataset.labels).ok();
            configs.push(("Danger zone, zone.toml", labels.map(|labels| labels.zone_toml)));
        }
        for (title, text) in configs {
            if let Some(text) = text {
                blocks.push(Block::fold(title, vec![Block::code(text.trim_end())]));
            }
        }
    }
    blocks
}

/// SHA-256 of what was scored, as far as it is known.
fn hashes(source: &Provenance) -> Option<Block> {
    let mut lines: Vec<String> =
        source.checkpoint_sha256.iter().map(|hash| format!("network       {hash}")).collect();
    if let Some(of) = &source.fingerprint {
        lines.push(format!("dataset.json  {}", of.dataset_sha256));
        lines.push(format!("labels        {}", of.labels_sha256));
    }
    (!lines.is_empty()).then(|| Block::fold("Network and data, SHA-256", vec![Block::code(lines.join("\n"))]))
}

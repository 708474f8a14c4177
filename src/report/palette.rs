//! The pictures' colours: a dark, calm ground; one tone for each thing that must differ.

use super::canvas::Color;
use crate::object::Harm;
use crate::zone::ZoneKind;

pub const PAGE: Color = Color::new(0x0010_141b);
pub const PANEL: Color = Color::new(0x000b_0e13);
pub const WEDGE: Color = Color::new(0x0014_1a23);
pub const RING: Color = Color::new(0x002c_3747);
pub const TEXT: Color = Color::new(0x00ee_f2f7);
pub const TEXT_SOFT: Color = Color::new(0x0097_a5b8);
pub const ZONE: Color = Color::new(0x003d_dc84);
pub const EGO: Color = Color::new(0x00dd_e4ee);
/// Truth without labels.
pub const UNLABELLED: Color = Color::new(0x00b8_c2d0);

/// Truth: red harmful, blue harmless.
pub const fn truth(harm: Harm) -> Color {
    match harm {
        Harm::Harmful => Color::new(0x00ff_4d57),
        Harm::Harmless => Color::new(0x0054_a8ff),
    }
}

/// Tones of the zones where several are drawn, in their order; colour-blind people can tell them apart too.
const ZONES: [Color; 8] = [
    ZONE,
    Color::new(0x00ff_d84d),
    Color::new(0x00ff_7ad9),
    Color::new(0x0048_b8ff),
    Color::new(0x00ff_9a3d),
    Color::new(0x00b5_8cff),
    Color::new(0x0039_e0d0),
    Color::new(0x00d9_e7a0),
];

/// A zone's tone where several are drawn.
pub const fn zone(kind: ZoneKind) -> Color {
    ZONES[kind as usize % ZONES.len()]
}

/// Predictions: warmer and paler than the truth's tones, so that both are readable when they overlap. The drawings in
/// prediction files have them too.
pub const fn predicted(harm: Harm) -> Color {
    match harm {
        Harm::Harmful => Color::new(0x00ff_b938),
        Harm::Harmless => Color::new(0x00cb_b2ff),
    }
}

/// Colours of LiDAR heights, from the ground up to [`HEIGHT_RANGE_M`].
const HEIGHTS: [Color; 4] =
    [Color::new(0x0048_5c7a), Color::new(0x0055_92b5), Color::new(0x0087_c7b5), Color::new(0x00f3_e6a8)];

/// Heights above the ground between which the colour changes, metres.
pub const HEIGHT_RANGE_M: (f32, f32) = (0.0, 3.0);

/// Colour for a share of the height range, 0 to 1.
pub fn height(share: f32) -> Color {
    let at = share.clamp(0.0, 1.0) * (HEIGHTS.len() - 1) as f32;
    let i = (at as usize).min(HEIGHTS.len() - 2);
    HEIGHTS[i].mix(HEIGHTS[i + 1], at - i as f32)
}

#[cfg(test)]
mod tests {
    use foxglove::messages::SceneUpdate;
    use prost::Message as _;

    use super::*;
    use crate::episode::{DetectionWriter, ForeignFile, SampleDetections, SourceMeta};
    use crate::geometry::{Box3, Point};
    use crate::object::Detection;

    #[test]
    fn prediction_files_draw_boxes_in_the_tones_of_the_pictures() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("town.mcap");
        let meta = SourceMeta {
            episode: "town".into(),
            episode_sha256: "0".repeat(64),
            set: "made".into(),
            config_toml: String::new(),
            generator_version: "0.1.0".into(),
        };
        let center = Point::new(9.0, 0.0, 0.8);
        let detections = Harm::ALL.into_iter().map(|harm| Detection {
            box_in_ego: Box3 { center, length_m: 4.0, width_m: 2.0, height_m: 1.6, yaw_rad: 0.0 },
            velocity_in_ego_mps: [0.0; 2],
            harm,
            score: 0.5,
            spread: None,
        });
        let mut writer = DetectionWriter::create(&path, &meta).unwrap();
        writer.write(&SampleDetections { time_ns: 7, detections: detections.collect() }).unwrap();
        writer.finish().unwrap();
        let file = ForeignFile::open(&path).unwrap();
        let topic = file.topics().iter().find(|topic| topic.name == "/detections/markers").unwrap();
        let messages = file.chunk(0, &[topic.channel_id]).unwrap();
        let drawn = SceneUpdate::decode(messages[0].bytes.clone()).unwrap();
        assert_eq!(drawn.entities.len(), Harm::ALL.len());
        for (harm, entity) in Harm::ALL.into_iter().zip(&drawn.entities) {
            let color = entity.cubes[0].color.unwrap();
            let rgb = [color.r, color.g, color.b].map(|part| (255.0 * part).round() as u8);
            assert_eq!(rgb, predicted(harm).rgb, "{harm:?}");
        }
    }
}

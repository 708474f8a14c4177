//! The names of nuScenes' scenes by section. The devkit's evaluation and mmdetection3d's converter know no others.

/// A section of nuScenes. The first three are of `v1.0-trainval` and `v1.0-test`, the others of `v1.0-mini`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SceneSection {
    Train,
    Val,
    Test,
    MiniTrain,
    MiniVal,
}

impl SceneSection {
    /// The devkit's name of the section.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Train => "train",
            Self::Val => "val",
            Self::Test => "test",
            Self::MiniTrain => "mini_train",
            Self::MiniVal => "mini_val",
        }
    }
}

/// `utils/splits.py` of nuscenes-devkit 1.2.0 as ranges of numbers, without the scenes for which its CAN bus reader knows no
/// messages (161 to 168, 170 to 176, 309 to 314).
const NUMBERS: &str = include_str!("scene_names.txt");

/// The names of a section's scenes, in order: `scene-0001`, ...
#[must_use]
pub fn scene_names(section: SceneSection) -> Vec<String> {
    let line = NUMBERS.lines().find_map(|line| line.strip_prefix(section.name())?.strip_prefix(": "));
    let number = |text: &str| text.parse::<u32>().expect("the shipped list holds numbers");
    let ranges = line.expect("the shipped list has every section").split(' ');
    let numbers = ranges.flat_map(|range| match range.split_once('-') {
        Some((first, last)) => number(first)..=number(last),
        None => number(range)..=number(range),
    });
    numbers.map(|number| format!("scene-{number:04}")).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sections_have_the_devkits_sizes_but_for_scenes_without_can_bus() {
        let n = |section| scene_names(section).len();
        assert_eq!([n(SceneSection::Train), n(SceneSection::Val), n(SceneSection::Test)], [685, 150, 144]);
        assert_eq!(scene_names(SceneSection::MiniVal), ["scene-0103", "scene-0916"]);
        assert_eq!(scene_names(SceneSection::MiniTrain)[0], "scene-0061");
        assert_eq!(n(SceneSection::MiniTrain), 8);
    }
}
